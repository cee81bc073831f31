"""Kernels are compiled once, and from laws that are in no file."""

import numba
import numpy as np
import pytest

from pter_gym._physics import open_loop
from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.controllers import Policy
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import observation_layout

LAW = """
from pter_gym.controllers import PerClutch, device

@device
def law(obs, scales, gains, memory):
    return PerClutch(gains[0], {second}, 0.0, 0.0)
"""


def law_of_a_notebook(second: str):
    names = {}
    exec(compile(LAW.format(second=second), "<cell of a notebook>", "exec"), names)
    return names["law"]


def test_a_law_may_stand_in_no_file():
    layout = observation_layout(BASELINE, "torque")
    observation = np.zeros(len(layout), np.float32)
    for second, volts in (("2.0 * gains[0]", [3.0, 6.0, 0.0, 0.0]), ("5.0", [3.0, 5.0, 0.0, 0.0])):
        policy = Policy(np.array([3.0]), layout, law_of_a_notebook(second))
        assert policy(observation).tolist() == volts


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_the_shape_of_an_input_is_no_reason_to_compile_again():
    state, steps = initial_state(BASELINE, (0.5, 2.0)), 5
    simulate(BASELINE, state, np.zeros(4), np.zeros(2), duration=steps * BASELINE.substep)
    simulate(BASELINE, state, np.zeros((steps, 4)), np.zeros(2))
    simulate(BASELINE, state, np.zeros(4), np.zeros((steps, 2)), np.zeros((steps, 2)))
    assert len(open_loop._kernel(papers=True).signatures) == 1
