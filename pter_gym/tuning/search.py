"""The search for gains: Optuna studies in a journal file, which can be stopped, resumed and shared."""

import hashlib
import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from pter_gym.benchmark.naming import find_policy
from pter_gym.benchmark.tuned import TABLE, TUNABLE, controller_of, read_table
from pter_gym.controllers import CONTROLLERS, Controller, Guided, PaceSchedule
from pter_gym.errors import ParameterError, needs_extra, unknown_name
from pter_gym.internal.checks import whole_number
from pter_gym.internal.files import FilePath, check_target, find_path
from pter_gym.scenarios import Scenario, find_pace, find_scenario
from pter_gym.scenarios.own_machine import AnyMachine, find_own
from pter_gym.tuning.examination import Examination, Verdict
from pter_gym.tuning.journal import keeping, open_journal
from pter_gym.tuning.offspring import offspring
from pter_gym.tuning.spaces import SPACES, Range, gains_at, point_at

TRIALS = 3000
"""The budget of a controller for a scenario and a pace: gains that are tried."""

STARTS = 5
"""Starts of a search, each from random gains of its own: where one ends, another may have half of the error."""

EPISODES = 200
"""The budget of a trial: training draws."""

FINALISTS = 40
"""The best trials of each start, which are judged once more on other draws; the best of them there is the result."""

STARTUP = 64
"""Trials at random, before every other one comes from a model of the scores, and the rest from the best trials."""

PARENTS = 20
"""Best trials from which others come."""

REDUCTION = 4
"""Of the trials that are judged on a part of the draws, one in so many goes on to so many times more of them."""

RUNGS = 3
"""Numbers of draws on which a trial is judged, one after the other; the last is all of them. Those of the others begin
otherwise."""


Gains = dict[str, float | bool]


@dataclass(frozen=True)
class Study:
    """The result of a search.

    Attributes
    ----------
    controller, scenario, pace
        Names.
    gains
        The best gains.
    verdict
        Their scores on draws that the search had not seen.
    trials, starts, episodes, seed
        Gains that were tried, starts, draws of each trial, and the seed of draws and searches.
    machine
        What was in place of the machines that the scenario draws, as it was given; None if nothing was.
    """

    controller: str
    scenario: str
    pace: str
    gains: Gains
    verdict: Verdict
    trials: int
    starts: int
    episodes: int
    seed: int
    machine: AnyMachine | None = None


def tune(
    controller: str,
    scenario: str,
    pace: str,
    *,
    trials: int = TRIALS,
    starts: int = STARTS,
    episodes: int = EPISODES,
    storage: FilePath = "pter-tune.journal",
    seed: int = 0,
    machine: AnyMachine | None = None,
    on_trial: Callable[[int, float], None] = lambda _count, _best: None,
) -> Study:
    """Search for a controller's gains on training draws of a scenario.

    The trials are shared out evenly, a share for each start and one more for the start that is best by then. A search
    that was stopped goes on where it was: a start ends when the storage holds its share of finished trials, whoever
    made them. Alone and not stopped, the same seed gives the same result.

    Parameters
    ----------
    controller, scenario, pace
        Names.
    trials, starts
        Gains to try, and starts from random gains; the first one tries the gains that are known, too.
    episodes
        Draws for each trial.
    storage
        Journal file of Optuna's, which may hold many studies; made if need be, in a folder that exists.
    seed
        Of the draws and the search, ≥ 0.
    machine
        One in place of those that the scenario draws, as in ``pter_gym.scenarios.find_scenario``.
    on_trial
        Called after each trial with the number of finished ones of all starts, and the best value of this one [m].

    Raises
    ------
    ParameterError
        If there is no such controller, scenario, pace or machine, a number is out of range, the storage cannot be
        written, or Optuna is not installed.
    StorageError
        If the storage cannot be written any more; a search with the same arguments goes on from the trials that it has.
    """
    storage = find_path("storage", storage)
    _check(controller, scenario, pace, storage, {"trials": trials, "starts": starts, "episodes": episodes}, seed)
    trials, starts, episodes, seed = map(int, (trials, starts, episodes, seed))
    own = None if machine is None else find_own(machine)  # read once, whatever becomes of its file
    counts = [-(-episodes // REDUCTION**k) for k in reversed(range(RUNGS))]
    rungs = [Examination(scenario, pace, count, 2 * seed, own) for count in counts]
    name = f"{_label(find_scenario(scenario, own))} {controller} {pace} {episodes} {seed}"
    search = Search(controller, pace, rungs)
    studies = _open(storage, name, [starts * seed + start for start in range(starts)])
    with keeping(storage):
        for point in known_points(controller, scenario, pace):
            studies[0][0].enqueue_trial(point, skip_if_exists=True)
        share = -(-trials // (starts + 1))
        for start, (study, rng) in enumerate(studies):
            search.run(study, rng, share, lambda done, best, before=start * share: on_trial(before + done, best))
        best, rng = min(studies, key=lambda each: finished_trials(each[0])[1][0].value)
        search.run(
            best, rng, trials - (starts - 1) * share, lambda done, value: on_trial((starts - 1) * share + done, value)
        )
    found = [gains for study, _ in studies for gains in search.best(study)]
    final = Examination(scenario, pace, episodes, 2 * seed + 1, own)
    judged = [(final.judge(make(controller, gains)), gains) for gains in found]
    verdict, gains = min(judged, key=lambda pair: pair[0].value)
    return Study(controller, scenario, pace, gains, verdict, trials, starts, episodes, seed, machine)


class Search(NamedTuple):
    """What a start searches for, and how it is judged: a trial on one examination after the other while it keeps up."""

    controller: str
    pace: str
    rungs: Sequence[Examination]

    def run(self, study: Any, rng: np.random.Generator, trials: int, on_trial: Callable[[int, float], None]) -> None:
        """Let a start go on until it has so many finished trials, one of them judged on all draws."""
        speed = find_pace(self.pace)
        finished, best = finished_trials(study)
        while len(finished) < trials or not best:
            if len(finished) >= STARTUP and len(finished) % 2:
                study.enqueue_trial(offspring(self.controller, [trial.params for trial in best[:PARENTS]], rng))
            trial = study.ask()
            self._judge(study, trial, make(self.controller, gains_at(_suggest(trial, self.controller), speed)))
            finished, best = finished_trials(study)
            on_trial(len(finished), best[0].value if best else math.inf)

    def best(self, study: Any) -> list[Gains]:
        """Return the gains of a start's best trials, the best first."""
        _, best = finished_trials(study)
        return [gains_at(trial.params, find_pace(self.pace)) for trial in best[:FINALISTS]]

    def _judge(self, study: Any, trial: Any, tried: Controller) -> None:
        """Judge a trial on more and more draws while it keeps up, and tell the study."""
        from optuna.trial import TrialState

        for k, rung in enumerate(self.rungs[:-1]):
            trial.report(rung.judge(tried).value, REDUCTION**k)
            if trial.should_prune():
                study.tell(trial, state=TrialState.PRUNED)
                return
        study.tell(trial, self.rungs[-1].judge(tried).value)


def make(controller: str, gains: Gains) -> Guided:
    """Return a controller with gains; the others are the paper's."""
    kind: Any = CONTROLLERS[controller]
    return kind(**gains)


def _check(controller: str, scenario: str, pace: str, storage: Path, numbers: Mapping[str, int], seed: int) -> None:
    if controller not in TUNABLE:
        raise unknown_name("controller", controller, TUNABLE)
    find_scenario(scenario)
    find_pace(pace)
    for name, number in numbers.items():
        whole_number(name, number)
    whole_number("seed", seed, at_least=0)
    check_target("storage", storage)


def _label(scenario: Scenario) -> str:
    """Return what tells the draws of a scenario from those of others."""
    label = f"{scenario.name}-v{scenario.version}"
    if scenario.own is None:
        return label
    return f"{label} {hashlib.sha256(repr((scenario.own, scenario.task)).encode()).hexdigest()[:16]}"


def _open(storage: Path, name: str, seeds: Sequence[int]) -> list[tuple[Any, np.random.Generator]]:
    """Return the starts of a search, new or as they were left, each with random numbers for what is left of it."""
    try:
        import optuna
    except ImportError:
        raise needs_extra("pter tune", "tune") from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        journal = open_journal(storage.resolve())
        studies = [
            optuna.create_study(storage=journal, study_name=f"{name} {start}", load_if_exists=True)
            for start in range(len(seeds))
        ]
    except (OSError, ValueError, LookupError, AssertionError) as error:  # what Optuna raises for other files
        raise ParameterError(f"storage must be a journal file of Optuna's, got {str(storage)!r}: {error}") from None
    return [_begin(study, seed) for study, seed in zip(studies, seeds, strict=True)]


def _begin(study: Any, seed: int) -> tuple[Any, np.random.Generator]:
    """Give a study its sampler and pruner, and return it with random numbers for what is left of it."""
    import optuna

    stream = _stream(study, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study.sampler = optuna.samplers.TPESampler(
            n_startup_trials=STARTUP, multivariate=True, constant_liar=True, seed=stream
        )
    study.pruner = optuna.pruners.SuccessiveHalvingPruner(min_resource=1, reduction_factor=REDUCTION)
    return study, np.random.default_rng(stream)


def _stream(study: Any, seed: int) -> int:
    """Return a seed of random numbers for what is left of a study, another one for each tuner that works on it."""
    begun = study.get_trials(deepcopy=False)
    shared = any(trial.state.name == "RUNNING" for trial in begun)
    return (seed + 1000003 * len(begun) + (os.getpid() if shared else 0)) % 2**32


def known_points(controller: str, scenario: str, pace: str) -> list[Gains]:
    """Return points of the search with the gains that a controller ships with, and has by default at a pace.

    Those that ship for the scenario and the pace come first, then the default ones, then those for others.
    """
    shipped = {
        (each, at): point_at(controller, controller_of(controller, entry, TABLE), find_pace(at))
        for each, controllers in read_table().items()
        for at, entry in controllers.get(controller, {}).items()
    }
    own = [shipped.pop((scenario, pace))] if (scenario, pace) in shipped else []
    return [*own, default_point(controller, pace), *shipped.values()]


def default_point(controller: str, pace: str) -> Gains:
    """Return the point of the search with the gains that a controller has by default at a pace."""
    policy = cast("Guided | PaceSchedule", find_policy(controller))
    return point_at(controller, policy.at(find_pace(pace)), find_pace(pace))


def _suggest(trial: Any, controller: str) -> Gains:
    """Return the point of a trial."""
    return {
        name: trial.suggest_float(name, space.low, space.high, log=space.log)
        if isinstance(space, Range)
        else trial.suggest_categorical(name, space)
        for name, space in SPACES[controller].items()
    }


def finished_trials(study: Any) -> tuple[list[Any], list[Any]]:
    """Return the trials with a value, and those among them that were judged on all draws, the best first."""
    finished = [trial for trial in study.get_trials(deepcopy=False) if trial.value is not None]
    whole = [trial for trial in finished if trial.state.name == "COMPLETE"]
    return finished, sorted(whole, key=lambda trial: (trial.value, trial.number))
