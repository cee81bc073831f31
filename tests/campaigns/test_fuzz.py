"""A small fuzz campaign, and that it finds what it looks for."""

from typing import Any

import numpy as np
import pytest

from campaigns import fuzz
from pter_gym.tasks.path_following import _specification as specification


def test_constructors_accept_or_refuse_and_say_nothing_else() -> None:
    built = fuzz.build(1500)
    assert built.accepted + built.refused.total() == 1500
    assert built.accepted > 20
    assert len(built.refused) > 40, "many fields are named"


def test_extreme_parameters_keep_every_number_finite_and_the_energy_balanced() -> None:
    ran = fuzz.run(60_000)
    assert ran.episodes > 1000
    assert (ran.not_finite, ran.worst) == (0, "")
    assert ran.energy_error <= fuzz.ENERGY_LIMIT
    assert ran.unit_error <= fuzz.UNIT_LIMIT


@pytest.mark.long
def test_the_campaign_finds_what_the_limits_prevent(monkeypatch: pytest.MonkeyPatch) -> None:
    """With hands a thousand times as strong as is accepted."""
    force = fuzz.largest_force

    def largest(arm: Any, h: float, period: float) -> float:
        return 1e4 * force(arm, h, period)

    monkeypatch.setattr(fuzz, "largest_force", largest)
    monkeypatch.setattr(specification, "largest_force", largest)
    with np.errstate(all="ignore"):
        assert fuzz.run(1).not_finite > 0
