"""One clutch on a bench: its numbers, what its log does not tell, and its file."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pter_gym._commands.main import main
from pter_gym.params import BASELINE, Clutch, find_machine
from pter_gym.tools.identification.bench import Bench, BenchResult, identify_clutch, read_bench

TRUE = {
    "slope": 0.8,
    "off_state": 0.3,
    "breakaway_ratio": 1.25,
    "stribeck": 0.4,
    "viscous": 0.05,
    "time_constant": 0.08,
    "fall_ratio": 2.0,
}


def bench_rows(seed: int = 0, noise: float = 0.05, swing: float = 1.95) -> np.ndarray:
    """Rows (t, V, ω, T) of 40 s: steps of voltage while the speed sweeps up and down."""
    rng, h = np.random.default_rng(seed), 2e-3
    times = h * np.arange(20000)
    volts = np.where(times % 2.0 < 1.2, 2.0 + 2.0 * (times // 2.0 % 8), 0.0)
    omega = 2.0 + swing * np.sin(1.3 * times)
    held, value = np.empty_like(volts), volts[0]
    for k, target in enumerate(volts):
        held[k] = value
        rate = TRUE["time_constant"] * (1.0 if target > value else TRUE["fall_ratio"])
        value = target + (value - target) * np.exp(-h / rate)
    sliding = TRUE["stribeck"] ** 2 / (TRUE["stribeck"] ** 2 + omega**2)
    torque = (TRUE["slope"] * held + TRUE["off_state"]) * (
        1.0 + (TRUE["breakaway_ratio"] - 1.0) * sliding
    ) + TRUE["viscous"] * omega
    return np.column_stack([times, volts, omega, torque + noise * rng.standard_normal(len(times))])


def identified(rows: np.ndarray, start: Clutch = BASELINE.clutch) -> BenchResult:
    return identify_clutch(Bench(*rows.T), start)


def test_the_numbers_of_a_clutch_are_inside_their_intervals():
    inside = []
    for seed in range(5):
        found = identified(bench_rows(seed))
        told = {f.quantity.name: f for f in found.findings}
        inside += [told[name].low <= true <= told[name].high for name, true in TRUE.items()]
        assert found.findings[0].status == "identified"
        for name, true in TRUE.items():
            assert told[name].quantity.value == pytest.approx(true, rel=0.05)
    assert np.mean(inside) >= 0.85


@pytest.mark.parametrize("late", [-1, 0, 1, 3])
def test_a_dead_time_is_found_and_not_taken_for_lag(late: int):
    """Rows by which the torque is recorded later than the voltage."""
    rows = bench_rows()
    rows[:, 3] = np.roll(rows[:, 3], late)
    told = {f.quantity.name: f for f in identified(rows[10:-10]).findings}
    for name, true in (("dead_time", 2e-3 * late), ("time_constant", TRUE["time_constant"])):
        assert told[name].low <= true <= told[name].high
        assert told[name].status == "identified"


def without_stribeck(rows: np.ndarray) -> np.ndarray:
    sliding = TRUE["stribeck"] ** 2 / (TRUE["stribeck"] ** 2 + rows[:, 2] ** 2)
    drag = TRUE["viscous"] * rows[:, 2]
    rows[:, 3] = (rows[:, 3] - drag) / (1.0 + (TRUE["breakaway_ratio"] - 1.0) * sliding) + drag
    return rows


def at_one_voltage(rows: np.ndarray) -> np.ndarray:
    """Off-state torque and slope are one number."""
    return rows[(rows[:, 1] == 8.0) & (rows[:, 0] % 2.0 > 0.8)]


def at_one_speed(_: np.ndarray) -> np.ndarray:
    """Viscous and off-state torque are one number, as are slope and Stribeck effect."""
    return bench_rows(swing=0.0)


@pytest.mark.parametrize(
    ("log", "untold"),
    [
        (without_stribeck, {"stribeck", "breakaway_ratio"}),
        (at_one_voltage, {"off_state", "time_constant", "fall_ratio", "dead_time"}),
        (at_one_speed, {"stribeck"}),
    ],
)
def test_what_the_log_does_not_tell_is_kept_and_named(log: Callable, untold: set[str]):
    start = BASELINE.clutch
    findings = identified(log(bench_rows())).findings
    kept = {f.quantity.name: f for f in findings if f.reason}
    assert untold <= kept.keys()
    if log is at_one_speed:  # one of the two, which are told equally badly
        assert kept.keys() & {"viscous", "off_state"}
    tied = " ".join(f.reason.partition("only together with")[2] for f in kept.values())
    assert not [f for f in findings if f.status == "identified" and f.quantity.name in tied]
    for name in kept.keys() & {"stribeck", "viscous", "time_constant", "fall_ratio"}:
        f = kept[name]
        assert f.status == "kept"
        assert f.low == f.high == f.quantity.value == getattr(start, name)


def test_a_bench_log_becomes_a_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    rows = bench_rows() * [1e3, 1e3, 30.0 / np.pi, 1.0]
    head = "time\tV [mV]\tspeed [rpm]\ttorque (Nm)"
    np.savetxt("bench.csv", rows, "%.9g", "\t", header=head, comments="")
    arguments = ["--clutch", "--columns", "t_s=time", "omega=speed [rpm]", "--out", "mine"]
    assert main(["identify", "bench.csv", *arguments]) == 0
    assert "next: pter device mine/clutch.toml" in capsys.readouterr().out
    machine = find_machine("mine/clutch.toml")
    assert machine.clutch.time_constant == pytest.approx(0.08, rel=0.02)
    assert machine.clutch.stribeck == pytest.approx(0.4, rel=0.1)
    assert machine.clutch.voltage_max == 16.0
    assert "identified: from bench.csv, 95 % interval" in Path("mine/clutch.toml").read_text(
        "utf-8"
    )


def test_rows_without_numbers_are_left_out(tmp_path: Path):
    np.savetxt(
        tmp_path / "b.csv", bench_rows(), "%.9g", ",", header="t_s,V,omega,torque", comments=""
    )
    lines = (tmp_path / "b.csv").read_text().splitlines()
    lines[100] = lines[100].rsplit(",", 1)[0] + ",-nan(ind)"
    (tmp_path / "b.csv").write_text("\n".join(lines))
    assert len(read_bench(tmp_path / "b.csv", {}).times) == 19999
