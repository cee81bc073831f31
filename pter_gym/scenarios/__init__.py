"""The suite: named and versioned sets of episodes."""

from pter_gym.scenarios._paces import PACES, find_pace, name_of_pace, names_of_paces, title_of_pace
from pter_gym.scenarios._suite import SCENARIOS, Scenario, find_scenario

__all__ = [
    "PACES",
    "SCENARIOS",
    "Scenario",
    "find_pace",
    "find_scenario",
    "name_of_pace",
    "names_of_paces",
    "title_of_pace",
]
