"""The suite: named and versioned sets of episodes."""

from pter_gym.scenarios._suite import SCENARIOS, Scenario, find_scenario
from pter_gym.scenarios.paces import PACES

__all__ = ["PACES", "SCENARIOS", "Scenario", "find_scenario"]
