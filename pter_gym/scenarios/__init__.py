"""The suite: named and versioned sets of episodes."""

from pter_gym.scenarios._suite import PACES, SCENARIOS, Scenario, find_pace, find_scenario

__all__ = ["PACES", "SCENARIOS", "Scenario", "find_pace", "find_scenario"]
