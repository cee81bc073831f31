"""The paper's gains at other paces: only the damper along the path differs, and it keeps the pace."""

import math
from dataclasses import replace

import numba
import pytest

from pter_gym._engine.batch import Batch
from pter_gym.benchmark import PACES, find_policy, run_scenario
from pter_gym.benchmark import _pacing as pacing
from pter_gym.benchmark._pacing import damping_for_pace, damping_table
from pter_gym.controllers import CONTROLLERS, Impedance, PaceSchedule, TorqueFeedback
from pter_gym.errors import ParameterError
from pter_gym.scenarios import SCENARIOS

LAWS = {"impedance": Impedance(), "torque-feedback": TorqueFeedback()}


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="takes an hour without the compiler")
@pytest.mark.parametrize(
    ("name", "scenario", "pace"),
    [
        ("torque-feedback", "standard", "brisk"),
        *(
            pytest.param(n, s, p, marks=pytest.mark.long)
            for n in LAWS
            for s in ("standard", "everything")
            for p in PACES
        ),
    ],
)
def test_the_table_is_what_the_solver_finds(name: str, scenario: str, pace: str) -> None:
    solved = damping_for_pace(LAWS[name], PACES[pace], scenario)
    assert damping_table()[scenario][name][pace] == pytest.approx(solved, rel=1e-3)


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


@pytest.mark.parametrize(("pace", "damping"), [(0.5, 80.0), (0.04, 1000.0), (1e-3, 3000.0), (5.0, 10.0)])
def test_the_solver_finds_where_a_falling_pace_is_met(
    pace: float, damping: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or the end of its range that comes nearest."""
    drawn = []

    def cruising_pace(controller: Impedance, batch: Batch) -> float:
        drawn.append(batch.num_worlds)
        return 40.0 / controller.damping_tangential

    monkeypatch.setattr(pacing, "_cruising_pace", cruising_pace)
    assert damping_for_pace(Impedance(), pace) == pytest.approx(damping, rel=1e-4)
    assert drawn == [64] * math.ceil(math.log2(math.log(300.0) / 1e-4))
