"""Worlds do what they did when ``traces.npz`` was written: each number, whichever function has made it.

Other libraries round sines and exponentials otherwise in the last place, which 24 control steps do not make much of.
"""

import numpy as np
import pytest

from conformance.traces import FILE, PARTS, TASKS, of_all_kinds


@pytest.mark.parametrize("part", PARTS)
def test_worlds_do_what_they_did(part: str):
    with np.load(FILE) as stored:
        expected = {key.removeprefix(f"{part}: "): stored[key] for key in stored.files if key.startswith(f"{part}: ")}
    found = PARTS[part]()
    assert found.keys() == expected.keys()
    for name, array in found.items():
        single = array.dtype == np.float32
        rtol, atol = (1e-5, 1e-5) if single else (1e-8, 1e-10)
        np.testing.assert_allclose(array, expected[name], rtol=rtol, atol=atol, err_msg=name)


def test_every_way_to_end_is_among_them():
    terminated, truncated, success = of_all_kinds()["flags"].any(axis=0)[:, : len(TASKS)]
    assert success[[3, 5]].all(), "arrived"
    assert (terminated & ~success)[[6, 7, 11]].all(), "missed, strayed, singular"
    assert (truncated & ~terminated)[[0, 8, 9]].all(), "by the time limit, and far from the path"
