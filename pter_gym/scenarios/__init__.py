"""The suite: named and versioned sets of episodes."""

from pter_gym.scenarios._suite import (
    PACES,
    SCENARIOS,
    Scenario,
    find_pace,
    find_scenario,
    name_of_pace,
    title_of_pace,
)

__all__ = [
    "PACES",
    "SCENARIOS",
    "Scenario",
    "find_pace",
    "find_scenario",
    "name_of_pace",
    "title_of_pace",
]
