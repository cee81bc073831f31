"""Data of the package that a script makes: `python docs/make/store.py episodes|paces`."""

from pathlib import Path

import tyro

from pter_gym._internal.files import write_text_atomic
from pter_gym.benchmark import _pacing as pacing
from pter_gym.benchmark import episodes as stored
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.scenarios._evaluation_draws import evaluation_draws

PACES_HEAD = """\
# Dampers along the path [N·s/m] with which the paper's controllers keep the commanded paces on the training
# draws of each scenario; their other gains are those of pter.toml. derived: made by `python docs/make/store.py paces`.
"""


def episodes(names: tyro.conf.Positional[tuple[str, ...]] = tuple(SCENARIOS), folder: Path = stored.FOLDER) -> None:
    """Store the evaluation episodes of scenarios, of all by default, in pter_gym/episodes.

    They change every published score: raise the version of a scenario whose episodes change.
    """
    for name in names:
        scenario = find_scenario(name)
        machines, tasks, strata = zip(*evaluation_draws(scenario), strict=True)
        seeds = list(range(scenario.episodes))
        path = stored.store_episodes(name, machines, tasks, seeds, strata, version=scenario.version, folder=folder)
        print(path.name, path.stat().st_size, {kind: strata.count(kind) for kind in sorted(set(strata))})


def paces() -> None:
    """Solve the dampers in pter_gym/presets/paces.toml again, after a change of the physics."""
    text = PACES_HEAD
    for scenario, controllers in pacing.solve_table().items():
        for name, dampers in controllers.items():
            text += f"\n[{scenario}.{name}]\n"
            text += "".join(f"{pace} = {damping!r}\n" for pace, damping in dampers.items())
    write_text_atomic(pacing.TABLE, text)


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({each.__name__: each for each in (episodes, paces)})
