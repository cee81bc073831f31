"""The paper's gains at other paces: only the damper along the path differs, and it keeps the pace."""

from dataclasses import replace

import pytest

from pter_gym.benchmark import PACES, PerPace, find_policy
from pter_gym.benchmark.pacing import damping_for_pace, damping_table
from pter_gym.controllers import CONTROLLERS, Impedance, TorqueFeedback
from pter_gym.errors import ParameterError


@pytest.mark.slow
def test_the_table_is_what_the_solver_finds() -> None:
    for name, kind in (("impedance", Impedance), ("torque-feedback", TorqueFeedback)):
        for pace, speed in PACES.items():
            assert damping_table()[name][pace] == pytest.approx(damping_for_pace(kind(), speed), rel=1e-3)


def test_every_other_gain_stays() -> None:
    assert set(damping_table()) == {"impedance", "torque-feedback"}
    for name, dampers in damping_table().items():
        found = find_policy(name)
        assert isinstance(found, PerPace)
        assert set(dampers) == set(PACES)
        for pace, damping in dampers.items():
            assert found.at(pace) == replace(CONTROLLERS[name](), damping_tangential=damping)  # type: ignore[call-arg]
    with pytest.raises(ParameterError, match="did you mean 'brisk'"):
        found.at("brisc")


@pytest.mark.slow
def test_a_pace_out_of_reach_is_refused() -> None:
    with pytest.raises(ParameterError, match="pace must be from"):
        damping_for_pace(Impedance(), 3.9, draws=2)
