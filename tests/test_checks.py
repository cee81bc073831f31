"""Arguments: whole numbers, finite numbers and lists of names."""

from typing import Any

import numpy as np
import pytest

from pter_gym._internal.checks import is_finite, names_in, whole_number
from pter_gym.errors import ParameterError


@pytest.mark.parametrize("value", [3, np.int64(3), np.uint8(3)])
def test_whole_numbers(value: Any) -> None:
    found = whole_number("n", value)
    assert found == 3
    assert type(found) is int


@pytest.mark.parametrize("value", [0, -1, 3.0, "3", None, True, np.array([3]), float("nan")])
def test_others_are_refused(value: Any) -> None:
    with pytest.raises(ParameterError, match=r"^n "):
        whole_number("n", value)


def test_finite_numbers() -> None:
    assert all(map(is_finite, (0, 1.5, -(10**300), np.float64(2.0))))
    assert not any(map(is_finite, (True, "1", None, float("inf"), float("nan"), 10**400, 1j)))


def test_names() -> None:
    assert names_in("names", iter(["a", "b"])) == ["a", "b"]
    assert names_in("names", "a") == ["a"]
    for given in ("", b"a", [], None, 3):
        with pytest.raises(ParameterError, match=r"^names"):
            names_in("names", given)  # type: ignore[arg-type]
