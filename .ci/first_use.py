"""Measure how long a newcomer waits for the first step of the environment, with and without compilation.

Each number is a whole process, from its start to the end of its first step. Fails beyond the limits.
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


def seconds_to_first_step(cache: str) -> float:
    """Seconds that a new process needs for its first step, with numba's cache at the given place."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", PROGRAM], env=os.environ | {"NUMBA_CACHE_DIR": cache}, check=True)
    return time.perf_counter() - begin


def main() -> int:
    """Print both times; 1 if one is beyond its limit."""
    with tempfile.TemporaryDirectory() as cache:
        first = seconds_to_first_step(cache)
        again = min(seconds_to_first_step(cache) for _ in range(3))
    print(f"first use, with compilation: {first:.1f} s (limit {FIRST_LIMIT_S:g} s)")
    print(f"afterwards, to the first step: {again:.2f} s (limit {AGAIN_LIMIT_S:g} s)")
    return int(first > FIRST_LIMIT_S or again > AGAIN_LIMIT_S)


if __name__ == "__main__":
    sys.exit(main())
