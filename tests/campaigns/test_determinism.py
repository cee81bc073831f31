"""A small digest: the same however worlds are run, and another one when a bit changes."""

import numpy as np
import pytest

from campaigns import determinism
from campaigns.determinism import STEPS, alone, digest, in_processes, mixed, of_batch, summed


def test_the_digest_does_not_depend_on_how_the_worlds_are_run() -> None:
    steps = 30 * STEPS
    expected = digest(steps)
    assert digest(steps, lambda first, last: of_batch(first, last, 7)) == expected
    assert digest(steps, alone) == expected
    assert in_processes(steps, 2, "spawn") == expected


def test_nor_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(determinism, "STEPS", 5)
    steps = 5 * 2100  # worlds for more than one block a thread
    assert len({digest(steps, lambda a, b, n=n: of_batch(a, b, 2100, n)) for n in (1, 3, 16)}) == 1


def test_any_bit_counts() -> None:
    words, part = np.arange(5, dtype=np.uint64), np.random.default_rng(0).random((5, 6), np.float32)
    before = summed(words, part)
    for bit in range(32):
        other = part.copy()
        other.view(np.uint32)[3, 2] ^= np.uint32(1 << bit)
        assert (summed(words, other) != before).tolist() == [False, False, False, True, False]
    assert len(set(mixed(np.arange(1000, dtype=np.uint64)).tolist())) == 1000
