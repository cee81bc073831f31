"""`pter device`: what is measured without learning, in closed form, and what it writes."""

import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pter_gym._commands.main import main
from pter_gym.benchmark import evaluate, find_policy
from pter_gym.benchmark.boards import Leaderboard, Standing
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.benchmark.intervals import Interval
from pter_gym.controllers import Free
from pter_gym.errors import DataError, ParameterError
from pter_gym.hands import HandSpread, HumanArm, find_hands
from pter_gym.hands._hand_files import format_hand
from pter_gym.params import ACTUATORS, BASELINE, Arm, Hand, MachineSpread, TorqueCurve, find_machine
from pter_gym.paths import Line
from pter_gym.scenarios.distributions import Draws
from pter_gym.tasks.path_following import COLUMN, TELEMETRY, PathFollowing
from pter_gym.tools.device import examine_device, measures
from pter_gym.tools.device.command import errors, gains_in_words, title_of
from pter_gym.tools.device.data_sheet import find_device, machine_of_sheet
from pter_gym.tools.device.measures import (
    FREQUENCY,
    SHAKE,
    Rendering,
    _free_impedance,
    _stiffness_of_wall,
)
from pter_gym.tools.device.promise import MIN_DRAWS, SEED as PROMISE_SEED, make_promise, order_of
from pter_gym.tools.device.report import SCENARIOS, DeviceReport, _for_any

THETA = np.array([0.4, 0.4 + math.pi / 2])


def test_a_free_arm_has_the_impedance_of_its_mass():
    """At a right angle, with link B along y and link A across, each carries inertia/length²."""
    arm = Arm(length_a=0.5, length_b=0.5, inertia_a=0.8, inertia_b=0.8, coupling=0.0)
    machine = replace(BASELINE, arm=arm, clutch_scale=(0.0,) * 4, substep=1e-3)
    mass = 0.8 / 0.5**2
    found = _free_impedance(machine, THETA)
    amplitude = SHAKE / mass / (2.0 * math.pi * FREQUENCY) ** 2
    assert amplitude < 0.01, "so small a motion that the pose hardly changes"
    assert found == pytest.approx(mass * 2.0 * math.pi * FREQUENCY, rel=0.05)


def test_an_arm_held_by_drag_does_not_move():
    curve = replace(BASELINE.clutch.dynamic, off_state=20.0)
    machine = replace(BASELINE, clutch=replace(BASELINE.clutch, breakaway=curve, dynamic=curve))
    assert _free_impedance(machine, THETA) == math.inf


def test_the_stiffness_of_a_wall_is_of_the_force_into_it(monkeypatch: pytest.MonkeyPatch):
    """A spring of 700 N/m behind a tilted surface, and a push of 30 N along it."""
    task = PathFollowing(path=Line(direction=0.4), free_left=0.1)
    rows = np.zeros((41, len(TELEMETRY)))
    depth = np.linspace(-2e-3, 8e-3, 41)
    into = 700.0 * depth.clip(0.0)
    rows[:, COLUMN.normal_error] = -depth
    rows[:, COLUMN.force.x] = 30.0 * math.cos(0.4) + into * math.sin(0.4)
    rows[:, COLUMN.force.y] = 30.0 * math.sin(0.4) - into * math.cos(0.4)
    pairs = SimpleNamespace(pairs=lambda *_: [(BASELINE, task)])
    monkeypatch.setattr(measures, "find_scenario", lambda *_: SimpleNamespace(draws=pairs))
    ridden = SimpleNamespace(telemetry=rows)
    monkeypatch.setattr(measures, "record_episode", lambda *_, **__: ridden)
    assert _stiffness_of_wall(BASELINE, Free(), "medium") == pytest.approx(700.0)


def test_a_device_that_is_too_weak_is_told_how_much_torque_it_lacks():
    """A third of PTER's steering force, with a law that is not ranked."""
    numbers = dict.fromkeys(Rendering.__dataclass_fields__, 1.0)
    own, usual = (Rendering(**{**numbers, "least_steering_n": n}) for n in (20.0, 60.0))
    standing = Standing("law", None, None, Interval(0.1, 0.1, 0.1), {"mean_force_n": 50.0}, THETA)
    board = Leaderboard("standard", "medium", 4, 0, (standing,))
    report = DeviceReport("brake", "medium", own, usual, {}, (board,))
    assert report.verdict.startswith("No: it steers with 20 N")
    assert "It would need about 3 times the torque." in report.verdict


@pytest.mark.slow
@pytest.mark.usefixtures("few_hands")
def test_examine_writes_a_page_with_numbers_and_pictures(tmp_path: Path):
    pytest.importorskip("optuna")
    machine = replace(BASELINE, clutch=ACTUATORS["rough-mr-brake"].clutch)
    said: list[str] = []
    with pytest.warns(UserWarning, match=r"universal was not trained .* 5\.1 N·m, not 14\.6 to"):
        report = examine_device(
            machine, tmp_path, name="a <brake>", trials=2, episodes=4, on_progress=said.append
        )
    stored = json.loads((tmp_path / "device.json").read_text("utf-8"))
    assert stored == json.loads(json.dumps(report.as_json()))
    assert (
        {board["scenario"] for board in stored["boards"]} == set(SCENARIOS) == set(stored["gains"])
    )
    assert (
        stored["rendering"]["largest_steering_n"] > stored["rendering"]["least_steering_n"] >= 0.0
    )
    page = (tmp_path / "index.html").read_text("utf-8")
    assert "a &lt;brake&gt;" in page
    assert "<brake>" not in page
    for picture in ("forces.png", *(f"{name}.webp" for name in SCENARIOS)):
        assert picture in page
        assert (tmp_path / picture).stat().st_size > 1000
    assert 'alt=""' not in page
    assert '<td class="text">single-dof-tuned</td><td class="">' in page
    assert len(said) == len(SCENARIOS) + 6
    assert len(report.failing) == 12
    assert "<h2>If a clutch fails</h2>" in page
    assert '<td class="text">clutch 4 stuck on</td>' in page
    guided = next(board for board in report.boards if board.scenario == "standard")
    assert all(each.policy in errors(guided) for each in guided.standings)
    worst = {each.policy: each.worst for each in guided.standings if each.worst}
    assert worst.keys() == {"single-dof-tuned", "universal"}
    assert all(found.sentence(name) in page for name, found in worst.items())


@pytest.mark.parametrize(
    ("given", "title"),
    [
        (("particle-brake", None, None), "particle-brake"),
        (("mine/machine.toml", None, None), "mine"),
        (("machine.toml", None, None), "machine"),
        (("my.toml", None, None), "my"),
        (("", 5.4, 12.0), "a clutch of 5.4 N·m at 12 V"),
        (("", None, None), "a clutch of PTER's torque"),
    ],
)
def test_a_page_has_its_device_as_title(given: tuple, title: str) -> None:
    assert title_of(*given) == title


def test_gains_that_a_search_has_found_are_told() -> None:
    found = {"stiffness": 1234.5678, "tip_space": True}
    assert gains_in_words(found) == "stiffness 1235, tip_space True"


def test_a_device_that_the_policy_for_any_device_refuses_is_examined_without_it():
    assert [*_for_any(BASELINE)] == ["universal"]
    for name in ("double-brakes", "couplings-1-2"):
        assert not _for_any(find_machine(name))


def test_a_data_sheet_is_a_straight_torque_curve_and_the_rest_is_pters(tmp_path: Path):
    """On the sheet's line, and PTER itself for PTER's numbers."""
    (tmp_path / "sheet.toml").write_text(
        "[clutch]\ntorque = 5.4\nat = 12\noff = 0.4\nlag = 0.015\n"
    )
    machine = find_device(str(tmp_path / "sheet.toml"))
    assert machine == machine_of_sheet(torque=5.4, at=12.0, off=0.4, lag=0.015)
    clutch = machine.clutch
    assert [clutch.dynamic.torque(v) for v in (0.0, 6.0, 12.0)] == pytest.approx([0.4, 2.9, 5.4])
    assert (clutch.voltage_max, clutch.time_constant) == (12.0, 0.015)
    assert machine.arm == BASELINE.arm
    assert machine_of_sheet(lag=BASELINE.clutch.time_constant) == BASELINE
    looped = machine_of_sheet(torque=5.0, at=12.0, hysteresis=0.05).clutch
    assert looped.dynamic == machine_of_sheet(torque=5.0, at=12.0).clutch.dynamic
    assert looped.least.dynamic == pytest.approx(0.05 * 5.0)


def test_a_table_of_a_sheet_becomes_the_curve_that_made_it(tmp_path: Path):
    """Of a curve with its knee at 0.25 of the supply, in V or in A; and of a straight line."""
    made = TorqueCurve(slope=1.2, knee=3.0, curvature=-0.05, off_state=0.5)
    volts = [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0]
    found = machine_of_sheet(torque=[made.torque(v) for v in volts], at=volts).clutch
    assert [found.dynamic.torque(v) for v in volts] == pytest.approx(
        [made.torque(v) for v in volts]
    )
    assert (found.dynamic.knee, found.voltage_max) == pytest.approx((made.knee, 12.0))
    in_amperes = machine_of_sheet(
        torque=[made.torque(v) for v in volts[1:]], at=np.divide(volts[1:], 48.0).tolist(), off=0.5
    )
    assert in_amperes.clutch.dynamic.torque(0.125) == pytest.approx(made.torque(6.0))
    (tmp_path / "sheet.toml").write_text("[clutch]\ntorque = [0.5, 5, 9, 12]\nat = [0, 4, 8, 12]\n")
    near = find_device(str(tmp_path / "sheet.toml")).clutch.dynamic
    assert [near.torque(v) for v in (0, 4, 8, 12)] == pytest.approx([0.5, 5.0, 9.0, 12.0], abs=0.1)
    ratio = BASELINE.clutch.breakaway.slope / BASELINE.clutch.dynamic.slope
    assert found.breakaway == found.dynamic.scaled(ratio)


@pytest.mark.parametrize(
    ("sheet", "message"),
    [
        ({"torque": 5.0}, "together"),
        ({"torque": 1.0, "at": 12.0, "off": 1.0}, "above off"),
        ({"lag": -1.0}, "lag"),
        ({"lag": 15}, r"lag .* 0\.0005 to 2 s, got 15: is this in s\?"),
        ({"torque": 5400, "at": 12}, r"torque .* 0 to 500 N·m, got 5400: is this in N·m\?"),
        ({"torque": 5, "at": 0}, "at"),
        ({"torque": "5.4", "at": 12}, "torque"),
        ({"lag": float("nan")}, "lag"),
        ({"off": 60.0}, "off"),
        ({"hysteresis": 5.0}, r"hysteresis .* 0 to 0\.4 of the largest voltage, got 5"),
        ({"mass": 1.0}, "clutch"),
        ({"torque": [0.5, 5, 9, 12], "at": 12}, "as many numbers"),
        ({"torque": [0.5, 5, 4], "at": [0, 4, 8]}, "rise"),
        ({"torque": [0.5, 5, 9], "at": [0, 4, 8], "off": 0.5}, "off"),
        ({"torque": [0.1, 0.2, 9, 9.1], "at": [0, 4, 8, 12]}, "straight line"),
    ],
)
def test_a_sheet_that_is_no_clutch_is_refused(sheet: dict, message: str):
    with pytest.raises(ParameterError, match=message):
        machine_of_sheet(**sheet)


@pytest.mark.parametrize("text", ["clutch = 3", "clutch = [1]", "[clutch]\ntorque = 3"])
def test_a_file_that_is_no_sheet_is_refused(text: str, tmp_path: Path):
    (tmp_path / "sheet.toml").write_text(text)
    with pytest.raises(DataError, match=r"sheet\.toml"):
        find_device(str(tmp_path / "sheet.toml"))


def test_a_promise_is_kept_by_new_machines_and_its_order_is_that_of_the_binomial():
    """0.95⁵⁹ < 0.05 < 0.95⁵⁸, so of 59 draws the largest is the limit; new draws keep to it."""
    assert MIN_DRAWS == 59
    assert [order_of(draws) for draws in (58, 59, 93, 200)] == [59, 59, 92, 196]
    variance = (0.1 * BASELINE.arm.inertia_a) ** 2
    machines = MachineSpread(machine=BASELINE, places=("arm.inertia_a",), covariance=((variance,),))
    law = find_policy("single-dof-tuned")
    promise = make_promise(law, "law", machines, "standard", "medium", draws=59, episodes=1)
    some = find_episodes("standard", "medium", PROMISE_SEED).first(1)
    rng = np.random.default_rng(7)
    errors = [
        evaluate(law, replace(some, machines=(machines.draw(rng),)))["path_error_m"][0]
        for _ in range(20)
    ]
    assert sum(error <= promise.error_m for error in errors) >= 17


def test_a_promise_holds_for_hands_too():
    """The same as that of machines, if nothing but the hand is drawn."""
    variance = 30.0**2
    hands = HandSpread(hand=HumanArm(), places=("impedance.stiffness",), covariance=((variance,),))
    law, given = find_policy("single-dof-tuned", "hands"), ("standard", "medium")
    promise = make_promise(law, "law", BASELINE, *given, draws=59, episodes=1, hand=hands)
    assert promise.sentence.startswith("On 95 % of the hands that fit your log, law has")
    rng = np.random.default_rng(PROMISE_SEED)
    (task,) = find_episodes("standard", "medium", PROMISE_SEED, hand=hands).first(1).tasks
    errors = [
        evaluate(law, Episodes.from_pairs("one", Draws(task=own), [(BASELINE, own)], [0]))
        for own in (
            replace(task, hand=replace(task.hand, impedance=hands.draw(rng).impedance))
            for _ in range(59)
        )
    ]
    assert promise.error_m == max(each["path_error_m"][0] for each in errors)


@pytest.mark.parametrize(
    ("options", "field"),
    [({"pace": "fast"}, "pace"), ({"trials": 0}, "trials"), ({"episodes": -1}, "episodes")],
)
def test_bad_arguments_are_refused_before_anything_is_written(
    tmp_path: Path, options: dict, field: str
):
    with pytest.raises(ParameterError, match=field):
        examine_device(BASELINE, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_an_unknown_device_suggests_the_nearest(tmp_path: Path):
    with pytest.raises(ParameterError, match="particle-brake"):
        examine_device("particle-break", tmp_path / "out")


def test_nothing_is_written_without_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setitem(sys.modules, "optuna", None)
    assert main(["device", "particle-brake", "--out", str(tmp_path / "out")]) != 0
    assert "extra tune" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.usefixtures("few_hands")
def test_a_device_is_examined_with_a_measured_hand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("optuna")
    hands = HandSpread(
        hand=HumanArm(impedance=Hand(mass=1.4, damping=12.0, stiffness=250.0)),
        places=("impedance.stiffness", "impedance.damping"),
        covariance=((110.0, -4.5), (-4.5, 0.36)),
    )
    file, out = tmp_path / "mine.toml", tmp_path / "out"
    file.write_text(format_hand(hands, {}, "A measured hand."), "utf-8")
    assert find_hands(str(file)) == hands
    budget = ["--trials", "1", "--episodes", "2"]
    assert main(["device", "baseline", "--hand", str(file), *budget, "--out", str(out)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    stored = json.loads((out / "device.json").read_text("utf-8"))
    promised = {each["policy"]: each for each in stored["promises"]}
    assert promised.keys() == {"single-dof-tuned", "universal"}
    assert {each["of"] for each in promised.values()} == {"hands"}
    page = (out / "index.html").read_text("utf-8")
    for said in (printed, page):
        assert said.count("On 95 % of the hands that fit your log, ") == 2
    assert f"All episodes have the hand {file}." in page
    assert stored["hand"] == str(file)
    assert f"--hand {file}" in printed.replace("\n", "")
