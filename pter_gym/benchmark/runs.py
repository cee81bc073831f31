"""Run policies on the evaluation episodes of a scenario, at each commanded pace."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from pter_gym._engine.batch import Batch
from pter_gym._internal.checks import names_in, whole_number
from pter_gym._internal.files import FilePath
from pter_gym.benchmark._find_policy import PerSeed, find_policies
from pter_gym.benchmark._wanted import wanted_forces
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.scores import SCORES, ScenarioRun, Scores, score_episodes
from pter_gym.benchmark.simulation import AnyPolicy, run, sensors_of, time_limit
from pter_gym.controllers import bind
from pter_gym.params import BASELINE, Machine
from pter_gym.scenarios import PACES, Scenario, find_scenario, name_of_pace
from pter_gym.tasks.path_following import PathFollowing, observation_layout

CHUNK = 64
"""Episodes that are simulated together."""


Policies = Mapping[str, AnyPolicy | PerSeed | FilePath] | Iterable[FilePath] | FilePath


def run_scenario(
    scenario: str | Scenario | PathFollowing,
    policies: Policies,
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
        volts``, float32 (N, entries) to (N, 4), a ``PerSeed``, or what ``find_policy`` takes. Or a
        list of names that it takes.
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
    found = find_scenario(scenario)
    if paces is None:
        paces = scenario.pace if isinstance(scenario, PathFollowing) else tuple(PACES)
    listed = names_in("paces", [paces] if isinstance(paces, int | float) else paces)
    seed = 0 if seed is None and found.digest else seed
    sets = {
        pace: find_episodes(found, pace, seed)
        for pace in (name_of_pace(each, "paces") for each in listed)
    }
    named = find_policies(policies, found.whose_gains)
    if episodes is not None:
        sets = {pace: full.first(episodes) for pace, full in sets.items()}
    folder = (
        results if results is None or isinstance(results, ResultsFolder) else ResultsFolder(results)
    )
    if folder:
        folder.make()
    runs: list[ScenarioRun] = []
    for pace, drawn in sets.items():
        for name, versions in named.items():
            scored = [
                evaluate(policy, drawn, num_threads, nominal=found.nominal) for policy in versions
            ]
            trained = [
                ScenarioRun(
                    found.name, pace, name, number, seed, drawn.strata, scores, digest=found.digest
                )
                for number, scores in enumerate(scored)
            ]
            if folder:
                folder.add(trained)
            runs += trained
            on_progress(f"{name}, {pace}")
    return tuple(runs)


def evaluate(
    policy: AnyPolicy, episodes: Episodes, num_threads: int = 2, *, nominal: Machine = BASELINE
) -> Scores:
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
        return score_episodes(
            telemetry,
            tasks,
            voltage_max=batch.machine.clutch.voltage_max,
            machines=episodes.machines[chunk],
            wanted=wanted_forces(acting, telemetry, tasks),
        )

    with ThreadPoolExecutor(
        num_threads if acting.compiled else 1, thread_name_prefix="pter-benchmark"
    ) as pool:
        parts = list(pool.map(evaluate_from, range(0, len(episodes), CHUNK)))
    names = (name for name in SCORES if all(name in part for part in parts))
    return {name: np.concatenate([part[name] for part in parts]) for name in names}
