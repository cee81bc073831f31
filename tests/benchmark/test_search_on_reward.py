"""A search for reward alone, by another way than an agent's, finds nothing that rides worse."""

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmark.attacks import Course
from benchmark.test_reward import CLEARLY, discounted, judge, policies, sight
from pter_gym.benchmark.boards import COMPLETION, PACE_ERROR
from pter_gym.benchmark.episodes import Episodes
from pter_gym.benchmark.rollout import record_episodes
from pter_gym.benchmark.scores import score_episodes
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES, find_scenario
from pter_gym.tasks.path_following import COLUMN, observation_layout

cmaes = pytest.importorskip("cmaes")

CANDIDATES = 2000
POPULATION = 20
EPISODES = 8
"""Training draws on which each candidate rides."""

HIDDEN = 8
JUDGED = 50
"""Other training episodes, on which the best candidate is compared with the policies."""

STICKS = {("tremor", "slow"): "single-dof-tuned"}
"""A law that earns less than its error says, as it sticks and slips (docs/reward.md)."""

Array = NDArray[np.float64]
ENTRIES = len(observation_layout(BASELINE, "torque"))
WEIGHTS = (ENTRIES + 1) * HIDDEN + (HIDDEN + 1) * 4


class Networks:
    """Networks of one hidden layer and normalised actions, each for so many worlds in turn."""

    def __init__(self, weights: Array, worlds: int) -> None:
        count = len(weights)
        first, second = np.split(weights, [(ENTRIES + 1) * HIDDEN], axis=1)
        self._first = first.reshape(count, ENTRIES + 1, HIDDEN)
        self._second = second.reshape(count, HIDDEN + 1, 4)
        self._worlds = worlds

    def __call__(self, obs: NDArray[np.float32]) -> Array:
        seen = obs[:, :ENTRIES].reshape(len(self._first), self._worlds, ENTRIES)
        hidden = np.tanh(seen @ self._first[:, :-1] + self._first[:, -1:])
        action = np.tanh(hidden @ self._second[:, :-1] + self._second[:, -1:])
        return BASELINE.clutch.voltage_max * (0.5 * (action + 1.0)).reshape(len(obs), 4) ** 2


def searched(course: Course, discount: float, seed: int) -> Array:
    """Return the best candidate of a search by CMA-ES (Hansen, arXiv:1604.00772)."""
    pairs = find_scenario(course.scenario).draws.pairs(EPISODES, seed, course.pace)
    machines, tasks = (list(each) * POPULATION for each in zip(*pairs, strict=True))
    worlds = len(tasks)
    episodes = Episodes("", tuple(machines), tuple(tasks), tuple(range(worlds)), ("",) * worlds)
    search = cmaes.CMA(np.zeros(WEIGHTS), 0.3, seed=seed, population_size=POPULATION)
    best, highest = np.zeros(WEIGHTS), -np.inf
    for _ in range(CANDIDATES // POPULATION):
        points = np.array([search.ask() for _ in range(POPULATION)])
        networks = Networks(points, EPISODES)
        telemetry = record_episodes(networks, episodes).telemetry[..., [COLUMN.reward]]
        rewards = np.nan_to_num(telemetry[1:, :, 0])
        found = [discounted(part, discount) for part in np.split(rewards, POPULATION, axis=1)]
        search.tell([(point, -value) for point, value in zip(points, found, strict=True)])
        if max(found) > highest:
            best, highest = points[np.argmax(found)], max(found)
    return best


def rides_clearly_worse(course: Course, rows: Array, best: float) -> bool:
    """Return whether there is no rank at limits twice as wide, or a clearly larger error."""
    scores = score_episodes(rows, course.tasks)
    off = max(float(scores[name].mean()) for name in ("mean_pace_error", "segment_pace_error"))
    missed = 1.0 - float(scores["completed"].mean())
    error = float(scores["path_error_m"].mean())
    return (
        off > CLEARLY * PACE_ERROR
        or missed > CLEARLY * (1.0 - COMPLETION)
        or error > CLEARLY * best
    )


@pytest.mark.long
@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("scenario", ["standard", "tremor", "everything"])
def test_a_search_for_reward_returns_less_than_clearly_better_tracking(
    scenario: str, pace: str
) -> None:
    course = Course(scenario, pace, JUDGED, 991)
    discounts = (1.0, sight(course))
    honest = {name: judge(policy, course) for name, policy in policies(course).items()}
    rows = course.telemetry(Networks(searched(course, discounts[1], seed=5)[None], JUDGED))
    rewards = np.nan_to_num(rows[1:, :, COLUMN.reward])
    found = [discounted(rewards, discount) for discount in discounts]
    assert found[0] > honest["locked"].returned(1.0), "the search found nothing"
    ranked = {name: each for name, each in honest.items() if each.ranks}
    ranked = ranked or {
        name: honest[name] for name in ("residual", "single-dof-tuned")
    }  # `tremor` at the brisk pace
    more = [
        name
        for name, each in ranked.items()
        if name != STICKS.get((scenario, pace))
        if rides_clearly_worse(course, rows, each.error)
        if any(
            each.returned(discount) <= mine for discount, mine in zip(discounts, found, strict=True)
        )
    ]
    assert more == [], found
    assert found[0] < max(each.returned(1.0) for each in ranked.values())
