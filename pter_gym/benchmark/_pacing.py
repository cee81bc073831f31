"""The commanded paces, and the paper's gains at each: only the damper along the path changes, which sets the pace.

The gains were made for about 0.5 m/s. ``docs/make/store.py paces`` solves for the damper at a commanded pace on a
scenario's training draws, which never include evaluation episodes, and writes the table.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType

from pter_gym.controllers import Impedance, PaceSchedule
from pter_gym.scenarios import PACES

TABLE = Path(__file__).parents[1] / "presets" / "paces.toml"

HOLD = 1e-6
"""Fraction of a commanded pace about it in which its damper holds: far more than the rounding of a float32."""


def paced(controller: Impedance, dampers: Mapping[str, float]) -> PaceSchedule:
    """Return a controller whose damper along the path [N·s/m] follows the commanded pace, given for paces by name."""
    knots = [(PACES[pace], replace(controller, damping_tangential=damping)) for pace, damping in dampers.items()]
    return PaceSchedule(tuple(sorted(knots, key=lambda knot: knot[0])), hold=HOLD)


@cache
def damping_table() -> Mapping[str, Mapping[str, Mapping[str, float]]]:
    """Return the damper along the path [N·s/m] by scenario, controller and pace."""
    return MappingProxyType(tomllib.loads(TABLE.read_text(encoding="utf-8")))
