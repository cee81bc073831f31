"""A hand from clutch pulses: its numbers, what its log does not tell, pulses, and its file."""

from dataclasses import replace
from pathlib import Path

import measured_hands as bench  # in benchmarks
import numpy as np
import pytest

from pter_gym._commands.arguments import scenario_on
from pter_gym._commands.main import main
from pter_gym.benchmark import Assessment
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.worst_hand import find_worst
from pter_gym.controllers import Impedance
from pter_gym.errors import DataError, ParameterError
from pter_gym.hands import NORMAL, HandSpread, find_hand, find_hands
from pter_gym.params import BASELINE, Hand
from pter_gym.scenarios import find_scenario
from pter_gym.tools.identification import Log, rehearsal, write_log
from pter_gym.tools.identification.hand import MeasuredHand, identify_hand
from pter_gym.tools.identification.pulses import (
    MIDDLE,
    forces_around,
    joint_speeds,
    pulses,
    tip_forces,
    tip_positions,
)
from pter_gym.tools.tuning.search import TunedGains

TRUE = Hand(mass=1.1, damping=18.0, stiffness=420.0)
NAMES = ("stiffness", "damping", "mass")


@pytest.fixture(scope="module")
def log() -> Log:
    return rehearsal.rehearse(BASELINE, TRUE, np.array(MIDDLE), 30.0, 60.0, 3)


@pytest.fixture(scope="module")
def found(log: Log) -> MeasuredHand:
    return identify_hand(log, BASELINE)


def errors(found: MeasuredHand) -> np.ndarray:
    """Errors over half of the 95 % intervals."""
    estimates = [found.estimates[name] for name in NAMES]
    return np.array(
        [
            (value - getattr(TRUE, name)) / half
            for name, (value, half) in zip(NAMES, estimates, strict=True)
        ]
    )


def test_a_hand_is_inside_its_intervals(found: MeasuredHand):
    assert np.abs(errors(found)).max() <= 1.0
    assert not found.warnings
    assert found.switches > 500


def test_a_minute_tells_a_hand_to_a_tenth(found: MeasuredHand):
    for each in found.findings[:3]:
        assert each.half_width < 0.1 * getattr(TRUE, each.quantity.name)


def test_a_tremor_is_predicted_from_its_past(log: Log, found: MeasuredHand):
    """Six times the hand's other disturbances, at one frequency, hardly widen intervals."""
    push = 6.0 * np.sin(2.0 * np.pi * 5.3 * log.times)[:, None]
    other = identify_hand(replace(log, force=log.force + push), BASELINE)
    for a, b in zip(found.findings[:3], other.findings[:3], strict=True):
        assert b.half_width < 1.3 * a.half_width


def test_a_person_who_reacts_is_noticed(log: Log):
    """A push of half the stiffness against where the arm was 0.15 s ago, within its last second."""
    tip = tip_positions(BASELINE, log.theta)
    late, second = round(0.15 / log.interval), round(1.0 / log.interval)
    ago = np.roll(tip, late, axis=0)
    since = ago - np.stack([np.convolve(x, np.ones(second) / second, "same") for x in ago.T], 1)
    other = identify_hand(replace(log, force=log.force - 0.5 * TRUE.stiffness * since), BASELINE)
    assert any("0.1 to 0.2 s ago" in each for each in other.warnings)
    assert all(each.status != "identified" for each in other.findings)
    assert other.grade != "measured"


@pytest.mark.slow
def test_a_hand_that_gives_way_is_noticed():
    """Its intent never leads the tip by more than 0.12 m, so its push is limited."""
    soft, gives = Hand(mass=1.0, damping=12.0, stiffness=200.0), bench.Condition(lead=0.12)
    found = identify_hand(
        bench.record(soft, gives, np.random.default_rng([0, 99]), 240.0), BASELINE
    )
    assert any("gives way" in each for each in found.warnings)
    assert all(each.status != "identified" for each in found.findings)


def test_coarse_angles_are_noticed(log: Log):
    step = 2.0 * np.pi / 2**10
    other = identify_hand(replace(log, theta=step * np.round(log.theta / step)), BASELINE)
    assert any("steps of 6.1 mrad" in each for each in other.warnings)
    assert all(each.status != "identified" for each in other.findings)


def test_forces_recorded_late_are_noticed_and_do_not_bias(log: Log, found: MeasuredHand):
    """A hand whose forces are 15 ms late would seem to have less damping by 0.015 s · stiffness."""
    late = replace(log, force=np.roll(log.force, 3, axis=0))
    other = identify_hand(late, BASELINE)
    assert np.abs(errors(other)).max() <= 1.5
    delays = [each.findings[-1].quantity.value for each in (found, other)]
    half = found.findings[-1].half_width
    assert delays[1] - delays[0] == pytest.approx(0.015, abs=half)
    # the same test functions, but for three rows in thousands
    for name in NAMES:
        (a, size), (b, _) = found.estimates[name], other.estimates[name]
        assert a == pytest.approx(b, abs=0.2 * size)


def test_a_wrong_machine_does_not_bias(log: Log):
    """Clutches and inertias decide which instruments are used, not what they are compared with."""
    arm = replace(BASELINE.arm, inertia_a=0.6, inertia_b=0.8)
    clutch = replace(BASELINE.clutch, time_constant=0.06)
    other = identify_hand(log, replace(BASELINE, arm=arm, clutch=clutch))
    assert np.abs(errors(other)).max() <= 1.5


def test_too_few_pulses_are_refused(log: Log):
    with pytest.raises(ParameterError, match="log must have at least 150 switches"):
        identify_hand(replace(log, volts=np.zeros_like(log.volts)), BASELINE)


@pytest.mark.parametrize("reaction", [0.1, 0.6, float("nan")])
def test_a_reaction_out_of_range_is_refused(log: Log, reaction: float):
    with pytest.raises(ParameterError, match=r"reaction must be from 0\.15 to 0\.5 s"):
        identify_hand(log, BASELINE, reaction=reaction)


def test_pulses_keep_within_their_force_and_never_repeat():
    force = 25.0
    in_middle = force / forces_around(BASELINE)
    volts = pulses(BASELINE, np.array(MIDDLE), 60.0, 5e-3, in_middle, 0)
    torque = np.vectorize(BASELINE.clutch.breakaway.torque)(volts)
    rng = np.random.default_rng(0)
    poses = np.array(MIDDLE) + rng.uniform(-0.35, 0.35, (200, 2))
    sizes = np.linalg.norm(tip_forces(BASELINE, poses), axis=2)  # (poses, clutches)
    assert (sizes @ torque.T).max() <= force * (1.0 + 1e-9)
    rows = np.flatnonzero(np.abs(np.diff(volts, axis=0)).max(axis=1) > 0.0)
    assert ((volts[rows] > 0.0) != (volts[rows + 1] > 0.0)).any(axis=1).all()


def test_levers_are_those_of_the_arm():
    theta, step = np.array([[0.5, 2.0]]), 1e-6
    turned = [tip_positions(BASELINE, theta + step * each) for each in np.eye(2)]
    jacobian = np.stack([(each - tip_positions(BASELINE, theta))[0] / step for each in turned], 1)
    # forward differences of sines of at most 1 m: an error of step/2
    np.testing.assert_allclose(joint_speeds(BASELINE, theta)[0] @ jacobian, np.eye(2), atol=1e-5)


def test_commands_write_pulses_and_a_hand_that_others_take(
    log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    write_log(log, tmp_path / "log.csv")
    main(["identify", str(tmp_path / "log.csv"), "--hand", "--out", str(tmp_path)])
    assert "switches of clutches" in capsys.readouterr().out
    file = str(tmp_path / "hand.toml")
    hands = find_hands(file)
    assert isinstance(hands, HandSpread)
    assert hands.hand == find_hand(file)
    assert hands.hand.impedance.damping == pytest.approx(TRUE.damping, rel=0.3)
    scenario = scenario_on("standard", None, None, 0.0, file)
    assert scenario.name == "standard-by-hand"
    assert scenario.digest == find_scenario("standard", hand=hands).digest
    tasks = [task for _, task in scenario.draws.pairs(3, 0, "medium")]
    assert len({each.hand.impedance for each in tasks}) == 3
    assert all(each.hand.random_phases for each in tasks)


def test_hands_are_drawn_within_the_intervals(found: MeasuredHand):
    """Standard errors of 2,000 draws are 1.6 % of a standard deviation, 2.2 % of a mean."""
    rng, hands = np.random.default_rng(0), found.hands
    drawn = [hands.draw(rng).impedance for _ in range(2000)]
    numbers = np.array([[getattr(each, name) for name in NAMES] for each in drawn])
    for values, name in zip(numbers.T, NAMES, strict=True):
        value, half = found.estimates[name]
        assert values.mean() == pytest.approx(value, abs=0.05 * half)
        assert 1.96 * values.std() == pytest.approx(half, rel=0.08)
    among = np.corrcoef(numbers.T)[0, 2]
    size = np.sqrt(np.diag(found.covariance))
    assert among == pytest.approx(found.covariance[0, 2] / size[0] / size[2], abs=0.07)


def test_what_a_log_does_not_tell_does_not_vary():
    """In half a minute, a stiffness is known to about ±50 N/m."""
    soft = replace(TRUE, stiffness=40.0)
    short = rehearsal.rehearse(BASELINE, soft, np.array(MIDDLE), 30.0, 30.0, 3)
    hands = identify_hand(short, BASELINE).hands
    assert hands.places[:2] == ("impedance.damping", "impedance.mass")
    drawn = [hands.draw(np.random.default_rng(seed)).impedance for seed in (0, 1)]
    assert {each.stiffness for each in drawn} == {NORMAL.stiffness}
    assert len({each.damping for each in drawn}) == 2


@pytest.mark.usefixtures("few_hands")
def test_the_worst_hand_is_searched_within_the_intervals(found: MeasuredHand):
    scenario = find_scenario("standard", hand=found.hands)
    worst = find_worst(Impedance(), scenario, "brisk").task.hand
    assert worst.impedance != found.hand
    for name in NAMES:
        value, half = found.estimates[name]
        # each of the search's numbers is within 3.3 standard deviations
        assert abs(getattr(worst.impedance, name) - value) <= 3.3 * half


def test_pulses_are_written_with_how_long_to_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(rehearsal, "SECONDS", 30.0)
    file = tmp_path / "pulses.csv"
    main(["identify", "--pulses", str(file), "--seconds", "30", "--force", "25"])
    assert "stiffness" in capsys.readouterr().out
    table = np.genfromtxt(file, delimiter=",", names=True)
    assert table.dtype.names == ("t_s", "V1", "V2", "V3", "V4")
    assert table["t_s"][0] == 0.0
    assert np.diff(table["t_s"]).min() > 0.0
    assert table[-1].tolist() == (30.0, 0.0, 0.0, 0.0, 0.0)
    expected = pulses(BASELINE, np.array(MIDDLE), 30.0, 5e-3, 25.0 / forces_around(BASELINE), 0)
    played = np.searchsorted(table["t_s"], 5e-3 * np.arange(len(expected)) + 1e-9) - 1
    volts = np.column_stack([table[f"V{k}"] for k in range(1, 5)])
    np.testing.assert_allclose(volts[played], expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--force", "0"], "force must be > 0 N"),
        (["--seconds", "5"], "seconds must be from 20 to 600"),
        (["log.csv"], "pulses must be given without logs"),
    ],
)
def test_pulses_out_of_range_are_refused(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["identify", "--pulses", str(tmp_path / "pulses.csv"), *options]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "pulses.csv").exists()


def test_a_hand_replaces_all_that_a_training_or_a_search_would_draw(tmp_path: Path):
    file = tmp_path / "mine.toml"
    file.write_text('type = "Hand"\nmass = 1.5\ndamping = 12.0\nstiffness = 222.0\n', "utf-8")
    episodes = find_episodes("hands", "medium", 3, hand=str(file))
    assert {task.hand.impedance.stiffness for task in episodes.tasks} == {222.0}
    assert len({task.hand.phases for task in episodes.tasks}) > 1
    found = TunedGains(
        "impedance",
        "standard",
        "medium",
        {},
        Assessment(0.0, 1.0, 0.0, 0.0),
        1,
        1,
        0,
        hand=str(file),
    )
    assert found.command.endswith(f"--hand {file}")


def test_a_malformed_file_is_refused(tmp_path: Path):
    file = tmp_path / "hand.toml"
    with pytest.raises(ParameterError, match="hand must name a file that exists"):
        find_hand(str(file))
    file.write_text('type = "Hand"\nweight = 1.0\n', "utf-8")
    with pytest.raises(DataError, match="weight"):
        find_hand(str(file))
    known = 'type = "Hand"\nmass = 1.0\ndamping = 9.0\nstiffness = 200.0\n[uncertainty]\n'
    file.write_text(f'{known}places = ["stifness"]\ncovariance = [[1.0]]\n', "utf-8")
    with pytest.raises(DataError, match=r"impedance\.stifness"):
        find_hands(str(file))
    file.write_text(f'{known}places = ["stiffness"]\ncovariance = [[-1.0]]\n', "utf-8")
    with pytest.raises(DataError, match=r"HandSpread\.covariance"):
        find_hands(str(file))
