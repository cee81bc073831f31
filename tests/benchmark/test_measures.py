"""What scores are made of, by numbers that can be followed by hand."""

import math

import numpy as np
import pytest

from pter_gym.benchmark._measures import (
    CUTOFF,
    find_marks,
    low_pass,
    pace_errors,
    smoothness,
    way_integral,
)

NAN = np.nan


def test_marks_are_passed_between_rows_on_a_row_and_never():
    furthest = np.array([[0.0], [0.0], [1.0], [1.0], [3.0]])
    found = find_marks(furthest, np.array([[0.0], [0.25], [1.0], [2.0], [3.5]]))
    np.testing.assert_array_equal(found.after[:4, 0], [0, 2, 2, 4])
    np.testing.assert_array_equal(found.before[:4, 0], [0, 1, 1, 3])
    np.testing.assert_array_equal(found.part[:, 0], [1.0, 0.25, 1.0, 0.5, NAN])
    times = found.find(np.array([[0.0], [10.0], [20.0], [30.0], [40.0]]))
    np.testing.assert_array_equal(times[:, 0], [0.0, 12.5, 20.0, 35.0, NAN])


def test_each_new_part_of_the_way_counts_with_the_largest_error_since_the_last():
    furthest = np.array([[0.0], [0.0], [1.0], [1.0], [1.0], [1.5], [1.5]])
    errors = np.array([[0.1], [0.2], [0.7], [0.3], [0.4], [NAN]])
    found = way_integral(furthest, errors)
    np.testing.assert_allclose(found[:, 0], [0.0, 0.0, 0.2, 0.2, 0.2, 0.2 + 0.35, 0.2 + 0.35])


def test_an_unfinished_stretch_has_at_least_the_error_of_one_that_was_not_begun():
    times, finished = np.array([0.75, 1.25, 0.75, 1.25, 2.5]), np.array([True, True, False, False, False])
    np.testing.assert_array_equal(pace_errors(times, finished), [0.25, 0.25, 1.0, 1.0, 1.5])


def test_smoothness_by_hand():
    period, jump = 0.4, 3.0
    speed = np.array([[7.0], [0.25], [0.5], [9.0]])
    acceleration = np.array([[[20.0, 0.0]], [[0.0, 0.0]], [[jump, jump]], [[50.0, 0.0]]])
    counted = np.array([[False], [True], [True], [False]])
    jerk = (2 * period) ** 3 * (2 * jump**2) / period
    assert smoothness(speed, acceleration, counted, period) == pytest.approx(-math.log(jerk / 0.5**2))
    assert smoothness(0.0 * speed, acceleration, counted, period) == 0.0
    assert smoothness(speed, 0.0 * acceleration, counted, period) == 0.0  # ln 1: no jerk counts as D = 1


def test_low_pass_starts_at_rest_and_holds_its_input():
    period = 0.01
    decay = math.exp(-2.0 * math.pi * CUTOFF * period)
    found = low_pass(np.array([1.0, 1.0, 0.0]), period)
    np.testing.assert_allclose(found, [1.0 - decay, 1.0 - decay**2, decay - decay**3])
