"""Repeat the runs in a folder of results, and compare their scores bit for bit."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from pter_gym._internal.files import FilePath
from pter_gym.benchmark._naming import find_policy, is_code
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.results import ResultsFolder, read_run
from pter_gym.benchmark.runs import PerSeed, ScenarioRun, evaluate
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.errors import ParameterError, PterError

SAME = "same"


class Verdict(NamedTuple):
    """The result for one file: its name, and ``same``, what differs, or why it cannot be run again."""

    file: str
    finding: str

    @property
    def same(self) -> bool:
        """Whether the repeated scores equal the file's."""
        return self.finding == SAME


def verify(
    results: ResultsFolder | FilePath,
    policies: Mapping[str, AnyPolicy | PerSeed] | None = None,
    *,
    num_threads: int = 2,
    on_progress: Callable[[str], None] = lambda _: None,
) -> tuple[Verdict, ...]:
    """Repeat every run in a folder of results; return what each file's scores are compared with those.

    Parameters
    ----------
    results
        The folder, or its path.
    policies
        By their names in the results. Missing ones are looked up as ``find_policy`` does, but no code is imported.
    num_threads
        As in ``run_scenario``.
    on_progress
        Called with the name of each file before it is run again.

    Raises
    ------
    ParameterError
        If the folder holds no run.
    """
    results = results if isinstance(results, ResultsFolder) else ResultsFolder(results)
    if not results.files():
        raise ParameterError(f"results must be a folder with files in runs, {str(results.path)!r} has none")
    verdicts: list[Verdict] = []
    for path in results.files():
        on_progress(path.name)
        try:
            finding = _repeat(read_run(path), policies or {}, num_threads)
        except PterError as error:
            finding = f"cannot be run again: {error}"
        verdicts.append(Verdict(path.name, finding))
    return tuple(verdicts)


def _repeat(run: ScenarioRun, policies: Mapping[str, AnyPolicy | PerSeed], num_threads: int) -> str:
    """Return the first score that differs when a run is repeated, in words, or ``SAME``."""
    if run.policy not in policies and is_code(run.policy):
        raise ParameterError(f"policies must hold {run.policy!r}, whose code is not imported")
    policy = policies[run.policy] if run.policy in policies else find_policy(run.policy, run.scenario)
    trained = policy.policies if isinstance(policy, PerSeed) else (policy,)
    if run.training_seed >= len(trained):
        raise ParameterError(f"policies must hold {run.training_seed + 1} training seeds of {run.policy!r}")
    episodes = find_episodes(run.scenario, run.pace, run.seed).first(run.episodes)
    if run.strata != episodes.strata:
        return "differs: strata"
    scores, _ = evaluate(trained[run.training_seed], episodes, num_threads)
    for name, values in scores.items():
        for k in np.flatnonzero(run.scores[name] != values):
            return f"differs: {name} of episode {k} is {run.scores[name][k]}, repeated {values[k]}"
    return SAME
