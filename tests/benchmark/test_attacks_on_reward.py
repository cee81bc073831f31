"""Ways to collect reward without riding well: none has the return of the honest policy that it is made of."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from benchmark.test_attacks import Attack, Course, alternates, beside, beyond, every, inside, locks, rides, sets, tells
from pter_gym.benchmark import PACES, find_policy
from pter_gym.benchmark.measures import column
from pter_gym.controllers import bind
from pter_gym.params import BASELINE

HONEST = {"standard": "ppo-standard", "paths": "single-dof-tuned"}
DISCOUNTS = (1.0, 0.995, 0.99)


ATTACKS: dict[str, Attack] = {
    "stands at the start": locks(beyond(-9.0)),
    "lets go and rushes": sets(0.0, beyond(-9.0)),
    "stands after a while": locks(beyond(0.5)),
    "lives on before the end": locks(beyond(0.97)),
    "locks again and again for reward": locks(partial(every, steps=10, of=20)),
    "lets go again and again for reward": sets(0.0, partial(every, steps=10, of=20)),
    "rides at half of the pace": rides(lambda *_: 0.5),
    "rides at twice the pace": rides(lambda *_: 2.0),
    "stops and goes for reward": alternates(0.5, 2.0, 20),
    "rides 60 mm beside for reward": beside(0.06),
    "leaves the workspace at once": beside(0.5),
    "weaves for reward": tells(error=lambda self, _: 0.02 * np.sin(0.3 * self.steps)),
}

ON_BENDS: dict[str, Attack] = {
    "cuts the corners for reward": inside(0.1, 0.03),
    "rides near the centres of the bends for reward": inside(0.85, 0.2),
}


def returns(telemetry: Any, discount: float) -> float:
    rewards = np.nan_to_num(column(telemetry[1:], "reward"))
    return float((discount ** np.arange(len(rewards)) @ rewards).mean())


@pytest.mark.slow
@pytest.mark.parametrize("scenario", HONEST)
@pytest.mark.parametrize("pace", PACES)
def test_no_attack_has_the_return_of_the_honest_policy(pace: str, scenario: str) -> None:
    course = Course(scenario, pace)
    policy = bind(find_policy(HONEST[scenario], scenario=scenario), BASELINE, course.batch.layout)
    rows = course.telemetry(policy)
    attacked = course.attacked(policy, rows)
    honest = [returns(rows, discount) for discount in DISCOUNTS]
    more = {}
    tried = ATTACKS if scenario == "standard" else ON_BENDS
    for attack in tried:
        telemetry = course.telemetry(tried[attack](attacked))
        found = [returns(telemetry, discount) for discount in DISCOUNTS]
        if any(mine >= other for mine, other in zip(found, honest, strict=True)):
            more[attack] = found
    assert more == {}, honest
