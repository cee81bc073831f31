"""A library of clutches and brakes, from ``presets/actuators.toml`` with its sources."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from pter_gym._internal.reading import parse_toml
from pter_gym.params._machine import Clutch, TorqueCurve

Grade = Literal["fitted", "measured", "order of magnitude"]
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
    grade: Grade
    provenance: str
    source: str
    unknown: tuple[str, ...]


def read_actuators(shipped: Mapping[str, Clutch]) -> Mapping[str, Actuator]:
    """Return the library by name; ``shipped`` are the clutches of the machine's own preset, by their names in it."""
    tables = parse_toml(
        (Path(__file__).parents[1] / "presets" / "actuators.toml").read_text("utf-8")
    )
    return MappingProxyType(
        {name: _actuator(name, dict(table), shipped) for name, table in tables.items()}
    )


def _actuator(name: str, table: dict[str, Any], shipped: Mapping[str, Clutch]) -> Actuator:
    told = {key: table.pop(key) for key in ("grade", "provenance", "source")}
    unknown = tuple(table.pop("unknown"))
    if name in shipped:
        return Actuator(name=name, clutch=shipped[name], unknown=unknown, **told)
    ratio, slope, off_state = (table.pop(key) for key in ("breakaway_ratio", "slope", "off_state"))
    dynamic = TorqueCurve(slope=slope, knee=0.0, curvature=0.0, off_state=off_state)
    clutch = Clutch(breakaway=dynamic.scaled(ratio), dynamic=dynamic, **table)
    return Actuator(name=name, clutch=clutch, unknown=unknown, **told)
