"""``pter record``: data sets for offline learning."""

from functools import partial
from itertools import product
from pathlib import Path
from shlex import quote
from typing import Literal

from pter_gym._commands.arguments import ScenarioName
from pter_gym._commands.terminal import conclude, progress_bar, say


def record(
    scenario: tuple[ScenarioName, ...] = ("standard", "everything"),
    level: tuple[Literal["expert", "random"], ...] = ("expert", "random"),
    steps: int = 1_000_000,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Write Minari data sets for offline learning.

    A trained policy and random actions run on training episodes of scenarios. The data sets are
    called pter/SCENARIO/LEVEL-v0. The same command always writes the same bytes.

    Example: pter record --scenario standard --level expert --steps 20000 --out data

    Args:
        scenario: Scenarios.
        level: Who acts: a trained policy, or random actions.
        steps: Control steps of each data set; its last episode is completed.
        seed: Seed of the contexts, the resets and the random actions, at least 0.
        out: Folder for the data sets; by default the one where Minari looks for them.
    """
    from pter_gym._internal.files import make_folder
    from pter_gym.tools.datasets.recording import record_transitions
    from pter_gym.tools.datasets.writing import load_minari, write_dataset

    if out is not None:
        make_folder(out)
    load_minari()
    with progress_bar() as progress:
        for name, which in product(scenario, level):
            task = progress.add_task(f"{name}, {which}", total=steps)
            episodes = record_transitions(
                name, which, steps, seed=seed, on_steps=partial(progress.advance, task)
            )
            command = f"pter record --scenario {name} --level {which} --steps {steps} --seed {seed}"
            say(f"wrote {write_dataset(name, which, episodes, out, seed=seed, command=command)}")
    folder = f"MINARI_DATASETS_PATH={quote(str(out))} " if out else ""
    conclude([], f"{folder}minari show pter/{scenario[0]}/{level[0]}-v0")
