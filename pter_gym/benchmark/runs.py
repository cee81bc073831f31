"""Run policies on the evaluation episodes of a scenario, at each commanded pace."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pter_gym._engine.batch import Batch
from pter_gym._internal.checks import names_in, whole_number
from pter_gym._internal.files import FilePath
from pter_gym._version import __version__
from pter_gym.benchmark._naming import PerSeed, find_policies
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.benchmark.scores import SCORES, Scores, score_episodes
from pter_gym.benchmark.simulation import AnyPolicy, run, sensors_of, time_limit
from pter_gym.controllers import bind
from pter_gym.errors import unknown_name
from pter_gym.params import BASELINE, Machine
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import observation_layout

if TYPE_CHECKING:
    from pter_gym.benchmark.results import ResultsFolder

CHUNK = 64
"""Episodes that are simulated together."""


@dataclass(frozen=True)
class ScenarioRun:
    """The scores of one policy on the episodes of one scenario at one pace.

    Attributes
    ----------
    training_seed
        Number of the training seed, for a policy that was trained with several; 0 otherwise.
    seed
        Seed of fresh episodes; None for the stored ones.
    strata, scores
        A label for each episode, and an array with an entry for each episode under the name of each score.
    """

    scenario: str
    pace: str
    policy: str
    training_seed: int
    seed: int | None
    strata: tuple[str, ...]
    scores: Scores
    version: str = __version__

    @property
    def episodes(self) -> int:
        """How many of the scenario's episodes were run, starting with the first."""
        return len(self.strata)


Policies = Mapping[str, AnyPolicy | PerSeed | FilePath] | Iterable[FilePath] | FilePath


def run_scenario(
    scenario: str,
    policies: Policies,
    paces: Iterable[str | float] | float = tuple(PACES),
    *,
    episodes: int | None = None,
    seed: int | None = None,
    results: "ResultsFolder | FilePath | None" = None,
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
        (N, entries) to (N, 4), a ``PerSeed``, or what ``find_policy`` takes. Or a list of names that it takes.
    paces
        Names of commanded paces or their speeds [m/s], or one of them.
    episodes
        How many episodes to run, starting with the first; all by default.
    seed
        Seed of fresh episodes, within [0, 2⁶⁴); by default, the stored ones.
    results
        A folder of results or its path, where each run is stored.
    num_threads
        Threads that share the episodes of a compiled law, ≥ 1; scores do not depend on their number.
    on_progress
        Called with the name of each policy and pace when it is done.

    Raises
    ------
    ParameterError
        If there is no such scenario, policy or pace, or there are fewer episodes than asked for.
    DataError
        If the stored episodes are damaged.
    """
    from pter_gym.benchmark.results import ResultsFolder

    num_threads = whole_number("num_threads", num_threads)
    listed = names_in("paces", [paces] if isinstance(paces, int | float) else paces)
    sets = {pace: find_episodes(scenario, pace, seed) for pace in map(_name_of, listed)}
    named = find_policies(policies, scenario)
    if episodes is not None:
        sets = {pace: full.first(episodes) for pace, full in sets.items()}
    folder = results if results is None or isinstance(results, ResultsFolder) else ResultsFolder(results)
    if folder:
        folder.make()
    runs: list[ScenarioRun] = []
    for pace, drawn in sets.items():
        for name, versions in named.items():
            trained = [
                ScenarioRun(scenario, pace, name, number, seed, drawn.strata, evaluate(policy, drawn, num_threads))
                for number, policy in enumerate(versions)
            ]
            if folder:
                folder.add(trained)
            runs += trained
            on_progress(f"{name}, {pace}")
    return tuple(runs)


def evaluate(policy: AnyPolicy, episodes: Episodes, num_threads: int = 2, *, nominal: Machine = BASELINE) -> Scores:
    """Return the scores of a policy, bound to the nominal machine, on episodes."""
    sensors = sensors_of(policy)
    acting = bind(policy, nominal, observation_layout(nominal, sensors))

    def evaluate_from(start: int) -> Scores:
        chunk = slice(start, start + CHUNK)
        tasks = episodes.tasks[chunk]
        limits = [time_limit(task) for task in tasks]
        batch = Batch(episodes.machines[chunk], tasks, sensors=sensors)
        telemetry = run(batch, acting, episodes.seeds[chunk], limits).telemetry
        for world, limit in enumerate(limits):
            telemetry[limit + 1 :, world] = np.nan
        return score_episodes(telemetry, tasks, voltage_max=batch.machine.clutch.voltage_max)

    with ThreadPoolExecutor(num_threads if acting.compiled else 1, thread_name_prefix="pter-benchmark") as pool:
        parts = list(pool.map(evaluate_from, range(0, len(episodes), CHUNK)))
    return {name: np.concatenate([part[name] for part in parts]) for name in SCORES}


def _name_of(pace: str | float) -> str:
    """Return the name of a commanded pace given by its name or its speed [m/s], or raise a ParameterError."""
    for name, speed in PACES.items():
        if pace in (name, speed):
            return name
    raise unknown_name("paces", pace, PACES)
