"""``pter record``: data sets for offline learning."""

from pathlib import Path
from typing import Annotated

import tyro

from pter_gym._commands.arguments import split
from pter_gym._internal.checks import names_in
from pter_gym._internal.terminal import progress_bar, say
from pter_gym.errors import unknown_name
from pter_gym.scenarios import find_scenario


def record(
    scenario: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = "standard,everything",
    level: Annotated[str, tyro.conf.arg(metavar="NAME,…")] = "expert,medium,replay,random",
    steps: int = 1_000_000,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Write Minari data sets for offline learning.

    Policies of several levels run on training draws of scenarios; the stored evaluation episodes are never read. The
    data sets are called pter/SCENARIO/LEVEL-v0. The same command always writes the same bytes.

    Example: pter record --scenario standard --level expert --steps 20000 --out data

    Args:
        scenario: Scenarios, separated by commas.
        level: Levels of the policies, separated by commas: expert, medium, replay, random.
        steps: Control steps of each data set; its last episode is completed.
        seed: Seed of the draws, the resets and the noise, at least 0.
        out: Folder for the data sets; by default the one where Minari looks for them.
    """
    from pter_gym._internal.terminal import make_folder
    from pter_gym.tools.datasets import LEVELS, record_episodes, write_dataset
    from pter_gym.tools.datasets.writing import load_minari

    scenarios, levels = names_in("scenario", split(scenario)), names_in("level", split(level))
    for each in scenarios:
        find_scenario(each)
    for each in levels:
        if each not in LEVELS:
            raise unknown_name("level", each, LEVELS)
    load_minari()
    if out is not None:
        make_folder(out)
    with progress_bar() as progress:
        for each in scenarios:
            for which in levels:
                task = progress.add_task(f"{each}, {which}", total=steps)
                episodes = record_episodes(
                    each, which, steps, seed=seed, on_steps=lambda done, task=task: progress.advance(task, done)
                )
                command = f"pter record --scenario {each} --level {which} --steps {steps} --seed {seed}"
                say(f"wrote {write_dataset(each, which, episodes, out, seed=seed, command=command)}")
