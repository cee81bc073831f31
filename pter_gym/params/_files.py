"""Machines as TOML files: the plain data of their dataclasses, with units and sources as comments.

``save_machine`` and ``pter identify`` write them; ``find_machine`` and ``--machine`` read them. A
file may also state the uncertainty of its numbers, which ``find_machines`` reads too.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, cast

from pter_gym._internal.checks import builtin
from pter_gym._internal.files import FilePath, expand_path, has_ending, write_text_atomic
from pter_gym._internal.reading import read_toml, reading
from pter_gym.errors import ParameterError, nearest
from pter_gym.params._connection import Connection
from pter_gym.params._machine import Arm, Clutch, Hand, Machine, TorqueCurve
from pter_gym.params._named import ACTUATORS, BASELINE, MACHINES
from pter_gym.params._spread import MachineSpread

if TYPE_CHECKING:
    from pter_gym._internal.codec import Codec

UNCERTAINTY = "uncertainty"
"""Table of the places and the covariance of a ``Spread``."""

ORIGINS = ("published", "derived", "fitted", "identified", "chosen")
"""First words of a provenance."""


@cache
def _codec() -> "Codec":
    from pter_gym._internal.codec import Codec  # loads cattrs, which no other part of params needs

    return Codec((Arm, Clutch, Connection, Hand, Machine, TorqueCurve))


def find_machine(machine: Machine | FilePath | None) -> Machine:
    """Return a machine, given as an object, a name or a file; ``BASELINE`` for None.

    A name is one of ``MACHINES``, or of ``ACTUATORS`` for PTER with four of these instead of its
    clutches.

    Raises
    ------
    ParameterError
        If it is neither a machine nor a known name (the nearest are suggested), or there is no
        such file.
    DataError
        If a file is damaged, incomplete or out of range.
    """
    given: object = builtin(machine)
    if given is None:
        return BASELINE
    if isinstance(given, Machine):
        return given
    name = given if isinstance(given, str) else ""
    if name in MACHINES:
        return MACHINES[name]
    if name in ACTUATORS:
        return replace(BASELINE, clutch=ACTUATORS[name].clutch)
    if is_machine_file(name):
        return load_machine(name)
    names = (*MACHINES, *ACTUATORS)
    raise ParameterError(
        f"machine must be a Machine, one of {', '.join(names)} or the path of a file (.toml), "
        f"got {given!r:.200}{nearest(given, names)}"
    )


def find_machines(machine: Machine | FilePath) -> Machine | MachineSpread:
    """Return the distribution of machines that a file describes, or its only machine.

    Arguments and errors are those of ``find_machine``.
    """
    middle = find_machine(machine)
    if not is_machine_file(source := builtin(machine)):
        return middle
    content = read_toml(expand_path("machine", source), "machine")
    with reading(f"machine {source}"):
        uncertain = uncertainty_from(content)
        return MachineSpread(machine=middle, **uncertain) if uncertain else middle


def uncertainty_from(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the places and the covariance that a file's plain data has; empty without them."""
    table = content.get(UNCERTAINTY)
    if table is None:
        return {}
    if not isinstance(table, dict) or not isinstance(table.get("covariance"), list):
        raise TypeError(f"{UNCERTAINTY} must be a table with places and rows of a covariance")
    table = cast("dict[str, Any]", table)
    rows = tuple(tuple(map(float, row)) for row in table["covariance"])
    return {"places": tuple(table["places"]), "covariance": rows}


def format_uncertainty(
    places: Sequence[str], covariance: Sequence[Sequence[float]], note: str = ""
) -> str:
    """Return the table that ``uncertainty_from`` reads as text."""
    return (
        f"\n[{UNCERTAINTY}]  # of normally distributed numbers, in products of their units\n"
        f"places = {json.dumps(places)}{note}\ncovariance = {json.dumps(covariance)}\n"
    )


def is_machine_file(machine: object) -> bool:
    """Return whether a machine is given by the path of a file."""
    return isinstance(machine, str) and has_ending(machine, ".toml")


def load_machine(path: FilePath) -> Machine:
    """Read a machine from a file.

    Raises
    ------
    ParameterError
        If there is no such file.
    DataError
        If it is not TOML, or a field is unknown, missing or out of range.
    """
    file = expand_path("machine", path)
    if not file.is_file():
        raise ParameterError(f"machine must name a file that exists, there is no {str(path)!r}")
    content = read_toml(file, "machine")
    with reading(f"machine {path}"):
        return machine_from(content)


def machine_from(content: Mapping[str, Any]) -> Machine:
    """Return a machine from plain data, or raise a ParameterError that names the field."""
    machine = _codec().from_plain(
        {name: value for name, value in content.items() if name != UNCERTAINTY}
    )
    if not isinstance(machine, Machine):
        raise ParameterError(f"type must be 'Machine', got {content.get('type')!r:.60}")
    return machine


def save_machine(
    machine: Machine | MachineSpread,
    path: FilePath,
    *,
    origin: str,
    origins: Mapping[str, str] | None = None,
    title: str = "",
) -> None:
    """Write a machine to a file, which commands and ``find_machine`` accept instead of a name.

    Parameters
    ----------
    machine
        The machine, or a ``MachineSpread``, of which the covariance is written too.
    path
        The file, whose name ends in ``.toml``.
    origin
        Provenance of the numbers that differ from PTER's: one line that begins with
        ``published:``, ``derived:``, ``fitted:``, ``identified:`` or ``chosen:``.
    origins
        Provenance of single fields by their place, such as ``arm.length_a``, instead.
    title
        Heading of the file.

    Raises
    ------
    ParameterError
        If ``origin``, ``origins`` or ``path`` is not of this form.
    """
    file = expand_path("path", path)
    if not is_machine_file(str(file)):
        raise ParameterError(f"path must end in .toml, got {str(file)!r}")
    write_text_atomic(file, format_machine(machine, origin, origins or {}, title))


def format_machine(
    machine: Machine | MachineSpread, origin: str, origins: Mapping[str, str], title: str = ""
) -> str:
    """Return a machine's file as text; see ``save_machine``."""
    if isinstance(machine, MachineSpread):
        note = "  # clutch_scale.1 is the strength of clutch 1"
        table = format_uncertainty(machine.places, machine.covariance, note)
        return format_machine(machine.machine, origin, origins, title) + table
    if not isinstance(cast("object", machine), Machine):
        raise ParameterError(f"machine must be a Machine, got {machine!r:.200}")
    for text in (origin, *origins.values()):
        if text.split(":")[0] not in ORIGINS or not text.isprintable():
            raise ParameterError(
                f"origin must be a line that begins with one of {', '.join(ORIGINS)}, got {text!r}"
            )
    usual, data = (cast("dict[str, Any]", _codec().to_plain(m)) for m in (BASELINE, machine))
    lines = [f"# {line}".rstrip() for line in title.splitlines()]
    lines += _table("", machine, data, usual, origin, origins)
    return "\n".join(lines).lstrip("\n") + "\n"


def _table(
    place: str,
    owner: Any,
    data: dict[str, Any],
    usual: dict[str, Any],
    origin: str,
    origins: Mapping[str, str],
) -> Iterator[str]:
    """Yield the lines of a dataclass: its numbers, then a table for each dataclass in it."""
    yield from ("", f"[{place}]") if place else ()
    yield f"type = {_quoted(data['type'])}"
    tables: list[str] = []
    for item in fields(owner):
        name, where = item.name, f"{place}.{item.name}".lstrip(".")
        value = data.get(name)
        if isinstance(value, dict) or name == "clutches":
            tables.append(name)
        elif name in data:
            known = item.metadata["provenance"] if value == usual.get(name) else origin
            comment = f"{item.metadata['unit']}; {origins.get(where, known)}"
            yield f"{name} = {_written(value)}  # {comment}"
    for name in tables:
        where = f"{place}.{name}".lstrip(".")
        if name == "clutches":
            for connection in data.get(name, ()):
                note = origins.get(where, origin)
                yield from ("", f"[[{where}]]  # {note}", 'type = "Connection"')
                yield from (f"{key} = {_written(connection[key])}" for key in ("name", "row"))
        else:
            part = getattr(owner, name)
            assert is_dataclass(part)
            yield from _table(where, part, data[name], usual[name], origin, origins)


def _written(value: Any) -> str:
    """Return a value as TOML: numbers and lists of them as Python writes them."""
    return _quoted(value) if isinstance(value, str) else repr(value)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
