"""One clutch on a bench: its numbers, and an entry for the library."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from pter_gym._commands.main import main
from pter_gym.params import BASELINE
from pter_gym.tools.identification.bench import NAMES, Bench, entry_of, identify_clutch, read_bench

TRUE = {
    "slope": 0.8,
    "off_state": 0.3,
    "breakaway_ratio": 1.25,
    "stribeck": 0.4,
    "viscous": 0.05,
    "time_constant": 0.08,
    "fall_ratio": 2.0,
}


def bench_rows(seed: int = 0, noise: float = 0.05) -> np.ndarray:
    """Rows (t, V, ω, T) of 40 s: steps of voltage while the speed sweeps up and down."""
    rng, h = np.random.default_rng(seed), 2e-3
    times = h * np.arange(20000)
    volts = np.where(times % 2.0 < 1.2, 2.0 + 2.0 * (times // 2.0 % 8), 0.0)
    omega = 2.0 + 1.95 * np.sin(1.3 * times)
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


def test_the_numbers_of_a_clutch_are_inside_their_intervals():
    inside = []
    for seed in range(5):
        _, volts, omega, torque = bench_rows(seed).T
        found = identify_clutch(Bench(2e-3, volts, omega, torque), BASELINE.clutch)
        inside += [f.low <= TRUE[f.quantity.name] <= f.high for f in found.findings]
        assert found.findings[0].status == "identified"
        for f in found.findings:
            assert f.quantity.value == pytest.approx(TRUE[f.quantity.name], rel=0.05)
    assert np.mean(inside) >= 0.85


def test_a_bench_log_becomes_an_entry_of_the_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    rows = bench_rows() * [1e3, 1e3, 1.0, 1.0]
    head = "time\tV [mV]\tspeed\ttorque (Nm)"
    np.savetxt("bench.csv", rows, "%.9g", "\t", header=head, comments="")
    arguments = ["--clutch", "--columns", "t_s=time", "omega=speed"]
    assert main(["identify", "bench.csv", *arguments]) == 0
    assert "slope" in capsys.readouterr().out
    bench = read_bench("bench.csv", {"t_s": "time", "omega": "speed"})
    entry = tomllib.loads(entry_of(identify_clutch(bench, BASELINE.clutch), "mine"))["mine"]
    assert {name for name, _ in NAMES} < entry.keys()
    assert entry["time_constant"] == pytest.approx(0.08, rel=0.02)
    assert entry["voltage_max"] == 16.0
