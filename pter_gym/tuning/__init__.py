"""Gains for controllers, searched on training draws of a scenario; evaluation episodes are never read."""

from pter_gym.tuning.examination import Examination, Verdict, examine
from pter_gym.tuning.search import EPISODES, TRIALS, Study, tune
from pter_gym.tuning.shipping import add_study
from pter_gym.tuning.spaces import SPACES

__all__ = ["EPISODES", "SPACES", "TRIALS", "Examination", "Study", "Verdict", "add_study", "examine", "tune"]
