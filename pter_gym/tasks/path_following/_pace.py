"""The pace for reward and score: a recent average, without the start-up time."""

import math

import numpy as np

from pter_gym._compiled.compiler import inlined
from pter_gym._physics.arm import cos_difference, joint_torque, motion_at
from pter_gym._physics.model import model_of
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.paths import Line
from pter_gym.tasks.path_following._model import TaskModel

COMMANDED_PACE = 0.5
"""The paper's pace [m/s]: the baseline's mean tip speed in Table I, 19.69 in/s."""

TIME_CONSTANTS = 2.0
"""After this many time constants a clutch has 86 % of a torque that is requested at the start."""

START = 0.01
"""Part of the path that the allowance covers; time lost later counts."""


def start_up_allowance() -> float:
    """Return the allowance of the paper's machine with the paper's hand on the paper's line [s].

    It is two time constants of the clutches, plus the time lost while the push accelerates the arm
    from rest to the paper's pace v: with an effective mass m of the tip along the line and a push F
    this takes m·v/F, and half of it is lost compared with a start at that pace.
    """
    path = Line()
    arm = model_of(BASELINE).arm
    (x, y), heading = path.point(0.0), path.heading(0.0)
    at = motion_at(arm, x, y)
    torque = np.array(joint_torque(arm, at, math.cos(heading), math.sin(heading)))
    coupling = arm.coupling * cos_difference(at)
    mass = 1.0 / float(torque @ np.linalg.solve([[arm.m11, coupling], [coupling, arm.m22]], torque))
    lost = 0.5 * mass * COMMANDED_PACE / MultiSineHand().push
    return TIME_CONSTANTS * BASELINE.clutch.time_constant + lost


ALLOWANCE = start_up_allowance()
"""The extra time for the start-up [s], about 0.22 s: the same for all policies and scenarios."""


@inlined
def in_start_up(reached: float, length: float, pace: float, time: float) -> bool:
    """Return whether a delay is within the allowance, from the progress [m] and the time [s]."""
    return (reached <= START * length) & (time <= ALLOWANCE + START * length / pace)


@inlined
def recent_pace(
    ratio: float, travel: float, reached: float, time: float, period: float, task: TaskModel
) -> float:
    """Return the recent mean of the pace over the commanded one, after a control step.

    Parameters
    ----------
    ratio
        The mean before the step.
    travel, reached
        Change of the arc length in the step, and its largest value so far [m].
    time, period
        Time since the start of the episode, and length of the step [s].
    task
        The task. During start-up a slow pace counts as the commanded one.
    """
    ratio += task.pace_decay * (travel / (period * task.pace) - ratio)
    excused = (ratio < 1.0) & in_start_up(reached, task.path.length, task.pace, time)
    return 1.0 if excused else ratio
