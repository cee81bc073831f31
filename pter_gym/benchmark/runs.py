"""Run policies on the evaluation episodes of a scenario, or assess them on training draws."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from pter_gym._internal.checks import builtin, names_in, whole_number
from pter_gym._internal.files import FilePath
from pter_gym.benchmark.boards import COMPLETION, PACE_ERROR
from pter_gym.benchmark.episodes import Episodes, find_episodes, training_episodes
from pter_gym.benchmark.policies import Policies, find_policies
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.rollout import evaluate
from pter_gym.benchmark.scores import ScenarioRun
from pter_gym.controllers import AnyPolicy
from pter_gym.params import Machine
from pter_gym.scenarios import PACES, Scenario, find_scenario, name_of_pace
from pter_gym.tasks.path_following import PathFollowing


def run_scenario(
    scenario: str | Scenario | PathFollowing,
    policies: Policies | Iterable[FilePath] | FilePath,
    paces: Iterable[str | float] | float | None = None,
    *,
    episodes: int | None = None,
    seed: int | None = None,
    results: ResultsFolder | FilePath | None = None,
    num_threads: int = 2,
    on_progress: Callable[[str], None] = lambda _: None,
) -> tuple[ScenarioRun, ...]:
    """Run policies on the evaluation episodes of a scenario.

    Parameters
    ----------
    scenario
        Its name, or a scenario or a task of your own, as ``find_scenario`` takes them.
    policies
        By name: controllers, which are bound to the nominal machine, any ``policy(observations) ->
        volts``, float32 (N, entries) to (N, 4), or what ``find_policy`` takes; a sequence of them
        holds those of several training seeds. Or a list of names that ``find_policy`` takes.
    paces
        Names of commanded paces or speeds [m/s], or one of them; by default all that have names, or
        a task's own.
    episodes
        How many episodes to run, starting with the first; all by default.
    seed
        Seed of fresh episodes, within [0, 2⁶⁴); by default, the stored ones, or 0 where there are
        none.
    results
        A folder of results or its path, where each run is stored.
    num_threads
        Threads that share the episodes of a compiled law, ≥ 1; scores do not depend on their
        number.
    on_progress
        Called with the name of each policy and pace when it is done.

    Raises
    ------
    ParameterError
        If there is no such scenario, policy or pace, or there are fewer episodes than asked for.
    DataError
        If the stored episodes are damaged.
    """
    num_threads = whole_number("num_threads", num_threads)
    drawn = find_scenario(scenario)
    if paces is None:
        paces = scenario.pace if isinstance(scenario, PathFollowing) else tuple(PACES)
    several: Any = builtin(paces)
    listed = names_in("paces", [several] if isinstance(several, int | float) else several)
    seed = 0 if seed is None and drawn.digest else seed
    sets = {
        pace: find_episodes(drawn, pace, seed)
        for pace in (name_of_pace(name, "paces") for name in listed)
    }
    named = find_policies(policies, drawn.whose_gains)
    if episodes is not None:
        sets = {pace: full.first(episodes) for pace, full in sets.items()}
    folder = (
        results if results is None or isinstance(results, ResultsFolder) else ResultsFolder(results)
    )
    if folder:
        folder.make()
    runs: list[ScenarioRun] = []
    for pace, chosen in sets.items():
        for name, versions in named.items():
            scored = [evaluate(policy, chosen, num_threads) for policy in versions]
            trained = [
                ScenarioRun(
                    drawn.name, pace, name, number, seed, chosen.strata, scores, digest=drawn.digest
                )
                for number, scores in enumerate(scored)
            ]
            if folder:
                folder.add(trained)
            runs += trained
            on_progress(f"{name}, {pace}")
    return tuple(runs)


RESERVE, MISSING = 0.97, 0.75
"""Parts of the leaderboard's limits on pace errors and on missing completions that the search keeps
to.

Gains that just keep a limit on its draws may miss it on others: the mean pace error over 400 draws
of `everything` has a standard error of 3 % of the limit, and among completions a single draw weighs
much.
"""

PENALTY = 1.0
"""Path error [m] that counts for each unit over a limit."""

BASELINES = ("free", "locked", "random")
"""Policies that know nothing; any that has learned something is better than each of them."""

UNSEEN = 10_000
"""Seed of draws that no training has by default."""


class Assessment(NamedTuple):
    """How good a policy is on training draws: the means of the scores that decide ranks."""

    path_error_m: float
    completed: float
    mean_pace_error: float
    segment_pace_error: float

    @property
    def value(self) -> float:
        """One finite number that orders all policies, the smallest first.

        It is the path error [m] plus a penalty for each limit that is not kept.
        """
        over = max(0.0, (1.0 - self.completed) - MISSING * (1.0 - COMPLETION))
        over += max(0.0, self.mean_pace_error - RESERVE * PACE_ERROR)
        over += max(0.0, self.segment_pace_error - RESERVE * PACE_ERROR)
        return self.path_error_m + PENALTY * over

    def __str__(self) -> str:
        """Return the scores as text."""
        arrives, mean, segments = (f"{100 * share:.0f} %" for share in self[1:])
        return (
            f"{1000 * self.path_error_m:.1f} mm, arrives in {arrives}, pace error {mean} "
            f"(segments {segments})"
        )


def assess(policies: Sequence[AnyPolicy], episodes: Episodes) -> Assessment:
    """Return the means of the scores that decide ranks, over episodes and training seeds."""
    scores = [evaluate(policy, episodes, 1, ranking=True) for policy in policies]
    means = {name: float(np.mean([each[name] for each in scores])) for name in Assessment._fields}
    return Assessment(**means)


def examine(
    policies: Policies | Iterable[FilePath] | FilePath = (),
    scenario: str | Scenario | PathFollowing = "standard",
    pace: str = "medium",
    *,
    episodes: int = 64,
    seed: int = UNSEEN,
    machine: Machine | str | None = None,
) -> dict[str, Assessment]:
    """Assess policies on training draws and compare them with trivial ones; the best comes first.

    Evaluation episodes are not read, so the results may guide further training. ``free``,
    ``locked`` and ``random`` are assessed, too.

    Parameters
    ----------
    policies
        As in ``run_scenario``; training seeds of one policy are averaged.
    scenario, pace
        As in ``run_scenario``.
    episodes, seed
        Number of draws, and their seed, ≥ 0; training uses ``context_seed``, 0 by default.
    machine
        One machine in place of those that the scenario draws, as in ``find_scenario``; policies
        know about it.
    """
    drawn = find_scenario(scenario, machine)
    draws = training_episodes(drawn, pace, episodes, seed)
    named = find_policies(BASELINES, drawn.whose_gains)
    named |= find_policies(policies, drawn.whose_gains) if policies else {}
    assessed = {name: assess(versions, draws) for name, versions in named.items()}
    return dict(sorted(assessed.items(), key=lambda item: item[1].value))
