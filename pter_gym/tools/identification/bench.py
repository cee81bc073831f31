# pyright: standard
"""One clutch or brake on a bench, from a log of its voltage, speed and torque."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from pter_gym._internal.files import FilePath, expand_path
from pter_gym._internal.tables import read_table
from pter_gym.errors import ParameterError
from pter_gym.params import Clutch, TorqueCurve
from pter_gym.tools.identification.fit import BLOCK, TIED, correlations, jackknife, scaled
from pter_gym.tools.identification.identifying import Finding
from pter_gym.tools.identification.log import MAX_FILE, in_seconds, unwrapped
from pter_gym.tools.identification.parameters import Quantity
from pter_gym.tools.identification.verdict import MAX_REL_HALF_WIDTH

Array = NDArray[np.float64]

COLUMNS = {"t_s": "s", "V": "V", "omega": "rad/s", "torque": "N·m"}
"""Columns of such a log and their units."""

BLOCKS = 40
"""Stretches of the log, each of which is one error in the jackknife."""

MIN_ROWS, SLOW = 500, 0.02
"""Fewest rows; speed up to which a clutch may be stuck [rad/s]: such rows are left out."""

LAGS, DELAYS = (0.005, 0.015, 0.05, 0.15, 0.4), (0.0, 0.01, 0.03, 0.1)
"""Time constants and dead times with which the search may begin [s]."""

UNSEEN = 1.0
"""Half of the 95 % interval over the scale from which the log does not tell a number."""


class Search(NamedTuple):
    """Unit, bounds and fields in a machine file of a number."""

    unit: str
    low: float
    high: float
    places: tuple[str, ...] = ()


def _both(name: str) -> tuple[str, ...]:
    return f"clutch.dynamic.{name}", f"clutch.breakaway.{name}"


SEARCHES = {
    "slope": Search("N·m/V", 1e-6, 1e3, ("clutch.dynamic.slope",)),
    "off_state": Search("N·m", 0.0, 1e3, _both("off_state")),
    "breakaway_ratio": Search("1", 1.0, 5.0, ("clutch.breakaway.slope",)),
    "stribeck": Search("rad/s", 1e-3, 50.0, ("clutch.stribeck",)),
    "viscous": Search("N·m·s", 0.0, 1e2, ("clutch.viscous",)),
    "time_constant": Search("s", 1e-3, 5.0, ("clutch.time_constant",)),
    "fall_ratio": Search("1", 0.05, 20.0, ("clutch.fall_ratio",)),
    "dead_time": Search("s", -0.1, 0.5),
}
"""What is identified, by name."""


@dataclass(frozen=True)
class Bench:
    """Rows of a log: time [s], voltage [V], speed [rad/s] and torque [N·m], shape (rows,).

    A voltage acts from its row on.
    """

    times: Array
    volts: Array
    omega: Array
    torque: Array


@dataclass(frozen=True)
class BenchResult:
    """The numbers of a clutch, the share of torque that they leave, and the clutch."""

    findings: list[Finding]
    left: float
    clutch: Clutch

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
    columns, _ = read_table(file, names, unit=units, blanks=True, max_size=MAX_FILE)
    table = np.stack([columns[name] for name in names])
    stamps, volts, omega, torque = table[:, np.isfinite(table).all(axis=0)]
    if len(stamps) < MIN_ROWS or (np.diff(times := in_seconds(unwrapped(stamps))[0]) <= 0.0).any():
        raise ParameterError(f"{file} must have at least {MIN_ROWS} rows, and t_s must rise")
    return Bench(times, np.maximum(volts, 0.0).round(2), omega, np.abs(torque))


def identify_clutch(bench: Bench, start: Clutch) -> BenchResult:
    """Identify the torque of a clutch, its rise and fall, and the dead time before them.

    What the log does not tell keeps the value of ``start``; a dead time, 0.

    Raises
    ------
    ParameterError
        If the clutch hardly slips.
    """
    speed = np.abs(bench.omega)
    turning = speed > SLOW
    if turning.sum() < MIN_ROWS or not bench.volts.any():
        raise ParameterError("log: the clutch must slip, and V must not be 0 throughout")
    size, top = float(np.sqrt(np.mean(bench.torque[turning] ** 2))), float(bench.volts.max())
    values = _first_values(bench, speed, turning)
    own = {
        **dict.fromkeys(SEARCHES, 0.0),
        "slope": start.dynamic.slope,
        "off_state": start.dynamic.off_state,
        "breakaway_ratio": start.breakaway.slope / start.dynamic.slope,
        **{n: getattr(start, n) for n in ("stribeck", "viscous", "time_constant", "fall_ratio")},
    }
    natural = {"off_state": 0.1 * size, "viscous": 0.1 * size / float(np.median(speed[turning]))}
    natural |= {"stribeck": 0.1, "dead_time": values["time_constant"]}
    kept, unsure = dict[str, str](), set[str]()
    while True:
        free = [name for name in SEARCHES if name not in kept]

        def residual(p: Array, values: dict[str, float] = values, free: list[str] = free) -> Array:
            found = values | dict(zip(free, p, strict=True))
            return (_torque(bench, speed, found) - bench.torque)[turning] / size

        low, high = (np.array([getattr(SEARCHES[n], end) for n in free]) for end in ("low", "high"))
        first = np.array([values[name] for name in free]).clip(low, high)
        steps = np.maximum(first, 0.01)
        solution = optimize.least_squares(
            residual, first, bounds=(low, high), x_scale=steps, loss="soft_l1"
        )
        values |= dict(zip(free, solution.x.tolist(), strict=True))
        left = residual(solution.x)
        errors, tied = _errors(left, solution.jac, free)
        scales = {name: max(abs(values[name]), natural.get(name, 0.0)) for name in free}
        excess = {name: errors[name] / (UNSEEN * scales[name]) for name in free}
        if "stribeck" in free and values["breakaway_ratio"] - 1.0 <= errors["breakaway_ratio"]:
            excess["stribeck"] = np.inf  # of an effect that the log does not show
        worst = max(excess, key=lambda name: excess[name])
        if excess[worst] <= 1.0 or len(free) == 1:
            break
        together = f"; only together with {', '.join(tied[worst])}" if tied[worst] else ""
        kept[worst] = f"the log does not tell it{together}"
        unsure |= set(tied[worst])
        values[worst] = own[worst]
    findings: list[Finding] = []
    for name, each in SEARCHES.items():
        value, error = values[name], errors.get(name, 0.0)
        q = Quantity(name, each.unit, value, scales.get(name, abs(value)), each.places)
        sure = name not in unsure and error <= MAX_REL_HALF_WIDTH * q.scale
        status = "kept" if name in kept else "identified" if sure else "uncertain"
        ends = {"low": value - error, "high": value + error, "before": own[name]}
        findings.append(Finding(quantity=q, status=status, reason=kept.get(name, ""), **ends))
    curve = TorqueCurve(
        slope=values["slope"], knee=top, curvature=0.0, off_state=values["off_state"]
    )
    clutch = replace(
        start,
        dynamic=curve,
        breakaway=curve.scaled(values["breakaway_ratio"]),
        voltage_max=top,
        **{n: values[n] for n in ("stribeck", "viscous", "time_constant", "fall_ratio")},
    )
    return BenchResult(findings, float(np.sqrt(np.mean(left**2))), clutch)


def _first_values(bench: Bench, speed: Array, turning: NDArray[np.bool_]) -> dict[str, float]:
    """Return numbers from which the search begins: the best of a grid, of which others follow."""
    found, best = dict.fromkeys(SEARCHES, 1.0), np.inf
    for lag, delay in product(LAGS, DELAYS):
        lagged = _lagged(bench, lag, lag, delay)
        columns = np.column_stack([lagged, np.ones_like(speed), speed])[turning]
        solution, left = optimize.nnls(columns, bench.torque[turning])
        if left < best:
            best = left
            found |= dict(zip(("slope", "off_state", "viscous"), solution.tolist(), strict=True))
            found |= {"time_constant": lag, "dead_time": delay}
    return found | {"breakaway_ratio": 1.1, "stribeck": 0.1}


def _errors(
    left: Array, jacobian: Array, free: list[str]
) -> tuple[dict[str, float], dict[str, list[str]]]:
    """Return halves of 95 % intervals, and the numbers with which each is only seen together."""
    whole = len(left) - len(left) % (BLOCK * BLOCKS)
    parts = left[:whole].reshape(BLOCK * BLOCKS, -1)
    changes, information = jackknife(parts, jacobian[:whole].reshape(*parts.shape, -1))
    normal, size = scaled(information)
    naive = np.diag(np.linalg.inv(normal)) / size**2 * max(float(np.mean(left**2)), 1e-12)
    quantile = float(stats.t.ppf(0.975, BLOCKS - len(free)))
    halves = quantile * np.sqrt(np.maximum(np.sum(changes**2, axis=0), naive))
    tied = {
        name: [
            other for other, each in zip(free, row, strict=True) if each > TIED and other != name
        ]
        for name, row in zip(free, correlations(information), strict=True)
    }
    return dict(zip(free, halves.tolist(), strict=True)), tied


def _torque(bench: Bench, speed: Array, values: Mapping[str, float]) -> Array:
    """Return the torque of a slipping clutch [N·m]."""
    rise, stribeck = values["time_constant"], values["stribeck"]
    lagged = _lagged(bench, rise, rise * values["fall_ratio"], values["dead_time"])
    share = stribeck**2 / (stribeck**2 + np.maximum(speed, SLOW) ** 2)
    sliding = 1.0 + (values["breakaway_ratio"] - 1.0) * share
    return (values["slope"] * lagged + values["off_state"]) * sliding + values["viscous"] * speed


def _lagged(bench: Bench, rise: float, fall: float, delay: float) -> Array:
    """Return voltages [V] behind a dead time and a lag with two time constants [s]."""
    steps = np.flatnonzero(np.diff(bench.volts, prepend=np.nan) != 0.0)
    begin, targets = bench.times[steps], bench.volts[steps]
    before, value = [], float(targets[0])
    for target, passed in zip(targets.tolist(), np.diff(begin, append=np.inf), strict=True):
        before.append(value)
        value = target + (value - target) * np.exp(-passed / (rise if target > value else fall))
    last = (np.searchsorted(begin, bench.times - delay, side="right") - 1).clip(0)
    passed = np.maximum(bench.times - delay - begin[last], 0.0)
    target, ahead = targets[last], np.array(before)[last] - targets[last]
    return target + ahead * np.exp(-passed / np.where(ahead < 0.0, rise, fall))
