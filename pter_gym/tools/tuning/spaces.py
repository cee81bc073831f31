"""The search spaces of gains."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

DIGITS = 4
"""Significant digits of a gain: what is printed is what was tried."""


@dataclass(frozen=True)
class Range:
    """Numbers from low to high, uniform or logarithmic."""

    low: float
    high: float
    log: bool = True


SWITCH = (False, True)
"""A gain that is on or off."""

Space = Mapping[str, Range | tuple[bool, bool]]

_SHARED: Space = {
    "braking": Range(10.0, 300.0),
    "pace_fraction": Range(0.0, 0.95, log=False),
    "pace_integral": Range(0.05, 30.0),
    "grip": Range(0.0, 30.0, log=False),
    "slip_threshold": Range(1e-3, 0.2),
}

_LOOP: Space = {"feedback": Range(0.01, 5.0), "hold_when_stuck": SWITCH}

_IMPEDANCE: Space = {
    **_SHARED,
    "stiffness": Range(50.0, 20_000.0),
    "damping_normal": Range(5.0, 3000.0),
    "tip_space": SWITCH,
}

_STEERING: Space = {
    **_SHARED,
    **_LOOP,
    "approach": Range(1.0, 100.0),
    "lead": Range(0.0, 0.4, log=False),
    "strength": Range(3.0, 300.0),
}

SPACES: Mapping[str, Space] = MappingProxyType(
    {
        "impedance": _IMPEDANCE,
        "torque-feedback": {**_IMPEDANCE, **_LOOP},
        "single-dof": {
            **_STEERING,
            "slow": Range(0.01, 1.0),
            "reluctance": Range(0.0, 0.5, log=False),
        },
        "velocity-ratio": {**_STEERING, "slow": Range(0.02, 2.0), "tip_space": SWITCH},
    }
)
"""The coordinates of each controller's search, in SI: its gains, except for the damper along the
path.

In its place comes ``braking``, the force [N] with which it holds the hand back at the commanded
pace. That force has to balance the hand's push, whatever the other gains are. """


def gains_at(point: Mapping[str, float | bool], pace: float) -> dict[str, float | bool]:
    """Return the gains of a point of a search at a commanded pace [m/s], with ``DIGITS`` significant digits."""
    excess = pace * (1.0 - rounded(point["pace_fraction"]))
    gains = {"damping_tangential": point["braking"] / excess, **point}
    del gains["braking"]
    return {name: rounded(gain) for name, gain in gains.items()}


def point_at(controller: str, gains: Any, pace: float) -> dict[str, float | bool]:
    """Return the point of a search that is nearest to a controller's gains at a commanded pace [m/s]."""
    point: dict[str, float | bool] = {}
    for name, space in SPACES[controller].items():
        braking = gains.damping_tangential * pace * (1.0 - gains.pace_fraction)
        point[name] = within(space, braking if name == "braking" else getattr(gains, name))
    return point


def within(space: Range | tuple[bool, bool], value: Any) -> float | bool:
    """Return the value of a space that is nearest to one."""
    return min(max(value, space.low), space.high) if isinstance(space, Range) else bool(value)


def rounded(gain: float | bool) -> float | bool:
    """Return a gain with ``DIGITS`` significant digits."""
    return gain if isinstance(gain, bool) else float(f"{gain:.{DIGITS}g}")
