"""Compile the kernels for all processes of a test run: each once, in two processes."""

import subprocess
import sys
from importlib.util import find_spec

import numpy as np

from documents import run_extending
from pter_gym._engine.batch import Batch
from pter_gym._engine.kernels import alone_kernel
from pter_gym._physics import open_loop
from pter_gym.benchmark.measures import Travel
from pter_gym.controllers import Free
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing
from rollouts import simulate

PARTS = ("steps", "rest")


def main(part: str) -> None:
    """Compile one of two parts, which take about as long."""
    batch = Batch(BASELINE, PathFollowing(), 1)
    policy = Free().bind(BASELINE, batch.layout)
    if part == "steps":
        Travel([batch.task]).add(simulate(batch, policy, [0], 1))
        simulate(batch, lambda _: np.zeros((1, 4), np.float32), [0], 1)
        alone_kernel(False)
        run_extending()  # after the others: laws share what they have compiled
        if find_spec("jax"):
            from pter_gym._engine.xla import register_calls, register_law
            from pter_gym.controllers._law_kernel import guarded

            register_calls()
            assert policy.law is not None
            register_law(policy.law.function, guarded(policy.law.function))
    else:
        state = open_loop.initial_state(BASELINE, (0.5, 2.0))
        open_loop.simulate(BASELINE, state, np.zeros(4), np.zeros(2), duration=BASELINE.substep)
        if find_spec("pter_gym.tools.identification"):
            from pter_gym.tools.identification.parameters import Shape
            from pter_gym.tools.identification.shooting import make_inputs, predict

            inputs = make_inputs(1e-3, np.zeros((3, 4)), np.zeros((3, 2)))
            shape = Shape(BASELINE, 22.0)
            p = shape.coordinates(BASELINE)
            predict(shape, p, inputs, np.array([[0.5, 2.0, 0.0, 0.0]]), 2)


def compile_all() -> None:
    """Compile both parts at the same time."""
    command = [sys.executable, __file__]
    parts = [subprocess.Popen([*command, part], stderr=subprocess.PIPE) for part in PARTS]
    for process in parts:
        errors = process.communicate()[1].decode()
        if process.returncode:  # the first test that needs the kernel tells more
            sys.stderr.write(f"kernels are not compiled beforehand:\n{errors}")


if __name__ == "__main__":
    main(*sys.argv[1:])
