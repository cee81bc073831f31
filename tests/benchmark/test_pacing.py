"""The paper's gains at other paces: only the damper along the path differs, and it keeps the pace."""

from dataclasses import replace

import pytest

from pter_gym.benchmark import PACES, find_policy, run_scenario
from pter_gym.benchmark._pacing import damping_table
from pter_gym.controllers import CONTROLLERS, Impedance, PaceSchedule, TorqueFeedback
from pter_gym.errors import ParameterError
from pter_gym.scenarios import SCENARIOS

LAWS = {"impedance": Impedance(), "torque-feedback": TorqueFeedback()}


def test_every_other_gain_stays() -> None:
    assert set(damping_table()) == set(SCENARIOS)
    for scenario, controllers in damping_table().items():
        assert set(controllers) == set(LAWS)
        for name, dampers in controllers.items():
            found = find_policy(name, scenario=scenario)
            assert isinstance(found, PaceSchedule)
            assert set(dampers) == set(PACES)
            for pace, damping in dampers.items():
                expected = replace(CONTROLLERS[name](), damping_tangential=damping)  # type: ignore[call-arg]
                assert found.at(PACES[pace]) == expected
    with pytest.raises(ParameterError, match="did you mean 'brisk'"):
        run_scenario("standard", {"paper": found}, ["brisc"], episodes=1)
    with pytest.raises(ParameterError, match=r"pace must be one of 0\.12, 0\.25, 0\.5 m/s, got 0\.3"):
        found.at(0.3)
