"""The paper's gains at other paces: only the damper along the path differs, and it keeps the pace."""

import math
from dataclasses import replace

import numba
import pytest

from pter_gym.benchmark import PACES, find_policy, pacing, run_scenario
from pter_gym.benchmark.pacing import LOWEST, damping_for_pace, damping_table
from pter_gym.controllers import CONTROLLERS, Impedance, PaceSchedule, TorqueFeedback
from pter_gym.engine.batch import Batch
from pter_gym.errors import ParameterError
from pter_gym.scenarios import SCENARIOS


@pytest.mark.long
@pytest.mark.parametrize("scenario", ["standard", "everything"])
@pytest.mark.parametrize("name", ["impedance", "torque-feedback"])
def test_the_table_is_what_the_solver_finds(name: str, scenario: str) -> None:
    for pace, speed in PACES.items():
        solved = damping_for_pace(CONTROLLERS[name](), speed, scenario)  # type: ignore[arg-type]
        assert damping_table()[scenario][name][pace] == pytest.approx(solved, rel=1e-3)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="takes an hour without the compiler")
def test_an_entry_of_the_table_is_what_the_solver_finds() -> None:
    """The cheapest one; all of them are solved in the test above."""
    solved = damping_for_pace(TorqueFeedback(), PACES["brisk"], "standard")
    assert damping_table()["standard"]["torque-feedback"]["brisk"] == pytest.approx(solved, rel=1e-3)


def test_every_other_gain_stays() -> None:
    assert set(damping_table()) == set(SCENARIOS)
    for scenario, controllers in damping_table().items():
        assert set(controllers) == {"impedance", "torque-feedback"}
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
    drawn = []

    def cruising_pace(controller: Impedance, batch: Batch) -> float:
        drawn.append(batch.num_worlds)
        return 40.0 / controller.damping_tangential

    monkeypatch.setattr(pacing, "_cruising_pace", cruising_pace)
    assert damping_for_pace(Impedance(), pace) == pytest.approx(damping, rel=1e-4)
    assert set(drawn) == {64}
    assert len(drawn) == math.ceil(math.log2(math.log(300.0) / 1e-4))


def test_the_table_is_of_the_papers_laws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pacing, "damping_for_pace", lambda controller, pace, scenario: 1234.5678 * pace)  # noqa: ARG005
    row = {pace: float(f"{1234.5678 * speed:.4g}") for pace, speed in PACES.items()}
    assert pacing.solve_table() == {name: {"impedance": row, "torque-feedback": row} for name in SCENARIOS}


@pytest.mark.slow
def test_a_pace_out_of_reach_gives_the_end_of_the_range() -> None:
    assert damping_for_pace(Impedance(), 3.9, draws=2) == pytest.approx(LOWEST, rel=1e-3)
