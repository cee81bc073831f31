"""The order of a substep is one edit: simulation, adjoint and tangents of another order agree."""

import os
import subprocess
import sys

import pytest

ORDERS = {
    "drift and kick": "((DRIFT, WHOLE), (KICK, WHOLE))",
    "kick and drift": "((KICK, WHOLE), (DRIFT, WHOLE))",
    "as shipped": "((DRIFT, HALF), (KICK, WHOLE), (DRIFT, HALF))",
}

EDIT = """
import sys, types
from importlib.util import find_spec
spec = find_spec("pter_gym._physics.order")
with open(spec.origin, encoding="utf-8") as file:
    head, _, rest = file.read().partition("ORDER = (")
order = types.ModuleType(spec.name)
exec(head + "ORDER = " + sys.argv[1] + rest[rest.index("\\n"):], order.__dict__)
sys.modules[spec.name] = order
"""

CHECK = """
import numpy as np
from pter_gym._compiled.records import store
from pter_gym._engine.batch import Batch
from pter_gym._physics.arm import Load
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.open_loop import BODY, BODY_WIDTH, body_of, initial_state, simulate
from pter_gym._physics.step import paper_clutches
from pter_gym.gradients import rollout
from pter_gym.gradients._tangent import substep_tangents
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import COLUMN, PathFollowing

rng = np.random.default_rng(0)
volts, force = rng.uniform(0.0, 6.0, (4, 4)), rng.uniform(-20.0, 20.0, (4, 1, 2))
start = initial_state(BASELINE, (0.5, 2.0), (0.3, -0.2))
h, weight = BASELINE.substep, rng.normal(size=(5, 2))
run = rollout(BASELINE, start, volts, force, period=h)
again = simulate(BASELINE, start, volts, force[:, 0])
print(np.abs(run.theta[1:] - again.theta).max())

def total(force):
    return float((rollout(BASELINE, start, volts, force, period=h).theta * weight).sum())

by, step = run.gradient(theta=weight).hand_force, 1e-4 * rng.normal(size=force.shape)
change = (total(force + step) - total(force - step)) / 2.0
print(abs(change - (by * step).sum()) / np.abs(by * step).sum())

body, dot = body_of(BASELINE, start), np.zeros((BODY_WIDTH, 1))
dot[BODY.motion.omega_b] = 1.0
advance = substep_tangents(paper_clutches, 1)
for k in range(4):
    store(body, BODY.command, 0, PerClutch(*volts[k]))
    store(body, BODY.load, 0, Load(*force[k, 0], 0.0, 0.0, 0.0, 0.0))
    advance(body, dot, h, True)
last = np.zeros((5, 2))
last[-1, 0] = 1.0
wanted = run.gradient(theta=last).state.omega[1]
print(abs(dot[BODY.motion.theta_a, 0] / wanted - 1.0))
print(run.theta[-1, 0].hex())

batch = Batch(BASELINE, PathFollowing(), 1)
batch.reset([0])
print(batch.step(np.full((1, 4), 1.0)).telemetry[0, 0, COLUMN.energy.hand_work])
"""

HAND_WORK = 0.148
"""Work of the hand in the first control step with the shipped order [J]."""


def test_another_order_is_one_edit():
    """Each in a process of its own, without compiling."""
    quiet = {"env": {**os.environ, "NUMBA_DISABLE_JIT": "1"}, "capture_output": True, "text": True}
    ends = set()
    for order in ORDERS.values():
        done = subprocess.run([sys.executable, "-c", EDIT + CHECK, order], check=False, **quiet)
        assert done.returncode == 0, done.stderr
        motion, adjoint, tangent, end, hand_work = done.stdout.split()
        assert float(motion) == 0.0
        assert float(adjoint) < 1e-6
        assert float(tangent) < 1e-9
        assert float(hand_work) == pytest.approx(HAND_WORK, rel=0.02)
        ends.add(end)
    assert len(ends) == len(ORDERS)
