"""Measure how long a newcomer waits for the first step, with and without compilation.

Each number is the processor time of a whole process, from its start to the end of its first step.
The limits are ratios to what the same machine needs to import Gymnasium and numba: a slow or a busy
machine judges as a fast one does. Measured were 37 to 52 and 2.4 to 3.2;
docs/development/verification.md has those of its last run.
"""

import os
import subprocess
import sys
import tempfile

FIRST_LIMIT = 60.0
AGAIN_LIMIT = 3.5

IMPORTS = "import gymnasium, numba"

PROGRAM = """
import gymnasium, pter_gym
env = gymnasium.make("PTER/PathFollowing-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


def seconds_of(program: str, cache: str) -> float:
    """Return the processor time [s] of a new process that runs a program, with a numba cache."""
    before = os.times()
    subprocess.run(
        [sys.executable, "-c", program], env=os.environ | {"NUMBA_CACHE_DIR": cache}, check=True
    )
    after = os.times()
    return (
        after.children_user - before.children_user + after.children_system - before.children_system
    )


def main() -> int:
    """Print the times and their ratios; 1 if one is beyond its limit."""
    with tempfile.TemporaryDirectory() as cache:
        seconds_of(IMPORTS, cache)  # from the disk
        first = seconds_of(PROGRAM, cache)
        pairs = [(seconds_of(IMPORTS, cache), seconds_of(PROGRAM, cache)) for _ in range(5)]
    imports, again = (min(times) for times in zip(*pairs, strict=True))
    print(f"imports of Gymnasium and numba: {imports:.2f} s")
    print(
        f"first use, with compilation: {first:.1f} s, "
        f"{first / imports:.1f} times as long (limit {FIRST_LIMIT:g})"
    )
    print(
        f"afterwards, to the first step: {again:.2f} s, "
        f"{again / imports:.2f} times as long (limit {AGAIN_LIMIT:g})"
    )
    return int(first > FIRST_LIMIT * imports or again > AGAIN_LIMIT * imports)


if __name__ == "__main__":
    sys.exit(main())
