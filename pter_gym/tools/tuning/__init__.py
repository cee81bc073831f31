"""Gains for controllers, searched on training draws of a scenario; evaluation episodes are never read."""

from pter_gym.tools.tuning.search import EPISODES, TRIALS, TunedGains, tune
from pter_gym.tools.tuning.shipping import add_gains
from pter_gym.tools.tuning.spaces import SPACES

__all__ = ["EPISODES", "SPACES", "TRIALS", "TunedGains", "add_gains", "tune"]
