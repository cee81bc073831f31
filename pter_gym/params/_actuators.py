"""A library of clutches and brakes, from ``presets/actuators.toml`` with its sources."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from pter_gym._internal.reading import read_toml
from pter_gym.params._machine import Clutch, TorqueCurve

ActuatorGrade = Literal["fitted", "measured", "order of magnitude"]
"""Fitted to the paper's results, read where the numbers are printed, or chosen."""


@dataclass(frozen=True, kw_only=True)
class Actuator:
    """A clutch or brake of the library.

    Attributes
    ----------
    clutch
        Its parameters.
    grade, provenance
        Where the numbers come from.
    source
        What prints them, or has suggested them.
    unknown
        Parameters that the source does not give; they have the value of a clutch without the
        effect.
    """

    name: str
    clutch: Clutch
    grade: ActuatorGrade
    provenance: str
    source: str
    unknown: tuple[str, ...]


def read_actuators(own: Mapping[str, Clutch]) -> Mapping[str, Actuator]:
    """Return the library by name; ``own`` are PTER's clutches, by their names in it."""
    tables = read_toml(Path(__file__).parents[1] / "presets" / "actuators.toml", "actuators")
    return MappingProxyType(
        {name: _actuator(name, dict(table), own.get(name)) for name, table in tables.items()}
    )


def _actuator(name: str, table: dict[str, Any], clutch: Clutch | None) -> Actuator:
    sources = {key: table.pop(key) for key in ("grade", "provenance", "source")}
    unknown = tuple(table.pop("unknown"))
    if clutch is None:
        ratio, slope, off = (table.pop(key) for key in ("breakaway_ratio", "slope", "off_state"))
        dynamic = TorqueCurve(slope=slope, knee=0.0, curvature=0.0, off_state=off)
        clutch = Clutch(breakaway=dynamic.scaled(ratio), dynamic=dynamic, **table)
    return Actuator(name=name, clutch=clutch, unknown=unknown, **sources)
