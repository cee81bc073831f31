"""How good could it be? Model-predictive control over the compiled simulator.

``Privileged`` knows the true machine, the true hand and its future. No controller of a real machine can: it is marked
so wherever its scores are shown, and has no rank. It shows what the clutches can do, beside what laws do with them.
``Honest`` knows the nominal machine, path and pace, and what the sensors have told so far.
"""

from pter_gym.controllers._predictive.honest import HonestPlanner
from pter_gym.controllers._predictive.planner import Planner, Settings
from pter_gym.controllers._predictive.policies import UNPRIVILEGED, Honest, Predictive, Privileged

__all__ = ["UNPRIVILEGED", "Honest", "HonestPlanner", "Planner", "Predictive", "Privileged", "Settings"]
