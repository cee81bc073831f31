"""The hand's force against its closed form (paper Eq. 5)."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pter_gym._engine.batch import Batch
from pter_gym.controllers import Free
from pter_gym.errors import ParameterError
from pter_gym.hands import MultiSineHand, eq5
from pter_gym.hands._operators import EQ5_FREQUENCIES
from pter_gym.params import BASELINE, Arm
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from rollouts import simulate


def test_eq5_as_printed() -> None:
    hand = eq5(force_max=50.0, push=10.0)
    for time in np.linspace(0.0, 3.0, 50):
        printed = 50.0 / 5.0 * sum(math.sin(2.0**n * math.pi * time) for n in range(5))
        assert hand.normal_force(float(time)) == pytest.approx(printed, abs=1e-12)


@pytest.mark.parametrize("phases", [(0.0,) * 5, (0.3, 1.0, -2.0, 4.0, 0.1)])
def test_the_kernel_follows_the_closed_form_for_ten_seconds(phases: tuple[float, ...]) -> None:
    """Each half of a substep turns a unit vector and rounds it: at most four ulp of angle each."""
    heavy = replace(BASELINE, arm=Arm(inertia_a=1e6, inertia_b=1e6, coupling=0.0))
    hand = MultiSineHand(push=7.0, amplitudes=(10.0, 20.0, 5.0, 1.0, 12.0), phases=phases)
    batch = Batch(heavy, PathFollowing(hand=hand))
    policy = Free().bind(heavy, batch.layout)
    rows = simulate(batch, policy, [0], 1000)[1:, 0]
    assert np.isfinite(rows[-1, COLUMN.time])
    expected = [hand.normal_force(time) for time in rows[:, COLUMN.time]]
    turns = 2 * round(rows[-1, COLUMN.time] / heavy.substep)
    tolerance = turns * 4 * np.finfo(float).eps * sum(hand.amplitudes)
    np.testing.assert_allclose(rows[:, COLUMN.force.y], expected, rtol=0.0, atol=tolerance)
    np.testing.assert_array_equal(rows[:, COLUMN.force.x], 7.0)


def test_random_phases_keep_amplitudes_and_frequencies() -> None:
    hand = MultiSineHand(push=0.0, amplitudes=(0.0, 0.0, 9.0, 0.0, 0.0), random_phases=True)
    heavy = replace(BASELINE, arm=Arm(inertia_a=1e6, inertia_b=1e6, coupling=0.0))
    batch = Batch(heavy, PathFollowing(hand=hand), 200)
    policy = Free().bind(heavy, batch.layout)
    rows = simulate(batch, policy, range(200), 100)[1:]
    force = rows[:, :, COLUMN.force.y]
    time = rows[:, 0, COLUMN.time]
    frequency = 2.0 * math.pi * EQ5_FREQUENCIES[2]
    basis = np.stack([np.sin(frequency * time), np.cos(frequency * time)], axis=1)
    fitted = np.linalg.lstsq(basis, force, rcond=None)[0]
    np.testing.assert_allclose(np.hypot(*fitted), 9.0, rtol=1e-9)
    phases = np.arctan2(fitted[1], fitted[0])
    assert np.histogram(phases, bins=4, range=(-math.pi, math.pi))[0].min() > 25, (
        "phases are not spread evenly"
    )


@pytest.mark.parametrize(
    ("field", "keywords"),
    [
        ("push", {"push": float("nan")}),
        ("amplitudes", {"amplitudes": (1.0, 2.0)}),
        ("frequencies", {"frequencies": (-1.0, 1.0, 1.0, 1.0, 1.0)}),
        ("phases", {"phases": (float("inf"),) * 5}),
        ("random_phases", {"random_phases": 1}),
    ],
)
def test_bad_hands_are_named(field: str, keywords: dict[str, object]) -> None:
    with pytest.raises(ParameterError, match=rf"\.{field}\b"):
        MultiSineHand(**keywords)  # pyright: ignore[reportArgumentType]


def test_a_sine_that_is_too_fast_for_the_substep_is_refused() -> None:
    fast = MultiSineHand(frequencies=(1.0, 1.0, 1.0, 1.0, 200.0))
    with pytest.raises(ParameterError, match="frequencies"):
        Batch(BASELINE, PathFollowing(hand=fast))
