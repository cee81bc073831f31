"""Model-predictive control with the compiled simulator, to show how good a policy could be.

``Privileged`` knows the true machine, the true hand and its future. No controller of a real machine can, so its
scores are marked wherever they are shown, and it is not ranked. It shows what the clutches can do. ``Honest`` knows the
nominal machine, path and pace, and the sensor readings so far.
"""

from pter_gym.controllers._predictive.honest import HonestPlanner
from pter_gym.controllers._predictive.planner import Planner, Settings
from pter_gym.controllers._predictive.policies import UNPRIVILEGED, Honest, Predictive, Privileged

__all__ = ["UNPRIVILEGED", "Honest", "HonestPlanner", "Planner", "Predictive", "Privileged", "Settings"]
