"""The extra time allowed for the start-up: one number, the same for all policies and scenarios."""

import math

import numpy as np

from pter_gym._compiled.compiler import device
from pter_gym._physics.arm import cos_difference, joint_torque
from pter_gym._physics.model import model_of
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.paths import Line
from pter_gym.tasks.path_following._situation import motion_at
from pter_gym.tasks.path_following._specification import PathFollowing

TIME_CONSTANTS = 2.0
"""After this many time constants a clutch has 86 % of a torque that is requested at the start."""

START = 0.01
"""The allowance covers this part of the path: time lost within it does not count, time lost later does."""


def start_up_allowance() -> float:
    """Return the allowance of the paper's machine with the paper's hand on the paper's line [s].

    It is two time constants of the clutches, plus the time lost while the push accelerates the arm from rest to the
    paper's pace v: with an effective mass m of the tip along the line and a push F this takes m·v/F, and half of it is
    lost compared with a start at that pace.
    """
    path = Line()
    arm = model_of(BASELINE).arm
    (x, y), heading = path.point(0.0), path.heading(0.0)
    at = motion_at(arm, x, y)
    torque = np.array(joint_torque(arm, at, math.cos(heading), math.sin(heading)))
    coupling = arm.coupling * cos_difference(at)
    mass = 1.0 / float(torque @ np.linalg.solve([[arm.m11, coupling], [coupling, arm.m22]], torque))
    lost = 0.5 * mass * PathFollowing().pace / MultiSineHand().push
    return TIME_CONSTANTS * BASELINE.clutch.time_constant + lost


ALLOWANCE = start_up_allowance()
"""The allowance [s], about 0.22 s."""


@device
def in_start_up(reached: float, length: float, pace: float, time: float) -> bool:
    """Tell whether the delay is within the allowance, given the largest arc length so far [m] and the time [s]."""
    return (reached <= START * length) & (time <= ALLOWANCE + START * length / pace)
