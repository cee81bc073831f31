"""The suite: named and versioned sets of episodes. What varies in them is imported when it is first used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pter_gym.scenarios.suite import PACES, SCENARIOS, Scenario, find_pace, find_scenario

if TYPE_CHECKING:
    from pter_gym.scenarios.variations import (
        ARMS,
        CLUTCHES,
        CURVES,
        DRIFT,
        EQ5,
        FORCES,
        HUMANS,
        SENSORS,
        STANDARD,
        TIGHTEST,
        TORQUE_ERRORS,
        WIDTH,
    )

__all__ = [
    "ARMS",
    "CLUTCHES",
    "CURVES",
    "DRIFT",
    "EQ5",
    "FORCES",
    "HUMANS",
    "PACES",
    "SCENARIOS",
    "SENSORS",
    "STANDARD",
    "TIGHTEST",
    "TORQUE_ERRORS",
    "WIDTH",
    "Scenario",
    "find_pace",
    "find_scenario",
]


def __getattr__(name: str) -> Any:
    """Import a distribution on first use."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("pter_gym.scenarios.variations"), name)
