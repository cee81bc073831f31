"""Repeat the runs in a folder of results, and compare their scores bit for bit."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pter_gym._internal.files import FilePath
from pter_gym.benchmark._find_policy import find_policies, is_code
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.results import ResultsFolder, read_run
from pter_gym.benchmark.runs import Policies, evaluate
from pter_gym.benchmark.scores import ScenarioRun
from pter_gym.errors import ParameterError, PterError

SAME = "same"


class Comparison(NamedTuple):
    """The name of a file, and ``same``, which score differs, or why the run cannot be repeated."""

    file: str
    finding: str

    @property
    def same(self) -> bool:
        """Whether all scores are the same."""
        return self.finding == SAME


def verify(
    results: ResultsFolder | FilePath,
    policies: Policies = (),
    on_progress: Callable[[str], None] = lambda _: None,
) -> tuple[Comparison, ...]:
    """Repeat the runs in a folder, or raise a ParameterError if it has none; return a verdict for
    each file.

    Policies that are not given, as for ``run_scenario``, are looked up as ``find_policy`` does, but
    no code is imported. ``on_progress`` is called with the name of each file before it is repeated.
    """
    results = results if isinstance(results, ResultsFolder) else ResultsFolder(results)
    if not results.files():
        raise ParameterError(
            f"results must be a folder with files in runs, {str(results.path)!r} has none"
        )
    verdicts: list[Comparison] = []
    for path in results.files():
        on_progress(path.name)
        try:
            finding = _repeat(read_run(path), policies)
        except PterError as error:
            finding = f"cannot be repeated: {error}"
        verdicts.append(Comparison(path.name, finding))
    return tuple(verdicts)


def _repeat(run: ScenarioRun, policies: Policies) -> str:
    """Return the first score that differs when a run is repeated, in words, or ``SAME``."""
    given = find_policies(policies, run.scenario) if policies else {}
    if run.policy not in given and is_code(run.policy):
        raise ParameterError(f"policies must hold {run.policy!r}, whose code is not imported")
    versions = given.get(run.policy) or find_policies(run.policy, run.scenario)[run.policy]
    if run.digest:
        raise ParameterError(f"scenario must be one of the suite's, {run.scenario!r} is your own")
    if run.training_seed >= len(versions):
        raise ParameterError(
            f"policies must hold {run.training_seed + 1} training seeds of {run.policy!r}"
        )
    episodes = find_episodes(run.scenario, run.pace, run.seed).first(run.episodes)
    repeated = evaluate(versions[run.training_seed], episodes)
    for name, values in run.scores.items():
        again = repeated.get(name, np.full(len(values), np.nan))
        for k in np.flatnonzero(values != again):
            return f"{name} of episode {k} differs: {values[k]}, repeated {again[k]}"
    return SAME if run.strata == episodes.strata else "strata differ"
