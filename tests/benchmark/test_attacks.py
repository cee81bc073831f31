"""Riding that is meant to look better than it is has no better rank than honest riding."""

from benchmark.attacks import Attack, Course, alternates, beside, rides
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.scores import score_episodes
from pter_gym.controllers import bind
from pter_gym.params import BASELINE

ATTACKS: tuple[Attack, ...] = (
    rides(lambda _: 0.88),
    alternates(0.6, 2.5, 20),
    beside(0.06, until=0.95),
)


def test_no_attack_ranks_above_the_honest_policy() -> None:
    course = Course("standard", "brisk")
    policy = bind(find_policy("residual", scenario="standard"), BASELINE, course.layout)
    honest, *attacks = (
        score_episodes(course.telemetry(rider), course.tasks)
        for rider in (policy, *(attack(policy) for attack in ATTACKS))
    )
    assert course.ranked(honest)
    best = honest["path_error_m"].mean()
    assert all(not course.ranked(each) or each["path_error_m"].mean() > best for each in attacks)
