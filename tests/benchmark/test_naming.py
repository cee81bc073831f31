"""Policies as users write them, and how little is loaded for one that acts."""

import subprocess
import sys
from typing import Any

import pytest

from pter_gym.benchmark import find_policy
from pter_gym.benchmark._pacing import damping_table
from pter_gym.controllers import Impedance, PaceSchedule
from pter_gym.errors import ParameterError


def test_gains_are_those_of_the_scenario() -> None:
    assert find_policy("impedance", scenario=None) == Impedance()
    paced = find_policy("impedance", scenario="hands")
    assert isinstance(paced, PaceSchedule)
    expected = sorted(damping_table()["hands"]["impedance"].values(), reverse=True)
    assert [law.damping_tangential for _, law in paced.knots] == expected  # type: ignore[attr-defined]
    assert find_policy("single-dof-tuned", scenario="hands") != find_policy("single-dof-tuned", scenario="paths")


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("impedanze", "impedance"),
        ("some/where.json", "some/where"),
        ("nowhere.at_all:thing", "nowhere"),
        ("os:nothing", "os:nothing"),
        ("os:", "os:"),
        ("my.py", "my:policy"),
        ("functools:partial", "functools:partial"),
        (3, "policies"),
    ],
)
def test_what_cannot_be_found_is_named_as_it_was_written(name: Any, match: str) -> None:
    with pytest.raises(ParameterError, match=match):
        find_policy(name)


def test_a_policy_acts_without_what_scores_need() -> None:
    program = """
import sys, gymnasium, pter_gym
env = gymnasium.make("PTER/Standard-v0", frame_skip=1)
before = set(sys.modules)
pter_gym.load_policy("residual", env)
print(*sorted(set(sys.modules) - before))
"""
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    ours = {name.removeprefix("pter_gym.benchmark.") for name in found if name.startswith("pter_gym.benchmark.")}
    assert ours == {"_from_sb3", "_loading", "_naming", "simulation", "tuned"}
    assert not {"scipy", "rich"} & set(found)
