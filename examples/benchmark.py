"""Rank policies on test episodes, store the runs, and read the scores."""

from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from pter_gym.benchmark import ResultsFolder, find_policy, leaderboards, print_boards, run_scenario


def half_closed(observations):
    """Return volts (N, 4) for observations (N, entries): any such function is a policy."""
    return np.full((len(observations), 4), 5.0)


policies = {
    "residual": find_policy("residual"),
    "single-dof-tuned": find_policy("single-dof-tuned"),
    "half-closed": half_closed,
}
folder = ResultsFolder(Path(mkdtemp()) / "results")
runs = run_scenario("standard", policies, ["medium"], episodes=20, seed=1, results=folder)
print_boards(runs)

# each run has an array of every score, an entry for each episode
for run in runs:
    errors = 1000 * run.scores["path_error_m"]
    print(f"{run.policy}: {errors.mean():.1f} mm, worst {errors.max():.1f} mm")
(board,) = leaderboards(folder.runs())
print(f"the folder holds {len(folder.runs())} runs on {board.scenario} at the {board.pace} pace")
