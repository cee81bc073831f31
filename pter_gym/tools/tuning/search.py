"""The search for gains: an Optuna study in a journal file, which processes resume and share."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shlex import quote
from typing import Any

from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import FilePath, check_target, expand_path
from pter_gym._internal.locks import lock_beside, locked
from pter_gym.benchmark import Assessment, Episodes, assess, training_episodes
from pter_gym.errors import ParameterError, StorageError, needs_extra
from pter_gym.hands import HandSpread, Operator
from pter_gym.params import Machine
from pter_gym.paths import Path as AnyPath
from pter_gym.scenarios import find_scenario
from pter_gym.scenarios.paces import find_pace, name_of_pace
from pter_gym.tools.tuning.laws import Range, TunableLaw, find_law

__all__ = ["TunedGains", "tune"]

TRIALS = 3000
"""Gains to try for a law, a scenario and a pace."""

EPISODES = 200
"""Training episodes of a trial."""

FINALISTS = 40
"""The best trials, which are judged again on other draws; the best there is the result."""

STARTUP_TRIALS = 24
"""Random trials before those of the evolution strategy."""

REDUCTION, RUNGS = 4, 3
"""A trial is judged on a part of the draws; one in four goes on to four times as many."""


@dataclass(frozen=True)
class TunedGains:
    """The best gains of a search, their scores on unseen draws, and its arguments."""

    controller: str
    scenario: str
    pace: str
    gains: dict[str, float | bool]
    assessment: Assessment
    trials: int
    episodes: int
    seed: int
    machine: Machine | str | None = None
    path: AnyPath | str | None = None
    smooth: float = 0.0
    worst: bool = False
    hand: Operator | HandSpread | str | None = None

    @property
    def command(self) -> str:
        """The command that repeats the search."""
        names = ("trials", "episodes", "seed", "machine", "path", "smooth", "worst", "hand")
        given: dict[str, Any] = {name: getattr(self, name) for name in names}
        return command_of(self.controller, self.scenario, self.pace, **given)


def command_of(
    controller: str,
    scenario: str,
    pace: str,
    *,
    trials: int,
    episodes: int,
    seed: int,
    machine: Machine | str | None,
    path: AnyPath | str | None,
    smooth: float,
    worst: bool,
    hand: Operator | HandSpread | str | None,
) -> str:
    """Return the command of a search, whose arguments are those of ``tune``."""
    command = (
        f"pter tune {quote(controller)} --scenario {scenario} --pace {pace} "
        f"--trials {trials} --episodes {episodes} --seed {seed}"
    )
    for name, value, kind in (
        ("machine", machine, "MACHINE.toml"),
        ("path", path, "FILE.csv"),
        ("hand", hand, "HAND.toml"),
    ):
        if value is not None:
            command += f" --{name} {quote(value) if isinstance(value, str) else kind}"
    command += f" --smooth {1e3 * smooth:g}" if smooth else ""
    return command + " --worst" * worst


def tune(
    controller: str,
    scenario: str,
    pace: str,
    *,
    trials: int = TRIALS,
    episodes: int = EPISODES,
    storage: FilePath = "pter-tune.journal",
    seed: int = 0,
    machine: Machine | str | None = None,
    path: AnyPath | str | None = None,
    smooth: float = 0.0,
    worst: bool = False,
    hand: Operator | HandSpread | str | None = None,
    on_trial: Callable[[int, float], None] = lambda _count, _best: None,
) -> TunedGains:
    """Search for a law's gains on training episodes of a scenario, with CMA-ES.

    The search begins with the shipped gains and the defaults. Gains without effect on these
    episodes are left out (``needs`` of the law) and keep their defaults. It resumes from the trials
    in its storage, whichever process ran them. A single process gives the same result for the same
    seed, even if it stops between trials and resumes.

    Parameters
    ----------
    controller, scenario, pace
        Names, or for a law of your own ``FILE.py:attribute``: a dataclass whose attribute
        ``search`` holds ranges by the names of its gains, ``(low, high)``, logarithmic where low >
        0, or ``(False, True)``.
    trials
        Gains to try.
    episodes
        Training episodes for each trial.
    storage
        File of the trials in Optuna's journal format, created if necessary.
    seed
        Seed of the episodes and the search.
    machine
        A machine for all episodes, instead of those of the scenario: a machine, its name, or its
        file.
    path
        A path for all episodes, as in ``find_scenario``.
    smooth
        Noise of a path from a file that is smoothed away [m], as in ``find_scenario``.
    worst
        Whether the largest path error of the episodes is minimised instead of the mean.
    hand
        A hand for all episodes, instead of those of the scenario, as in ``find_scenario``.
    on_trial
        Called after each trial with the number of finished trials and the smallest value so far
        [m].

    Raises
    ------
    ParameterError
        If there is no such controller, scenario, pace, machine or hand, a number is out of range,
        or the storage is not a journal or cannot be written.
    DependencyError
        If Optuna is not installed.
    StorageError
        If the storage can no longer be written; the same search resumes from the trials that it
        holds.
    """
    journal = expand_path("storage", storage)
    definition = find_scenario(scenario, machine, path, smooth, hand)
    pace = name_of_pace(pace)
    law = find_law(controller, find_pace(pace), definition.whose_gains)
    trials, episodes = whole_number("trials", trials), whole_number("episodes", episodes)
    seed = whole_number("seed", seed, at_least=0)
    check_target("storage", journal)
    rungs = [
        training_episodes(definition, pace, -(-episodes // REDUCTION**k), 2 * seed)
        for k in reversed(range(RUNGS))
    ]
    law = law.shown_by(rungs[-1].tasks)
    set_of_draws = f"{pace} {episodes} {seed} {definition.digest}".rstrip() + " worst" * worst
    name = f"{definition.name}-v{definition.version} {law.key} {set_of_draws}"
    study = _open_study(journal, name, law, seed)
    for start in law.starts():
        study.enqueue_trial(start, skip_if_exists=True)

    best = _scored(study, "COMPLETE")
    try:
        while (finished := len(_scored(study, "COMPLETE", "PRUNED"))) < trials or not best:
            study.optimize(partial(_judge, law=law, rungs=rungs, worst=worst), n_trials=1)
            best = _scored(study, "COMPLETE")
            on_trial(finished + 1, best[0].value if best else math.inf)
    except OSError as error:
        raise StorageError(
            f"storage {str(journal)!r} cannot be written: {error.strerror or error}"
        ) from error
    final = training_episodes(definition, pace, episodes, 2 * seed + 1)
    finalists = [law.gains(trial.params) for trial in best[:FINALISTS]]
    judged = [(assess([law.with_gains(gains)], final, worst=worst), gains) for gains in finalists]
    assessment, gains = min(judged, key=lambda pair: pair[0].value)
    return TunedGains(
        controller,
        scenario,
        pace,
        gains,
        assessment,
        trials,
        episodes,
        seed,
        machine,
        path,
        smooth,
        worst,
        hand,
    )


def _judge(trial: Any, law: TunableLaw, rungs: Sequence[Episodes], *, worst: bool) -> float:
    """Return the value of a trial, scored on more draws as long as it keeps up with others."""
    import optuna

    point = {
        name: trial.suggest_float(name, space.low, space.high, log=space.log)
        if isinstance(space, Range)
        else trial.suggest_categorical(name, space)
        for name, space in law.space.items()
    }
    candidate = law.with_gains(law.gains(point))
    for k, rung in enumerate(rungs[:-1]):
        trial.report(assess([candidate], rung, worst=worst).value, REDUCTION**k)
        if trial.should_prune():
            raise optuna.TrialPruned
    return assess([candidate], rungs[-1], worst=worst).value


def load_optuna() -> Any:
    """Return Optuna, or raise a DependencyError if it or its CMA-ES is not installed."""
    try:
        import cmaes  # noqa: F401  # pyright: ignore[reportUnusedImport]
        import optuna
    except ImportError:
        raise needs_extra("a search for gains", "tune") from None
    return optuna


def _open_study(path: Path, name: str, law: TunableLaw, seed: int) -> Any:
    """Return the study of a search, new or resumed."""
    optuna = load_optuna()
    from pter_gym.tools.tuning.evolution import Evolution

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    known = len({tuple(start.items()) for start in law.starts()})
    unreadable = OSError, ValueError, LookupError, AssertionError  # of Optuna for other files
    try:
        return optuna.create_study(
            storage=open_journal(path),
            study_name=name,
            load_if_exists=True,
            pruner=optuna.pruners.SuccessiveHalvingPruner(
                min_resource=1, reduction_factor=REDUCTION
            ),
            sampler=Evolution(law.space, known=known, random=STARTUP_TRIALS, seed=seed % 2**32),
        )
    except unreadable as error:
        raise ParameterError(
            f"storage must be a journal file of Optuna's, got {str(path)!r}: {error}"
        ) from None


def open_journal(path: Path) -> Any:
    """Return Optuna's storage in a journal file, which is created if necessary."""
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    file, lock = path.resolve(), lock_beside(path)

    class Journal(JournalFileBackend):
        """As Optuna's, with a lock that is free again once a process dies.

        It does not wait for the disk at each of a trial's gains.
        """

        def append_logs(self, logs: list[dict[str, Any]]) -> None:
            lines = [json.dumps(log, separators=(",", ":")) + "\n" for log in logs]
            with locked(lock), file.open("ab") as journal:
                journal.write("".join(lines).encode())

    return JournalStorage(Journal(str(file)))


def _scored(study: Any, *states: str) -> list[Any]:
    """Return the trials in these states, the best first."""
    found = [trial for trial in study.get_trials(deepcopy=False) if trial.state.name in states]
    return sorted(found, key=lambda trial: (trial.value, trial.number))
