"""Attacks on score and reward: none has a smaller error or a larger return than honest riding."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from benchmark.attacks import (
    COURSES,
    Attack,
    Course,
    alternates,
    beside,
    beyond,
    inside,
    locks,
    rides,
    sets,
    tells,
)
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.measures import column
from pter_gym.benchmark.scores import score_episodes
from pter_gym.controllers import bind
from pter_gym.params import BASELINE
from rollouts import Acting

HONEST = {"standard": "ppo-standard", "paths": "single-dof-tuned"}
DISCOUNTS = (1.0, 0.998, 0.995, 0.99)


ATTACKS: dict[str, Attack] = {
    "stands at the start": locks(beyond(-9.0)),
    "lets go and rushes": sets(0.0, beyond(-9.0)),
    "lives on before the end": locks(beyond(0.97)),
    "rides at half of the pace": rides(lambda _: 0.5),
    "rides at twice the pace": rides(lambda _: 2.0),
    "stops and goes": alternates(0.5, 2.0, 20),
    "rides 60 mm beside the path": beside(0.06),
    "leaves the workspace at once": beside(0.5),
    "weaves": tells(error=lambda self, _: 0.02 * np.sin(0.3 * self.steps)),
}

ON_BENDS: dict[str, Attack] = {
    "cuts the corners": inside(0.1, 0.03),
    "rides near the centres of the bends": inside(0.85, 0.2),
}


def discounted(rewards: Any, discount: float) -> float:
    """Return the mean return of episodes from the rewards of their control steps, (T, N)."""
    return float((discount ** np.arange(len(rewards)) @ rewards).mean())


def returns(telemetry: Any, discount: float) -> float:
    return discounted(np.nan_to_num(column(telemetry[1:], "reward")), discount)


ON_SCORE: tuple[Attack, ...] = (
    rides(lambda _: 0.88),
    alternates(0.6, 2.5, 20),
    beside(0.06, until=0.95),
)


def test_no_attack_ranks_above_the_honest_policy() -> None:
    course = Course("standard", "brisk")
    policy = bind(find_policy("residual", scenario="standard"), BASELINE, course.layout)
    honest, *attacks = (
        score_episodes(course.telemetry(rider), course.tasks)
        for rider in (policy, *(attack(policy) for attack in ON_SCORE))
    )
    assert course.ranked(honest)
    best = honest["path_error_m"].mean()
    assert all(not course.ranked(each) or each["path_error_m"].mean() > best for each in attacks)


@pytest.mark.parametrize(("scenario", "pace"), COURSES)
def test_no_attack_has_the_return_of_the_honest_policy(scenario: str, pace: str) -> None:
    course = Course(scenario, pace)
    policy = bind(find_policy(HONEST[scenario], scenario=scenario), BASELINE, course.layout)
    rows = course.telemetry(policy)
    honest = [returns(rows, discount) for discount in DISCOUNTS]
    more = {}
    tried = ATTACKS if scenario == "standard" else ON_BENDS
    for attack in tried:
        telemetry = course.telemetry(tried[attack](policy))
        found = [returns(telemetry, discount) for discount in DISCOUNTS]
        if any(mine >= other for mine, other in zip(found, honest, strict=True)):
            more[attack] = found
    assert more == {}, honest


def mean_return(policy: str, leaves_at: float = np.inf) -> float:
    """Return the mean return of a policy that is led off the path beyond a part of it."""
    envs: Any = gymnasium.make_vec(
        "PTER/Standard-v0", 128, frame_skip=1, action_unit="volt", autoreset_mode="SAME_STEP"
    ).unwrapped
    layout = envs.batch.layout
    rider = Acting(bind(find_policy(policy, scenario="standard"), BASELINE, layout))
    progress, error = layout.index("progress"), layout.index("normal_error")
    obs = envs.reset(seed=3)[0]
    total, alive = np.zeros(len(obs)), np.ones(len(obs), bool)
    while alive.any():
        told = np.array(obs)
        told[told[:, progress] * layout.scales[progress] >= leaves_at, error] += (
            0.5 / layout.scales[error]
        )
        obs, rewards, terminated, truncated, _ = envs.step(rider(told))
        total += np.where(alive, rewards, 0.0)
        alive &= ~(terminated | truncated)
    return float(total.mean())


def test_in_the_ids_leaving_sideways_returns_less_than_any_ranked_law() -> None:
    ranked = min(mean_return(law) for law in ("single-dof-tuned", "torque-feedback-tuned"))
    led_off = {
        "ppo-standard": (0.3, 0.5, 0.7),
        "residual": (0.3, 0.5),
    }  # the latter is not fooled from 0.7 on
    for policy, parts in led_off.items():
        for part in parts:
            assert mean_return(policy, leaves_at=part) < 0.0 < ranked
