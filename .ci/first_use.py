"""Measure how long a newcomer waits for the first step of the environment, with and without compilation.

Each number is a whole process, from its start to the end of its first step. Fails beyond the limits, 20 s and 1.5 s.
They are held to processor time, which is the wall time of an otherwise idle machine: compilation has one thread.
"""

import os
import subprocess
import sys
import tempfile
import time

FIRST_LIMIT_S = 20.0
AGAIN_LIMIT_S = 1.5

PROGRAM = """
import gymnasium, pter_gym
env = gymnasium.make("PTER/PathFollowing-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


def seconds_to_first_step(cache: str) -> tuple[float, float]:
    """Seconds to a new process's first step, of wall and of processor time, with numba's cache at the given place."""
    begin, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, "-c", PROGRAM], env=os.environ | {"NUMBA_CACHE_DIR": cache}, check=True)
    wall, after = time.perf_counter() - begin, os.times()
    processor = after.children_user - before.children_user + after.children_system - before.children_system
    return wall, processor


def main() -> int:
    """Print both times; 1 if one is beyond its limit."""
    with tempfile.TemporaryDirectory() as cache:
        first = seconds_to_first_step(cache)
        again = min(seconds_to_first_step(cache) for _ in range(3))
    print("first use, with compilation: {:.1f} s ({:.1f} s of processor time)".format(*first))
    print("afterwards, to the first step: {:.2f} s ({:.2f} s of processor time)".format(*again))
    return int(first[1] > FIRST_LIMIT_S or again[1] > AGAIN_LIMIT_S)


if __name__ == "__main__":
    sys.exit(main())
