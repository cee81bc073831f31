"""Repeat results, to check that the scores in a folder are those of the policies they name."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np

from pter_gym._internal.files import FilePath
from pter_gym._internal.reading import parse_json, read_bytes
from pter_gym.benchmark._evaluation import Batches, PerSeed, bind_once, each_seed, evaluate
from pter_gym.benchmark._naming import find_policy, is_code
from pter_gym.benchmark._results import Contents, ResultsFolder
from pter_gym.benchmark._run_files import run_path
from pter_gym.benchmark._runs import ScenarioRun, other_score
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.errors import ParameterError, PterError

SAME = "same"

MOST_SUMMARY = 1 << 23
"""Largest summary that is compared [B]."""

Policies = Mapping[str, AnyPolicy | PerSeed]


class Verdict(NamedTuple):
    """The result for one file.

    Attributes
    ----------
    file
        Its name.
    finding
        ``SAME``, what differs, or why it cannot be compared.
    """

    file: str
    finding: str

    @property
    def same(self) -> bool:
        """Whether the repeated result equals the file's."""
        return self.finding == SAME


def verify(
    results: ResultsFolder | FilePath,
    policies: Policies | None = None,
    *,
    seed: int = 0,
    num_threads: int = 2,
    on_progress: Callable[[str], None] = lambda _: None,
) -> tuple[Verdict, ...]:
    """Repeat every run in a folder of results and compare the scores, bit for bit.

    The measured time of a decision is not compared. Nothing in the folder changes.

    Parameters
    ----------
    results
        The folder, or its path.
    policies
        By their names in the results. Missing ones are looked up by name, as ``find_policy`` does, but code named in
        the results is not imported.
    seed
        Seed of the random policy, if they are found by name.
    num_threads
        As in ``run_scenario``.
    on_progress
        Called with the name of each file before it is run again.

    Returns
    -------
    verdicts
        One for each file of a run; the last is for ``benchmark.json``.

    Raises
    ------
    ParameterError
        If the folder holds no file of a run.
    """
    results = results if isinstance(results, ResultsFolder) else ResultsFolder(results)
    contents = results.read()
    if not contents.runs and not contents.left_out:
        found = "there are none in" if results.path.is_dir() else "there is no folder"
        raise ParameterError(f"results must be a folder with files in runs, {found} {str(results.path)!r}")

    @lru_cache(1)
    def batches_of(scenario: str, pace: str, count: int, fresh: int) -> Batches:
        return Batches(find_episodes(scenario, pace, None if fresh < 0 else fresh).first(count))

    verdicts = [Verdict(left.file, left.reason) for left in contents.left_out]
    for run in sorted(contents.runs, key=_episodes_of):
        file = run_path(results.path, run.conditions).name
        on_progress(file)
        try:
            policy = _policy_of(run, policies or {}, seed)
            finding = _compare(run, policy, batches_of(*_episodes_of(run)), num_threads)
        except PterError as error:
            finding = f"it cannot be run again: {error}"
        verdicts.append(Verdict(file, finding))
    return (*sorted(verdicts), Verdict(results.summary.name, compare_summary(results, contents)))


def _episodes_of(run: ScenarioRun) -> tuple[str, str, int, int]:
    at = run.conditions
    return at.scenario, at.pace, at.episodes, -1 if at.fresh_seed is None else at.fresh_seed


def _policy_of(run: ScenarioRun, policies: Policies, seed: int) -> AnyPolicy:
    at = run.conditions
    if at.policy not in policies and is_code(at.policy):
        raise ParameterError(f"policies must name the code that may be imported, {at.policy!r} is not among them")
    known = policies[at.policy] if at.policy in policies else find_policy(at.policy, seed, at.scenario)
    if at.seed >= len(each_seed(known)):
        raise ParameterError(f"there is no training seed {at.seed} of {at.policy!r}")
    return each_seed(known)[at.seed]


def _compare(run: ScenarioRun, policy: AnyPolicy, batches: Batches, num_threads: int) -> str:
    """Repeat a run and return the first difference in words, or ``SAME``."""
    at, bound = run.conditions, bind_once(policy)
    if at.data != batches.episodes.checksum:
        return f"other episodes: the file says {at.data}, these are {batches.episodes.checksum}"
    if at.identity and bound.identity and at.identity != bound.identity:
        return f"other policy: the file says {at.identity}, this is {bound.identity}"
    scores, samples, planning = evaluate(bound, batches, num_threads)
    for name, values in scores.items():
        for k in np.flatnonzero(run.scores[name] != values)[:1]:
            return f"differs: {name} of episode {k}: {run.scores[name][k].item()!r} instead of {values[k].item()!r}"
    if (planning and replace(planning, decision_ms=0.0)) != (run.planning and replace(run.planning, decision_ms=0.0)):
        return f"differs: planning: {run.planning} instead of {planning}"
    for one, two in zip(run.samples, samples, strict=True):
        if not (np.array_equal(one.tip, two.tip) and np.array_equal(one.theta, two.theta)):
            return f"differs: the motion of episode {two.episode}"
    return SAME


def compare_summary(results: ResultsFolder, contents: Contents) -> str:
    """Return how ``benchmark.json`` differs from a summary of the runs, or ``SAME``."""
    try:
        found = parse_json(read_bytes(results.summary, MOST_SUMMARY), MOST_SUMMARY)
    except (OSError, ValueError) as error:
        return f"it cannot be read: {error}"
    expected = json.loads(json.dumps(contents.as_json()))
    there = cast("dict[str, Any]", found if isinstance(found, dict) else {})
    if there.get("code") != expected["code"]:
        return other_score(there.get("code", "unknown"))
    differ = [name for name in expected if there.get(name) != expected[name]]
    return f"differs from what the runs give: {', '.join(differ)}" if differ else SAME
