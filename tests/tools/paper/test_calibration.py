"""The calibrated preset: Table I as close as it got, the rules of the search, and a repeatable search."""

import math
from pathlib import Path

import numpy as np
import pytest
from pter_gym.params._preset import load_preset

from pter_gym._commands import main as cli
from pter_gym.errors import ParameterError
from pter_gym.hands import eq5
from pter_gym.tasks.path_following import check_machine
from pter_gym.tasks.path_following._specification import sin_elbow
from pter_gym.tools.paper import calibration
from pter_gym.tools.paper.calibration import HAND_MAX, SPACE, decode, is_accepted, misfit
from pter_gym.tools.paper.path_tests import table1, time_constant_sweep
from pter_gym.tools.paper.printed_values import BREAKAWAY_SMALL_VOLTAGE
from pter_gym.tools.paper.setup import STUDY, setup_of


def points(count: int) -> np.ndarray:
    rng = np.random.default_rng(7)
    return np.concatenate(
        [rng.random((count, len(SPACE))), rng.integers(0, 2, (count, len(SPACE))).astype(float)]
    )


def test_run_cases_gives_table_1():
    setups = [setup_of(preset) for preset in (decode(points(1)[0]), STUDY)]
    found = calibration.quality_of(setups, calibration.FIRST_LOOK)
    sweeps = time_constant_sweep(setups[1], setups[1].time_constants[calibration.FIRST_LOOK])
    np.testing.assert_allclose(found.table[1], list(table1(sweeps).values()), rtol=1e-12)
    errors = np.array([sweep.position_error for sweep in sweeps.values()])
    np.testing.assert_allclose(found.order[1], (errors[2] / errors[:2]).max(axis=1), rtol=1e-12)


def test_rules_hold_at_every_point():
    seconds = np.linspace(0.0, 2.0, 2001)
    for point in points(60):
        preset = decode(point)
        setup = setup_of(preset)
        baseline, experimental, theoretical = (
            machine.clutch for machine in setup.machines.values()
        )
        assert min(preset.arm["length_a"], preset.arm["length_b"]) >= 0.3
        assert max(preset.arm["length_a"], preset.arm["length_b"]) <= 0.66
        assert min(preset.arm["inertia_a"], preset.arm["inertia_b"]) >= 0.25
        assert max(preset.arm["inertia_a"], preset.arm["inertia_b"]) <= 2.0
        assert 15.0 - 0.02 <= baseline.dynamic.torque(24.0) <= 70.0 + 0.1
        assert 4.0 - 0.01 <= baseline.breakaway.voltage(BREAKAWAY_SMALL_VOLTAGE) <= 8.0 + 0.01
        for clutch in (baseline, experimental):
            assert clutch.breakaway.torque(24.0) / clutch.dynamic.torque(24.0) >= 1.12 - 1e-9
        mu = preset.delrin["mu_dynamic_present"]
        assert 0.35 < mu <= 0.45
        assert theoretical.dynamic.slope == pytest.approx(baseline.dynamic.slope * 0.35 / mu)
        assert theoretical.breakaway.slope == pytest.approx(baseline.breakaway.slope * 0.20 / 0.45)
        assert 0.7 <= setup.table_error <= 1.4
        assert 0.15 - 1e-9 <= setup.time_constants[-1] <= 0.25 + 1e-9
        hand = eq5(preset.hand["force_max"], preset.hand["push"])
        peak = max(math.hypot(preset.hand["push"], hand.normal_force(t)) for t in seconds)
        assert max(peak, preset.hand["force_max"]) <= HAND_MAX + 0.1
        if is_accepted(setup):
            for machine in setup.machines.values():
                check_machine(setup.task, machine)
        line = setup.task.path
        assert (
            sin_elbow(preset.arm["length_a"], preset.arm["length_b"], line.sampled(3)).min() >= 0.39
        )


def test_an_arm_that_the_substep_cannot_hold_is_left_out():
    refused = next(
        preset for preset in map(decode, points(60)) if not is_accepted(setup_of(preset))
    )
    with pytest.raises(ParameterError, match="hand"):
        check_machine(setup_of(refused).task, setup_of(refused).baseline)
    alone, (beside, other) = misfit([refused], 0.3), misfit([refused, STUDY], 0.3)
    assert alone[0] == beside > other


@pytest.mark.long
def test_fit_writes_what_the_search_finds_and_is_repeatable_bit_for_bit(tmp_path: Path):
    file = tmp_path / "a.toml"
    assert cli.main(["fit", "--seed", "3", "--budget", "1000", "--out", str(file)]) == 0
    assert load_preset(file) == calibration.search(seed=3, budget=1000).preset


def test_the_search_finds_the_lowest_point_of_a_valley():
    """Ten-to-one ellipsoid, turned, with its centre inside the cube."""
    turned, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(len(SPACE),) * 2))
    scale = 10.0 ** np.linspace(0.0, 1.0, len(SPACE))
    center = np.full(len(SPACE), 0.4)
    value, found = calibration.adapted(
        lambda x: (((x - center) @ turned * scale) ** 2).sum(axis=1),
        np.random.default_rng(0),
        12_000,
        np.full(len(SPACE), 0.9),
    )
    assert value < 1e-3
    assert np.abs(found - center).max() < 0.02


@pytest.mark.parametrize(("name", "value"), [("seed", -1), ("budget", 10), ("trends", -0.1)])
def test_search_refuses_bad_arguments(name: str, value: float):
    with pytest.raises(ParameterError, match=name):
        calibration.search(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("out", ["no/such/folder/p.toml", "p.json"])
def test_fit_refuses_a_file_that_it_cannot_write_before_any_work(
    monkeypatch, tmp_path: Path, out: str
):
    monkeypatch.setattr(
        calibration, "search", lambda *_: pytest.fail("searched before it looked at the file")
    )
    assert cli.main(["fit", "--out", str(tmp_path / out)]) == 2
    assert not list(tmp_path.iterdir())
