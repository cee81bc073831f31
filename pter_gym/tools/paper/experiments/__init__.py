"""The paper's experiments: each a function that takes parameters and returns a typed result. Nothing here draws."""

from pter_gym.tools.paper.experiments.claims import STATEMENTS, Claim, Statement, check
from pter_gym.tools.paper.experiments.feedback import gain_sweep, line_following
from pter_gym.tools.paper.experiments.holding import holding
from pter_gym.tools.paper.experiments.reversal import reversals
from pter_gym.tools.paper.experiments.setup import PAPER_MACHINES, STUDY, Setup
from pter_gym.tools.paper.experiments.single_dof import single_dof
from pter_gym.tools.paper.experiments.step_response import step_response
from pter_gym.tools.paper.experiments.study import Study
from pter_gym.tools.paper.experiments.time_constants import table1, time_constant_sweep
from pter_gym.tools.paper.experiments.torque_curves import torque_curves

__all__ = [
    "PAPER_MACHINES",
    "STATEMENTS",
    "STUDY",
    "Claim",
    "Setup",
    "Statement",
    "Study",
    "check",
    "gain_sweep",
    "holding",
    "line_following",
    "reversals",
    "single_dof",
    "step_response",
    "table1",
    "time_constant_sweep",
    "torque_curves",
]
