"""Make stored evaluation episodes in pter_gym/episodes again: `python docs/make/store_episodes.py [NAME …]`.

They change every published score: raise the version of a scenario whose episodes change.
"""

from pathlib import Path

import tyro

from pter_gym.benchmark.episodes import FOLDER, store_episodes
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.scenarios.evaluation_draws import evaluation_draws


def main(names: tyro.conf.Positional[tuple[str, ...]] = tuple(SCENARIOS), folder: Path = FOLDER) -> None:
    """Store the evaluation episodes of scenarios, of all by default."""
    for name in names:
        scenario = find_scenario(name)
        machines, tasks, strata = zip(*evaluation_draws(scenario), strict=True)
        seeds = list(range(scenario.episodes))
        path = store_episodes(name, machines, tasks, seeds, strata, version=scenario.version, folder=folder)
        print(path.name, path.stat().st_size, {kind: strata.count(kind) for kind in sorted(set(strata))})


if __name__ == "__main__":
    tyro.cli(main)
