# pyright: standard
"""One clutch or brake on a bench, from a log of its voltage, speed and torque."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from pter_gym._internal.files import FilePath, expand_path
from pter_gym._internal.tables import read_table
from pter_gym.errors import ParameterError
from pter_gym.params import Clutch
from pter_gym.tools.identification.fit import BLOCK, jackknife
from pter_gym.tools.identification.identifying import MAX_REL_HALF_WIDTH, Finding
from pter_gym.tools.identification.log import MAX_FILE, in_seconds
from pter_gym.tools.identification.parameters import Quantity

Array = NDArray[np.float64]

_OPTIMIZE: Any = optimize
_STATS: Any = stats

COLUMNS = {"t_s": "s", "V": "V", "omega": "rad/s", "torque": "N·m"}
"""Columns of such a log and their units."""

BLOCKS = 40
"""Stretches of the log, each of which is one error in the jackknife."""

MIN_ROWS, SLOW = 500, 0.02
"""Fewest rows; speed up to which a clutch may be stuck [rad/s]: such rows are left out."""

NAMES = (
    ("slope", "N·m/V"),
    ("off_state", "N·m"),
    ("breakaway_ratio", "1"),
    ("stribeck", "rad/s"),
    ("viscous", "N·m·s"),
    ("time_constant", "s"),
    ("fall_ratio", "1"),
)
LOW = np.array([1e-6, 0.0, 1.0, 1e-3, 0.0, 1e-3, 0.05])
HIGH = np.array([1e3, 1e3, 5.0, 50.0, 1e2, 5.0, 20.0])


@dataclass(frozen=True)
class Bench:
    """Even rows: the interval [s], voltage [V], speed [rad/s] and torque [N·m], shape (rows,)."""

    interval: float
    volts: Array
    omega: Array
    torque: Array


@dataclass(frozen=True)
class BenchResult:
    """The numbers of a clutch, the share of torque that they leave, the highest voltage [V]."""

    findings: list[Finding]
    left: float
    voltage_max: float

    @property
    def sentence(self) -> str:
        """The result in words."""
        return f"The model leaves {100 * self.left:.2g} % of the clutch's torque unexplained."


def read_bench(path: FilePath, renamed: Mapping[str, str]) -> Bench:
    """Read a log of one clutch, with the columns ``COLUMNS`` or those that ``renamed`` names."""
    file = expand_path("log", path)
    if unknown := renamed.keys() - COLUMNS.keys():
        raise ParameterError(f"columns: {', '.join(unknown)} must be of {', '.join(COLUMNS)}")
    names = [renamed.get(name, name) for name in COLUMNS]
    units = dict(zip(names, COLUMNS.values(), strict=True))
    table = read_table(file, names, unit=units, max_size=MAX_FILE)
    stamps, volts, omega, torque = (table.columns[name] for name in names)
    if len(stamps) < MIN_ROWS or (np.diff(stamps) <= 0.0).any():
        raise ParameterError(f"{file} must have at least {MIN_ROWS} rows, and t_s must rise")
    times, _ = in_seconds(stamps)
    interval = float(times[-1]) / (len(times) - 1)
    even = interval * np.arange(len(times), dtype=np.float64)
    held: Array = volts[np.searchsorted(times, even + 1e-9, side="right") - 1]
    return Bench(
        interval=interval,
        volts=np.maximum(held, 0.0).round(2),
        omega=np.interp(even, times, omega),
        torque=np.interp(even, times, np.abs(torque)),
    )


def identify_clutch(bench: Bench, start: Clutch) -> BenchResult:
    """Identify slope, off-state torque, T_s/T_k, Stribeck velocity, viscous torque, rise and fall.

    Raises
    ------
    ParameterError
        If the clutch hardly slips.
    """
    speed = np.abs(bench.omega)
    turning = speed > SLOW
    if turning.sum() < MIN_ROWS or not bench.volts.any():
        raise ParameterError("log: the clutch must slip, and V must not be 0 throughout")
    scale = float(np.sqrt(np.mean(bench.torque[turning] ** 2)))

    def residual(p: Array) -> Array:
        return (_torque(bench, speed, p) - bench.torque)[turning] / scale

    curve = start.dynamic
    first = np.array([curve.slope, 0.01, 1.1, 0.1, 0.001, start.time_constant, 1.0])
    first[0] = max(float(bench.torque.max()) / float(bench.volts.max()), 2.0 * LOW[0])
    solution = _OPTIMIZE.least_squares(
        residual, first, bounds=(LOW, HIGH), x_scale=np.maximum(first, 0.01), loss="soft_l1"
    )
    jacobian, left = solution.jac, residual(solution.x)
    whole = len(left) - len(left) % (BLOCK * BLOCKS)
    parts = left[:whole].reshape(BLOCK * BLOCKS, -1)
    changes, _ = jackknife(parts, jacobian[:whole].reshape(*parts.shape, -1))
    errors = float(_STATS.t.ppf(0.975, BLOCKS - len(LOW))) * np.linalg.norm(changes, axis=0)
    judged = {"off_state": 0.1 * scale, "stribeck": 0.1}
    judged["viscous"] = 0.1 * scale / float(np.median(speed[turning]))
    findings: list[Finding] = []
    rows = zip(NAMES, solution.x.tolist(), errors.tolist(), first.tolist(), strict=True)
    for (name, unit), value, error, before in rows:
        q = Quantity(name, unit, value, max(value, judged.get(name, 0.0)))
        status = "identified" if error <= MAX_REL_HALF_WIDTH * q.scale else "uncertain"
        ends = {"low": value - error, "high": value + error, "before": before}
        findings.append(Finding(quantity=q, status=status, **ends))
    return BenchResult(findings, float(np.sqrt(np.mean(left**2))), float(bench.volts.max()))


def _torque(bench: Bench, speed: Array, p: Array) -> Array:
    """Return the torque of a slipping clutch with numbers in the order of ``NAMES`` [N·m]."""
    slope, off_state, ratio, stribeck, viscous, rise, fall_ratio = p
    held = _lagged(bench.volts, bench.interval, rise, rise * fall_ratio)
    sliding = 1.0 + (ratio - 1.0) * stribeck**2 / (stribeck**2 + speed**2)
    return (slope * held + off_state) * sliding + viscous * speed


def _lagged(volts: Array, interval: float, rise: float, fall: float) -> Array:
    """Return voltages behind a lag with two time constants [s], run by run of equal voltage."""
    held, value = np.empty_like(volts), float(volts[0])
    starts = np.flatnonzero(np.diff(volts, prepend=np.nan) != 0.0)
    for begin, end in zip(starts, [*starts[1:], len(volts)], strict=True):
        target = float(volts[begin])
        passed = interval * np.arange(end - begin + 1)
        way = target + (value - target) * np.exp(-passed / (rise if target > value else fall))
        held[begin:end], value = way[:-1], float(way[-1])
    return held


def entry_of(result: BenchResult, name: str) -> str:
    """Return an entry for ``presets/actuators.toml``."""
    lines = [f'["{name}"]', 'grade = "measured"', 'source = "your bench"', "unknown = []"]
    said = "; ".join(f"{f.quantity.name} {f.low:.3g} to {f.high:.3g}" for f in result.findings)
    lines.append(f'provenance = "identified: 95 % intervals {said}"')
    lines += [f"{f.quantity.name} = {f.quantity.value:.6g}" for f in result.findings]
    return "\n".join([*lines, f"voltage_max = {result.voltage_max:g}"])
