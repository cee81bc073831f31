"""Results, run again: whether the scores in a folder are those of the policies that they are said to be of."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.evaluation import Batches, PerSeed, each_seed, evaluate
from pter_gym.benchmark.identity import SAID, identity_of
from pter_gym.benchmark.leaderboard import leaderboards
from pter_gym.benchmark.naming import find_policy
from pter_gym.benchmark.results import SUMMARY, Contents, ResultsFolder, summary_of
from pter_gym.benchmark.run_files import run_path
from pter_gym.benchmark.runs import Planning, Sample, ScenarioRun
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.errors import ParameterError, PterError
from pter_gym.internal.files import FilePath
from pter_gym.internal.reading import parse_json, read_bytes

SAME = "same"

MOST_SUMMARY = 1 << 23
"""Largest summary that is compared [B]."""

Policies = Mapping[str, AnyPolicy | PerSeed]


class Verdict(NamedTuple):
    """What came out for one file.

    Attributes
    ----------
    file
        Its name.
    finding
        ``SAME``, what differs, or why nobody can tell.
    """

    file: str
    finding: str

    @property
    def same(self) -> bool:
        """Whether the file holds what comes out again."""
        return self.finding == SAME


def verify(
    results: ResultsFolder | FilePath,
    policies: Policies | None = None,
    *,
    seed: int = 0,
    num_threads: int = 2,
    on_progress: Callable[[str], None] = lambda _: None,
) -> tuple[Verdict, ...]:
    """Run every run in a folder of results again and compare what comes out, bit for bit.

    The measured time of a decision is not compared. Nothing in the folder changes.

    Parameters
    ----------
    results
        The folder, or its path.
    policies
        By their names in the results; those that are missing are found by name, as ``find_policy`` does.
    seed
        Of the random policy, and of those that plan, if they are found by name.
    num_threads
        As in ``run_scenario``.
    on_progress
        Called with the name of each file before it is run again.

    Returns
    -------
    verdicts
        One for each file of a run, and the last for ``benchmark.json``.

    Raises
    ------
    ParameterError
        If the folder holds no file of a run.
    """
    results = results if isinstance(results, ResultsFolder) else ResultsFolder(results)
    contents = results.read()
    if not contents.runs and not contents.left_out:
        raise ParameterError(f"results must be a folder with files in runs, there are none in {str(results.path)!r}")
    again = _Again(results, policies or {}, seed, num_threads)
    verdicts = [Verdict(left.file, left.reason) for left in contents.left_out]
    for run in sorted(contents.runs, key=_episodes_of):
        file = run_path(results.path, run.conditions).name
        on_progress(file)
        verdicts.append(Verdict(file, again.finding(run)))
    return (*sorted(verdicts), Verdict(results.summary.name, summary_finding(results, contents)))


def _episodes_of(run: ScenarioRun) -> tuple[str, str, int, int]:
    at = run.conditions
    return at.scenario, at.pace, at.episodes, -1 if at.fresh is None else at.fresh


class _Again:
    """Runs the runs of a folder again; see ``verify``."""

    def __init__(self, results: ResultsFolder, policies: Policies, seed: int, num_threads: int) -> None:
        self._results = results
        self._policies = policies
        self._seed = seed
        self._num_threads = num_threads
        self._batches = lru_cache(1)(self._make_batches)

    def finding(self, run: ScenarioRun) -> str:
        """Return what comes out of one run."""
        at = run.conditions
        try:
            batches = self._batches(*_episodes_of(run))
            policy = self._policy(run)
            bound = batches.bind(policy)
            if at.data != batches.episodes.checksum:
                return f"other episodes: the file says {_short(at.data)}, those are {_short(batches.episodes.checksum)}"
            identity = identity_of(policy, bound.policy)
            told = None if at.identity is None or at.identity.startswith(SAID) else at.identity
            if identity != told:
                return f"another policy: the file says {_short(told)}, that of this name is {_short(identity)}"
            scores, samples, planning = evaluate(bound, batches, self._num_threads)
        except PterError as error:
            return f"it cannot be run again: {error}"
        return difference(run, replace(run, scores=scores, samples=samples, planning=planning))

    def _make_batches(self, scenario: str, pace: str, count: int, seed: int) -> Batches:
        episodes = find_episodes(scenario, pace, None if seed < 0 else seed, folder=self._results.data)
        return Batches(episodes.first(count))

    def _policy(self, run: ScenarioRun) -> AnyPolicy:
        at = run.conditions
        known = self._policies.get(at.policy)
        seeds = each_seed(find_policy(at.policy, self._seed, at.scenario) if known is None else known)
        if at.seed >= len(seeds):
            raise ParameterError(f"there is no training seed {at.seed} of {at.policy!r}")
        return seeds[at.seed]


def difference(run: ScenarioRun, again: ScenarioRun) -> str:
    """Return the first difference between a run and the same one run again, in words, or ``SAME``."""
    for name, values in again.scores.items():
        other = np.flatnonzero(run.scores[name] != values)
        if len(other):
            k = int(other[0])
            return f"differs: {name} of episode {k}: {run.scores[name][k].item()!r} instead of {values[k].item()!r}"
    if _untimed(run.planning) != _untimed(again.planning):
        return f"differs: planning: {_untimed(run.planning)} instead of {_untimed(again.planning)}"
    for one, two in zip(run.samples, again.samples, strict=True):
        if not _are_same(one, two):
            return f"differs: the motion of episode {two.episode}"
    return SAME


def _untimed(planning: Planning | None) -> Planning | None:
    return planning and replace(planning, decision_ms=0.0)


def _are_same(one: Sample, two: Sample) -> bool:
    return one.episode == two.episode and np.array_equal(one.tip, two.tip) and np.array_equal(one.theta, two.theta)


def summary_finding(results: ResultsFolder, contents: Contents) -> str:
    """Tell whether ``benchmark.json`` is what follows from the runs."""
    try:
        found = parse_json(read_bytes(results.summary, MOST_SUMMARY), MOST_SUMMARY)
    except (OSError, ValueError) as error:
        return f"it cannot be read: {error}"
    expected = json.loads(json.dumps(summary_of(contents, leaderboards(contents.runs))))
    differ = [name for name in expected if found.get(name) != expected[name]] if isinstance(found, dict) else [SUMMARY]
    return f"differs from what the runs give: {', '.join(differ)}" if differ else SAME


def _short(identity: str | None) -> str:
    return "unknown" if identity is None else f"{identity[:8]}…"
