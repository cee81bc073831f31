"""Measure a control step in the WebAssembly module and natively, and write both to docs/browser.md.

Worlds of the paper's task with a law and their telemetry: one by the wrapper in node, one and many in numba's kernel.
"""

import subprocess
import time

import numpy as np
from pages import ROOT, write_block

from pter_gym.benchmark.naming import find_policy
from pter_gym.engine.batch import Batch
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.web.tables import MODULE, STATIC, TABLES

DOCS = ROOT / "docs"

SIMULATOR = ("pter.js", "world.js", "network.js", "drawn.js")
"""Its files beside the module; the others are those of the page."""

STEPS, ROUNDS, TURNS = 200, 100, 5
LAW = "impedance-tuned"


def main() -> None:
    """Measure and write."""
    turns = [(in_node(), natively(1), natively(64)) for _ in range(TURNS)]
    module, alone, many = np.min(turns, axis=0)
    files = sum(path.stat().st_size for path in map(STATIC.joinpath, SIMULATOR))
    write_block(
        DOCS / "browser.md",
        "speed",
        f"The module has {MODULE.stat().st_size / 1000:.0f} kB, its tables {TABLES.stat().st_size / 1000:.0f} kB, the "
        f"JavaScript {files / 1000:.0f} kB.\nA control step with law and telemetry takes {module:.1f} µs in V8 "
        f"(node), {module / alone:.2f} times\nthe {alone:.1f} µs of a world alone in numba's kernel. A block of 64 "
        f"takes {many:.2f} µs for each.\n",
    )


def in_node() -> float:
    """Return the fastest time of a control step in node [µs]."""
    arguments = [str(STATIC), str(STEPS), str(ROUNDS), LAW]
    script = str(DOCS / "make" / "web_speed.mjs")
    return float(subprocess.run(["node", script, *arguments], capture_output=True, text=True, check=True).stdout)


def natively(worlds: int) -> float:
    """Return the fastest time of a control step of one of so many worlds in numba's kernel [µs]."""
    batch = Batch(BASELINE, PathFollowing(pace=0.25), worlds, sensors="force")
    policy = find_policy(LAW).bind(BASELINE, batch.layout)
    taken: list[float] = []
    for round_ in range(ROUNDS):
        obs, _ = batch.reset([round_] * worlds)
        begin = time.perf_counter()
        batch.rollout(obs, policy.law, policy.gains, STEPS)
        taken.append(1e6 * (time.perf_counter() - begin) / STEPS / worlds)
    return min(taken)


if __name__ == "__main__":
    main()
