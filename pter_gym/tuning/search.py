"""The search for gains: an Optuna study in an SQLite file, which can be stopped, resumed and shared."""

import math
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from filelock import FileLock

from pter_gym.benchmark.naming import find_policy
from pter_gym.benchmark.tuned import TUNABLE
from pter_gym.controllers import CONTROLLERS, Controller, Guided, PaceSchedule
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.scenarios import find_pace, find_scenario
from pter_gym.tuning.examination import Examination, Verdict
from pter_gym.tuning.offspring import offspring
from pter_gym.tuning.spaces import SPACES, Range, gains_at, point_at

TRIALS = 2000
"""The budget of a controller for a scenario and a pace: gains that are tried. It caps what learning may try, too."""

EPISODES = 200
"""The budget of a trial: training draws."""

FINALISTS = 40
"""The best trials, which are judged once more on other draws; the best of them there is the result."""

STARTUP = 64
"""Trials at random, before every other one comes from a model of the scores, and the rest from the best trials."""

PARENTS = 20
"""Best trials from which others come."""

REDUCTION = 4
"""Of the trials that are judged on a part of the draws, one in so many goes on to so many times more of them."""

RUNGS = 3
"""Numbers of draws on which a trial is judged, one after the other; the last is all of them. Those of the others begin
otherwise."""

WAIT = 120.0
"""Seconds to wait for the storage while others write to it."""


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
    trials, episodes, seed
        Trials in the study, draws of each, and the seed of the draws.
    """

    controller: str
    scenario: str
    pace: str
    gains: dict[str, float | bool]
    verdict: Verdict
    trials: int
    episodes: int
    seed: int


def tune(
    controller: str,
    scenario: str,
    pace: str,
    *,
    trials: int = TRIALS,
    episodes: int = EPISODES,
    storage: Path = Path("pter-tune.db"),
    seed: int = 0,
    on_trial: Callable[[int, float], None] = lambda _count, _best: None,
) -> Study:
    """Search for a controller's gains on training draws of a scenario.

    A study that was stopped goes on where it was: it ends when its storage holds ``trials`` finished trials, whoever
    made them. Alone and not stopped, the same seed gives the same result.

    Parameters
    ----------
    controller, scenario, pace
        Names.
    trials, episodes
        Gains to try, and draws for each.
    storage
        SQLite file, which may hold many studies; made if need be, in a folder that exists.
    seed
        Of the draws and the search, ≥ 0.
    on_trial
        Called after each trial with the number of finished ones and the best value so far [m].

    Raises
    ------
    ParameterError
        If there is no such controller, scenario or pace, a number is out of range, the storage cannot be written, or
        Optuna is not installed.
    """
    _check(controller, scenario, pace, trials, episodes, seed, storage)
    study = _open(storage, f"{scenario}-v{find_scenario(scenario).version} {controller} {pace} {episodes} {seed}", seed)
    rng = np.random.default_rng(_stream(study, seed))
    study.enqueue_trial(default_point(controller, pace), skip_if_exists=True)
    speed = find_pace(pace)
    rungs = [Examination(scenario, pace, -(-episodes // REDUCTION**k), 2 * seed) for k in reversed(range(RUNGS))]
    finished, best = _finished(study)
    while len(finished) < trials or not best:
        if len(finished) >= STARTUP and len(finished) % 2:
            study.enqueue_trial(offspring(controller, [trial.params for trial in best[:PARENTS]], rng))
        trial = study.ask()
        _judge(study, trial, make(controller, gains_at(_suggest(trial, controller), speed)), rungs)
        finished, best = _finished(study)
        on_trial(len(finished), best[0].value if best else math.inf)
    final = Examination(scenario, pace, episodes, 2 * seed + 1)
    last = [gains_at(trial.params, speed) for trial in best[:FINALISTS]]
    judged = [(final.judge(make(controller, gains)), gains) for gains in last]
    verdict, gains = min(judged, key=lambda pair: pair[0].value)
    return Study(controller, scenario, pace, gains, verdict, len(finished), episodes, seed)


def make(controller: str, gains: dict[str, float | bool]) -> Guided:
    """Return a controller with gains; the others are the paper's."""
    kind: Any = CONTROLLERS[controller]
    return kind(**gains)


def _judge(study: Any, trial: Any, tried: Controller, rungs: Sequence[Examination]) -> None:
    """Judge a trial on more and more draws while it keeps up, and tell the study."""
    from optuna.trial import TrialState

    for k, rung in enumerate(rungs[:-1]):
        trial.report(rung.judge(tried).value, REDUCTION**k)
        if trial.should_prune():
            study.tell(trial, state=TrialState.PRUNED)
            return
    study.tell(trial, rungs[-1].judge(tried).value)


def _check(controller: str, scenario: str, pace: str, trials: int, episodes: int, seed: int, storage: Path) -> None:
    if controller not in TUNABLE:
        raise unknown_name("controller", controller, TUNABLE)
    find_scenario(scenario)
    find_pace(pace)
    for name, number, least in (("trials", trials, 1), ("episodes", episodes, 1), ("seed", seed, 0)):
        if number < least:
            raise ParameterError(f"{name} must be ≥ {least}, got {number!r}")
    if not os.access(storage.parent, os.W_OK | os.X_OK):
        raise ParameterError(f"storage must be a file in a folder that can be written to, got {str(storage)!r}")


def _open(storage: Path, name: str, seed: int) -> Any:
    """Return the study of that name, new or as it was left."""
    try:
        import optuna
        from sqlalchemy import event
        from sqlalchemy.exc import SQLAlchemyError
    except ImportError:
        raise ParameterError("pter tune needs Optuna: install pter-gym[tune]") from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        with FileLock(storage.with_name(f".{storage.name}.lock")):  # two that make its tables at once would fail
            file = optuna.storages.RDBStorage(
                f"sqlite:///{storage.resolve()}", engine_kwargs={"connect_args": {"timeout": WAIT}}
            )
            event.listen(file.engine, "connect", _write_ahead)
            file.engine.dispose()
            study = optuna.create_study(storage=file, study_name=name, load_if_exists=True)
    except SQLAlchemyError as error:
        raise ParameterError(f"storage must be an SQLite file of Optuna's: {error}") from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study.sampler = optuna.samplers.TPESampler(
            n_startup_trials=STARTUP,
            multivariate=True,
            constant_liar=True,
            seed=_stream(study, seed),
        )
    study.pruner = optuna.pruners.SuccessiveHalvingPruner(min_resource=1, reduction_factor=REDUCTION)
    return study


def _stream(study: Any, seed: int) -> int:
    """Return a seed of random numbers for what is left of a study, another one for each tuner that works on it."""
    begun = study.get_trials(deepcopy=False)
    shared = any(trial.state.name == "RUNNING" for trial in begun)
    return (seed + 1000003 * len(begun) + (os.getpid() if shared else 0)) % 2**32


def _write_ahead(connection: Any, _: Any) -> None:
    """Let SQLite write to a log first: a trial then takes a tenth of the time, and readers do not wait for writers."""
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=NORMAL")


def default_point(controller: str, pace: str) -> dict[str, float | bool]:
    """Return the point of the search with the gains that a controller has by default at a pace."""
    policy = cast("Guided | PaceSchedule", find_policy(controller))
    return point_at(controller, policy.at(find_pace(pace)), find_pace(pace))


def _suggest(trial: Any, controller: str) -> dict[str, float | bool]:
    """Return the point of a trial."""
    return {
        name: trial.suggest_float(name, space.low, space.high, log=space.log)
        if isinstance(space, Range)
        else trial.suggest_categorical(name, space)
        for name, space in SPACES[controller].items()
    }


def _finished(study: Any) -> tuple[list[Any], list[Any]]:
    """Return the trials with a value, and those among them that were judged on all draws, the best first."""
    finished = [trial for trial in study.get_trials(deepcopy=False) if trial.value is not None]
    whole = [trial for trial in finished if trial.state.name == "COMPLETE"]
    return finished, sorted(whole, key=lambda trial: (trial.value, trial.number))
