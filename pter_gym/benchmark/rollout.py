"""The only loop of a policy over episodes, and the scores of what it records."""

from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import COMPILES
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import SKIP
from pter_gym._internal.files import FilePath
from pter_gym.benchmark.boards import is_ranked, over_limits
from pter_gym.benchmark.episodes import Episodes, training_episodes
from pter_gym.benchmark.following import Followed, follow
from pter_gym.benchmark.measures import Travel
from pter_gym.benchmark.policies import Policies, find_policies
from pter_gym.benchmark.scores import SCORES, Scores, score_episodes
from pter_gym.controllers import AnyPolicy, Policy, bind
from pter_gym.controllers._policy import sensors_of
from pter_gym.params import BASELINE, Machine
from pter_gym.policies._view import at_every_step
from pter_gym.scenarios import Scenario, find_scenario
from pter_gym.tasks.path_following import COLUMN, PathFollowing, Sensors, observation_layout

Array = NDArray[np.float64]
Observations = NDArray[np.float32]

NUMBERS = 2**53
"""A law's memory counts episodes by their seeds, in whole numbers that a float64 holds exactly."""

FULL = 0.7
"""Share of the worlds that still run at which a compiled law continues without the others."""

TOGETHER = 16
"""Control steps that a compiled law makes in one call."""


RANKED = {
    "path_error_m": Travel.path_error,
    "completed": Travel.completed,
    "mean_pace_error": Travel.mean_pace_error,
    "segment_pace_error": Travel.segment_pace_error,
}
"""The scores that decide ranks."""


class RecordedEpisodes(NamedTuple):
    """What a policy did in N episodes, from their resets on: T control steps.

    Attributes
    ----------
    telemetry
        float64 (T + 1, N, columns), NaN after the end of an episode.
    obs
        Observations, float32 (T + 1, N, entries), zero after it.
    """

    telemetry: Array
    obs: Observations


def record_episodes(
    policy: AnyPolicy, episodes: Episodes, *, sensors: Sensors | None = None
) -> RecordedEpisodes:
    """Let a policy act in episodes, as ``run_episodes`` does, and return all that it did."""
    telemetry, observations = zip(*run_episodes(policy, episodes, sensors=sensors), strict=True)
    return RecordedEpisodes(np.concatenate(telemetry), np.concatenate(observations))


def run_episodes(
    policy: AnyPolicy, episodes: Episodes, *, sensors: Sensors | None = None
) -> Generator[tuple[Array, Observations]]:
    """Let a policy act in episodes until each has ended or has come to its time limit.

    Yields telemetry, (T, N, columns), and observations, (T, N, entries), of the reset, then of the
    next T control steps; after the end of an episode they are NaN and zero.

    Parameters
    ----------
    policy
        What ``bind`` takes; it is bound to the nominal machine of the episodes.
    episodes
        The episodes.
    sensors
        Sensors of the observations; by default those that the policy needs. It sees no others.
    """
    acting = bind_to(policy, episodes)
    memory = acting.start(len(episodes), [seed % NUMBERS for seed in episodes.seeds])
    limits = np.array(episodes.time_limits)
    running, age, places = limits > 0, 0, np.arange(len(episodes))
    with episodes.worlds(sensors or sensors_of(policy)) as every:
        batch, (obs, telemetry) = every, every.reset(episodes.seeds)
        yield telemetry[None], obs[None]
        while running.any():
            if acting.law and np.count_nonzero(running) <= FULL * len(running):
                batch, memory, obs = batch.only(running), memory[running], obs[running]
                limits, places, running = limits[running], places[running], running[running]
            left = np.where(running, limits - age, 0)
            made = move(acting, batch, obs, memory, episodes.machines[0], age, left)
            over = np.arange(len(made.obs))[:, None] >= left
            made.telemetry[over], made.obs[over] = np.nan, 0.0
            age, obs, running = age + len(made.obs), made.obs[-1], made.left > 0
            whole = len(episodes)
            yield among(made.telemetry, places, whole, np.nan), among(made.obs, places, whole, 0.0)


def move(
    policy: Policy,
    batch: Batch,
    obs: Observations,
    memory: Any,
    machine: Machine,
    age: int,
    left: NDArray[np.int64],
) -> Followed:
    """Let a policy act for one or more control steps in episodes of an age; see ``follow``."""
    if policy.law and COMPILES:
        return follow(policy.law, batch, obs, memory, age, left, policy.frame_skip, TOGETHER)
    entries = np.ascontiguousarray(obs[:, : len(policy.layout)])
    volts = policy.volts(entries, memory, machine)
    obs, _, _, (terminated, truncated, _), telemetry = batch.step(volts, SKIP)
    left = np.where(terminated | truncated, 0, np.maximum(left - 1, 0))
    return Followed(obs[None], telemetry, left)


def among(rows: NDArray[Any], places: NDArray[np.intp], count: int, rest: float) -> NDArray[Any]:
    """Return rows (T, N, …) at their places among ``count``; others are filled with ``rest``."""
    if rows.shape[1] == count:
        return rows
    whole = np.full((len(rows), count, rows.shape[2]), rest, rows.dtype)
    whole[:, places] = rows
    return whole


def bind_to(policy: AnyPolicy, episodes: Episodes) -> Policy:
    """Return a policy bound to the nominal machine of episodes, with the sensors that it needs.

    Unless it is a compiled law, it is to be called at every control step. Raises a ParameterError
    also if it cannot act at their control period.
    """
    layout = observation_layout(episodes.machines[0], sensors_of(policy))
    acting = bind(policy, episodes.nominal, layout)
    acting.check_period(episodes.tasks[0].control_period)
    return acting if acting.law and COMPILES else at_every_step(acting, episodes.nominal)


def evaluate(
    policy: AnyPolicy, episodes: Episodes, num_threads: int = 2, *, ranking: bool = False
) -> Scores:
    """Return the scores of a policy, a number for each episode.

    Parameters
    ----------
    policy, episodes
        As in ``record_episodes``.
    num_threads
        Threads that share the episodes of a compiled law; scores do not depend on their number.
    ranking
        Whether only the scores that decide ranks are wanted, which takes less time.
    """
    acting, sensors = bind_to(policy, episodes), sensors_of(policy)

    def evaluate_chunk(chunk: Episodes) -> Scores:
        if not ranking:
            telemetry = record_episodes(acting, chunk, sensors=sensors).telemetry
            return score_episodes(telemetry, chunk.tasks, chunk.machines[0])
        travel = Travel(chunk.tasks)
        for telemetry, _ in run_episodes(acting, chunk, sensors=sensors):
            travel.add(telemetry)
        return {name: find(travel) for name, find in RANKED.items()}

    threads = num_threads if acting.law else 1
    chunks = episodes.chunks
    threads = min(threads, len(chunks))
    if threads == 1:
        scores = [evaluate_chunk(chunk) for chunk in chunks]
    else:
        with ThreadPoolExecutor(threads, thread_name_prefix="pter-benchmark") as pool:
            scores = list(pool.map(evaluate_chunk, chunks))
    names = (name for name in SCORES if all(name in chunk for chunk in scores))
    return {name: np.concatenate([chunk[name] for chunk in scores]) for name in names}


def check_acting(policy: AnyPolicy, episodes: Episodes) -> None:
    """Let a Python function act once, in two worlds that begin the first episode.

    So one that cannot act is refused before any work.
    """
    acting = bind_to(policy, episodes)
    if not acting.law:
        with episodes.first(1).worlds(sensors_of(policy)) as batch:
            obs, _ = batch.reset(episodes.seeds[:1])
        both = np.repeat(obs[:, : len(acting.layout)], 2, axis=0)
        acting.volts(both, acting.start(2, [0, 1]), episodes.machines[0])


class Episode(NamedTuple):
    """One episode of T control steps, with all that a policy observed and did.

    Attributes
    ----------
    telemetry
        float64 (T + 1, len(TELEMETRY)): the row of the reset, then one per control step.
    obs
        Observations with force sensors, float32 (T + 1, entries).
    volts
        Applied voltages [V], float32 (T, 4).
    """

    telemetry: Array
    obs: Observations
    volts: NDArray[np.float32]


def record_episode(
    policy: AnyPolicy,
    machine: Machine,
    task: PathFollowing,
    seed: int,
    *,
    nominal: Machine = BASELINE,
) -> Episode:
    """Return an episode in a world of its own, with the benchmark's time limit."""
    episode = Episodes("", (machine,), (task,), (seed,), ("",), nominal)
    run = record_episodes(policy, episode, sensors="force")
    telemetry = run.telemetry[:, 0]
    volts = telemetry[1:, np.array(COLUMN.volts, int)]
    return Episode(telemetry, run.obs[:, 0], volts.astype(np.float32))


RESERVE = {"completed": 0.0025, "mean_pace_error": 0.0045, "segment_pace_error": 0.0045}
"""How far within the leaderboard's limits the search keeps.

Gains that just keep a limit on its draws may miss it on others: the mean pace error over 400 draws
of `everything` has a standard error of 3 % of the limit, and among completions a single draw weighs
much.
"""

PENALTY = 1.0
"""Path error [m] that counts for each unit over a limit."""

BASELINES = ("free", "locked", "random")
"""Policies that know nothing; any that has learned something is better than each of them."""

UNSEEN = 10_000
"""Seed of draws that no training has by default."""


class Assessment(NamedTuple):
    """How good a policy is on training episodes: the means of the scores that decide ranks.

    With ``assess(…, worst=True)``, the path error is the largest instead of the mean.
    """

    path_error_m: float
    completed: float
    mean_pace_error: float
    segment_pace_error: float

    @property
    def value(self) -> float:
        """One finite number that orders all policies, the smallest first.

        It is the path error [m] plus a penalty for each limit that is not kept.
        """
        over = over_limits(self._asdict())
        return self.path_error_m + PENALTY * sum(
            max(0.0, over[name] + kept) for name, kept in RESERVE.items()
        )

    @property
    def ranked(self) -> bool:
        """Whether the means are within the limits of a rank."""
        return is_ranked(self._asdict())

    def __str__(self) -> str:
        """Return the scores as text."""
        arrives, mean, segments = (f"{100 * share:.0f} %" for share in self[1:])
        return (
            f"{1000 * self.path_error_m:.1f} mm, arrives in {arrives}, pace error {mean} "
            f"(segments {segments})"
        )


def assess(policies: Sequence[AnyPolicy], episodes: Episodes, *, worst: bool = False) -> Assessment:
    """Return the means of the scores that decide ranks, over episodes and training seeds.

    With ``worst``, the path error is the largest of all.
    """
    scores = [evaluate(policy, episodes, ranking=True) for policy in policies]
    means = {name: float(np.mean([each[name] for each in scores])) for name in Assessment._fields}
    if worst:
        means["path_error_m"] = float(np.max([each["path_error_m"] for each in scores]))
    return Assessment(**means)


def examine(
    policies: Policies | Iterable[FilePath] | FilePath = (),
    scenario: str | Scenario | PathFollowing = "standard",
    pace: str = "medium",
    *,
    episodes: int = 64,
    seed: int = UNSEEN,
    machine: Machine | str | None = None,
) -> dict[str, Assessment]:
    """Assess policies on training episodes and compare with trivial ones; the best comes first.

    Test episodes are not read, so the results may guide further training. ``free``,
    ``locked`` and ``random`` are assessed, too.

    Parameters
    ----------
    policies
        As in ``run_scenario``; training seeds of one policy are averaged.
    scenario, pace
        As in ``run_scenario``.
    episodes, seed
        Number of episodes, and the seed that selects them, ≥ 0; training uses ``context_seed``, 0
        by default.
    machine
        A machine that replaces those of the scenario, as in ``find_scenario``; policies know it.
    """
    drawn = find_scenario(scenario, machine)
    draws = training_episodes(drawn, pace, episodes, seed)
    named = find_policies(BASELINES, drawn.whose_gains)
    named |= find_policies(policies, drawn.whose_gains) if policies else {}
    assessed = {name: assess(versions, draws) for name, versions in named.items()}
    return dict(sorted(assessed.items(), key=lambda item: item[1].value))
