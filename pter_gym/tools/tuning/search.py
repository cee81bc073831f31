"""The search for gains: an Optuna study for each start in a journal file, which can be stopped, resumed and shared."""

import hashlib
import math
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from filelock import FileLock

from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import FilePath, check_target, find_path
from pter_gym.benchmark._examination import Assessment, Examination
from pter_gym.benchmark._naming import find_policy
from pter_gym.benchmark.tuned import TABLE, TUNABLE, controller_of, read_table
from pter_gym.controllers import CONTROLLERS, Guided, PaceSchedule
from pter_gym.errors import ParameterError, StorageError, needs_extra, unknown_name
from pter_gym.scenarios import Scenario, find_pace, find_scenario
from pter_gym.scenarios._own_machine import AnyMachine, find_own
from pter_gym.tools.tuning.spaces import SPACES, Range, gains_at, point_at

TRIALS = 3000
"""The budget of a controller for a scenario and a pace: gains that are tried."""

STARTS = 5
"""Starts of a search, each from random gains of its own: where one ends, another may have half of the error."""

EPISODES = 200
"""The budget of a trial: training draws."""

FINALISTS = 40
"""The best trials of each start, which are judged once more on other draws; the best of them there is the result."""

STARTUP = 24
"""Trials at random before those of Optuna's evolution strategy."""

REDUCTION = 4
"""Of the trials that are judged on a part of the draws, one in so many goes on to so many times more of them."""

RUNGS = 3
"""Numbers of draws on which a trial is judged, one after the other; the last is all of them."""

JOURNAL_LINE = b'{"op_code":'
"""The beginning of each line of a journal of Optuna's."""

Gains = dict[str, float | bool]


@dataclass(frozen=True)
class TunedGains:
    """The result of a search.

    Attributes
    ----------
    controller, scenario, pace
        Names.
    gains
        The best gains.
    assessment
        Their scores on draws that the search had not seen.
    trials, starts, episodes, seed
        Number of gains tried, starts, draws per trial, and the seed of draws and searches.
    machine
        The given machine in place of those that the scenario draws; None if there was none.
    known
        Whether the first start began with the shipped gains.
    """

    controller: str
    scenario: str
    pace: str
    gains: Gains
    assessment: Assessment
    trials: int
    starts: int
    episodes: int
    seed: int
    machine: AnyMachine | None = None
    known: bool = True


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
    known: bool = True,
    on_trial: Callable[[int, float], None] = lambda _count, _best: None,
) -> TunedGains:
    """Search for a controller's gains on training draws of a scenario.

    Each start has an equal share of the trials, and the best start then gets one more share. An interrupted search
    resumes: a start ends when the storage holds its share of finished trials, no matter which process ran them. A
    search that runs alone and without interruption gives the same result for the same seed.

    Parameters
    ----------
    controller, scenario, pace
        Names.
    trials, starts
        Gains to try, and starts from random gains.
    episodes
        Draws for each trial.
    storage
        Optuna journal file, which may hold many studies; created if necessary, in a folder that exists.
    seed
        Seed of the draws and the search, ≥ 0.
    machine
        A machine in place of those that the scenario draws, as in ``pter_gym.scenarios.find_scenario``.
    known
        Whether the first start begins with the shipped gains, which were found on the paper's machine. Leave them out
        for a fair comparison of machines.
    on_trial
        Called after each trial with the number of finished trials in all starts, and this start's best value [m].

    Raises
    ------
    ParameterError
        If there is no such controller, scenario, pace or machine, a number is out of range, or the storage is not
        a journal or cannot be written.
    DependencyError
        If Optuna is not installed.
    StorageError
        If the storage can no longer be written; the same search resumes from the trials that it holds.
    """
    storage = find_path("storage", storage)
    if controller not in TUNABLE:
        raise unknown_name("controller", controller, TUNABLE)
    find_scenario(scenario)
    speed = find_pace(pace)
    trials, starts = whole_number("trials", trials), whole_number("starts", starts)
    episodes, seed = whole_number("episodes", episodes), whole_number("seed", seed, at_least=0)
    check_target("storage", storage)
    own = None if machine is None else find_own(machine)  # read once, in case its file changes
    counts = [-(-episodes // REDUCTION**k) for k in reversed(range(RUNGS))]
    rungs = [Examination(scenario, pace, count, 2 * seed, own) for count in counts]
    name = f"{_label(find_scenario(scenario, own))} {controller} {pace} {episodes} {seed}{'' if known else ' unaided'}"
    studies = _open(storage, name, [starts * seed + start for start in range(starts)])
    share = -(-trials // (starts + 1))

    def judge(trial: Any) -> float:
        return _judge(trial, controller, speed, rungs)

    def run(start: int, budget: int, before: int) -> None:
        """Continue a start until it has that many finished trials, at least one of them scored on all draws."""
        study = studies[start]
        while len(finished := finished_trials(study)) < budget or not best_trials(study):
            study.optimize(judge, n_trials=1)
            best = best_trials(study)
            on_trial(before + len(finished) + 1, best[0].value if best else math.inf)

    try:
        for point in known_points(controller, scenario, pace) if known else ():
            studies[0].enqueue_trial(point, skip_if_exists=True)
        for start in range(starts):
            run(start, share, start * share)
        best = min(range(starts), key=lambda start: best_trials(studies[start])[0].value)
        run(best, trials - (starts - 1) * share, (starts - 1) * share)
    except OSError as error:
        raise StorageError(
            f"storage {str(storage)!r} cannot be written: {error.strerror or error}; "
            "the same search goes on from the trials that it holds"
        ) from error
    final = Examination(scenario, pace, episodes, 2 * seed + 1, own)
    found = [gains_at(trial.params, speed) for study in studies for trial in best_trials(study)[:FINALISTS]]
    judged = [(final.judge(make(controller, gains)), gains) for gains in found]
    assessment, gains = min(judged, key=lambda pair: pair[0].value)
    return TunedGains(controller, scenario, pace, gains, assessment, trials, starts, episodes, seed, machine, known)


def make(controller: str, gains: Gains) -> Guided:
    """Return a controller with gains; the others are the paper's."""
    kind: Any = CONTROLLERS[controller]
    return kind(**gains)


def _judge(trial: Any, controller: str, pace: float, rungs: Sequence[Examination]) -> float:
    """Return the value of a trial, scored on more and more draws as long as it keeps up with the others."""
    import optuna

    point = {
        name: trial.suggest_float(name, space.low, space.high, log=space.log)
        if isinstance(space, Range)
        else trial.suggest_categorical(name, space)
        for name, space in SPACES[controller].items()
    }
    tried = make(controller, gains_at(point, pace))
    for k, rung in enumerate(rungs[:-1]):
        trial.report(rung.judge(tried).value, REDUCTION**k)
        if trial.should_prune():
            raise optuna.TrialPruned
    return rungs[-1].judge(tried).value


def _label(scenario: Scenario) -> str:
    """Return a label that distinguishes a scenario's draws from others."""
    label = f"{scenario.name}-v{scenario.version}"
    if scenario.own is None:
        return label
    return f"{label} {hashlib.sha256(repr((scenario.own, scenario.task)).encode()).hexdigest()[:16]}"


def _open(storage: Path, name: str, seeds: Sequence[int]) -> list[Any]:
    """Return the studies of a search, one for each start, new or resumed."""
    try:
        import cmaes  # noqa: F401  # pyright: ignore[reportUnusedImport]
        import optuna
    except ImportError:
        raise needs_extra("pter tune", "tune") from None
    optuna.logging.set_verbosity(optuna.logging.ERROR)  # a failed trial's traceback is told as one line
    try:
        journal = open_journal(storage)
        studies = [
            optuna.create_study(
                storage=journal,
                study_name=f"{name} {start}",
                load_if_exists=True,
                pruner=optuna.pruners.SuccessiveHalvingPruner(min_resource=1, reduction_factor=REDUCTION),
            )
            for start in range(len(seeds))
        ]
    except (OSError, ValueError, LookupError, AssertionError) as error:  # what Optuna raises for other files
        raise ParameterError(f"storage must be a journal file of Optuna's, got {str(storage)!r}: {error}") from None
    for study, seed in zip(studies, seeds, strict=True):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            study.sampler = optuna.samplers.CmaEsSampler(
                seed=_stream(study, seed),
                n_startup_trials=STARTUP,
                consider_pruned_trials=True,
                warn_independent_sampling=False,  # switches are drawn at random
            )
    return studies


def _stream(study: Any, seed: int) -> int:
    """Return a seed of random numbers for the rest of a study, another one for each process that works on it."""
    begun = study.get_trials(deepcopy=False)
    shared = any(trial.state.name == "RUNNING" for trial in begun)
    return (seed + 1000003 * len(begun) + (os.getpid() if shared else 0)) % 2**32


def open_journal(path: Path) -> Any:
    """Return Optuna's storage in a journal file, which is created if necessary.

    An incomplete last line, as from a full disk, is cut off: Optuna would read nothing after it.
    """
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    lock: Any = FileLock(path.with_name(f".{path.name}.lock"))  # Optuna's own is never free again if a rename fails
    backend = JournalFileBackend(str(path.resolve()), lock)
    with lock:
        content = path.read_bytes()
        whole = content.rfind(b"\n") + 1
        half = content[whole:]
        if half[: len(JOURNAL_LINE)] != JOURNAL_LINE[: len(half)]:
            raise ValueError("its last line is not one of a journal")
        os.truncate(path, whole)
    return JournalStorage(backend)


def known_points(controller: str, scenario: str, pace: str) -> list[Gains]:
    """Return points of the search with a controller's shipped gains and its default gains at a pace.

    Gains shipped for the scenario and the pace come first, then the defaults, then those for others.
    """
    speed = find_pace(pace)
    default = cast("Guided | PaceSchedule", find_policy(controller)).at(speed)
    shipped = {
        (each, at): point_at(controller, controller_of(controller, entry, TABLE), find_pace(at))
        for each, controllers in read_table().items()
        for at, entry in controllers.get(controller, {}).items()
    }
    own = [shipped.pop((scenario, pace))] if (scenario, pace) in shipped else []
    return [*own, point_at(controller, default, speed), *shipped.values()]


def finished_trials(study: Any) -> list[Any]:
    """Return the trials that were scored, on all or some draws."""
    return [trial for trial in study.get_trials(deepcopy=False) if trial.state.name in ("COMPLETE", "PRUNED")]


def best_trials(study: Any) -> list[Any]:
    """Return the trials that were scored on all draws, the best first."""
    whole = [trial for trial in study.get_trials(deepcopy=False) if trial.state.name == "COMPLETE"]
    return sorted(whole, key=lambda trial: (trial.value, trial.number))
