"""The reward agrees with the score: who scores clearly better returns more, at any usual discount."""

from functools import partial
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
import pytest

from benchmark.test_attacks import Attack, Course, beside, every, locks, rides, within
from benchmark.test_attacks_on_reward import DISCOUNTS, returns
from pter_gym._engine.batch import Batch
from pter_gym.benchmark import PACES, find_policy
from pter_gym.benchmark.metrics import score_episodes
from pter_gym.benchmark.simulation import run
from pter_gym.controllers import bind
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.policies import shipped_policies
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.tasks.path_following import COLUMN
from pter_gym.tasks.path_following._reward import PERFECT

DRAWS = 50
SEED = 991
"""Of training draws."""

CLEARLY = 2.0
"""Ratio of path errors beyond which scores differ clearly."""

AGREEING = 0.97
"""Smallest share of the pairs in which the reward agrees. Laws that stick and slip earn less than they score."""

SHORT_SIGHTED = {
    ("standard", "slow", 0.99, "single-dof-tuned rides beside"),
    ("tremor", "slow", 0.99, "free"),
}
"""Scenario, pace, discount and game where an agent does not see the game whole: within a second, a tenth of the path,
who is going to ride beside it is not beside yet, and a free arm is still where its hand holds it. No other game returns
more."""

GAMES: dict[str, Attack] = {
    "rushes": rides(lambda *_: 4.0),
    "crawls": rides(lambda *_: 0.4),
    "rides beside": beside(-0.15),
    "stops and goes": locks(partial(every, steps=30, of=60)),
}
"""What is made of honest policies, and has no rank or a large error."""

LINGERS = rides(within(0, 0.3))

LAWS = ("impedance", "torque-feedback")
TUNED = ("impedance-tuned", "torque-feedback-tuned", "single-dof-tuned", "velocity-ratio-tuned")
IDLE = ("locked", "free", "random")


class Judged(NamedTuple):
    """What a policy scores, and its returns under ``DISCOUNTS``."""

    error: float
    ranks: bool
    returns: tuple[float, ...]


def policies(course: Course) -> dict[str, Any]:
    """Return policies that a scenario has, honest and not."""
    found: dict[str, Any] = {}
    for name in (*IDLE, *LAWS, *TUNED, *shipped_policies()):
        try:
            found[name] = bind(find_policy(name, scenario=course.scenario), BASELINE, course.batch.layout)
        except ParameterError:
            continue
    for honest in ("residual", "single-dof-tuned"):
        attacked = course.attacked(found[honest], course.telemetry(found[honest]))
        found |= {f"{honest} {game}": play(attacked) for game, play in (*GAMES.items(), ("lingers", LINGERS))}
    return found


def judge(policy: Any, course: Course) -> Judged:
    rows = course.telemetry(policy)
    scores = score_episodes(rows, course.tasks)
    error = float(scores["path_error_m"].mean())
    return Judged(error, course.ranked(scores), tuple(returns(rows, discount) for discount in DISCOUNTS))


@pytest.mark.parametrize(
    ("scenario", "paces"),
    [("standard", ("brisk",)), *(pytest.param(name, tuple(PACES), marks=pytest.mark.long) for name in SCENARIOS)],
)
def test_who_scores_clearly_better_returns_more(scenario: str, paces: tuple[str, ...]) -> None:
    pairs, wrong = 0, list[tuple[str, float, str, str]]()
    for pace in paces:
        course = Course(scenario, pace, DRAWS, SEED)
        found = {name: judge(policy, course) for name, policy in policies(course).items()}
        for (name, better), (other, worse) in permutations(found.items(), 2):
            if better.ranks and better.error * CLEARLY < worse.error:
                pairs += len(DISCOUNTS)
                returned = zip(DISCOUNTS, better.returns, worse.returns, strict=True)
                wrong += [(pace, discount, name, other) for discount, more, less in returned if more <= less]
    games = (*IDLE, *GAMES)
    played = {(scenario, pace, discount, other) for pace, discount, _, other in wrong if other.endswith(games)}
    told = f"{len(wrong)} of {pairs}:\n" + "\n".join(map(str, wrong))
    assert played <= SHORT_SIGHTED, told
    assert pairs > 100
    assert len(wrong) <= (1.0 - AGREEING) * pairs, told


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_an_episode_pays_at_most_its_new_arc_length(scenario: str) -> None:
    """Whatever the voltages: a step pays at most what it newly covers, an episode at most ``PERFECT``."""
    pairs = find_scenario(scenario).randomisation(contexts=16, seed=3).pairs()
    machines, tasks = map(list, zip(*pairs, strict=True))
    batch = Batch(machines, tasks)
    rng = np.random.default_rng(0)
    rows = run(batch, lambda _: rng.choice([0.0, 3.0, 24.0], (16, 4)), list(range(16)), [400] * 16).telemetry
    lengths = np.array([task.path.length for task in tasks])
    new = np.nan_to_num(np.diff(rows[..., COLUMN.reached], axis=0))
    tracking = np.nan_to_num(rows[1:, :, COLUMN.terms.tracking])
    assert (tracking <= PERFECT * new / lengths * (1.0 + 1e-12)).all()
    assert (tracking.sum(axis=0) <= PERFECT).all()
    assert tracking.max() > 0.0
    pace = np.nan_to_num(rows[1:, :, COLUMN.terms.pace])
    assert (pace <= 0.0).all()
    assert pace.min() < 0.0
