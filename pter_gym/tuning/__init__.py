"""Gains for controllers, searched on training draws of a scenario; evaluation episodes are never read."""

from pter_gym.tuning.examination import Assessment, Examination, examine
from pter_gym.tuning.search import EPISODES, TRIALS, TunedGains, tune
from pter_gym.tuning.shipping import add_gains
from pter_gym.tuning.spaces import SPACES

__all__ = ["EPISODES", "SPACES", "TRIALS", "Assessment", "Examination", "TunedGains", "add_gains", "examine", "tune"]
