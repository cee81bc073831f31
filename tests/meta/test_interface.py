"""The public interface stands still: names, parameters, defaults, ids, commands, columns, keys."""

import difflib

import interface  # in docs/make
import numpy as np
import pytest

from pter_gym.controllers import Policy
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import observation_layout


@pytest.mark.agents
def test_the_public_interface_is_the_listed_one() -> None:
    """Whoever changes it says so in CHANGELOG.md, and runs `python docs/make/interface.py`."""
    stored = interface.LISTING.read_text("utf-8").splitlines()
    changes = difflib.unified_diff(stored, interface.listing().splitlines(), lineterm="", n=0)
    assert not list(changes)


def test_a_name_of_before_still_works_and_says_the_new_one() -> None:
    layout = observation_layout(BASELINE, "torque")
    with pytest.warns(DeprecationWarning, match="from_function"):
        policy = Policy.of_function(lambda obs: np.full((len(obs), 4), 3.0), layout)
    volts = policy.volts(np.zeros((2, len(layout)), np.float32), None, BASELINE)
    np.testing.assert_array_equal(volts, 3.0)
