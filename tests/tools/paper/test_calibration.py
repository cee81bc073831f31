"""The calibrated preset: Table I as close as it got, the rules of the search, a repeatable search, and bad files."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from pter_gym.tools.paper.experiments import calibration
from pter_gym.tools.paper.experiments.calibration import HAND_MAX, SPACE, Reading, decode, setup_of
from pter_gym.tools.paper.experiments.calibration.objective import is_accepted, misfit
from pter_gym.tools.paper.experiments.calibration.search import adapted
from pter_gym.tools.paper.experiments.claims import TABLE_TOLERANCE
from pter_gym.tools.paper.experiments.setup import STUDY

import pter_gym
from pter_gym.errors import ParameterError
from pter_gym.hands import eq5
from pter_gym.params._preset import PRESET, format_preset, load_preset, parse_preset
from pter_gym.tasks.path_following import check_machine
from pter_gym.tasks.path_following._specification import sin_elbow
from pter_gym.tools.paper.printed_values import BREAKAWAY_SMALL_VOLTAGE

FILE = Path(pter_gym.__file__).parent / "presets" / "pter.toml"


@pytest.fixture(scope="module")
def table() -> np.ndarray:
    return calibration.table_of(STUDY)


def points(count: int) -> np.ndarray:
    rng = np.random.default_rng(7)
    return np.concatenate([rng.random((count, len(SPACE))), rng.integers(0, 2, (count, len(SPACE))).astype(float)])


def test_no_entry_is_further_off_than_the_claims_allow(table: np.ndarray):
    deviation = np.abs(table / calibration.TARGET - 1.0)
    assert deviation.max() <= TABLE_TOLERANCE, deviation.round(4)


def test_smaller_substep_moves_no_entry_by_more_than_half_a_percent(table: np.ndarray):
    fine = calibration.table_of(STUDY, parts=10)
    assert np.abs(fine / table - 1.0).max() <= 0.005


@pytest.mark.parametrize("lag", ["normal_force", "voltage"])
def test_many_candidates_at_once_give_the_same_table(lag: str):
    preset = decode(points(1)[0])
    setups = [setup_of(preset), setup_of(STUDY, Reading(lag=lag))]
    found = calibration.quality_of(setups, (0.03, 0.105))
    wanted = calibration.table_of(STUDY, Reading(lag=lag, time_constants=(0.03, 0.105)))
    np.testing.assert_allclose(found.table[1], wanted, rtol=1e-12)


@pytest.mark.parametrize("reading", calibration.READINGS.values(), ids=calibration.READINGS.keys())
def test_every_reading_gives_a_table(reading: Reading):
    assert np.isfinite(calibration.table_of(STUDY, reading)).all()


def test_rules_hold_at_every_point():
    seconds = np.linspace(0.0, 2.0, 2001)
    for point in points(60):
        preset = decode(point)
        setup = setup_of(preset)
        baseline, experimental, theoretical = (machine.clutch for machine in setup.machines.values())
        assert min(preset.arm.length_a, preset.arm.length_b) >= 0.3
        assert max(preset.arm.length_a, preset.arm.length_b) <= 0.66
        assert min(preset.arm.inertia_a, preset.arm.inertia_b) >= 0.25
        assert max(preset.arm.inertia_a, preset.arm.inertia_b) <= 2.0
        assert 15.0 - 0.02 <= baseline.dynamic.torque(24.0) <= 70.0 + 0.1
        assert 4.0 - 0.01 <= baseline.breakaway.voltage(BREAKAWAY_SMALL_VOLTAGE) <= 8.0 + 0.01
        for clutch in (baseline, experimental):
            assert clutch.breakaway.torque(24.0) / clutch.dynamic.torque(24.0) >= 1.12 - 1e-9
        ratio = preset.clutch.breakaway_ratio
        mu = preset.delrin["mu_dynamic_present"]
        assert 0.35 < mu <= 0.45
        assert theoretical.dynamic.slope == pytest.approx(baseline.dynamic.slope * 0.35 / mu)
        assert 0.64 <= (preset.delrin["breakaway_ratio"] - 1.0) / (ratio - 1.0) <= 1.61
        assert theoretical.breakaway.slope == pytest.approx(baseline.breakaway.slope * 0.20 / 0.45)
        hand = eq5(preset.hand["force_max"], preset.hand["push"])
        peak = max(math.hypot(preset.hand["push"], hand.normal_force(t)) for t in seconds)
        assert max(peak, preset.hand["force_max"]) <= HAND_MAX + 0.1
        if is_accepted(setup):
            for machine in setup.machines.values():
                check_machine(setup.task, machine)
        line = setup.task.path
        assert sin_elbow(preset.arm.length_a, preset.arm.length_b, line.sampled(3)).min() >= 0.39


def test_an_arm_that_the_substep_cannot_hold_is_left_out():
    refused = next(preset for preset in map(decode, points(60)) if not is_accepted(setup_of(preset)))
    with pytest.raises(ParameterError, match="hand"):
        check_machine(setup_of(refused).task, setup_of(refused).baseline)
    alone, (beside, other) = misfit([refused], 0.3), misfit([refused, STUDY], 0.3)
    assert alone[0] == beside > other


@pytest.mark.slow
def test_fit_is_repeatable_bit_for_bit(tmp_path: Path):
    first = calibration.fit(seed=3, budget=1000, out=tmp_path / "a.toml")
    second = calibration.fit(seed=3, budget=1000, out=tmp_path / "b.toml")
    assert (tmp_path / "a.toml").read_bytes() == (tmp_path / "b.toml").read_bytes()
    assert first.misfit == second.misfit
    np.testing.assert_array_equal(first.quality.table, second.quality.table)
    assert load_preset(tmp_path / "a.toml") == first.preset


def test_the_search_finds_the_lowest_point_of_a_valley():
    """Ten-to-one ellipsoid, turned, with its centre inside the cube."""
    turned, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(len(SPACE),) * 2))
    scale = 10.0 ** np.linspace(0.0, 1.0, len(SPACE))
    center = np.full(len(SPACE), 0.4)
    value, found = adapted(
        lambda x: (((x - center) @ turned * scale) ** 2).sum(axis=1), np.random.default_rng(0), 12_000
    )
    assert value < 1e-3
    assert np.abs(found - center).max() < 0.02


@pytest.mark.parametrize(
    ("name", "value"), [("seed", -1), ("budget", 10), ("trends", -0.1), ("out", Path("no/such/folder/p.toml"))]
)
def test_fit_refuses_bad_arguments(name: str, value: object):
    with pytest.raises(ParameterError, match=name):
        calibration.fit(**{name: value})  # type: ignore[arg-type]


# --- the file ---


def test_file_comes_back_the_same():
    assert parse_preset(format_preset(PRESET, "title")) == PRESET
    assert load_preset(FILE) == PRESET


def text_with(section: str, field: str, entry: str) -> str:
    lines = FILE.read_text("utf-8").splitlines()
    begin = lines.index(f"[{section}]")
    k = next(i for i in range(begin, len(lines)) if lines[i].startswith(f"{field} "))
    lines[k] = f"{field} = {entry}" if entry else ""
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("", "'length_a' is missing"),
        ('{ value = "0.5", unit = "m", from = "fitted: x" }', "finite number"),
        ("{ value = 1" + "0" * 400 + ', unit = "m", from = "fitted: x" }', "finite number"),
        ('{ value = -0.5, unit = "m", from = "fitted: x" }', "> 0"),
        ('{ value = 0.5, unit = "in", from = "fitted: x" }', "unit"),
        ('{ value = 0.5, unit = "m", from = "guessed: x" }', "from"),
        ('{ value = 0.5, unit = "m" }', "'from' is missing"),
        ('{ value = 0.5, unit = "m", from = "fitted: x", note = 1 }', "unknown"),
    ],
)
def test_bad_numbers_are_named(entry: str, message: str):
    with pytest.raises(ParameterError, match=message) as raised:
        parse_preset(text_with("arm", "length_a", entry))
    assert "length_a" in str(raised.value)


@pytest.mark.parametrize(
    "text", ["", "[arm]\n[arm]", "arm = 1", "[arm]\nlength_a = nan", FILE.read_text("utf-8") + "\n[spare]\n"]
)
def test_bad_texts_are_refused(text: str):
    with pytest.raises(ParameterError):
        parse_preset(text)


def test_unknown_field_is_named():
    text = FILE.read_text("utf-8").replace("[hand]\n", "[hand]\nmass = { value = 1.0 }\n")
    with pytest.raises(ParameterError, match="mass"):
        parse_preset(text)


def test_every_number_of_the_file_has_a_provenance():
    tables = tomllib.loads(FILE.read_text("utf-8"))
    names = {f"{section}.{field}" for section, table in tables.items() for field in table}
    assert names == set(PRESET.provenance)
