"""The library of hands: numbers that an arm can have, and a tremor whose free hand moves as its
entry says."""

import math
import re
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from scipy import signal

from pter_gym._engine.batch import Batch
from pter_gym.controllers import Free
from pter_gym.errors import ParameterError
from pter_gym.hands import (
    LIBRARY_ARMS,
    LIBRARY_TREMORS,
    EssentialTremor,
    LibraryArm,
    LibraryTremor,
    TremorArm,
    find_hand,
)
from pter_gym.hands._library import HandGrade
from pter_gym.hands._tremor import KINDS
from pter_gym.params import BASELINE, Arm
from pter_gym.scenarios import find_scenario
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from rollouts import simulate

PERIOD = PathFollowing().control_period

PHYSICAL = {"mass": (0.3, 4.0), "damping": (2.0, 60.0), "stiffness": (20.0, 1000.0)}
"""Values over all directions that a human arm at the hand may have."""

EVERY_HAND = [
    replace(KINDS[name](), impedance=arm.hand, frequency=frequency, phase=1.0, swell_phase=2.0)
    for name, tremor in LIBRARY_TREMORS.items()
    for arm in LIBRARY_ARMS.values()
    for frequency in tremor.band
]
"""Each tremor at both ends of its band, of each arm."""


@pytest.mark.parametrize("arm", LIBRARY_ARMS.values(), ids=LIBRARY_ARMS)
def test_an_arm_is_complete_and_physical(arm: LibraryArm) -> None:
    for name, (low, high) in PHYSICAL.items():
        matrix = np.array(getattr(arm, name))
        np.testing.assert_array_equal(matrix, matrix.T)
        least, most = np.linalg.eigvalsh(matrix)
        assert low <= least <= most <= high
        turns = np.linspace(0.0, math.pi, 180, endpoint=False)
        directions = np.stack([np.cos(turns), np.sin(turns)])
        mean = np.einsum("id,ij,jd->d", directions, matrix, directions).mean()
        assert getattr(arm.hand, name) == pytest.approx(mean, rel=1e-12)
    is_cited(arm)
    assert arm.posture
    year = re.findall(r"\((\d{4})\)", arm.source)[0]
    rough = arm.grade == "order of magnitude"
    assert (arm.name.startswith("rough-"), arm.name.endswith(year)) == (rough, not rough)


@pytest.mark.parametrize("tremor", LIBRARY_TREMORS.values(), ids=LIBRARY_TREMORS)
def test_a_tremor_is_complete(tremor: LibraryTremor) -> None:
    is_cited(tremor)
    frequency, acceleration = tremor.middle
    assert 3.0 <= tremor.band[0] < frequency < tremor.band[1] <= 12.0
    assert 0.01 < tremor.acceleration[0] < acceleration < tremor.acceleration[1] < 20.0


def is_cited(entry: LibraryArm | LibraryTremor) -> None:
    assert re.search(r"\((19|20)\d\d\)", entry.source)
    assert entry.grade in get_args(HandGrade)
    assert len(entry.provenance) > 20


def test_the_bands_are_those_that_are_cited() -> None:
    bands = {name.removeprefix("tremor-"): tremor.band for name, tremor in LIBRARY_TREMORS.items()}
    assert bands == {
        "physiological": (8.0, 12.0),
        "essential": (4.0, 12.0),
        "parkinsonian": (3.0, 8.0),
    }


def test_matrices_of_the_joints_were_turned_into_those_at_the_hand() -> None:
    """The limb of Selen et al., hand straight ahead: the Jacobian by differences of angles found by
    bisection."""
    upper, lower, ahead = 0.31, 0.34, 0.435

    def tip(q: np.ndarray) -> np.ndarray:
        angles = np.array([q[0], q[0] + q[1]])
        return np.array([upper, lower]) @ np.stack([np.cos(angles), np.sin(angles)], axis=1)

    elbow, low, high = 0.0, 0.0, math.pi
    for _ in range(60):
        elbow = 0.5 * (low + high)
        low, high = (
            (elbow, high) if np.linalg.norm(tip(np.array([0.0, elbow]))) > ahead else (low, elbow)
        )
    x, y = tip(np.array([0.0, elbow]))
    q = np.array([0.5 * math.pi - math.atan2(y, x), elbow])
    np.testing.assert_allclose(tip(q), [0.0, ahead], atol=1e-12)
    inverse = np.linalg.inv(
        np.stack([(tip(q + d) - tip(q - d)) / 2e-6 for d in 1e-6 * np.eye(2)], axis=1)
    )

    def at_hand(joint: list[list[float]]) -> np.ndarray:
        found = inverse.T @ np.array(joint) @ inverse
        return 0.5 * (found + found.T)

    coupling = 0.5 * 1.52 * upper * lower * math.cos(elbow)
    own = 0.06 + 0.25 * 1.52 * lower**2
    both = own + coupling
    inertia = [
        [0.04 + 0.25 * 1.93 * upper**2 + 1.52 * upper**2 + both + coupling, both],
        [both, own],
    ]
    stiffness = at_hand([[10.8, 2.83], [2.51, 8.67]])
    arms = LIBRARY_ARMS
    # stored with three digits
    np.testing.assert_allclose(arms["gomi-osu-1998"].mass, at_hand(inertia), rtol=5e-3)
    np.testing.assert_allclose(arms["gomi-osu-1998"].stiffness, stiffness, rtol=5e-3)
    np.testing.assert_allclose(arms["gomi-osu-1998"].damping, 0.05 * stiffness, rtol=5e-3)
    np.testing.assert_allclose(arms["rough-moving"].stiffness, 2.0 * stiffness, rtol=5e-3)
    np.testing.assert_allclose(arms["rough-moving"].damping, 0.1 * stiffness, rtol=5e-3)
    assert arms["rough-force-field"].mass == arms["rough-moving"].mass == arms["gomi-osu-1998"].mass


@pytest.mark.parametrize("hand", [find_hand(name) for name in LIBRARY_TREMORS], ids=LIBRARY_TREMORS)
def test_the_spectrum_has_its_peak_at_the_frequency_and_all_within_the_band(
    hand: TremorArm,
) -> None:
    """Over 20 s through a Hann window: lines 0.05 Hz apart, none of which leaks far."""
    times = np.arange(0.0, 20.0, 0.001)
    power = np.abs(np.fft.rfft(np.hanning(len(times)) * hand.tremor(times))) ** 2
    frequencies = np.fft.rfftfreq(len(times), 0.001)
    assert abs(frequencies[power.argmax()] - hand.frequency) <= 0.025 + 1e-9
    (name,) = (name for name, kind in KINDS.items() if isinstance(hand, kind))
    low, high = LIBRARY_TREMORS[name].band
    assert power[(frequencies >= low) & (frequencies <= high)].sum() > 0.999 * power.sum()


@pytest.mark.parametrize("hand", EVERY_HAND)
def test_the_free_hand_moves_as_its_entry_says(hand: TremorArm) -> None:
    """Mass, damper and spring under the stored force: the sine in its motion has the amplitude.

    Of the beginning e^(−10·b/2m) < 1e-6 is left after 10 s. ``lsim`` is exact for forces that are
    linear between times."""
    arm = hand.impedance
    stored = hand.sampled(PERIOD) @ [math.cos(hand.direction), math.sin(hand.direction)]
    times = 0.001 * np.arange(14_001)
    force = np.interp(times, PERIOD * np.arange(len(stored)), stored)
    rates = [[0.0, 1.0], [-arm.stiffness / arm.mass, -arm.damping / arm.mass]]
    motion: Any = (rates, [[0.0], [1.0 / arm.mass]], [[1.0, 0.0]], [[0.0]])
    position = signal.lsim(motion, force, times)[1]
    frequencies = hand.frequency + hand.swell_frequency * np.array([0.0, -1.0, 1.0])
    turns = 2.0 * np.pi * np.outer(times[10_000:14_000], frequencies)
    sines = np.hstack([np.sin(turns), np.cos(turns)])
    fitted = np.linalg.lstsq(sines, position.ravel()[10_000:14_000], rcond=None)[0]
    amplitude = math.hypot(fitted[0], fitted[3])
    assert amplitude * (2.0 * math.pi * hand.frequency) ** 2 == pytest.approx(
        hand.acceleration, rel=1e-5
    )


def test_the_kernel_adds_the_tremor_along_its_line_until_it_ends() -> None:
    """On an arm that is too heavy to move, beside the same hand without a tremor."""
    heavy = replace(BASELINE, arm=Arm(inertia_a=1e9, inertia_b=1e9, coupling=0.0))
    hand = EssentialTremor(frequency=6.3, acceleration=4.0, direction=0.4, lasts=2.0)
    tasks = [PathFollowing(hand=each) for each in (hand, replace(hand, acceleration=0.0))]
    batch = Batch([heavy, heavy], tasks)
    policy = Free().bind(heavy, batch.layout)
    rows = simulate(batch, policy, [0, 0], 250)[1:]
    found = rows[:, 0, [*COLUMN.force]] - rows[:, 1, [*COLUMN.force]]
    assert np.isfinite(found).all()
    instants = rows[:, 0, COLUMN.time]
    stored = hand.sampled(PERIOD)
    expected: Any = [
        np.interp(instants, PERIOD * np.arange(len(stored)), force) for force in stored.T
    ]
    np.testing.assert_allclose(found, np.transpose(expected), rtol=0.0, atol=1e-6)
    assert np.abs(found).max() > 2.0
    np.testing.assert_allclose(found[210:], 0.0, atol=1e-6)


def test_the_scenario_draws_all_kinds_and_arms_within_the_ranges_of_the_library() -> None:
    hands: list[Any] = [task.hand for _, task in find_scenario("tremor").draws.pairs(300, 1)]
    assert {type(hand) for hand in hands} == set(KINDS.values())
    assert {hand.impedance for hand in hands} == {arm.hand for arm in LIBRARY_ARMS.values()}
    for name, kind in KINDS.items():
        own = [hand for hand in hands if type(hand) is kind]
        for drawn, (low, high) in (
            ([hand.frequency for hand in own], LIBRARY_TREMORS[name].band),
            ([hand.acceleration for hand in own], LIBRARY_TREMORS[name].acceleration),
        ):
            assert low <= min(drawn) < 1.2 * low
            assert 0.8 * high < max(drawn) <= high


def test_unknown_hands_are_refused_with_the_nearest() -> None:
    with pytest.raises(ParameterError, match="van-beek-2015"):
        find_hand("van-beek-2016")
    assert find_hand("rough-posture").impedance == LIBRARY_ARMS["rough-posture"].hand


@pytest.mark.parametrize(
    ("field", "keywords"),
    [
        ("frequency", {"frequency": 0.0}),
        ("frequency", {"frequency": 26.0}),
        ("acceleration", {"acceleration": -1.0}),
        ("direction", {"direction": math.nan}),
        ("swell", {"swell": 1.1}),
        ("swell_frequency", {"swell_frequency": 30.0}),
        ("lasts", {"lasts": 0.0}),
        ("eagerness", {"eagerness": 0.0}),
    ],
)
def test_bad_tremors_are_named(field: str, keywords: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match=rf"EssentialTremor\.{field}"):
        EssentialTremor(**keywords)


def test_a_tremor_that_is_too_fast_for_the_control_period_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"EssentialTremor\.frequency"):
        Batch(BASELINE, PathFollowing(hand=EssentialTremor(), control_period=0.05))
