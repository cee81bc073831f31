"""Train the algorithms beside `ppo` from scratch, five seeds each, and put what comes out into docs/agents.md.

    NUMBA_NUM_THREADS=1 python docs/make/algorithms.py RUNS
    python docs/make/algorithms.py RUNS --no-train

RUNS holds a folder for each run. A run that is finished is not repeated, and one that was stopped goes on. The scores
are of validation draws. Needs the agents extra.
"""

from pathlib import Path
from textwrap import fill

import tyro
from ablations import EPISODES, HEADER, arguments, results, row
from pages import AGENTS, put_block, table

from pter_agents.algorithms import load_settings

STEPS = {"recurrent": 2_000_000, "sac": 200_000, "tqc": 200_000}
"""Control steps, some minutes of one core for each."""


def main(
    runs: tyro.conf.Positional[Path],
    seeds: int = 5,
    train: bool = True,
    write: bool = True,
) -> None:
    """Train what is missing, unless told not to, and write the table of what is finished into the page, or print it."""
    planned = {
        (name, runs / f"{name}-seed{seed}"): arguments(name, load_settings(name), "standard", steps, seed)
        for seed in range(seeds)
        for name, steps in STEPS.items()
    }
    found = results(planned, train=train)
    head = (
        f"`standard`, {seeds} seeds, {EPISODES} validation draws at each pace; medians over the seeds at slow, medium, "
        "brisk pace, and how many seeds keep the limits of a rank at each:"
    )
    rows = [row(f"`{name}`, {STEPS[name] / 1e6:g} M steps", scores) for name, scores in found.items()]
    content = f"{fill(head, 120)}\n\n{table(['Algorithm', *HEADER[1:]], rows, '---')}"
    put_block(AGENTS, "algorithms", content, write=write)


if __name__ == "__main__":
    tyro.cli(main)
