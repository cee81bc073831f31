"""How fast the simulator is, as ratios against a peer that is measured in the same run."""

import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from pter_gym.controllers import Locked
from pter_gym.envs.batch import Batch
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing, substeps

PEER = "CartPole-v1"
ID = "PTER/PathFollowing-v0"

_REPEATS = 15
_STEPS = 400


@dataclass(frozen=True)
class SingleStep:
    """Time of one ``env.step`` through ``gymnasium.make``, ours and the peer's in turn [s], and the median ratio."""

    seconds: float
    peer_seconds: float
    ratio: float


@dataclass(frozen=True)
class Throughput:
    """Whole control steps per second of the block kernel on one thread."""

    worlds: int
    steps_per_second: float


def single_step() -> SingleStep:
    """Measure one ``env.step`` beside CartPole's, block by block in turn."""
    ours = gymnasium.make(ID)
    peer = gymnasium.make(PEER)
    full = np.full(4, 24.0, np.float32)
    pairs = [(_step_seconds(ours, full), _step_seconds(peer, 1)) for _ in range(_REPEATS + 1)][1:]
    return SingleStep(
        seconds=statistics.median(a for a, _ in pairs),
        peer_seconds=statistics.median(b for _, b in pairs),
        ratio=statistics.median(a / b for a, b in pairs),
    )


def throughput(worlds: int) -> Throughput:
    """Measure the block kernel with a control law inside, over ``worlds`` worlds that do not end."""
    task = PathFollowing()
    batch = Batch(BASELINE, task, worlds)
    policy = Locked().bind(BASELINE, batch.layout)
    steps = max(1, 40_000 // worlds)
    obs, _ = batch.reset([0] * worlds)
    batch.rollout(obs, policy.law, policy.gains, 1)
    best = min(_seconds(lambda: batch.rollout(obs, policy.law, policy.gains, steps)) for _ in range(_REPEATS))
    return Throughput(worlds=worlds, steps_per_second=worlds * steps / best)


def substeps_per_step() -> int:
    """Return the number of substeps in one control step of the measured environment."""
    return substeps(PathFollowing(), BASELINE)


def vectorised_loops() -> list[int]:
    """Return the width of each loop that LLVM vectorised when it compiled the block kernel anew."""
    code = (
        "import llvmlite.binding as llvm; llvm.set_option('', '-pass-remarks=loop-vectorize');"
        "from pter_gym.benchmark.speed import throughput; throughput(64)"
    )
    with tempfile.TemporaryDirectory() as cache:
        found = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "NUMBA_CACHE_DIR": cache},
            capture_output=True,
            text=True,
            check=True,
        )
    return [int(width) for width in re.findall(r"vectorized loop \(vectorization width: (\d+)", found.stderr)]


def _step_seconds(env: Any, action: Any) -> float:
    env.reset(seed=0)
    resets = 0.0
    begin = time.perf_counter()
    for _ in range(_STEPS):
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            resets += _seconds(env.reset)
    return (time.perf_counter() - begin - resets) / _STEPS


def _seconds(call: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin
