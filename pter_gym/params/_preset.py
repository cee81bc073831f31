"""Numbers for everything that the paper does not print, read from a human-readable TOML file.

Every number in the file has its unit and source. ``PRESET`` is the shipped set; ``pter fit`` writes such files.
"""

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

from pter_gym._internal.files import FilePath, find_path
from pter_gym._internal.reading import MOST_TOML, parse_toml, read_text, reading
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.params._connection import PAPER_CLUTCHES, SLOTS, Connection
from pter_gym.params._fields import check_number, quantity

KINDS = ("published", "derived", "fitted", "identified", "chosen")
"""First words of a provenance."""

Value = float | tuple[float, ...]


def number(unit: str, *, default: Any = MISSING, **bounds: float) -> Any:
    """Declare a number of a preset file: its unit, its bounds (see ``check_number``), and its default if any."""
    return field(metadata={"unit": unit, "bounds": bounds}, default=default)


@dataclass(frozen=True, kw_only=True)
class ArmValues:
    """Links: M12 is the coupling times cos(θA − θB) (paper Eqs. 3 and 4); friction of the axes against the base."""

    length_a: float = number("m", above=0.0)
    length_b: float = number("m", above=0.0)
    inertia_a: float = number("kg·m²", above=0.0)
    inertia_b: float = number("kg·m²", above=0.0)
    coupling: float = number("kg·m²")
    dry_a: float = number("N·m", at_least=0.0, default=0.0)
    dry_b: float = number("N·m", at_least=0.0, default=0.0)
    viscous_a: float = number("N·m·s", at_least=0.0, default=0.0)
    viscous_b: float = number("N·m·s", at_least=0.0, default=0.0)


@dataclass(frozen=True, kw_only=True)
class ClutchValues:
    """The present clutches: dynamic torque slope·v + curvature·max(v − knee, 0)²; breakaway is a multiple of it."""

    slope: float = number("N·m/V", above=0.0)
    knee: float = number("V", at_least=0.0)
    curvature: float = number("N·m/V²")
    breakaway_ratio: float = number("1", above=0.0)
    time_constant: float = number("s", above=0.0)
    voltage_max: float = number("V", above=0.0)
    scale: tuple[float, ...] = number("1", at_least=0.0)


@dataclass(frozen=True, kw_only=True)
class DelrinValues:
    """Delrin as measured on the testbed, and what the published coefficients scale (paper section IV-B.2)."""

    dynamic_scale: float = number("1", above=0.0)
    breakaway_ratio: float = number("1", above=0.0)
    mu_dynamic_present: float = number("1", above=0.0)


@dataclass(frozen=True, kw_only=True)
class PathValues:
    """The straight path of the standard test: its start from the axis of the drive, its direction and length."""

    x: float = number("m")
    y: float = number("m")
    direction: float = number("rad")
    length: float = number("m", above=0.0)


@dataclass(frozen=True, kw_only=True)
class HandValues:
    """The hand of the standard test: a constant push along the path, and Fmax of Eq. 5 across it."""

    push: float = number("N")
    force_max: float = number("N", at_least=0.0)


@dataclass(frozen=True, kw_only=True)
class ControllerValues:
    """Spring and dampers at the tip, knots of the torque table, and the gain of the torque loop."""

    stiffness: float = number("N/m", at_least=0.0)
    damping_normal: float = number("N·s/m", at_least=0.0)
    damping_tangential: float = number("N·s/m", at_least=0.0)
    slip_threshold: float = number("rad/s", at_least=0.0)
    table_volts: tuple[float, ...] = number("V", at_least=0.0)
    feedback: float = number("V/(N·m)", at_least=0.0)


@dataclass(frozen=True, kw_only=True)
class SensingValues:
    """The time from a voltage to the motion that it makes, as a computer sees both."""

    delay: float = number("s", at_least=0.0)


@dataclass(frozen=True, kw_only=True)
class Preset:
    """A complete set of numbers in SI.

    Attributes
    ----------
    arm, clutch, delrin, path, hand, controller, sensing
        The sections of the file.
    clutches
        What each clutch connects; the paper's four if a file has no section ``clutches``.
    provenance
        Where each number comes from, by section and field: ``preset.provenance["arm.length_a"]``.
    """

    arm: ArmValues
    clutch: ClutchValues
    delrin: DelrinValues
    path: PathValues
    hand: HandValues
    controller: ControllerValues
    sensing: SensingValues
    provenance: Mapping[str, str]
    clutches: tuple[Connection, ...] = PAPER_CLUTCHES


SECTIONS: Mapping[str, type[Any]] = MappingProxyType(
    {
        "arm": ArmValues,
        "clutch": ClutchValues,
        "delrin": DelrinValues,
        "path": PathValues,
        "hand": HandValues,
        "controller": ControllerValues,
        "sensing": SensingValues,
    }
)
"""The sections of a preset file, in their order."""

CLUTCHES = "clutches"
"""The section after them, of machines with other clutches than the paper's: the row of W of each clutch by its name."""

ROW = number("1")


def load_preset(path: FilePath) -> Preset:
    """Read a preset file.

    Raises
    ------
    ParameterError
        If the file cannot be read.
    DataError
        If it is not TOML, or a section or field is unknown, missing, not a finite number, out of range, in another
        unit, or without a provenance.
    """
    file = find_path("path", path)
    try:
        text = read_text(file, MOST_TOML)
    except (OSError, ValueError) as error:
        raise ParameterError(f"preset {path} cannot be read: {error}") from None
    with reading(f"preset {path}"):
        return parse_preset(text)


def parse_preset(text: str) -> Preset:
    """Return the preset in a TOML text; it raises a ParameterError where ``load_preset`` raises a DataError."""
    try:
        tables = parse_toml(text)
    except ValueError as error:
        raise ParameterError(f"it is not TOML: {error}") from None
    _check_names(tables, (*SECTIONS, CLUTCHES), "section", {CLUTCHES})
    provenance: dict[str, str] = {}
    sections = {name: _section(kind, name, tables[name], provenance) for name, kind in SECTIONS.items()}
    if CLUTCHES in tables:
        sections[CLUTCHES] = _clutches(tables[CLUTCHES], sections["clutch"], provenance)
    return Preset(**sections, provenance=MappingProxyType(provenance))


def format_preset(preset: Preset, title: str) -> str:
    """Return the TOML text of a preset, which ``parse_preset`` reads back to the same numbers.

    Parameters
    ----------
    preset
        What to write.
    title
        Heading lines, which become comments.
    """
    return "\n".join(_lines(preset, title)) + "\n"


def _lines(preset: Preset, title: str) -> Iterator[str]:
    yield from (f"# {line}".rstrip() for line in title.splitlines())
    for name, kind in SECTIONS.items():
        yield ""
        yield f"# {(kind.__doc__ or '').strip()}"
        yield f"[{name}]"
        for item in fields(kind):
            value, origin = getattr(getattr(preset, name), item.name), preset.provenance[f"{name}.{item.name}"]
            yield _line(item.name, value, item.metadata["unit"], origin)
    if preset.clutches != PAPER_CLUTCHES or any(where.startswith(f"{CLUTCHES}.") for where in preset.provenance):
        yield ""
        yield "# What each clutch connects: its row (a, b) of W. It slips at a·ω_A + b·ω_B."
        yield f"[{CLUTCHES}]"
        for each in preset.clutches:
            name, origin = json.dumps(each.name, ensure_ascii=False), preset.provenance[f"{CLUTCHES}.{each.name}"]
            yield _line(name, each.row, ROW.metadata["unit"], origin)


def _line(name: str, value: Value, unit: str, origin: str) -> str:
    written = repr(list(value)) if isinstance(value, tuple) else repr(value)
    return f'{name} = {{ value = {written}, unit = "{unit}", from = "{origin}" }}'


def _check_names(
    found: Mapping[str, object], known: Collection[str], what: str, optional: Collection[str] = ()
) -> None:
    """Raise a ParameterError unless the names that are found are the known ones; some may be missing."""
    for name in found:
        if name not in known:
            raise ParameterError(f"unknown {what} {name!r}: {unknown_name(what, name, known)}")
    for name in known:
        if name not in found and name not in optional:
            raise ParameterError(f"{what} {name!r} is missing")


def _section(kind: type[Any], section: str, table: object, provenance: dict[str, str]) -> Any:
    if not isinstance(table, dict):
        raise ParameterError(f"{section} must be a table")
    items: dict[str, Field[Any]] = {item.name: item for item in fields(kind)}
    entries = cast(dict[str, object], table)
    optional = {name for name, item in items.items() if item.default is not MISSING}
    _check_names(entries, items, f"field of {section}", optional)
    values: dict[str, Value] = {}
    for name, item in items.items():
        where = f"{section}.{name}"
        if name in entries:
            values[name], provenance[where] = _entry(item, entries[name], where)
        else:
            values[name], provenance[where] = cast("Value", item.default), "chosen: not in the file"
    return kind(**values)


def _clutches(table: object, clutch: ClutchValues, provenance: dict[str, str]) -> tuple[Connection, ...]:
    """Return what the clutches connect, checking that there is a scale for each."""
    if not isinstance(table, dict) or not 0 < len(cast("dict[str, object]", table)) <= SLOTS:
        raise ParameterError(f"{CLUTCHES} must be a table of 1 to {SLOTS} clutches, got {table!r:.200}")
    found: list[Connection] = []
    for name, entry in cast("dict[str, object]", table).items():
        where = f"{CLUTCHES}.{name}"
        row, provenance[where] = _entry(ROW, entry, where)
        found.append(Connection(name, cast("tuple[float, float]", row)))
    if len(clutch.scale) != len(found):
        raise ParameterError(f"clutch.scale must be {len(found)} numbers, one for each clutch, got {clutch.scale!r}")
    return tuple(found)


def _entry(item: "Field[Any]", entry: object, where: str) -> tuple[Value, str]:
    """Return value and provenance of a field."""
    if not isinstance(entry, dict):
        raise ParameterError(f"{where} must be a table with value, unit and from")
    entry = cast("dict[str, object]", entry)
    _check_names(entry, ("value", "unit", "from"), f"entry of {where}")
    if entry["unit"] != item.metadata["unit"]:
        raise ParameterError(f"{where}.unit must be {item.metadata['unit']!r}, got {entry['unit']!r}")
    return _value(item, entry["value"], where), _origin(entry["from"], where)


def _origin(value: object, where: str) -> str:
    if not isinstance(value, str) or value.split(":")[0] not in KINDS:
        raise ParameterError(f"{where}.from must begin with one of {', '.join(KINDS)}, got {value!r}")
    if not value.isprintable() or '"' in value or "\\" in value:
        raise ParameterError(f"{where}.from must be one line without quotes and backslashes, got {value!r}")
    return value


def _value(item: "Field[Any]", value: object, where: str) -> Value:
    if item.type is float:
        return _number(item, value, where)
    if not isinstance(value, list):
        raise ParameterError(f"{where} must be a list of numbers, got {value!r}")
    return tuple(_number(item, entry, where) for entry in cast("list[object]", value))


def _number(item: "Field[Any]", value: object, where: str) -> float:
    check_number(where, value, **item.metadata["bounds"])
    return float(cast("float", value))


PRESET = load_preset(Path(__file__).parents[1] / "presets" / "pter.toml")
"""The set of numbers that the package ships."""


def preset(section: str, name: str) -> Any:
    """Declare a field with unit, provenance and value from the preset that the package ships."""
    values = getattr(PRESET, section)
    unit = next(item.metadata["unit"] for item in fields(values) if item.name == name)
    return quantity(unit, PRESET.provenance[f"{section}.{name}"], default=getattr(values, name))
