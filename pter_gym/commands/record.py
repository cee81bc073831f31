"""``pter record``: demonstrations for imitation."""

import math
from pathlib import Path
from typing import Annotated

import tyro

from pter_gym.commands.arguments import check_file, split
from pter_gym.internal.terminal import progress_bar, say

DEMONSTRATORS = "predictive,single-dof-tuned,torque-feedback-tuned"


def record(
    policies: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = DEMONSTRATORS,
    scenarios: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = "standard,everything",
    paces: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = "slow,medium,brisk",
    episodes: int = 4,
    seed: int = 0,
    out: Path = Path("pter-demonstrations.npz"),
) -> None:
    """Write what policies see and do to a file, for imitation.

    They act on training draws of scenarios; the stored evaluation episodes are never read. The file is a NumPy archive
    without pickles, for `pter_gym.benchmark.demonstrations.read_demonstrations`.

    Example: pter record --policies residual --episodes 2 --out demonstrations.npz

    Args:
        policies: Separated by commas, as for `pter benchmark --scenario`.
        scenarios: Scenarios whose training draws are used, separated by commas.
        paces: Commanded paces, separated by commas.
        episodes: Training draws for each scenario and pace, at least 1; all policies have the same.
        seed: Seed of the draws, at least 0.
        out: File to write; its folder must exist.
    """
    from pter_gym.benchmark.demonstrations import record as simulate
    from pter_gym.benchmark.demonstrations import write_demonstrations

    check_file(out, ".npz")
    names = split(policies), split(scenarios), split(paces)
    with progress_bar() as progress:
        task = progress.add_task("record", total=math.prod(len(each) for each in names) * max(episodes, 0))
        found = simulate(*names, episodes=episodes, seed=seed, on_episode=lambda: progress.advance(task))
    write_demonstrations(found, out)
    say(f"{len(found)} episodes, {len(found.obs)} decisions, {out.stat().st_size / 1e6:.1f} MB")
    say(f"wrote {out}")
