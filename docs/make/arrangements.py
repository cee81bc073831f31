"""What each clutch buys: tuned laws and policies that correct them, on machines with other clutches; which-clutches.md.

    python docs/make/arrangements.py                does what is missing, one run on each core, then makes the page
    python docs/make/arrangements.py --minutes 60   stops beginning new runs after an hour; the next call goes on
    python docs/make/arrangements.py --no-run       makes the page of what there is

A run is a line of docs/make/arrangements.jsonl: a law tuned at each pace, or a policy trained at all of them, which
corrects the best law. Gains are searched without those that are known, which were found on the paper's machine, and the
best law is chosen by training draws; scores are those of fresh evaluation episodes. Needs the extra `agents`; takes
about two hours of CPU time.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, NamedTuple

import tyro
from cores import finished, perform

from pter_gym.controllers import PaceSchedule
from pter_gym.params import ARRANGEMENTS, BASELINE, PAPER_CLUTCHES, Machine
from pter_gym.scenarios import PACES

SCRIPT = Path(__file__).resolve()

BRAKES, (COUPLED, INVERTED) = PAPER_CLUTCHES[:2], PAPER_CLUTCHES[2:]
CLUTCHES = {
    "paper": PAPER_CLUTCHES,
    **ARRANGEMENTS,
    "brakes-and-coupling-1-2": (*BRAKES, replace(COUPLED, row=(1.0, -0.5))),
    "brakes-and-coupling-2-1": (*BRAKES, replace(COUPLED, row=(1.0, -2.0))),
    "couplings-alone": (COUPLED, INVERTED),
}
"""The arrangements that are compared, by name; the paper's is the one that was built."""

SCENARIOS = ("standard", "paths")
LAWS = ("single-dof", "velocity-ratio", "torque-feedback", "impedance")
POLICY = "residual"
SETTINGS: dict[str, Any] = {
    "truncation": 0.5,
    "history": (),
    "averages": (),
    "hidden": (64, 64),
    "value_hidden": (64, 64),
}
"""In place of the policy's own settings: laws may be far from the path, and small networks learn in less time."""

FRESH = 20261125
"""Seed of the episodes that are scored."""


class Sizes(NamedTuple):
    """Trials, starts and draws of a search at a pace; steps of a training; episodes scored. They are never mixed."""

    trials: int = 300
    starts: int = 2
    draws: int = 60
    steps: int = 4_000_000
    episodes: int = 100


SIZES = Sizes()


class Run(NamedTuple):
    """A law that is tuned or a policy that is trained, its arrangement, its scenario, and the seed."""

    arrangement: str
    scenario: str
    what: str
    seed: int

    @property
    def machine(self) -> Machine:
        return replace(BASELINE, clutches=CLUTCHES[self.arrangement])


Found = dict[str, Any]
"""By pace: path errors [mm] of the episodes by stratum, and other mean scores. Of a law too: gains, and values on
training draws [m], by pace; of a policy: the law that it corrects."""


def planned_laws(scenarios: Iterable[str], laws: Iterable[str]) -> Iterator[Run]:
    """Return the runs of laws, all arrangements before the next law."""
    for law, scenario, name in product(laws, scenarios, CLUTCHES):
        yield Run(name, scenario, law, 0)


def planned_policies(scenarios: Iterable[str], seeds: int) -> Iterator[Run]:
    """Return the runs of policies, all arrangements before the next seed."""
    for scenario, seed, name in product(scenarios, range(seeds), CLUTCHES):
        yield Run(name, scenario, POLICY, seed)


def best_law(runs: Mapping[Run, Found], arrangement: str, scenario: str) -> str | None:
    """Return the law that is best on training draws."""
    mine = {
        run.what: found for run, found in runs.items() if run[:2] == (arrangement, scenario) and "training" in found
    }
    return min(mine, key=lambda law: sum(mine[law]["training"].values()), default=None)


def tuned(run: Run, sizes: Sizes) -> tuple[PaceSchedule, Found]:
    """Return a law with gains for each pace; the gains, and their values on other training draws [m]."""
    from pter_gym.tools.tuning import tune
    from pter_gym.tools.tuning.search import make

    found: Found = {"gains": {}, "training": {}}
    search: dict[str, Any] = {"trials": sizes.trials, "starts": sizes.starts, "episodes": sizes.draws}
    with TemporaryDirectory() as folder:
        for pace in PACES:
            storage = Path(folder) / f"{pace}.journal"
            best = tune(run.what, run.scenario, pace, machine=run.machine, known=False, storage=storage, **search)
            found["gains"][pace], found["training"][pace] = best.gains, best.assessment.value
    knots = tuple((speed, make(run.what, found["gains"][pace])) for pace, speed in PACES.items())
    return PaceSchedule(knots), found


def trained(run: Run, sizes: Sizes) -> tuple[Any, Found]:
    """Return a policy, trained as `pter train residual` does, and the law that it corrects."""
    from pter_agents import training
    from pter_agents.algorithms import load_settings
    from pter_agents.prepare import make_interface
    from pter_gym.policies import NeuralPolicy
    from pter_gym.policies._interface import Base
    from pter_gym.scenarios._own_machine import OwnMachine

    runs = of_size(sizes)
    law = best_law(runs, run.arrangement, run.scenario)
    assert law, "laws come before policies"
    gains = runs[Run(run.arrangement, run.scenario, law, 0)]["gains"]
    base = Base(controller=law, paces=tuple(PACES.values()), gains=tuple(gains[pace] for pace in PACES))
    settings, own = replace(load_settings(POLICY), **SETTINGS), OwnMachine(run.machine)
    given: dict[str, Any] = {"scenario": run.scenario, "pace": "all", "steps": sizes.steps, "seed": run.seed}
    arguments = training.Arguments(algorithm=POLICY, settings=settings, machine=own, **given)
    draws = training.make_draws(arguments)
    interface = make_interface(settings, run.scenario, draws, run.seed, own.machine, base)
    worlds = training.make_training_worlds(arguments, draws, interface)
    model = training.make_model(arguments, worlds)
    try:
        while model.steps < sizes.steps:
            model.advance()
        return NeuralPolicy(worlds.interface, model.actor()), {"law": law}
    finally:
        model.close()
        worlds.close()


def scored(run: Run, policy: Any, sizes: Sizes) -> Found:
    """Return the scores of a policy on fresh evaluation episodes, on the run's machine."""
    from pter_gym.benchmark._evaluation import Batches, Bound, evaluate
    from pter_gym.benchmark.episodes import find_episodes
    from pter_gym.controllers import bind
    from pter_gym.tasks.path_following import observation_layout

    found: Found = {}
    acting = bind(policy, run.machine, observation_layout(run.machine, "torque"))
    for pace in PACES:
        episodes = find_episodes(run.scenario, pace, FRESH).first(sizes.episodes)
        batches = Batches(replace(episodes, machines=(run.machine,) * len(episodes)))
        scores, _, _ = evaluate(Bound(acting, None, "torque", type(policy)), batches, 1)
        errors: dict[str, list[float]] = {}
        for stratum, error in zip(episodes.strata, scores["path_error_m"], strict=True):
            errors.setdefault(stratum, []).append(round(1000.0 * float(error), 2))
        means = {name: float(scores[name].mean()) for name in ("completed", "mean_pace_error", "segment_pace_error")}
        found[pace] = {"errors": dict(sorted(errors.items())), **means}
    return found


def one(run: Run, sizes: Sizes) -> Found:
    """Tune or train, and return the scores."""
    policy, how = (trained if run.what == POLICY else tuned)(run, sizes)
    return {**scored(run, policy, sizes), **how, "seconds": round(process_time(), 1)}


def stored() -> dict[tuple[Run, Sizes], Found]:
    """Return the runs that are finished."""
    return {(Run(*run), Sizes(*of)): found for (run, of), found in finished(SCRIPT)}


def of_size(sizes: Sizes) -> dict[Run, Found]:
    """Return the finished runs of a size."""
    return {run: found for (run, of), found in stored().items() if of == sizes}


def tell(key: tuple[Run, Sizes], found: Found) -> str:
    """Return a line about a run: its cost."""
    return f"{' '.join(map(str, key[0]))} {found['seconds']} s"


def main(
    sizes: Sizes = SIZES,
    scenarios: tuple[str, ...] = SCENARIOS,
    laws: tuple[str, ...] = LAWS,
    seeds: int = 5,
    minutes: float = 600.0,
    only: str = "",
    no_run: bool = False,
) -> None:
    """Do what is missing, and make the page; ``only`` is for the processes that run."""
    if only:
        run, of = json.loads(only)
        print(json.dumps(one(Run(*run), Sizes(*of))))
        return
    if not no_run:
        for runs in (planned_laws(scenarios, laws), planned_policies(scenarios, seeds)):
            perform(SCRIPT, stored(), ((run, sizes) for run in runs), minutes, tell)
    from arrangements_page import make

    found = of_size(sizes)
    make(found, {key: best_law(found, *key) for key in product(CLUTCHES, scenarios)}, CLUTCHES)


if __name__ == "__main__":
    tyro.cli(main)
