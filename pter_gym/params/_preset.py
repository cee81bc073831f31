"""A machine, and the numbers of the paper's standard test, in a human-readable TOML file.

Every number in the file has its unit and source. ``PRESET`` is the shipped file; ``pter identify``
and ``save_preset`` write others.
"""

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, cast

from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym._internal.reading import MAX_TOML_SIZE, parse_toml, read_text, reading
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.params._connection import PAPER_CLUTCHES, SLOTS, Connection
from pter_gym.params._fields import SHIPPED, check_number, require
from pter_gym.params._machine import Arm, Clutch, Machine, TorqueCurve

ORIGINS = ("published", "derived", "fitted", "identified", "chosen")
"""First words of a provenance."""

SECTIONS = {
    "arm": "Links: M12 is the coupling times cos(θA − θB) (paper Eqs. 3 and 4); friction of the axes against the base.",
    "clutch": "The clutches: dynamic torque slope·v + curvature·max(v − knee, 0)²; breakaway is a multiple of it.",
    "delrin": "Delrin as measured on the testbed, and what the published coefficients scale (paper section IV-B.2).",
    "path": "The straight path of the standard test: its start from the axis of the drive, its direction and length.",
    "hand": "The hand of the standard test: a constant push along the path, and Fmax of Eq. 5 across it.",
    "controller": "Spring and dampers at the tip, knots of the torque table, and the gain of the torque loop.",
    "sensing": "The time from a voltage to the motion that it makes, as a computer sees both.",
    "runs": "The standard test: torques in the controller's table over the real ones, and the largest time constant.",
}
"""The sections of a preset file in their order, and their headings."""

OPTIONAL_SECTIONS = ("delrin", "path", "hand", "controller", "runs")
"""Sections that a file may leave out."""

Value = float | tuple[float, ...]
Section = Mapping[str, Any]

CLUTCHES = "clutches"
"""The section after them, of machines with other clutches than the paper's: the row of W of each clutch by its name."""

TERMS = {
    item.name: {
        "value": item.default,
        "unit": item.metadata["unit"],
        "from": item.metadata["provenance"],
    }
    for owner in (TorqueCurve, Clutch)
    for item in fields(owner)
    if item.metadata["later"]
}
"""Fields of the section ``clutch`` for what the paper's clutches do not have."""

KNOWN: Mapping[str, Section] = {
    name: SHIPPED[name] | (TERMS if name == "clutch" else {}) for name in SECTIONS
}
"""The fields of each section with unit and usual value."""

OPTIONAL = ("dry_a", "dry_b", "viscous_a", "viscous_b", *TERMS)
"""Fields that a file may leave out."""

LEFT_OUT = "chosen: not in the file"
"""Provenance of what a file leaves out: its value is the usual one."""


@dataclass(frozen=True, kw_only=True)
class Preset:
    """A complete set of numbers in SI: the sections of a file by field, and where each number comes
    from.

    Attributes
    ----------
    arm, clutch, sensing
        Of a machine: fields of ``Arm``; the curve of dynamic torque, T_s/T_k, each clutch's torques
        over those of the curve, and other fields of ``Clutch``; a delay [s].
    delrin, path, hand, controller, runs
        Of the paper's standard test.
    clutches
        What each clutch connects; the paper's four if a file has no section ``clutches``.
    provenance
        Where each number comes from, by section and field: ``preset.provenance["arm.length_a"]``.
    """

    arm: Section
    clutch: Section
    delrin: Section
    path: Section
    hand: Section
    controller: Section
    sensing: Section
    runs: Section
    provenance: Mapping[str, str]
    clutches: tuple[Connection, ...] = PAPER_CLUTCHES

    def __post_init__(self) -> None:
        """Check the machine."""
        machine_of(self)


def is_preset(machine: object) -> bool:
    """Return whether a machine is given by the path of a preset."""
    return isinstance(machine, str) and machine.endswith(".toml")


def load_preset(path: FilePath) -> Preset:
    """Read a preset file.

    Raises
    ------
    ParameterError
        If the file cannot be read.
    DataError
        If it is not TOML, or a section or field is unknown, missing, not a finite number, out of
        range, in another unit, or without a provenance.
    """
    file = find_path("path", path)
    try:
        text = read_text(file, MAX_TOML_SIZE)
    except (OSError, ValueError) as error:
        raise ParameterError(f"preset {path} cannot be read: {error}") from None
    with reading(f"preset {path}"):
        return parse_preset(text)


def parse_preset(text: str) -> Preset:
    """Return the preset in a TOML text; it raises a ValueError where ``load_preset`` raises a DataError."""
    tables = parse_toml(text)
    _check_names("section", tables, (*SECTIONS, CLUTCHES), {CLUTCHES, *OPTIONAL_SECTIONS})
    provenance = {f"{name}.{each}": LEFT_OUT for name, known in KNOWN.items() for each in known}
    sections: dict[str, Any] = {
        name: {each: _usual(name, each) for each in known} for name, known in KNOWN.items()
    }
    for name in [each for each in SECTIONS if each in tables]:
        _check_names(f"field of {name}", tables[name], KNOWN[name], OPTIONAL)
        sections[name] |= {
            each: _value(name, each, entry, provenance) for each, entry in tables[name].items()
        }
    if CLUTCHES in tables:
        _check_names(CLUTCHES, tables[CLUTCHES], tables[CLUTCHES], ())
        rows: Any = {
            each: _value(CLUTCHES, each, entry, provenance)
            for each, entry in tables[CLUTCHES].items()
        }
        if not 0 < len(rows) <= SLOTS or len(sections["clutch"]["scale"]) != len(rows):
            raise ParameterError(
                f"{CLUTCHES} and clutch.scale must be of 1 to {SLOTS} clutches, equally many"
            )
        sections[CLUTCHES] = tuple(Connection(name, row) for name, row in rows.items())
    return Preset(**sections, provenance=provenance)


def _check_names(what: str, found: Any, known: Collection[str], optional: Collection[str]) -> None:
    """Raise a ParameterError unless the names in a table are the known ones; some may be missing."""
    if not isinstance(found, dict):
        raise ParameterError(f"{what} must be in a table, got {found!r:.200}")
    names = cast("dict[str, object]", found)
    for name in names:
        if name not in known:
            raise unknown_name(what, name, known)
    for name in known:
        if name not in names and name not in optional:
            raise ParameterError(f"{what} {name!r} is missing")


def _usual(section: str, name: str) -> Value:
    """Return the value of a field that a file leaves out."""
    value = KNOWN[section][name]["value"]
    return tuple(cast("list[float]", value)) if isinstance(value, list) else value


def _value(section: str, name: str, entry: Any, provenance: dict[str, str]) -> Value:
    """Return the number or numbers of an entry, and note where they come from."""
    where = f"{section}.{name}"
    like: dict[str, Any] = KNOWN.get(section, {}).get(name, {"unit": "1", "value": []})
    _check_names(f"entry of {where}", entry, ("value", "unit", "from"), ())
    value, unit, origin = entry["value"], entry["unit"], entry["from"]
    if unit != like["unit"]:
        raise ParameterError(f"{where}.unit must be {like['unit']!r}, got {unit!r}")
    if not isinstance(origin, str) or origin.split(":")[0] not in ORIGINS:
        raise ParameterError(
            f"{where}.from must begin with one of {', '.join(ORIGINS)}, got {origin!r}"
        )
    several = isinstance(like["value"], list)
    if isinstance(value, list) != several:
        raise ParameterError(
            f"{where} must be {'a list of numbers' if several else 'a number'}, got {value!r:.200}"
        )
    for each in value if several else [value]:
        check_number(where, each)
    provenance[where] = origin
    return tuple(map(float, value)) if several else float(value)


def format_preset(preset: Preset, title: str) -> str:
    """Return the TOML text of a preset, which ``parse_preset`` reads back to the same numbers,
    under heading lines.

    What the preset's own file left out is left out.
    """
    lines = [f"# {line}".rstrip() for line in title.splitlines()]

    def add(section: str, name: str, value: Value, unit: str) -> None:
        written = repr(list(value)) if isinstance(value, tuple) else repr(float(value))
        origin = _quoted(preset.provenance[f"{section}.{name}"])
        key = _quoted(name) if section == CLUTCHES else name
        lines.append(f"{key} = {{ value = {written}, unit = {_quoted(unit)}, from = {origin} }}")

    for section, heading in SECTIONS.items():
        found = getattr(preset, section)
        written = [
            name
            for name in KNOWN[section]
            if preset.provenance[f"{section}.{name}"] != LEFT_OUT
            or found[name] != _usual(section, name)
        ]
        lines += ["", f"# {heading}", f"[{section}]"] if written else []
        for name in written:
            add(section, name, found[name], KNOWN[section][name]["unit"])
    if preset.clutches != PAPER_CLUTCHES or any(
        where.startswith(f"{CLUTCHES}.") for where in preset.provenance
    ):
        lines += [
            "",
            "# What each clutch connects: its row (a, b) of W. It slips at a·ω_A + b·ω_B.",
            f"[{CLUTCHES}]",
        ]
        for each in preset.clutches:
            add(CLUTCHES, each.name, each.row, "1")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def machine_of(preset: Preset) -> Machine:
    """Return the machine of a preset, with its present clutches."""
    values = preset.clutch
    dynamic = TorqueCurve(**{item.name: values[item.name] for item in fields(TorqueCurve)})
    own = {item.name: values[item.name] for item in fields(Clutch) if item.name in KNOWN["clutch"]}
    clutch = Clutch(breakaway=dynamic.scaled(values["breakaway_ratio"]), dynamic=dynamic, **own)
    scale = (*values["scale"], *[1.0] * (SLOTS - len(preset.clutches)))
    return Machine(
        arm=Arm(**preset.arm), clutch=clutch, clutch_scale=scale, clutches=preset.clutches
    )


PRESET = load_preset(Path(__file__).parents[1] / "presets" / "pter.toml")
"""The set of numbers that the package ships."""


def preset_of(machine: Machine, base: Preset = PRESET, *, origin: str | None = None) -> Preset:
    """Return a preset for ``machine_of``, without a hand and with breakaway torque a multiple of
    dynamic torque.

    Parameters
    ----------
    machine
        Its arm, its clutches, and what these connect.
    base
        All other numbers.
    origin
        Provenance of the numbers that differ from ``base``, in the form used in preset files.
    """
    curve, arm = machine.clutch.dynamic, vars(machine.arm)
    clutch = {
        **vars(curve),
        **{name: value for name, value in vars(machine.clutch).items() if name in KNOWN["clutch"]},
        "breakaway_ratio": machine.clutch.breakaway.slope / curve.slope,
        "scale": machine.clutch_scale[: len(machine.clutches)],
    }
    provenance = dict(base.provenance)
    if origin is not None:
        for section, now, was in (("arm", arm, base.arm), ("clutch", clutch, base.clutch)):
            provenance |= {
                f"{section}.{name}": origin for name, value in now.items() if value != was[name]
            }
        if machine.clutches != base.clutches:
            provenance |= {f"{CLUTCHES}.{each.name}": origin for each in machine.clutches}
    return replace(base, arm=arm, clutch=clutch, clutches=machine.clutches, provenance=provenance)


def save_preset(machine: Machine, path: FilePath, *, origin: str, title: str = "") -> None:
    """Write a machine as a preset; commands and ``find_machine`` accept its path in place of a
    machine.

    Parameters
    ----------
    machine
        What to write. A preset cannot hold a hand, or non-default ``slip_threshold``, ``substep``
        or ``lag``.
    path
        The file, whose name ends in ``.toml``.
    origin
        Provenance of the numbers that differ from the package's own preset: one line that begins
        with ``published:``, ``derived:``, ``fitted:``, ``identified:`` or ``chosen:``.
    title
        Heading of the file.

    Raises
    ------
    ParameterError
        If a preset cannot hold the machine, or ``origin`` or ``path`` is not of this form.
    """
    file = find_path("path", path)
    if not is_preset(str(file)):
        raise ParameterError(f"path must end in .toml, got {str(file)!r}")
    text = format_preset(preset_of(machine, origin=origin), title)
    read = machine_of(parse_preset(text))  # which checks it
    held = (
        (machine, read, ("hand", "slip_threshold", "substep")),
        (machine.clutch, read.clutch, ("lag",)),
    )
    for owner, usual, names in held:
        for name in names:
            value, there = getattr(owner, name), getattr(usual, name)
            require(value == there, owner, name, value, f"{there!r} in a preset")
    curve, like = (vars(each.clutch.breakaway) for each in (machine, read))
    alike = all(math.isclose(curve[name], like[name], rel_tol=1e-9) for name in curve)
    require(
        alike,
        machine.clutch,
        "breakaway",
        machine.clutch.breakaway,
        "a multiple of dynamic in a preset",
    )
    write_text_atomic(file, text)
