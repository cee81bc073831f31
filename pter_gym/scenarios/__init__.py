"""The suite: named and versioned sets of episodes."""

from pter_gym.scenarios._paces import PACES
from pter_gym.scenarios._suite import SCENARIOS, Scenario, find_scenario

__all__ = ["PACES", "SCENARIOS", "Scenario", "find_scenario"]
