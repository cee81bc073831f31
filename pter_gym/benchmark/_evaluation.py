"""Run policies on the evaluation episodes of a scenario, at each commanded pace."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._engine.batch import Batch
from pter_gym._internal.checks import names_in
from pter_gym._internal.files import FilePath
from pter_gym._version import __version__
from pter_gym.benchmark._identity import identity_of
from pter_gym.benchmark._isolation import Isolated
from pter_gym.benchmark._measures import column, vector
from pter_gym.benchmark._naming import find_policy, is_built_in, text_of
from pter_gym.benchmark._results import ResultsFolder
from pter_gym.benchmark._runs import (
    INSTANTS,
    Conditions,
    Planning,
    Sample,
    ScenarioRun,
    check_name,
    code_digest,
    derived_seed,
    sample_numbers,
)
from pter_gym.benchmark.episodes import DERIVED, Episodes, check_fresh, find_episodes
from pter_gym.benchmark.metrics import SCORES, Scores, score_episodes
from pter_gym.benchmark.simulation import AnyPolicy, run, sensors_of, time_limit
from pter_gym.controllers import BoundPolicy, Controller, bind
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import Sensors, observation_layout

CHUNK = 64
"""Episodes that are simulated together; their telemetry is scored and let go."""


@dataclass(frozen=True)
class PerSeed:
    """One policy trained with several seeds; the seeds share a row of the leaderboard."""

    policies: tuple[AnyPolicy, ...]

    def __post_init__(self) -> None:
        """Check that no policy appears twice: a copy does not count as another seed."""
        if not self.policies or len({id(each) for each in self.policies}) < len(self.policies):
            raise ParameterError(f"policies must be one or more, all of them different, got {self.policies!r:.200}")


Policies = Mapping[str, AnyPolicy | PerSeed] | Sequence[FilePath]


def run_scenario(
    scenario: str,
    policies: Policies,
    paces: Sequence[str] = tuple(PACES),
    *,
    episodes: int | None = None,
    fresh: int | str | None = None,
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
        (N, entries) to (N, 4), ``Isolated`` policies, or one of these for each training seed. Or a list of names of
        built-in policies and paths of exported ones.
    paces
        Names of commanded paces.
    episodes
        How many episodes to run, starting with the first; all by default.
    fresh
        Seed of fresh episodes, within [0, 2⁶⁴); or ``"derived"``: each policy has its own episodes, with a seed
        computed from its content, the code and the scenario. By default, the stored episodes.
    results
        A folder of results or its path. Finished runs are stored there and reused if they already exist. The content
        of a callable cannot be determined, so it is run again each time. An ``Isolated`` policy uses up the seed of
        its fresh episodes: the folder records it, and no other policy may run on them.
    num_threads
        Threads that share the episodes of a compiled law; scores do not depend on their number.
    on_progress
        Called with the name of each policy and pace when it is done.

    Raises
    ------
    ParameterError
        If there is no such scenario, policy or pace, there are fewer episodes than asked for, a seed is used up, or a
        seed is to be derived from a policy whose content cannot be determined.
    DataError
        If the stored episodes were changed.
    """
    named = _named(policies, scenario)
    fresh = check_fresh(fresh)
    everyone = [(name, bound) for name, seeds in named.items() for bound in seeds]
    if fresh == DERIVED:
        for name, bound in everyone:
            derived_seed(name, bound.identity, scenario)
    sets = {pace: _episodes(scenario, pace, fresh, episodes) for pace in names_in("paces", paces)}
    folder = ResultsFolder(results) if results is not None and not isinstance(results, ResultsFolder) else results
    if folder:
        folder.make()
        if isinstance(fresh, int) and any(issubclass(bound.kind, Isolated) for _, bound in everyone):
            folder.use_up(scenario, fresh)
    runs: list[ScenarioRun] = []
    for pace, shared in sets.items():
        batches = Batches(shared)
        for name, seeds in named.items():
            for seed, bound in enumerate(seeds):
                at = Conditions(
                    scenario=scenario,
                    pace=pace,
                    policy=name,
                    seed=seed,
                    episodes=len(shared),
                    data=shared.checksum,
                    identity=bound.identity,
                    version=__version__,
                    code=code_digest(),
                    fresh=fresh,
                )
                if fresh == DERIVED:
                    batches = Batches(_episodes(scenario, pace, at.fresh_seed, episodes))
                    at = replace(at, data=batches.episodes.checksum)
                runs.append(_run(at, bound, batches, folder, num_threads))
            if folder:
                folder.end_seeds(replace(runs[-1].conditions, seed=len(seeds)))
            on_progress(f"{name}, {pace}")
    return tuple(runs)


def _episodes(scenario: str, pace: str, fresh: int | str | None, count: int | None) -> Episodes:
    """Return that many episodes, all by default; the stored ones stand in where each policy has its own."""
    full = find_episodes(scenario, pace, None if isinstance(fresh, str) else fresh)
    return full if count is None else full.first(count)


def _run(
    at: Conditions, bound: "Bound", batches: "Batches", folder: ResultsFolder | None, num_threads: int
) -> ScenarioRun:
    """Return a run: from the folder if it is already there, otherwise run and stored there."""
    if folder and (found := folder.find(at)):
        return found
    made = ScenarioRun(at, batches.episodes.strata, *evaluate(bound, batches, num_threads))
    if folder:
        folder.add(made)
    return made


def each_seed(policy: AnyPolicy | PerSeed) -> tuple[AnyPolicy, ...]:
    """Return a policy's version from each of its training seeds."""
    return policy.policies if isinstance(policy, PerSeed) else (policy,)


def _named(policies: Policies, scenario: str) -> dict[str, list["Bound"]]:
    """Return bound policies by name, or raise a ParameterError for one that cannot be scored under its name."""
    if not policies:
        raise ParameterError("policies must hold at least one name")
    if not isinstance(policies, Mapping):
        names = [text_of(name) for name in names_in("policies", policies)]
        for name in names:
            check_name(name)
        policies = {name: find_policy(name, scenario=scenario) for name in names}
    for name, policy in policies.items():
        check_name(name)
        for each in each_seed(policy):
            if not isinstance(each, Controller) and not callable(each):
                raise ParameterError(f"policies must have a method bind or be callable, {name!r} is {each!r:.200}")
    named = {name: [bind_once(each) for each in each_seed(policy)] for name, policy in policies.items()}
    for name, seeds in named.items():
        if is_built_in(name) and any(bound.identity is None for bound in seeds):
            raise ParameterError(f"policies must have names of their own for callables, {name!r} is a built-in policy")
    return named


class Bound(NamedTuple):
    """A policy as it acts, its identity, its sensors, and the policy it was bound from."""

    policy: BoundPolicy
    identity: str | None
    sensors: Sensors
    kind: type


def bind_once(policy: AnyPolicy) -> Bound:
    """Return a policy bound to the nominal machine and the sensors that it asks for; what acts is what is scored."""
    sensors = sensors_of(policy)
    acting = bind(policy, BASELINE, observation_layout(BASELINE, sensors))
    return Bound(acting, identity_of(policy, acting), sensors, type(policy))


class Part(NamedTuple):
    """The results of one batch: scores, samples, how the policy planned, mean CPU time of a decision [ms]."""

    scores: Scores
    samples: list[Sample]
    decision_ms: float


class Batches:
    """The episodes in batches of ``CHUNK`` worlds, built once for all policies with the same sensors."""

    def __init__(self, episodes: Episodes) -> None:
        self.episodes = episodes
        self.chunks = [slice(start, start + CHUNK) for start in range(0, len(episodes), CHUNK)]
        self.batch = cache(self._make)

    def _make(self, number: int, sensors: Sensors) -> Batch:
        chunk = self.chunks[number]
        return Batch(self.episodes.machines[chunk], self.episodes.tasks[chunk], sensors=sensors)

    def run(self, number: int, bound: Bound) -> Part:
        """Return the results of one batch."""
        chunk, batch = self.chunks[number], self.batch(number, bound.sensors)
        tasks = self.episodes.tasks[chunk]
        limits = [time_limit(task) for task in tasks]
        rollout = run(batch, bound.policy, self.episodes.seeds[chunk], limits)
        telemetry = rollout.telemetry
        for world, limit in enumerate(limits):
            telemetry[limit + 1 :, world] = np.nan
        scores = score_episodes(telemetry, tasks, voltage_max=batch.machine.clutch.voltage_max)
        kept = [k for k in sample_numbers(self.episodes.strata) if chunk.start <= k < chunk.stop]
        samples = [_sample(k, telemetry[:, k - chunk.start]) for k in kept]
        return Part(scores, samples, rollout.decision_ms)


def evaluate(bound: Bound, batches: Batches, num_threads: int) -> tuple[Scores, tuple[Sample, ...], Planning | None]:
    """Return the scores of a policy on all episodes, sample episodes, and how it plans, if it does."""
    numbers = range(len(batches.chunks))
    one = partial(batches.run, bound=bound)
    if bound.policy.compiled and num_threads > 1:
        with ThreadPoolExecutor(num_threads, thread_name_prefix="pter-benchmark") as pool:
            parts = list(pool.map(one, numbers))
    else:
        parts = [one(number) for number in numbers]
    scores = {name: np.concatenate([part.scores[name] for part in parts]) for name in SCORES}
    return scores, tuple(sample for part in parts for sample in part.samples), None


def _sample(number: int, telemetry: NDArray[np.float64]) -> Sample:
    finished = telemetry[np.isfinite(column(telemetry, "time"))]
    shown = np.unique(np.linspace(0, len(finished) - 1, INSTANTS).round().astype(int))
    theta = np.stack([column(finished, "theta_a"), column(finished, "theta_b")], axis=-1)
    return Sample(number, vector(finished, "tip")[shown].round(5), theta[shown].round(5))
