"""Simulation, adjoint and tangents follow one order of a substep's stages."""

import numpy as np
import pytest

from pter_gym._compiled.records import store
from pter_gym._physics.arm import Load
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.open_loop import BODY, BODY_WIDTH, body_of, initial_state, simulate
from pter_gym._physics.step import paper_clutches
from pter_gym.gradients import rollout
from pter_gym.gradients._tangent import substep_tangents
from pter_gym.params import BASELINE


def test_simulation_adjoint_and_tangents_agree() -> None:
    """In control steps of one substep, in which the tangents' half drifts do not join."""
    rng = np.random.default_rng(0)
    volts, force = rng.uniform(0.0, 6.0, (4, 4)), rng.uniform(-20.0, 20.0, (4, 1, 2))
    start = initial_state(BASELINE, (0.5, 2.0), (0.3, -0.2))
    run = rollout(BASELINE, start, volts, force, period=BASELINE.substep)
    assert np.array_equal(run.theta[1:], simulate(BASELINE, start, volts, force[:, 0]).theta)

    body, dot = body_of(BASELINE, start), np.zeros((BODY_WIDTH, 1))
    dot[BODY.motion.omega_b] = 1.0
    advance = substep_tangents(paper_clutches, 1)
    for command, push in zip(volts, force[:, 0], strict=True):
        store(body, BODY.command, 0, PerClutch(*command))
        store(body, BODY.load, 0, Load(*push, 0.0, 0.0, 0.0, 0.0))
        advance(body, dot, BASELINE.substep, True)
    last = np.zeros((5, 2))
    last[-1, 0] = 1.0
    by_omega = run.gradient(theta=last).state.omega[1]
    assert dot[BODY.motion.theta_a, 0] == pytest.approx(by_omega, rel=1e-9)
