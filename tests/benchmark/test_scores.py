"""Scores against episodes whose scores are known, and what they are made of, by hand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from benchmark.handmade import LENGTH, METRE, PERIOD, TASK, Array, episode, padded, travel
from pter_gym._compiled.records import load, width
from pter_gym._engine.batch import Batch
from pter_gym._physics.friction import ClutchMode
from pter_gym.benchmark.measures import (
    ACCELERATION_CUTOFF,
    START_UP,
    Recorded,
    low_pass,
    pace_factor,
    smoothness,
)
from pter_gym.benchmark.scores import score, score_episodes
from pter_gym.benchmark.tally import PROGRESS, Progress, Sums, tally_kernel
from pter_gym.controllers import Free
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.paths import Line
from pter_gym.tasks.path_following import COLUMN, TELEMETRY
from pter_gym.tasks.path_following._pace import ALLOWANCE
from rollouts import simulate


def test_constant_error_at_constant_speed() -> None:
    steps = 98
    s = np.linspace(0.0, LENGTH, steps + 1)
    rows = episode(
        steps,
        arc_length=s,
        normal_error=-0.02,
        tip_x=s,
        tip_velocity_x=0.5,
        dissipated=0.1,
        hand_work=0.3,
    )
    rows[-1, TELEMETRY.index("is_success")] = 1.0
    found = score(rows, replace(TASK, pace=LENGTH / (steps * PERIOD)))
    expected = {
        **dict.fromkeys(("path_error_m", "mean_error_m"), 0.02),
        **dict.fromkeys(("rms_error_m", "path_average_error_m"), 0.02),
        "mean_speed_m_s": 0.5,
        "path_length_m": LENGTH,
        "duration_s": 0.98,
        "completed": True,
        "dissipated_j": 0.1 * steps,
        "hand_work_j": 0.3 * steps,
        "peak_acceleration_m_s2": 0.0,
        "smoothness": 0.0,
    }
    assert {name: getattr(found, name) for name in expected} == pytest.approx(expected)


# --- path error ---


def test_episodes_of_different_tasks_are_judged_as_each_alone() -> None:
    """By its own pace and path, also where another one comes first."""
    wall = replace(TASK, free_left=0.1)
    tasks = [wall, replace(wall, pace=0.1, path=Line(x=0.0, y=0.5, direction=0.7, length=0.4))]
    s, touch = np.linspace(0.0, 0.1, 41) ** 2, {"normal_error": -0.01, "force_x": 3.0}
    both = padded([travel(s, **touch), travel(s, **touch)])
    found = Recorded(both, tasks, 24.0)
    stiff = found.apparent_stiffness()
    assert stiff is not None
    for world, task in enumerate(tasks):
        alone = Recorded(both[:, [world]], [task], 24.0)
        assert found.lost_at_start[world] == alone.lost_at_start[0]
        assert stiff[world] == pytest.approx(300.0 * math.sin(task.path.heading(0.0)))
    assert found.lost_at_start[0] != found.lost_at_start[1]


def test_the_larger_average_counts() -> None:
    """Half of the time at the start, 0.1 m off, then exactly along the path; and the other way."""
    waits = np.concatenate([np.zeros(100), np.linspace(0.0, 1.0, 201)])
    beside = np.concatenate([np.full(100, 0.1), np.zeros(201)])
    waiting = score(travel(waits, normal_error=beside), METRE)
    counted = 1.0 + 0.2 - ALLOWANCE
    assert waiting.mean_error_m == pytest.approx(0.1 * 99 / 300)
    assert waiting.path_average_error_m == pytest.approx(0.1 * 0.005)
    factor = (counted / 0.2) ** 2
    assert waiting.path_error_m == pytest.approx(factor * 0.1 * 0.99 / counted / 10)
    hasty = score(
        travel(
            np.linspace(0.0, 1.0, 101)[[0, 1, *range(90, 101)]], normal_error=0.1 * np.eye(13)[2]
        ),
        METRE,
    )
    assert hasty.path_average_error_m == pytest.approx(0.1 * 0.89)
    assert hasty.path_error_m > 2.0 * hasty.path_average_error_m > hasty.mean_error_m


def test_a_detour_beside_the_path_counts_however_short() -> None:
    """The second tenth: 1 cm in 18 steps, 8 cm in one, 0.1 m beside the path, 1 cm in the last."""
    even = 0.005 * np.arange(201)
    s = np.concatenate([even[:21], 0.1 + 0.01 / 18 * np.arange(1, 19), [0.19], even[40:]])
    beside = np.where(s == 0.19, 0.1, 0.0)
    found = score(travel(s, normal_error=beside), METRE)
    assert found.path_error_m == pytest.approx(0.08 * 0.1 / 0.1 / 10)
    assert found.segment_pace_error == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("at", [40, 41, 59, 60])
def test_a_moment_beside_the_path_counts_in_one_segment(at: int) -> None:
    """Also at either end of it."""
    found = score(
        travel(np.linspace(0.0, 1.0, 201), normal_error=np.where(np.arange(201) == at, 0.1, 0.0)),
        METRE,
    )
    assert found.path_error_m == pytest.approx(0.1 / 20 / 10)


def test_an_error_costs_more_off_the_pace_and_a_slow_ride_gains_nothing() -> None:
    """Also where the error grows with the square of the speed."""
    for pace, factor in {0.8: 1.25**2, 1.0: 1.0, 1.25: 1.4}.items():
        s = 0.5 * pace * PERIOD * np.arange(round(200 / pace) + 2)
        assert score(travel(s, normal_error=0.02), METRE).path_error_m == pytest.approx(
            0.02 * factor, rel=5e-3
        )
    ratios = np.linspace(0.0, 10.0, 1001)
    found = pace_factor(ratios)
    assert np.diff(found[100:] / ratios[100:] ** 2) == pytest.approx(0.0)
    assert (np.diff(found[:101]) < 0.0).all()
    assert (found[0], found[100]) == (3.0, 1.0)


@settings(max_examples=100, deadline=None)
@given(st.integers(1, 200), st.integers(1, 300), st.integers(0, 2**32 - 1))
def test_waiting_on_the_path_gains_nothing(at: int, steps: int, seed: int) -> None:
    s = np.linspace(0.0, 1.0, 201)
    errors = 0.01 * np.random.default_rng(seed).random(201)
    errors[at] = 0.0
    rows = [np.arange(201), np.insert(np.arange(201), at, np.full(steps, at))]
    direct, waits = (score(travel(s[k], normal_error=errors[k]), METRE).path_error_m for k in rows)
    assert waits >= direct * (1.0 - 1e-12)


def test_unfinished_segments_count_as_the_bound_for_their_time() -> None:
    found = score(travel(np.minimum(0.5 * PERIOD * np.arange(141), 0.5)), METRE)
    assert found.path_error_m == pytest.approx(0.25 * (2.0**2 + 4.0) / 10)
    assert found.path_average_error_m == pytest.approx(0.25 / 2)
    assert found.rms_error_m == pytest.approx(0.25 / np.sqrt(2.0))


def test_an_episode_counts_as_lost_once_however_long_it_is_stuck() -> None:
    """At the start, half-way, and further off than the workspace reaches."""
    errors = np.where(np.arange(1400) == 100, 0.3, 0.0)
    for end, error, lost in ((0.0, 0.0, 0.25), (0.5, 0.0, 0.25), (0.5, errors, 0.3)):
        found = score(
            travel(np.minimum(0.5 * PERIOD * np.arange(1400), end), normal_error=error), METRE
        )
        assert found.path_error_m == lost


def test_squares_count() -> None:
    """0.1 m off in the first tenth, half of that in the last."""
    s = np.linspace(0.0, 1.0, 201)
    found = score(
        travel(s, normal_error=np.where(s <= 0.1, 0.1, np.where(s > 0.9, 0.05, 0.0))), METRE
    )
    assert found.path_error_m == pytest.approx(0.015)
    assert found.rms_error_m == pytest.approx(np.sqrt(0.1 * 0.1**2 + 0.1 * 0.05**2))


# --- pace ---


@pytest.mark.parametrize("factor", [0.5, 1.0, 4.0])
def test_constant_pace(factor: float) -> None:
    """A whole number of steps per segment is not needed: crossings are interpolated."""
    found = score(travel(0.5 * factor * PERIOD * np.arange(round(200 / factor) + 2)), METRE)
    time = 2.0 / factor - max(0.02 / factor - 0.02, 0.0)
    assert (found.mean_pace_error, found.segment_pace_error) == pytest.approx(
        [abs(time / 2.0 - 1.0)] * 2, abs=1e-12
    )
    assert found.mean_pace_m_s == pytest.approx(1.0 / time)


@pytest.mark.parametrize("wait", [0.0, 0.1, 0.5, 3.0])
def test_start_up_time_within_the_allowance_is_free(wait: float) -> None:
    s = np.concatenate([np.zeros(round(wait / PERIOD)), np.linspace(0.0, 1.0, 201)])
    found = score(travel(s), METRE)
    over = max(wait - ALLOWANCE, 0.0)
    assert (found.mean_pace_error, found.segment_pace_error) == pytest.approx(
        (over / 2.0, over / 2.0), abs=1e-12
    )
    assert found.mean_pace_m_s == pytest.approx(1.0 / (2.0 + over))


def test_the_allowance_is_that_of_the_lag_and_the_push() -> None:
    """At half of the pace on average, the arm loses half of the time that the push needs."""
    lag = 2.0 * BASELINE.clutch.time_constant
    task = replace(TASK, pace=0.5)
    rows = simulate(Batch(BASELINE, task, 1), Free(), [0], 30)[:, 0]
    fast = int((rows[:, TELEMETRY.index("tip_velocity_x")] >= 0.5).argmax())
    lost = PERIOD * fast - rows[fast, TELEMETRY.index("arc_length")] / 0.5
    assert pytest.approx(lag + lost, abs=0.005) == ALLOWANCE
    assert 0.2 < ALLOWANCE < 0.25


def test_cruising_begins_after_the_first_segment() -> None:
    """The first tenth in 0.4 s, the rest at 0.75 m/s, once to the end and once to the middle."""
    s = np.concatenate([np.linspace(0.0, 0.1, 41), 0.1 + 0.0075 * np.arange(1, 121)])
    for rows in (s, s[:95]):
        assert Recorded(travel(rows)[:, None], [METRE], 24.0).mean_pace(first=1) == pytest.approx(
            [0.75]
        )
    assert Recorded(travel(np.zeros(1))[[0, 0], None], [METRE], 24.0).mean_pace() == 0.0, (
        "no time, no pace"
    )


def test_a_segment_that_is_not_finished_counts_as_one_at_least() -> None:
    """Never begun; stopped half-way; and stuck there for long."""
    never = (1.0 - ALLOWANCE) / 0.2
    expected = {
        (0.0, 100): ((never - 1.0 + 9.0) / 10, 1.0, 0.0),
        (0.5, 120): (5 / 10, 1.0, 0.5 / 1.2),
        (0.5, 2100): ((100.0 - 1.0 + 4.0) / 10, 21.0 / 2.0 - 1.0, 0.5 / 21.0),
    }
    for (at, steps), values in expected.items():
        found = score(travel(np.minimum(0.5 * PERIOD * np.arange(steps + 1), at)), METRE)
        assert (
            found.segment_pace_error,
            found.mean_pace_error,
            found.mean_pace_m_s,
        ) == pytest.approx(values)


def test_a_step_back_does_not_make_a_segment_shorter() -> None:
    s = np.concatenate(
        [np.linspace(0.0, 0.5, 101), np.linspace(0.49, 0.3, 20), np.linspace(0.31, 1.0, 138)]
    )
    found = score(travel(s), METRE)
    direct = np.concatenate(
        [np.linspace(0.0, 0.5, 101), np.full(58, 0.5), np.linspace(0.505, 1.0, 100)]
    )
    assert found.segment_pace_error == pytest.approx(
        score(travel(direct), METRE).segment_pace_error, abs=0.02
    )
    assert found.segment_pace_error > 0.25


# --- acceleration, effort ---


def test_start_up_is_left_out_of_accelerations() -> None:
    steps = 100
    acceleration = np.zeros(steps + 1)
    acceleration[5] = 100.0
    acceleration[60:] = 3.0
    found = score(episode(steps, acceleration_x=acceleration, arc_length=0.0), TASK)
    assert found.peak_acceleration_m_s2 == pytest.approx(3.0, rel=1e-6)
    settled = low_pass(acceleration[1:, None], PERIOD)[round(START_UP / PERIOD) :]
    assert found.mean_acceleration_m_s2 == pytest.approx(np.abs(settled).mean())
    assert found.rms_acceleration_m_s2 == pytest.approx(math.sqrt((settled**2).mean()))
    short = score(episode(5, acceleration_y=2.0), TASK)
    assert short.peak_acceleration_m_s2 > 1.0, "an episode shorter than the start-up counts whole"


def test_effort_saturation_and_sticking() -> None:
    steps = 100
    top = BASELINE.clutch.voltage_max
    volts = np.where(np.arange(steps + 1) <= 25, top, 0.0)
    mode = np.where(np.arange(steps + 1) <= 40, ClutchMode.ZERO_DOF, ClutchMode.STUCK_1)
    found = score(episode(steps, volts_1=volts, volts_2=volts, mode=mode), TASK)
    assert found.effort == pytest.approx(0.25 * 0.5)
    assert found.saturated == pytest.approx(0.25)
    assert found.stuck == pytest.approx(0.4)
    clutch = replace(BASELINE.clutch, voltage_max=2.0 * top)
    other = score(
        episode(steps, volts_1=volts, volts_2=volts), TASK, replace(BASELINE, clutch=clutch)
    )
    assert other.saturated == 0.0
    assert other.effort == pytest.approx(0.25 * 0.5 / 4.0)


# --- many at once ---


@st.composite
def wanderings(draw: st.DrawFn) -> Array:
    """An episode of any length that wanders along and beside a path of one metre."""
    steps = draw(st.integers(1, 60))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    drift = draw(st.sampled_from([-0.01, 0.0, 0.02, 0.2]))
    s = np.concatenate([[0.0], np.cumsum(drift + 0.03 * generator.standard_normal(steps))])
    done = np.flatnonzero(s >= 1.0)
    s = s[: done[0] + 1] if len(done) else s
    rows = travel(s, normal_error=0.2 * generator.standard_normal(len(s)))
    for name in (
        "acceleration_x",
        "acceleration_y",
        "tip_velocity_x",
        "tip_velocity_y",
        "tip_x",
        "volts_1",
    ):
        rows[:, TELEMETRY.index(name)] = np.abs(generator.standard_normal(len(s)))
    return rows


@settings(max_examples=100, deadline=None)
@given(st.lists(wanderings(), min_size=1, max_size=5), st.randoms(use_true_random=False))
def test_properties(episodes: list[Array], random: object) -> None:
    found = score_episodes(padded(episodes), [METRE] * len(episodes))
    assert all(np.isfinite(values).all() for values in found.values())
    for larger in ("path_error_m", "rms_error_m"):
        assert (found[larger] >= found["path_average_error_m"] * (1.0 - 1e-12)).all()
    assert (found["mean_pace_error"][~found["completed"]] >= 1.0).all()
    order = list(range(len(episodes)))
    random.shuffle(order)  # type: ignore[attr-defined]
    again = score_episodes(padded([episodes[k] for k in order]), [METRE] * len(episodes))
    for name, values in found.items():
        assert again[name].tolist() == values[order].tolist(), name
    alone = score(episodes[0], METRE)
    for name, values in found.items():
        assert getattr(alone, name) == values[0], name


def test_an_episode_has_at_least_one_step_and_all_fields() -> None:
    found = score_episodes(padded([episode(1), episode(3)]), [TASK, TASK])
    assert found["path_error_m"][0] == score(episode(1), TASK).path_error_m > 0.0
    nothing = episode(3)
    nothing[1:] = np.nan
    for bad in (
        padded([episode(0)]),
        padded([nothing]),
        padded([episode(3), nothing]),
        np.zeros((3, 1, 5)),
    ):
        with pytest.raises(ParameterError, match="telemetry"):
            score_episodes(bad, [TASK] * bad.shape[1])


# --- by hand ---


def test_sums_at_marks_between_rows_on_a_row_and_unreached() -> None:
    rows = np.zeros((5, 1, len(TELEMETRY)))
    read: Any = [COLUMN.time, COLUMN.arc_length, COLUMN.normal_error]
    rows[:, 0, read] = np.transpose(
        [
            [0.0, 10.0, 20.0, 30.0, np.nan],  # time
            [0.0, 1.0, 0.5, 3.0, 9.0],  # arc length
            [0.0, -0.2, 0.7, 0.4, 9.0],  # normal error
        ]
    )
    marks, sums = np.array([[0.0], [0.25], [1.0], [2.0], [3.5]]), np.zeros((width(Progress), 1))
    sums[int(PROGRESS.sums.time)] = np.nan
    passed = np.full((width(Sums), 5), np.nan)
    for part in (rows[:2], rows[2:]):
        tally_kernel()(part, marks, sums, passed)
    in_time, on_path = [2.0, 7.0, 4.0], [0.2, 2 * 0.7]
    expected = [
        (0.0, 0.0, 0.0, 0.0),
        (2.5, 0.25 * in_time[0], 0.25 * on_path[0], 0.25 * 0.2**2),
        (10.0, in_time[0], on_path[0], 0.2**2),
        # half of the way from 1 to 3, where the tip came by a step back
        (25.0, 2.0 + 7.0 + 2.0, 0.2 + 0.7, 0.2**2 + 0.7**2),
        (np.nan,) * 4,
    ]
    np.testing.assert_allclose(passed.T, expected)
    progress = load(sums, PROGRESS, 0)
    assert (progress.furthest, progress.since, progress.largest) == (3.0, 0.0, 0.7)
    assert progress.sums == pytest.approx((30.0, sum(in_time), sum(on_path), 0.2**2 + 2 * 0.7**2))


def test_smoothness_of_a_jump() -> None:
    period, jump = 0.4, 3.0
    speed = np.array([[7.0], [0.25], [0.5], [9.0]])
    acceleration = np.array([[[20.0, 0.0]], [[0.0, 0.0]], [[jump, jump]], [[50.0, 0.0]]])
    counted = np.array([[False], [True], [True], [False]])
    jerk = (2 * period) ** 3 * (2 * jump**2) / period
    assert smoothness(speed, acceleration, counted, period) == pytest.approx(
        -math.log(jerk / 0.5**2)
    )
    assert smoothness(0.0 * speed, acceleration, counted, period) == 0.0
    # ln 1: no jerk counts as D = 1
    assert smoothness(speed, 0.0 * acceleration, counted, period) == 0.0


def test_low_pass_starts_at_rest_and_holds_its_input() -> None:
    period = 0.01
    decay = math.exp(-2.0 * math.pi * ACCELERATION_CUTOFF * period)
    found = low_pass(np.array([1.0, 1.0, 0.0]), period)
    np.testing.assert_allclose(found, [1.0 - decay, 1.0 - decay**2, decay - decay**3])
