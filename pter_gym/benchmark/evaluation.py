"""Policies on the evaluation episodes of a scenario, at each commanded pace."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._version import __version__
from pter_gym.benchmark.episodes import Episodes, check_fresh, find_episodes
from pter_gym.benchmark.identity import derived_seed, identity_of
from pter_gym.benchmark.measures import column, vector
from pter_gym.benchmark.metrics import Scores, score_episodes
from pter_gym.benchmark.naming import find_policy, is_built_in, text_of
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.runs import (
    INSTANTS,
    Conditions,
    Planning,
    Sample,
    ScenarioRun,
    check_name,
    code_digest,
    sample_numbers,
)
from pter_gym.benchmark.simulation import AnyPolicy, run, sensors_of, time_limit
from pter_gym.controllers import BoundPolicy, Controller, bind
from pter_gym.controllers.base import Plans
from pter_gym.controllers.predictive import UNPRIVILEGED
from pter_gym.engine.batch import Batch
from pter_gym.errors import ParameterError
from pter_gym.internal.checks import names_in
from pter_gym.internal.files import FilePath
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import Sensors, observation_layout

Array = NDArray[np.float64]

CHUNK = 64
"""Episodes that are simulated together; their telemetry is scored and let go."""


@dataclass(frozen=True)
class PerSeed:
    """One policy as it came out of several training seeds; they share a line of the leaderboard."""

    policies: tuple[AnyPolicy, ...]

    def __post_init__(self) -> None:
        """Check that no policy is there twice: a copy is no further seed."""
        if not self.policies or len({id(each) for each in self.policies}) < len(self.policies):
            raise ParameterError(f"policies must be one or more, all of them different, got {self.policies!r:.200}")


def run_scenario(
    scenario: str,
    policies: Mapping[str, AnyPolicy | PerSeed] | Sequence[FilePath],
    paces: Sequence[str] = tuple(PACES),
    *,
    episodes: int | None = None,
    fresh: int | None = None,
    results: ResultsFolder | FilePath | None = None,
    num_threads: int = 2,
    on_progress: Callable[[str], None] = lambda _: None,
) -> tuple[ScenarioRun, ...]:
    """Run policies on the evaluation episodes of a scenario.

    Parameters
    ----------
    scenario
        Its name.
    policies
        By name: controllers, which are bound to the nominal machine, any ``policy(observations) -> volts``, float32
        (N, entries) to (N, 4), ``Isolated`` ones, or one of these for each training seed; or names of built-in policies
        and paths of exported ones alone.
    paces
        Names of commanded paces.
    episodes
        How many of the episodes to run, from the first on; all by default.
    fresh
        Seed within [0, 2⁶⁴) of fresh episodes, see ``fresh_seed``; the stored ones by default.
    results
        Where each finished run is kept, and taken from if it was finished before: a folder of results or its path.
    num_threads
        Threads that share the episodes of a compiled law; the scores do not depend on it.
    on_progress
        Called with the name of each policy and pace when they are done.

    Raises
    ------
    ParameterError
        If there is no such scenario, policy or pace, or there are not so many episodes.
    DataError
        If the stored episodes were changed.
    """
    named = _named(policies, scenario)
    paces = names_in("paces", paces)
    fresh = None if fresh is None else check_fresh(fresh)
    sets = {pace: find_episodes(scenario, pace, fresh) for pace in paces}
    sets = {pace: full if episodes is None else full.first(episodes) for pace, full in sets.items()}
    if results is not None and not isinstance(results, ResultsFolder):
        results = ResultsFolder(results)
    if results:
        results.make()
    runs: list[ScenarioRun] = []
    for pace, chosen in sets.items():
        batches = Batches(chosen)
        for name, policy in named.items():
            conditions = _conditions(chosen, fresh, pace, name)
            for seed, trained in enumerate(each_seed(policy)):
                bound = batches.bind(trained)
                identity = identity_of(trained, bound.policy)
                _check_built_in(name, identity)
                at = replace(conditions, seed=seed, identity=identity)
                runs.append(_find_or_run(at, bound, batches, results, num_threads))
            if results:
                results.end_seeds(replace(conditions, seed=len(each_seed(policy))))
            on_progress(f"{name}, {pace}")
    return tuple(runs)


def fresh_seed(scenario: str, policies: Mapping[str, AnyPolicy | PerSeed] | Sequence[FilePath]) -> int:
    """Return the seed of fresh episodes that follows from what is judged: all policies, the code and the scenario.

    Parameters
    ----------
    scenario, policies
        As in ``run_scenario``; all that are compared on the episodes.

    Raises
    ------
    ParameterError
        If there is no such policy, or its content cannot be told, as of a plain callable; it names the policy.
    """
    identities = {
        name: [identity_of(each, _bound_to_nominal(each)) for each in each_seed(policy)]
        for name, policy in _named(policies, scenario).items()
    }
    return derived_seed(identities, code_digest(), scenario)


def each_seed(policy: AnyPolicy | PerSeed) -> tuple[AnyPolicy, ...]:
    """Return a policy as it came out of each of its training seeds."""
    return policy.policies if isinstance(policy, PerSeed) else (policy,)


def _named(
    policies: Mapping[str, AnyPolicy | PerSeed] | Sequence[FilePath], scenario: str
) -> Mapping[str, AnyPolicy | PerSeed]:
    if not policies:
        raise ParameterError("policies must hold at least one name")
    if not isinstance(policies, Mapping):
        names = [text_of(name) for name in names_in("policies", policies)]
        for name in names:
            check_name(name)
        return {name: find_policy(name, scenario=scenario) for name in names}
    for name in policies:
        check_name(name)
    for name, policy in policies.items():
        for each in each_seed(policy):
            if not isinstance(each, Controller) and not callable(each):
                raise ParameterError(f"policies must have a method bind or be callable, {name!r} is {each!r:.200}")
            if is_built_in(name):
                _check_built_in(name, identity_of(each, _bound_to_nominal(each)))
    return policies


def _bound_to_nominal(policy: AnyPolicy) -> BoundPolicy:
    """Return a policy that is bound to the nominal machine and to the sensors that it asks for."""
    return bind(policy, BASELINE, observation_layout(BASELINE, sensors_of(policy)))


def _conditions(episodes: Episodes, fresh: int | None, pace: str, policy: str) -> Conditions:
    """Return the conditions of a run by the present code, of the first training seed and an unknown identity."""
    return Conditions(
        scenario=episodes.scenario,
        pace=pace,
        policy=policy,
        seed=0,
        episodes=len(episodes),
        data=episodes.checksum,
        identity=None,
        version=__version__,
        code=code_digest(),
        fresh=fresh,
    )


def _check_built_in(name: str, identity: str | None) -> None:
    """Raise a ParameterError if nobody can tell whether a policy is the built-in one of its name."""
    if identity is None and is_built_in(name):
        raise ParameterError(f"policies must have names of their own for callables, {name!r} is a built-in policy")


def _find_or_run(
    conditions: Conditions, bound: "Bound", batches: "Batches", results: ResultsFolder | None, num_threads: int
) -> ScenarioRun:
    """Return a run, from the results if it is there."""
    found = results and results.find(conditions)
    if found:
        return found
    made = ScenarioRun(conditions, batches.episodes.strata, *evaluate(bound, batches, num_threads))
    if results:
        results.add(made)
    return made


class Bound(NamedTuple):
    """A policy as it acts, what its observations hold, and what was bound."""

    policy: BoundPolicy
    sensors: Sensors
    kind: type


class Part(NamedTuple):
    """What comes out of one batch: scores, samples, how it was planned, mean processor time of a decision [ms]."""

    scores: Scores
    samples: list[Sample]
    plans: Plans | None
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

    def bind(self, policy: AnyPolicy) -> Bound:
        """Return a policy that can act in any of the batches; it is bound once, so what is judged is what acts."""
        sensors = sensors_of(policy)
        return Bound(bind(policy, BASELINE, self.batch(0, sensors).layout), sensors, type(policy))

    def run(self, number: int, bound: Bound) -> Part:
        """Return what comes out of one batch."""
        chunk, batch = self.chunks[number], self.batch(number, bound.sensors)
        tasks = self.episodes.tasks[chunk]
        limits = [time_limit(task) for task in tasks]
        episodes = run(batch, bound.policy, self.episodes.seeds[chunk], limits)
        telemetry = episodes.telemetry
        for world, limit in enumerate(limits):
            telemetry[limit + 1 :, world] = np.nan
        scores = score_episodes(telemetry, tasks, voltage_max=batch.machine.clutch.voltage_max)
        here = (k for k in self.kept if chunk.start <= k < chunk.stop)
        return Part(
            scores, [_sample(k, telemetry[:, k - chunk.start]) for k in here], episodes.plans, episodes.decision_ms
        )


def evaluate(bound: Bound, batches: Batches, num_threads: int) -> tuple[Scores, tuple[Sample, ...], Planning | None]:
    """Return the scores of a policy on all episodes, samples of them, and how it plans, if it does."""
    numbers = range(len(batches.chunks))
    one = partial(batches.run, bound=bound)
    if bound.policy.compiled and num_threads > 1:
        with ThreadPoolExecutor(num_threads, thread_name_prefix="pter-benchmark") as pool:
            parts = list(pool.map(one, numbers))
    else:
        parts = [one(number) for number in numbers]
    scores = {name: np.concatenate([part.scores[name] for part in parts]) for name in parts[0].scores}
    return scores, tuple(sample for part in parts for sample in part.samples), _planning(bound, batches, parts)


def _planning(bound: Bound, batches: Batches, parts: Sequence[Part]) -> Planning | None:
    """Return how a policy planned, if it did; what it was told nobody knows, unless it is one of the package's own."""
    plans = next((part.plans for part in parts if part.plans is not None), None)
    if plans is None:
        return None
    seconds = plans.horizon * batches.episodes.tasks[0].control_period
    took = float(np.mean([part.decision_ms for part in parts]))
    return Planning(bound.kind not in UNPRIVILEGED, round(seconds, 6), plans.rollouts, round(took, 2))


def _sample(number: int, telemetry: Array) -> Sample:
    finished = telemetry[np.isfinite(column(telemetry, "time"))]
    shown = np.unique(np.linspace(0, len(finished) - 1, INSTANTS).round().astype(int))
    theta = np.stack([column(finished, "theta_a"), column(finished, "theta_b")], axis=-1)
    return Sample(number, vector(finished, "tip")[shown].round(5), theta[shown].round(5))
