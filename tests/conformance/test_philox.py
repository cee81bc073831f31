"""The counter-based generator against numpy's."""

import numpy as np
import pytest

from pter_gym._compiled.philox import philox, uniform4

WORDS = [0, 1, 2**32 - 1, 2**32, 0x9E3779B97F4A7C15, 2**63, 2**64 - 1]


@pytest.mark.parametrize("key", [(0, 0), (1, 2), (2**64 - 1, 2**63), (12345678901234567890, 42)])
def test_philox_is_numpys(key: tuple[int, int]) -> None:
    for c0 in WORDS:
        for c1 in (0, 7, 2**64 - 1):
            counter = (c0 + (c1 << 64) - 1) % 2**256  # numpy increments before it draws
            expected = np.random.Philox(key=key[0] + (key[1] << 64), counter=counter).random_raw(4)
            found = philox(*(np.uint64(x) for x in (*key, c0, c1)))
            assert [int(x) for x in found] == [int(x) for x in expected]


def test_uniform_numbers_are_numpys_doubles() -> None:
    expected = np.random.Generator(
        np.random.Philox(key=3 + (4 << 64), counter=(5 + (6 << 64)) - 1)
    ).random(4)
    assert uniform4(np.uint64(3), np.uint64(4), np.uint64(5), np.uint64(6)) == tuple(expected)
