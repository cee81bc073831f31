"""Identification of simulated machines: what is found, and what is named as not shown."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oracle.experiment import Experiment, Recorder, record_log
from pter_gym._commands.main import main
from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.params import BASELINE, Arm, Clutch, Machine, TorqueCurve, find_machine
from pter_gym.params._files import format_machine
from pter_gym.tools.identification import Identification, Log, identify, quantities, write_log
from pter_gym.tools.identification.command import read_start
from pter_gym.tools.identification.identifying import ASSUMED
from pter_gym.tools.identification.parameters import AT, COUNT, NAMES, STEPS, Shape
from pter_gym.tools.identification.shooting import LogInputs, differentiate, make_inputs, predict
from pter_gym.tools.identification.verdict import EXACT
from pter_gym.tools.identification.windows import lagged

PERFECT = Recorder(angle_resolution=0.0, angle_noise=1e-6, force_noise=0.0, delay=0.006)
SHORT = Experiment(levels=(4.0, 10.0, 20.5, 22.0), on=0.8, off=0.2, free=3.0)
OTHER = replace(
    BASELINE,
    arm=replace(BASELINE.arm, inertia_a=0.7, inertia_b=0.6, coupling=0.1),
    clutch_scale=(0.9, 1.1, 1.05, 0.95),
)


def errors(found: Identification, machine: Machine, delay: float) -> dict[str, float]:
    """Errors over the scale, by name."""
    true = quantities(machine, delay, found.fit.shape.top)
    return {
        f.quantity.name: (f.quantity.value - q.value) / q.scale
        for f, q in zip(found.findings, true, strict=True)
    }


def rows_of(log: Log, rows: slice) -> Log:
    return replace(log, volts=log.volts[rows], theta=log.theta[rows], force=log.force[rows])


def states(found: Identification) -> dict[str, str]:
    return {finding.quantity.name: finding.status for finding in found.findings}


# --- the model ---


def test_windows_are_the_simulator():
    rng = np.random.default_rng(0)
    volts, force = rng.uniform(0.0, 10.0, (31, 4)), rng.normal(0.0, 20.0, (31, 2))
    machine = replace(OTHER, substep=0.5e-3)
    inputs = make_inputs(1e-3, volts, force)
    start = np.array([[0.7, 2.2, 1.0, -2.0]])
    shape = Shape(OTHER, 22.0)
    angles = predict(shape, shape.coordinates(OTHER), inputs, start, 30)
    state = initial_state(machine, start[0, :2], start[0, 2:], volts=volts[0])
    way = simulate(machine, state, inputs.delayed_volts(0.0)[0], inputs.early_force(0.0)[0])
    assert np.array_equal(angles[0], way.theta[1::2])


def test_coordinates_and_numbers_are_of_the_machine_that_they_come_from():
    """Breakaway over dynamic torque, not the inverse; and a machine comes back from its own."""
    curve = OTHER.clutch.dynamic
    machine = replace(OTHER, clutch=replace(OTHER.clutch, breakaway=curve.scaled(1.3)))
    shape = Shape(machine, top=24.0)
    found = shape.machine(shape.coordinates(machine))
    assert found.clutch.breakaway.torque(20.0) == pytest.approx(1.3 * curve.torque(20.0))
    assert found.arm.inertia_b == pytest.approx(machine.arm.inertia_b)
    told = {each.name: each.value for each in quantities(machine, 0.0, 24.0)}
    assert told["breakaway_ratio"] == pytest.approx(1.3)


def test_lengths_are_those_of_links_a_and_b():
    arm = read_start("baseline", "0.5,0.4", None).arm
    assert (arm.length_a, arm.length_b) == (0.5, 0.4)


def test_the_lag_is_that_of_the_clutches():
    still, volts = np.zeros((100, 2)), np.repeat([[0.0], [5.0]], 50, axis=0) * np.ones(4)
    log = Log(interval=0.01, volts=volts, theta=still, force=still)
    behind = lagged(log, log.volts, 0.1)
    assert np.allclose(behind[:51], 0.0)
    assert np.allclose(behind[50:, 0], 5.0 * (1.0 - np.exp(-np.arange(50) * 0.1)))


def crossing(clutches: str, lag: str) -> tuple[Shape, np.ndarray, LogInputs, np.ndarray]:
    """Shape, coordinates, inputs and starts of windows in which clutches slip and stick."""
    rng = np.random.default_rng(3)
    start = BASELINE if clutches == "paper" else find_machine(clutches)
    arm = replace(OTHER.arm, dry_a=0.2, dry_b=0.1, viscous_a=0.1, viscous_b=0.2)
    dynamic = replace(OTHER.clutch.dynamic, off_state=0.2)
    clutch = replace(OTHER.clutch, dynamic=dynamic, breakaway=dynamic.scaled(1.12), lag=lag)
    clutch = replace(clutch, stribeck=0.1, fall_ratio=1.5)
    machine = replace(OTHER, arm=arm, clutch=clutch, clutches=start.clutches)
    shape = Shape(machine, 18.0)
    volts = np.repeat(
        rng.uniform(0.0, 18.0, (41, 4)) * (rng.uniform(size=(41, 4)) < 0.4), 10, axis=0
    )
    volts[:, len(machine.clutches) :] = 0.0
    force = np.repeat(rng.normal(0.0, 40.0, (41, 2)), 10, axis=0)
    starts = np.column_stack(
        [rng.uniform(0.4, 1.0, 4), rng.uniform(2.0, 2.5, 4), rng.normal(0.0, 0.5, (4, 2))]
    )
    other = np.zeros(COUNT)
    other[[AT["offset_a"], AT["force_delay"]]] = 0.3, 1.3e-3
    return (
        shape,
        shape.coordinates(machine, 3.3e-3) + other,
        make_inputs(2e-3, volts, force),
        starts,
    )


@pytest.mark.parametrize(
    ("clutches", "lag"),
    [
        pytest.param("paper", "normal_force", marks=pytest.mark.long),
        ("paper", "voltage"),
        pytest.param("couplings-1-2", "normal_force", marks=pytest.mark.long),
    ],
)
def test_windows_have_the_derivatives_of_central_differences(clutches: str, lag: str):
    """By each coordinate and each number of a start, over 800 substeps of stick-slip.

    A difference over 2·10⁻⁶ steps loses 10⁻¹⁶ rad to rounding per substep, and the formulas from
    coordinates to the kernel's constants are differentiated by differences that are right to 10⁻⁹.
    """
    shape, p, inputs, starts = crossing(clutches, lag)
    angles, by_p, by_start = differentiate(shape, p, inputs, starts, 100)

    def predicted(p: np.ndarray, starts: np.ndarray) -> np.ndarray:
        return predict(shape, p, inputs, starts, 100)

    assert np.array_equal(angles, predicted(p, starts))
    for i, step in enumerate(1e-5 * STEPS):
        e = step * np.eye(len(p))[i]
        difference = (predicted(p + e, starts) - predicted(p - e, starts)) / (2.0 * step)
        np.testing.assert_allclose(
            by_p[..., i], difference, rtol=1e-4, atol=400 * 1e-16 / step + 1e-7, err_msg=NAMES[i]
        )
    for j, e in enumerate(1e-6 * np.eye(4)):
        difference = (predicted(p, starts + e) - predicted(p, starts - e)) / 2e-6
        np.testing.assert_allclose(by_start[..., j], difference, rtol=1e-4, atol=1e-7)


def test_a_simulated_log_is_what_the_model_predicts():
    """Forces and angles are of the same instants: half a substep between them is 0.12 mrad."""
    log = record_log(OTHER, replace(SHORT, levels=(10.0,)), replace(PERFECT, angle_noise=0.0))
    inputs = make_inputs(log.interval, log.volts, log.force)
    shape, start = Shape(OTHER, 22.0), np.array([[*log.theta[0], 0.0, 0.0]])
    angles = predict(shape, shape.coordinates(OTHER, PERFECT.delay), inputs, start, 300)
    assert np.abs(log.theta[:301]).std(axis=0).min() > 0.01
    assert np.abs(angles[0] - log.theta[1:301]).max() < 0.03e-3


# --- what is found ---


@pytest.mark.slow
@pytest.mark.parametrize(
    "clutches",
    [
        "paper",
        pytest.param("two-brakes", marks=pytest.mark.long),
        pytest.param("double-brakes", marks=pytest.mark.long),
        pytest.param("couplings-1-2", marks=pytest.mark.long),
    ],
)
def test_a_log_without_noise_gives_the_machine_back(clutches: str):
    start = BASELINE if clutches == "paper" else find_machine(clutches)
    machine = replace(OTHER, clutches=start.clutches)
    found = identify(record_log(machine, SHORT, PERFECT), start)
    off = errors(found, machine, 0.006)
    kept = {name for name, status in states(found).items() if status == "kept"}
    # without noise, forces taken as linear between rows are 2 µs late
    kept |= {"force_delay"}
    assert kept == {"off_state", "stribeck", "fall_ratio", "offset_a", "offset_b", "force_delay"}
    for name, error in off.items():
        assert abs(error) < (
            0.005 if name in ("breakaway_ratio", "curvature", "delay") else 0.001
        ), name


@pytest.mark.slow
def test_unobservable_clutch_numbers_are_named_and_kept():
    log = record_log(OTHER, replace(SHORT, levels=(4.0, 10.0)), Recorder(delay=0.006))
    # what comes before was recorded without clutches 3 and 4
    first = int(np.flatnonzero(log.volts[:, 2])[0])
    found = identify(rows_of(log, slice(0, first)), BASELINE)
    told = {finding.quantity.name: finding for finding in found.findings}
    for name in ("scale_3", "scale_4", "curvature", "knee"):
        assert told[name].status == "kept"
        assert told[name].reason
        assert told[name].low == told[name].high
    assert told["scale_3"].quantity.value == 1.0
    assert told["knee"].quantity.value == BASELINE.clutch.dynamic.knee
    assert told["inertia_a"].status == told["inertia_b"].status == "identified"


@pytest.mark.slow
def test_a_combination_that_the_log_leaves_open_is_named(monkeypatch: pytest.MonkeyPatch):
    """At one voltage, a clutch's torque and the axis's dry friction are one number."""
    constant = lambda _experiment, times, _clutches: np.tile([5.0, 0, 0, 0], (len(times), 1))  # noqa: E731
    monkeypatch.setattr(Experiment, "voltages", constant)
    machine = replace(BASELINE, arm=replace(OTHER.arm, dry_a=0.3))
    log = record_log(machine, replace(SHORT, levels=(6.0,)), Recorder(delay=0.006))
    found = identify(log, BASELINE)
    told = {finding.quantity.name: finding for finding in found.findings}
    assert found.verdict.grade == EXACT
    assert {told["slope"].status, told["dry_a"].status} == {"kept", "uncertain"}
    assert any(
        "only together with" in each.reason and "dry_a" in each.reason for each in told.values()
    )
    assert "identified" not in {told["slope"].status, told["dry_a"].status}
    assert told["inertia_a"].status == told["dry_b"].status == "identified"


def drawn_machine(rng: np.random.Generator) -> Machine:
    """A machine unlike PTER."""
    inertia_a, inertia_b = np.exp(rng.uniform(np.log(0.25), np.log(1.5), 2)).tolist()
    slope, knee, top = (
        float(rng.uniform(*ends)) for ends in ((0.5, 1.3), (10.0, 19.5), (10.0, 26.0))
    )
    curvature = max(top - 22.0 * slope, 0.1 * top) / (22.0 - knee) ** 2
    dynamic = TorqueCurve(slope=slope, knee=knee, curvature=curvature)
    friction = (
        rng.uniform(-0.5, 1.0, 4).clip(0.0) * [0.6, 0.6, 0.3, 0.3]
    ).tolist()  # a third of them is zero
    scale = rng.uniform(0.85, 1.18, 4)
    return replace(
        BASELINE,
        arm=Arm(
            length_a=float(rng.uniform(0.42, 0.6)),
            length_b=float(rng.uniform(0.38, 0.5)),
            inertia_a=inertia_a,
            inertia_b=inertia_b,
            coupling=float(rng.uniform(-0.4, 0.4) * np.sqrt(inertia_a * inertia_b)),
            **dict(zip(("dry_a", "dry_b", "viscous_a", "viscous_b"), friction, strict=True)),
        ),
        clutch=Clutch(
            dynamic=dynamic,
            breakaway=dynamic.scaled(float(rng.uniform(1.08, 1.4))),
            time_constant=float(np.exp(rng.uniform(np.log(0.03), np.log(0.2)))),
        ),
        clutch_scale=tuple((scale / scale.mean()).tolist()),
    )


@pytest.mark.long
@pytest.mark.parametrize("number", range(10))
def test_identified_values_are_within_five_percent(number: int):
    """Encoders of 12 or 14 bit, noisy forces, up to 20 ms of delay; two intervals may fail."""
    rng = np.random.default_rng([18, number])
    machine = drawn_machine(rng)
    recorder = Recorder(
        angle_resolution=2.0 * np.pi / float(rng.choice([4096, 16384])),
        force_noise=float(rng.uniform(0.1, 1.0)),
        delay=float(rng.uniform(0.0, 0.02)),
    )
    lengths = {"length_a": machine.arm.length_a, "length_b": machine.arm.length_b}
    start = replace(BASELINE, arm=replace(BASELINE.arm, **lengths))
    found = identify(record_log(machine, recorder=recorder, seed=number), start)
    off = errors(found, machine, recorder.delay)
    assert found.verdict.grade == EXACT
    assert all(
        abs(off[name]) <= 0.05 for name, status in states(found).items() if status == "identified"
    )
    assert sum(status == "identified" for status in states(found).values()) >= 17
    outside = [
        f
        for f in found.findings
        if abs(off[f.quantity.name]) * f.quantity.scale > f.half_width + 1e-12
    ]
    assert len(outside) <= 2


@pytest.mark.long
def test_a_machine_with_noise_and_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    write_log(record_log(OTHER, recorder=Recorder(delay=0.011)), tmp_path / "log.csv")
    assert main(["identify", "log.csv", "--out", "mine"]) == 0
    machine = find_machine("mine/machine.toml")
    assert machine.arm.inertia_a == pytest.approx(OTHER.arm.inertia_a, rel=0.02)
    assert machine.clutch_scale == pytest.approx(OTHER.clutch_scale, rel=0.02)
    assert Path("mine/identified.png").read_bytes().startswith(b"\x89PNG")
    assert main(["watch", "impedance", "--machine", "mine/machine.toml", "--csv", "own.csv"]) == 0
    assert main(["identify", "log.csv", "--machine", "mine/machine.toml", "--out", "again"]) == 0


# --- the machine's file ---


@pytest.mark.slow
def test_the_file_is_the_machine_and_says_where_it_comes_from(tmp_path: Path):
    small = identify(
        record_log(OTHER, replace(SHORT, levels=(10.0,), on=0.6, free=2.0), PERFECT), BASELINE
    )
    text = format_machine(small.machine, ASSUMED, small.origins, "title")
    (tmp_path / "machine.toml").write_text(text, "utf-8")
    assert find_machine(str(tmp_path / "machine.toml")) == small.machine
    for line in (
        r"length_a = .*  # m; chosen: stated to pter identify, or that of its start",
        r"inertia_a = .*  # kg·m²; identified: from simulated, ",
        r"knee = .*  # V; chosen: from simulated, not determined by it and kept: ",
        r"clutch_scale = .*  # 1; identified: from simulated, ",
    ):
        assert re.search(rf"(?m)^{line}", text)
