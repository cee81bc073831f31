"""Policies on the evaluation episodes of a scenario, at each commanded pace."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._version import __version__
from pter_gym.benchmark.episodes import FOLDER, Episodes, load_episodes
from pter_gym.benchmark.measures import column, vector
from pter_gym.benchmark.metrics import Scores, score_episodes
from pter_gym.benchmark.naming import find_policy
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.runs import Conditions, Planning, Sample, ScenarioRun, code_digest
from pter_gym.benchmark.simulation import AnyPolicy, run, sensors_of, time_limit
from pter_gym.controllers import BoundPolicy, bind
from pter_gym.engine.batch import Batch
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import Sensors

Array = NDArray[np.float64]

CHUNK = 64
"""Episodes that are simulated together; their telemetry is scored and let go."""

SAMPLES = 4
"""Episodes of a run that are kept to be drawn: the first of each stratum, then the first ones."""

INSTANTS = 200
"""Largest number of instants that are kept of such an episode."""


@dataclass(frozen=True)
class PerSeed:
    """One policy as it came out of several training seeds; they share a line of the leaderboard."""

    policies: tuple[AnyPolicy, ...]


def run_scenario(
    scenario: str,
    policies: Mapping[str, AnyPolicy | PerSeed] | Sequence[str],
    paces: Sequence[str] = tuple(PACES),
    *,
    episodes: int | None = None,
    results: ResultsFolder | None = None,
    num_threads: int = 2,
    on_progress: Callable[[str], None] = lambda _: None,
    data: Path = FOLDER,
) -> tuple[ScenarioRun, ...]:
    """Run policies on the evaluation episodes of a scenario.

    Parameters
    ----------
    scenario
        Its name.
    policies
        By name: controllers, which are bound to the nominal machine, any ``policy(observations) -> volts``, float32
        (N, entries) to (N, 4), or one of these for each training seed; or names of built-in policies alone. What a
        callable is, its attribute ``identity`` may say (a string); without one, it is run again each time.
    paces
        Names of commanded paces.
    episodes
        How many of the stored episodes to run, from the first on; all by default.
    results
        Where each finished run is kept, and taken from if it was finished before.
    num_threads
        Threads that share the episodes of a compiled law; the scores do not depend on it.
    on_progress
        Called with the name of each policy and pace when they are done.
    data
        Folder of the stored episodes.

    Raises
    ------
    ParameterError
        If there is no such scenario, policy or pace, or there are not so many episodes.
    DataError
        If the stored episodes were changed.
    """
    named = (
        policies if isinstance(policies, Mapping) else {name: find_policy(name, scenario=scenario) for name in policies}
    )
    for field, given in (("policies", named), ("paces", paces)):
        if not given:
            raise ParameterError(f"{field} must hold at least one name")
    sets = {pace: load_episodes(scenario, pace, folder=data) for pace in paces}
    sets = {pace: full if episodes is None else full.first(episodes) for pace, full in sets.items()}
    if results:
        results.make()
    runs: list[ScenarioRun] = []
    for pace, chosen in sets.items():
        batches = Batches(chosen)
        for name, policy in named.items():
            for seed, trained in enumerate(policy.policies if isinstance(policy, PerSeed) else (policy,)):
                runs.append(_find_or_run(trained, batches, (pace, name, seed), results, num_threads))
            on_progress(f"{name}, {pace}")
    return tuple(runs)


def _find_or_run(
    policy: AnyPolicy, batches: "Batches", names: tuple[str, str, int], results: ResultsFolder | None, num_threads: int
) -> ScenarioRun:
    """Return the run of a policy, with the names of pace, policy and training seed; from the results if it is there."""
    conditions = _conditions(batches.episodes, *names, identity(policy, batches.bind(policy)))
    found = results and results.find(conditions)
    if found:
        return found
    made = ScenarioRun(conditions, batches.episodes.strata, *evaluate(policy, batches, num_threads))
    if results:
        results.add(made)
    return made


class Part(NamedTuple):
    """What comes out of one batch: scores, samples, and the mean processor time of a decision [ms]."""

    scores: Scores
    samples: list[Sample]
    decision_ms: float


class Batches:
    """The episodes in batches of ``CHUNK`` worlds, which are made once for all policies with the same sensors."""

    def __init__(self, episodes: Episodes) -> None:
        self.episodes = episodes
        self.chunks = [slice(start, start + CHUNK) for start in range(0, len(episodes), CHUNK)]
        self.kept = sample_numbers(episodes.strata)
        self.batch = cache(self._make)

    def _make(self, number: int, sensors: Sensors) -> Batch:
        chunk = self.chunks[number]
        return Batch(self.episodes.machines[chunk], self.episodes.tasks[chunk], sensors=sensors)

    def bind(self, policy: AnyPolicy) -> BoundPolicy:
        """Return a policy that can act in any of the batches."""
        return bind(policy, BASELINE, self.batch(0, sensors_of(policy)).layout)

    def run(self, number: int, policy: AnyPolicy) -> Part:
        """Return what comes out of one batch."""
        chunk, batch = self.chunks[number], self.batch(number, sensors_of(policy))
        tasks = self.episodes.tasks[chunk]
        limits = [time_limit(task) for task in tasks]
        episodes = run(batch, policy, self.episodes.seeds[chunk], limits)
        telemetry = episodes.telemetry
        for world, limit in enumerate(limits):
            telemetry[limit + 1 :, world] = np.nan
        scores = score_episodes(telemetry, tasks, voltage_max=batch.machine.clutch.voltage_max)
        here = (k for k in self.kept if chunk.start <= k < chunk.stop)
        return Part(scores, [_sample(k, telemetry[:, k - chunk.start]) for k in here], episodes.decision_ms)


def evaluate(
    policy: AnyPolicy, batches: Batches, num_threads: int
) -> tuple[Scores, tuple[Sample, ...], Planning | None]:
    """Return the scores of a policy on all episodes, samples of them, and how it plans, if it does."""
    bound = batches.bind(policy)
    numbers = range(len(batches.chunks))
    one = partial(batches.run, policy=policy)
    if bound.compiled and num_threads > 1:
        with ThreadPoolExecutor(num_threads, thread_name_prefix="pter-benchmark") as pool:
            parts = list(pool.map(one, numbers))
    else:
        parts = [one(number) for number in numbers]
    scores = {name: np.concatenate([part.scores[name] for part in parts]) for name in parts[0].scores}
    return scores, tuple(sample for part in parts for sample in part.samples), _planning(bound, batches, parts)


def _planning(policy: BoundPolicy, batches: Batches, parts: Sequence[Part]) -> Planning | None:
    """Return how a policy planned, if it did."""
    if policy.plans is None:
        return None
    privileged, horizon, rollouts = policy.plans
    seconds = horizon * batches.episodes.tasks[0].control_period
    took = float(np.mean([part.decision_ms for part in parts]))
    return Planning(privileged, round(seconds, 6), rollouts, round(took, 2))


def sample_numbers(strata: Sequence[str]) -> list[int]:
    """Return the numbers of the episodes that are kept to be drawn."""
    first_of_each = (strata.index(stratum) for stratum in dict.fromkeys(strata))
    return sorted(list(dict.fromkeys([*first_of_each, *range(len(strata))]))[:SAMPLES])


def _sample(number: int, telemetry: Array) -> Sample:
    finished = telemetry[np.isfinite(column(telemetry, "time"))]
    shown = np.unique(np.linspace(0, len(finished) - 1, INSTANTS).round().astype(int))
    theta = np.stack([column(finished, "theta_a"), column(finished, "theta_b")], axis=-1)
    return Sample(number, vector(finished, "tip")[shown].round(5), theta[shown].round(5))


def _conditions(episodes: Episodes, pace: str, name: str, seed: int, identity: str | None) -> Conditions:
    return Conditions(
        scenario=episodes.scenario,
        pace=pace,
        policy=name,
        seed=seed,
        episodes=len(episodes),
        data=episodes.checksum,
        identity=identity,
        version=__version__,
        code=code_digest(),
    )


def identity(policy: AnyPolicy, bound: BoundPolicy) -> str | None:
    """Return what a policy is, so a run need not be repeated, or None if that cannot be told.

    That is what it says itself in ``identity``; of a compiled law, its gains in words and a hash of gains and law.
    """
    if bound.fingerprint is not None:
        name = repr(policy) if is_dataclass(policy) else type(policy).__qualname__
        return f"{name} {bound.fingerprint}"
    said: Any = getattr(policy, "identity", None)
    return said if isinstance(said, str) else None
