"""Train a policy from several seeds, score each on fresh episodes, and put what comes out into docs/agents.md.

    NUMBA_NUM_THREADS=1 python docs/make/seeds.py RUNS
    NUMBA_NUM_THREADS=1 python docs/make/seeds.py RUNS --algorithm residual --scenario all --seeds 5
    python docs/make/seeds.py RUNS --no-train

RUNS holds a folder for each run. A run that is finished is not repeated, and one that was stopped goes on. The seed of
the episodes follows from the content of all policies. Which seed is the median one follows from the validation, on
training-side draws. Needs the agents extra.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

import tyro
from ablations import finish, is_finished
from pages import AGENTS, put_block, table

from pter_agents.algorithms import load_settings
from pter_agents.exporting import export_run
from pter_agents.training import PROGRESS, Arguments
from pter_agents.worlds import ALL, MIXED
from pter_gym.benchmark import Leaderboard, leaderboards, run_scenario
from pter_gym.benchmark.evaluation import fresh_seed
from pter_gym.policies import Neural, load_policy
from pter_gym.scenarios import PACES


def validated(run: Path) -> float:
    """The geometric mean over the paces of a run's path errors on validation draws [m]."""
    found = json.loads((run / PROGRESS).read_text("utf-8"))
    last = found[max(found, key=int)]
    return math.exp(sum(math.log(scores["path_error_m"]) for scores in last.values()) / len(last))


def median_of(runs: dict[str, Path]) -> str:
    """The name of the median run by validation; of an even number the better of both in the middle."""
    ordered = sorted(runs, key=lambda name: validated(runs[name]))
    return ordered[(len(ordered) - 1) // 2]


def load(run: Path, name: str) -> Neural:
    """The policy of a run."""
    export_run(run, run.parent / "policies", name=name)
    return load_policy(name, run.parent / "policies")


def cell(name: str, boards: Sequence[Leaderboard]) -> str:
    """The path errors of a policy [mm] on the leaderboards of a scenario, in brackets where it has no rank."""
    standings = [next(each for each in board.standings if each.policy == name) for board in boards]
    errors = [(f"{1000.0 * each.scores['path_error_m'].value:.1f}", each.rank is not None) for each in standings]
    return ", ".join(error if ranks else f"({error})" for error, ranks in errors)


def row(name: str, run: Path, boards: Sequence[Sequence[Leaderboard]], median: str) -> list[str]:
    """One line of the table."""
    number = name.rpartition("-")[2]
    label = f"**{number}**, the median" if name == median else number
    return [label, *(cell(name, each) for each in boards), f"{1000 * validated(run):.2f}"]


def main(
    runs: tyro.conf.Positional[Path],
    algorithm: str = "ppo",
    scenario: str = "standard",
    steps: int = 20_000_000,
    seeds: int = 10,
    train: bool = True,
    write: bool = True,
) -> None:
    """Train what is missing, unless told not to, and write the table of what is finished into the page, or print it."""
    found: dict[str, Path] = {}
    for seed in range(seeds):
        folder = runs / f"{algorithm}-{scenario}-{seed}"
        settings = load_settings(algorithm)
        given = Arguments(algorithm=algorithm, scenario=scenario, pace="all", steps=steps, seed=seed, settings=settings)
        if train:
            finish(folder, given)
        if is_finished(folder, given):
            found[folder.name] = folder
            print(f"seed {seed}: {folder}", flush=True)
    policies = {name: load(run, name) for name, run in found.items()}
    scenarios = MIXED if scenario == ALL else (scenario,)
    fresh = {each: fresh_seed(each, policies) for each in scenarios}
    boards = [leaderboards(run_scenario(each, policies, fresh=seed)) for each, seed in fresh.items()]
    median = median_of(found)
    told = ", ".join(f"{own[0].episodes} of `{own[0].scenario}` from seed {fresh[own[0].scenario]}" for own in boards)
    head = (
        f"`pter train {algorithm} --scenario {scenario} --steps {steps}`: path errors in mm at {', '.join(PACES)} pace "
        f"on fresh episodes, {told}. In brackets: no rank. *Validation*: the geometric mean of the three path errors "
        "on training-side draws, by which the median seed is chosen."
    )
    rows = [row(name, run, boards, median) for name, run in found.items()]
    text = f"{fill(head, 120)}\n\n{table(['Seed', *scenarios, 'Validation'], rows, '---')}"
    put_block(AGENTS, f"seeds: {algorithm} {scenario}", text, write=write)
    print(f"median: {median}")


if __name__ == "__main__":
    tyro.cli(main)
