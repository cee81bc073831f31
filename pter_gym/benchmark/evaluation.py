"""Policies on the evaluation episodes of a scenario, at each commanded pace."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._version import __version__
from pter_gym.benchmark.episodes import FOLDER, Episodes, load_episodes
from pter_gym.benchmark.metrics import Scores, column, score_episodes, vector
from pter_gym.benchmark.pacing import PACES, PerPace, find_policy
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.runs import Conditions, Planning, Sample, ScenarioRun, code_digest
from pter_gym.benchmark.simulation import AnyPolicy, bind, simulate, simulate_alone, time_limit
from pter_gym.compiled.compiler import digest_of
from pter_gym.controllers import Controller, Policy
from pter_gym.controllers.predictive import Predictive
from pter_gym.engine.batch import Batch
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import TELEMETRY

Array = NDArray[np.float64]
AnyKind = Controller | AnyPolicy | Predictive

CHUNK = 64
"""Episodes that are simulated together; their telemetry is scored and let go."""

SAMPLES = 4
"""Episodes of a run that are kept to be drawn: the first of each stratum, then the first ones."""

INSTANTS = 200
"""Largest number of instants that are kept of such an episode."""


@dataclass(frozen=True)
class PerSeed:
    """One policy as it came out of several training seeds; they share a line of the leaderboard."""

    policies: tuple[AnyKind | PerPace, ...]


def run_scenario(
    scenario: str,
    policies: Mapping[str, AnyKind | PerPace | PerSeed] | Sequence[str],
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
        (N, entries) to (N, 4), or policies that plan, or one of these for each pace, or any of these for each training
        seed; or names of built-in policies alone. What a callable is, its attribute ``identity`` may say (a string);
        without one, it is run again each time.
    paces
        Names of commanded paces.
    episodes
        How many of the stored episodes to run, from the first on; all by default.
    results
        Where each finished run is kept, and taken from if it was finished before.
    num_threads
        Threads that share the episodes of a controller; the scores do not depend on it.
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
                here = trained.at(pace) if isinstance(trained, PerPace) else trained
                ready = batches.bind(here)
                conditions = _conditions(chosen, pace, name, seed, identity(here, ready))
                run = results and results.find(conditions)
                if not run:
                    run = ScenarioRun(conditions, chosen.strata, *evaluate(ready, batches, num_threads))
                    if results:
                        results.add(run)
                runs.append(run)
            on_progress(f"{name}, {pace}")
    return tuple(runs)


class Batches:
    """The episodes in batches of ``CHUNK`` worlds, which are made once for all policies."""

    def __init__(self, episodes: Episodes) -> None:
        self.episodes = episodes
        starts = range(0, len(episodes), CHUNK)
        self.chunks = [slice(start, start + CHUNK) for start in starts]
        self.batches = [Batch(episodes.machines[chunk], episodes.tasks[chunk]) for chunk in self.chunks]
        self.kept = sample_numbers(episodes.strata)

    def bind(self, policy: AnyKind) -> AnyPolicy | Predictive:
        """Return a policy that can act in any of the batches."""
        return policy if isinstance(policy, Predictive) else bind(policy, BASELINE, self.batches[0])

    def run(self, number: int, policy: AnyPolicy) -> tuple[Scores, list[Sample]]:
        """Return the scores of one batch, and what is kept of it."""
        chunk, batch = self.chunks[number], self.batches[number]
        limits = [time_limit(task) for task in self.episodes.tasks[chunk]]
        telemetry = simulate(batch, policy, self.episodes.seeds[chunk], max(limits))
        for world, limit in enumerate(limits):
            telemetry[limit + 1 :, world] = np.nan
        return self._kept(number, telemetry)

    def plan(self, number: int, policy: Predictive) -> tuple[Scores, list[Sample], list[float]]:
        """Return the same of a policy that plans, each episode by itself, and the processor time of a decision [ms]."""
        chunk, e = self.chunks[number], self.episodes
        found = [
            simulate_alone(policy, machine, task, seed, time_limit(task))
            for machine, task, seed in zip(e.machines[chunk], e.tasks[chunk], e.seeds[chunk], strict=True)
        ]
        longest = max(len(episode.telemetry) for episode in found)
        telemetry = np.full((longest, len(found), len(TELEMETRY)), np.nan)
        for world, episode in enumerate(found):
            telemetry[: len(episode.telemetry), world] = episode.telemetry
        return (*self._kept(number, telemetry), [episode.decision_ms for episode in found])

    def _kept(self, number: int, telemetry: Array) -> tuple[Scores, list[Sample]]:
        """Return the scores of the telemetry of one batch, and samples of it."""
        chunk, batch = self.chunks[number], self.batches[number]
        tasks = self.episodes.tasks[chunk]
        scores = score_episodes(telemetry, tasks, voltage_max=batch.machine.clutch.voltage_max)
        here = (k for k in self.kept if chunk.start <= k < chunk.stop)
        return scores, [_sample(k, telemetry[:, k - chunk.start]) for k in here]


def evaluate(
    policy: AnyPolicy | Predictive, batches: Batches, num_threads: int
) -> tuple[Scores, tuple[Sample, ...], Planning | None]:
    """Return the scores of a policy on all episodes, samples of them, and how it plans, if it does."""
    numbers = range(len(batches.chunks))
    planning = None
    if isinstance(policy, Predictive):
        planned = [batches.plan(number, policy) for number in numbers]
        parts = [(scores, samples) for scores, samples, _ in planned]
        planning = _planning(policy, batches, [took for _, _, times in planned for took in times])
    elif isinstance(policy, Policy) and num_threads > 1:
        with ThreadPoolExecutor(num_threads, thread_name_prefix="pter-benchmark") as pool:
            parts = list(pool.map(partial(batches.run, policy=policy), numbers))
    else:
        parts = [batches.run(number, policy) for number in numbers]
    scores = {name: np.concatenate([part[name] for part, _ in parts]) for name in parts[0][0]}
    return scores, tuple(sample for _, samples in parts for sample in samples), planning


def _planning(policy: Predictive, batches: Batches, times: Sequence[float]) -> Planning:
    """Return how a policy planned whose decisions took so long in each episode [ms]."""
    settings = policy.settings
    horizon = settings.horizon * batches.episodes.tasks[0].control_period
    return Planning(policy.privileged, round(horizon, 6), settings.rollouts, round(float(np.mean(times)), 2))


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


def identity(policy: AnyKind, bound: AnyPolicy | Predictive) -> str | None:
    """Return what a policy is, so that a run need not be repeated, or None if nobody can tell.

    That is what it says itself in ``identity``; of a controller, its gains in words and a hash of gains and law.
    """
    if isinstance(bound, Policy):
        name = repr(policy) if is_dataclass(policy) else type(policy).__qualname__
        return f"{name} {hashlib.sha256(bound.gains.tobytes() + digest_of(bound.law).encode()).hexdigest()}"
    said: Any = getattr(policy, "identity", None)
    return said if isinstance(said, str) else None
