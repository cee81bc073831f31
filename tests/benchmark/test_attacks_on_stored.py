"""Policies that know the stored episodes: what a search finds for them gains there, and nothing on fresh ones.

The stored episodes are public validation, so this is no hole in them; it is why published tables have fresh ones.
"""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym._engine.batch import Batch
from pter_gym.benchmark import ResultsFolder, find_policy, run_scenario, verify
from pter_gym.benchmark.episodes import Episodes, load_episodes
from pter_gym.benchmark.metrics import score_episodes
from pter_gym.benchmark.simulation import Rollout, time_limit
from pter_gym.benchmark.statistics import difference_interval
from pter_gym.controllers import BoundPolicy, bind
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import observation_layout

COUNT = 24
TRIES = 24
PACE = "brisk"
FRESH = 12
SENSORS = "force"

Volts = NDArray[np.float32]


def honest_policy() -> BoundPolicy:
    """The policy of which the attacks are made; it sees as many entries as it needs."""
    return bind(find_policy("ppo-standard"), BASELINE, observation_layout(BASELINE, "torque"))


def search(episodes: Episodes) -> Volts:
    """Return the voltages of the best of some perturbed runs on each episode, (steps, COUNT, 4)."""
    tasks = [task for task in episodes.tasks for _ in range(TRIES)]
    machines = [machine for machine in episodes.machines for _ in range(TRIES)]
    rollout = Rollout(Batch(machines, tasks), [seed for seed in episodes.seeds for _ in range(TRIES)])
    policy, rng, sent = honest_policy(), np.random.default_rng(1), []
    policy.reset()
    drift = np.zeros((len(tasks), 4))
    perturbed = np.arange(len(tasks)) % TRIES != 0

    class Perturbed(BoundPolicy):
        layout = policy.layout

        def act(self, observations: Any) -> Any:
            drift[:] = 0.95 * drift + 0.15 * rng.standard_normal(drift.shape)
            sent.append(np.clip(policy.act(observations) + perturbed[:, None] * drift, 0.0, 24.0).astype(np.float32))
            return sent[-1]

    limit = max(map(time_limit, tasks))
    while not rollout.ended.all() and rollout.steps < limit:
        rollout.step(Perturbed())
    errors = score_episodes(rollout.telemetry, tasks)["path_error_m"].reshape(COUNT, TRIES)
    return np.array(sent)[:, np.arange(COUNT) * TRIES + errors.argmin(axis=1)]


class Replay:
    """Replays voltages on the episodes that it recognises by their first observations, and is honest elsewhere."""

    sensors = SENSORS

    def __init__(self, volts: Volts, known: NDArray[np.float32]) -> None:
        self.volts, self.known = volts, known
        self._honest = honest_policy()
        self.reset()

    def reset(self) -> None:
        self.step = 0
        self._honest.reset()

    def __call__(self, obs: Any) -> Any:
        if self.step == 0:
            same = (obs[:, None] == self.known[None]).all(axis=2)
            self._numbers = np.where(same.any(axis=1), same.argmax(axis=1), -1)
        width = len(self._honest.layout)
        volts = np.array(self._honest.act(np.ascontiguousarray(obs[:, :width])))
        if self.step < len(self.volts):
            here = self._numbers >= 0
            volts[here] = self.volts[self.step, self._numbers[here]]
        self.step += 1
        return volts


def path_errors(policy: Any, fresh: int | None) -> Any:
    (run,) = run_scenario("standard", {"policy": policy}, [PACE], episodes=COUNT, fresh=fresh)
    return run.scores["path_error_m"]


@pytest.mark.slow
def test_what_is_searched_for_stored_episodes_gains_nothing_on_fresh_ones() -> None:
    episodes = load_episodes("standard", PACE).first(COUNT)
    first, _ = Batch(episodes.machines, episodes.tasks, sensors=SENSORS).reset(episodes.seeds)
    replay = Replay(search(episodes), first)
    honest = find_policy("ppo-standard")
    assert difference_interval(path_errors(replay, None), path_errors(honest, None)).high < 0.0
    assert difference_interval(path_errors(replay, FRESH), path_errors(honest, FRESH)).high >= 0.0


# --- what decides by more than observations ---


def by_the_count_of_its_calls(obs: Any, calls: Any = itertools.count()) -> Any:  # noqa: B008
    return np.full((len(obs), 4), 0.001 * next(calls))


def test_a_score_that_does_not_come_again_is_found(tmp_path: Path) -> None:
    results = ResultsFolder(tmp_path)
    policies = {"mine": by_the_count_of_its_calls}
    run_scenario("standard", policies, [PACE], episodes=1, results=results)
    results.summarise()
    finding = next(verdict.finding for verdict in verify(results, policies) if not verdict.same)
    assert finding.startswith("differs: ")
