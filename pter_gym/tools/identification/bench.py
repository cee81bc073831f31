# pyright: standard
"""One clutch or brake on a bench, from a log of its voltage, speed and torque."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from pter_gym._internal.files import FilePath
from pter_gym._physics.clutch import sought
from pter_gym.errors import ParameterError
from pter_gym.params import Clutch, Machine, TorqueCurve
from pter_gym.tools.identification.columns import Recording, read_columns
from pter_gym.tools.identification.findings import Finding, derived_finding, make_finding
from pter_gym.tools.identification.fit import BLOCK, TIED, correlations, jackknife, scaled
from pter_gym.tools.identification.parameters import Quantity

Array = NDArray[np.float64]

BENCH_COLUMNS = {"t_s": "s", "V": "V", "omega": "rad/s", "torque": "N·m"}
"""Columns of such a log, and the unit of each where its name says none."""

BLOCKS = 40
"""Stretches of the log, each of which is one error in the jackknife."""

MIN_ROWS, SLOW = 500, 0.02
"""Fewest rows; speed up to which a clutch may be stuck [rad/s]: such rows are left out."""

LATE = 1.5
"""Time between speeds over the usual one from which torques in between are left out."""

RIPPLE = 2400.0
"""Voltages are rounded to the largest over this, 10 mV of 24 V."""

ASTRAY = 0.2
"""Largest share of torque that may drive the motion."""

LAGS, DELAYS, KNEES = (0.005, 0.015, 0.05, 0.15, 0.4), (0.0, 0.01, 0.03, 0.1), (0.0, 0.3, 0.6)
LOOPS = (0.01, 0.05, 0.15)
"""Time constants and dead times [s] with which the search may begin, and knees and hysteresis over
the largest voltage."""

UNSEEN = 1.0
"""Half of the 95 % interval over the scale from which the log does not determine a number."""

STRAIGHT = "torque is straight where the clutch slipped"

BRANCH = 50
"""Fewest rows of a branch of a loop."""

LONE = ("the log has rising levels alone", "the log has falling levels alone")
"""Why the log does not tell hysteresis, if it lacks a branch."""

SETTLED = 0.02
"""What may be left of a change of torque that has settled, over the torque."""


class Search(NamedTuple):
    """Bounds of a coordinate of the search, and its field in a clutch."""

    low: float
    high: float


SEARCHES = {
    "slope": Search(1e-6, 1e6),
    "bend": Search(-0.98, 20.0),
    "knee": Search(0.0, 0.9),
    "off_state": Search(0.0, 1e3),
    "breakaway_ratio": Search(1.0, 5.0),
    "stribeck": Search(1e-3, 50.0),
    "viscous": Search(0.0, 1e2),
    "time_constant": Search(1e-3, 5.0),
    "fall_ratio": Search(0.05, 20.0),
    "dead_time": Search(-0.1, 0.5),
    "fall_dead_time": Search(-0.1, 0.5),
    "hysteresis": Search(0.0, 0.45),
}
"""What is searched, in the units of ``_reported``; but the change of the slope from the knee to the
largest voltage is over the slope, and knee and hysteresis are over that voltage."""

DERIVED = {
    "breakaway_slope": ("slope", "breakaway_ratio"),
    "breakaway_off_state": ("off_state", "breakaway_ratio"),
    "breakaway_curvature": ("curvature", "breakaway_ratio"),
}
"""Numbers of the file that are products of reported ones."""


@dataclass(frozen=True)
class Bench:
    """Rows of a log: time [s], voltage [V], speed [rad/s] and torque against the motion [N·m].

    Shape (rows,). A voltage acts from its row on. ``drive`` is "A" if it is a current [A].
    """

    times: Array
    volts: Array
    omega: Array
    torque: Array
    drive: str = "V"
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class BenchResult:
    """What a log tells of a clutch.

    ``findings`` are its numbers, ``derived`` those of the file that follow from them; ``left`` is
    the share of the torque that they leave, ``clutch`` the clutch, and ``delay`` the dead time
    before its torque changes [s]. ``settled`` are rows of the log where the torque had settled,
    (voltage [V], torque [N·m] without what speed adds, whether the voltage had fallen).
    """

    findings: list[Finding]
    derived: list[Finding]
    left: float
    clutch: Clutch
    delay: float
    settled: tuple[Array, Array, NDArray[np.bool_]]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The result in words."""
        lone = self._found("hysteresis").reason
        unknown = (f"Hysteresis is unknown: {lone}.",) if lone in LONE else ()
        return *self._torque_told, *unknown

    @property
    def _torque_told(self) -> tuple[str, ...]:
        """What is left of the torque, and how its rise and fall differ."""
        left = f"The model leaves {100 * self.left:.2g} % of the clutch's torque unexplained."
        rise, fall = (self._found(name) for name in ("dead_time", "fall_dead_time"))
        apart = fall.quantity.value - rise.quantity.value
        if abs(apart) <= np.hypot(rise.half_width, fall.half_width):
            return (left,)
        return left, (
            f"Torque falls {1e3 * abs(apart):.2g} ms {'later' if apart > 0 else 'earlier'} than it "
            f"rises: a machine has one delay, and gets the longer, {1e3 * self.delay:.3g} ms."
        )

    def _found(self, name: str) -> Finding:
        return next(each for each in self.findings if each.quantity.name == name)

    def machine(self, start: Machine) -> Machine:
        """Return a machine with such clutches."""
        return replace(start, clutch=self.clutch, delay=self.delay)


def read_bench(
    path: FilePath, renamed: Mapping[str, str] | None = None, *, degrees: bool = False
) -> Bench:
    """Read a log of one clutch, with the columns ``BENCH_COLUMNS`` or those of ``renamed``.

    Raises
    ------
    ParameterError
        As ``read_log``, or if there are too few rows, or torque does not oppose the motion.
    """
    recording = read_columns(path, BENCH_COLUMNS, renamed=renamed, degrees=degrees)
    for name in ("V", "omega", "torque"):
        if not recording.known(name).any():
            raise ParameterError(f"{recording.file} must have numbers in the column {name}")
    times, clock = recording.clock("torque"), recording.clock("omega")
    nearest = np.abs(clock[_nearest(clock, times)] - times)
    seen = nearest <= LATE * float(np.median(np.diff(clock, append=np.inf)[:-1]))
    if seen.sum() < MIN_ROWS:
        raise ParameterError(f"{recording.file} must have at least {MIN_ROWS} rows of numbers")
    times = times[seen]
    omega = np.interp(times, clock, recording.values("omega"))
    commanded = recording.times[recording.known("V")]
    last = (np.searchsorted(commanded, times, side="right") - 1).clip(0)
    torque, remark = _against(recording, recording.values("torque")[seen], omega)
    remarks = tuple(f"{recording.file.name}: {each}" for each in (*recording.remarks, *remark))
    return Bench(times, recording.values("V")[last], omega, torque, recording.drive, remarks)


def _nearest(clock: Array, times: Array) -> NDArray[np.int64]:
    """Return which of the rising clock's times is the nearest to each."""
    middles = 0.5 * (clock[1:] + clock[:-1])
    return np.searchsorted(middles, times)


def _against(recording: Recording, torque: Array, omega: Array) -> tuple[Array, list[str]]:
    """Return the torque against the motion, whose noise about zero has both signs, and remarks."""
    against, size = torque * np.sign(omega), float(np.abs(torque).max())
    both_ways = (omega > SLOW).any() and (omega < -SLOW).any()
    if both_ways and torque.min() >= -ASTRAY * ASTRAY * size:
        return torque, ["torque is never below 0: it is taken as that against the motion."]
    if against.sum() < 0.0:
        against = -against
    if -against.clip(max=0.0).sum() > ASTRAY * np.abs(against).sum():
        raise ParameterError(
            f"{recording.file}: torque must oppose omega in both directions: are both signed?"
        )
    return against, []


def identify_clutch(bench: Bench, start: Clutch) -> BenchResult:
    """Identify the torque of a clutch, its rise and fall, and the dead times before them.

    What the log does not determine keeps the value of ``start``, a dead time 0, the torque a line.

    Raises
    ------
    ParameterError
        If the clutch hardly slips.
    """
    if (np.abs(bench.omega) > SLOW).sum() < MIN_ROWS or not bench.volts.any():
        raise ParameterError("log: the clutch must slip, and V must not be 0 throughout")
    fit = _BenchFit(bench, start)
    fit.search()
    while fit.keep_one():
        fit.search()
    findings = fit.findings()
    by_name = {each.quantity.name: each for each in findings}
    derived = [
        derived_finding(q, half, [by_name[name] for name in DERIVED[q.name]])
        for q, half in fit.with_halves()
        if q.name in DERIVED
    ]
    delay = max(fit.values["dead_time"], fit.values["fall_dead_time"], 0.0)
    return BenchResult(findings, derived, fit.size_left, fit.clutch(), delay, fit.settled())


@dataclass
class _BenchFit:
    """The search for the numbers of a clutch, and where it is.

    Of the coordinates ``values``, those not in ``kept`` are searched; those in ``unsure`` are only
    told together with one that is kept.
    """

    bench: Bench
    start: Clutch
    values: dict[str, float] = field(init=False)
    kept: dict[str, str] = field(default_factory=dict[str, str])
    unsure: set[str] = field(default_factory=set[str])
    _left: Array = field(init=False)
    _covariance: Array = field(init=False)
    _tied: dict[str, list[str]] = field(init=False)

    def __post_init__(self) -> None:
        """Begin with the best of a grid, of which the other numbers follow."""
        self.speed = np.abs(self.bench.omega)
        self.turning = self.speed > SLOW
        self.top = float(self.bench.volts.max())
        self.size = float(np.sqrt(np.mean(self.bench.torque[self.turning] ** 2)))
        step = self.top / RIPPLE
        volts = step * np.round(self.bench.volts / step)
        rows = np.flatnonzero(np.diff(volts, prepend=np.nan) != 0.0)
        self._steps = self.bench.times[rows], volts[rows]
        self._falls = np.repeat(_falling(volts[rows]), np.diff(rows, append=len(volts)))
        branches = self._falls, ~self._falls & (volts > 0.0)
        for lone, branch in zip(LONE, branches, strict=True):
            if np.count_nonzero(self.turning & branch) < BRANCH:
                self.kept["hysteresis"] = lone
                self.unsure.add("off_state")
        self.values = self._first_values()

    @property
    def free(self) -> list[str]:
        """The coordinates that are searched."""
        return [name for name in SEARCHES if name not in self.kept]

    @property
    def size_left(self) -> float:
        """Share of the torque that the numbers leave."""
        return float(np.sqrt(np.mean(self._left**2)))

    @property
    def own(self) -> dict[str, float]:
        """What a coordinate is where the log does not determine it."""
        same = ("stribeck", "viscous", "time_constant", "fall_ratio")
        return {name: getattr(self.start, name) for name in same} | {
            "slope": self.start.dynamic.slope,
            "bend": 0.0,
            "knee": self.values["knee"],
            "off_state": self.start.dynamic.off_state,
            "breakaway_ratio": self.start.breakaway.slope / self.start.dynamic.slope,
            "dead_time": 0.0,
            "fall_dead_time": 0.0 if "dead_time" in self.kept else self.values["dead_time"],
            "hysteresis": self.start.hysteresis / self.start.voltage_max,
        }

    @property
    def scales(self) -> dict[str, float]:
        """By what errors of coordinates are judged: their values, or something of their unit."""
        natural = {
            "bend": 1.0,
            "knee": 1.0,
            "off_state": 0.1 * self.size,
            "viscous": 0.1 * self.size / float(np.median(self.speed[self.turning])),
            "stribeck": 0.1,
            "dead_time": self.values["time_constant"],
            "fall_dead_time": self.values["time_constant"],
            "hysteresis": 0.1,
        }
        return {
            name: max(abs(value), natural.get(name, 0.0)) for name, value in self.values.items()
        }

    def search(self) -> None:
        """Search from where it is, and find the covariance of the free coordinates."""
        free, before = self.free, dict(self.values)

        def residual(p: Array) -> Array:
            found = before | dict(zip(free, p.tolist(), strict=True))
            return (self._torque(found) - self.bench.torque)[self.turning] / self.size

        low, high = np.array([SEARCHES[name] for name in free]).T
        first = np.array([before[name] for name in free]).clip(low, high)
        solution = optimize.least_squares(
            residual, first, bounds=(low, high), x_scale=np.maximum(first, 0.01), loss="soft_l1"
        )
        self.values |= dict(zip(free, solution.x.tolist(), strict=True))
        self._left = residual(solution.x)
        self._covariance, self._tied = _covariance(self._left, solution.jac, free)

    def keep_one(self) -> bool:
        """Keep the coordinate that the log tells worst, and return whether there is one."""
        free, values, scales = self.free, self.values, self.scales
        halves = dict(zip(free, self._halves(np.eye(len(free))), strict=True))
        excess = {name: halves[name] / (UNSEEN * scales[name]) for name in free}
        if "stribeck" in free and values["breakaway_ratio"] - 1.0 <= halves["breakaway_ratio"]:
            excess["stribeck"] = np.inf  # of an effect that the log does not show
        if "bend" in free and abs(values["bend"]) <= halves["bend"]:
            excess["knee" if "knee" in free else "bend"] = np.inf
        worst = max(excess, key=lambda name: excess[name])
        if excess[worst] <= 1.0 or len(free) == 1:
            return False
        tied = self._tied[worst]
        together = f"; only together with {', '.join(tied)}" if tied else ""
        self.kept[worst] = f"the log does not determine it{together}"
        if worst not in ("bend", "knee"):
            self.unsure |= set(tied)
        values[worst] = self.own[worst]
        return True

    def _halves(self, slopes: Array) -> Array:
        """Return halves of 95 % intervals of numbers, by their slopes (numbers, free)."""
        variances = np.einsum("qi,ij,qj->q", slopes, self._covariance, slopes)
        return float(stats.t.ppf(0.975, BLOCKS - len(self.free))) * np.sqrt(variances)

    def curve(self, values: Mapping[str, float]) -> TorqueCurve:
        """Return the dynamic torque by coordinates: a line ends with the largest voltage."""
        slope, knee = values["slope"], values["knee"] * self.top
        if values["bend"] == 0.0:
            knee = self.top
        curvature = 0.5 * slope * values["bend"] / ((1.0 - values["knee"]) * self.top)
        return TorqueCurve(
            slope=slope, knee=knee, curvature=curvature, off_state=values["off_state"]
        )

    def clutch(self) -> Clutch:
        """Return the clutch."""
        curve, same = self.curve(self.values), ("stribeck", "viscous", "time_constant")
        return replace(
            self.start,
            dynamic=curve,
            breakaway=curve.scaled(self.values["breakaway_ratio"]),
            voltage_max=self.top,
            fall_ratio=self.values["fall_ratio"],
            hysteresis=self.values["hysteresis"] * self.top,
            **{name: self.values[name] for name in same},
        )

    def _reported(self, values: Mapping[str, float]) -> list[Quantity]:
        """Return the numbers at coordinates, with their fields in a machine file."""
        curve, ratio, drive = self.curve(values), values["breakaway_ratio"], self.bench.drive
        scales, late = self.scales, values["fall_dead_time"] > values["dead_time"]
        bent = abs(curve.curvature) or curve.slope / self.top
        places = "clutch.dynamic", "clutch.breakaway"
        per = f"N·m/{drive}"
        return [
            Quantity("slope", per, curve.slope, curve.slope, (f"{places[0]}.slope",)),
            Quantity("knee", drive, curve.knee, self.top, tuple(f"{p}.knee" for p in places)),
            Quantity("curvature", f"{per}²", curve.curvature, bent, (f"{places[0]}.curvature",)),
            Quantity(
                *("off_state", "N·m", curve.off_state, scales["off_state"]),
                (f"{places[0]}.off_state",),
            ),
            Quantity("breakaway_ratio", "1", ratio, ratio),
            *(
                Quantity(name, unit, values[name], scales[name], (f"clutch.{name}",))
                for name, unit in (
                    *(("stribeck", "rad/s"), ("viscous", "N·m·s")),
                    *(("time_constant", "s"), ("fall_ratio", "1")),
                )
            ),
            *(
                Quantity(name, "s", values[name], scales[name], ("delay",) * is_longer)
                for name, is_longer in (("dead_time", not late), ("fall_dead_time", late))
            ),
            Quantity(
                *("hysteresis", drive, values["hysteresis"] * self.top),
                *(scales["hysteresis"] * self.top, ("clutch.hysteresis",)),
            ),
            *(
                Quantity(f"breakaway_{name}", unit, value * ratio, size, (f"{places[1]}.{name}",))
                for name, unit, value, size in (
                    ("slope", per, curve.slope, curve.slope * ratio),
                    ("off_state", "N·m", curve.off_state, scales["off_state"] * ratio),
                    ("curvature", f"{per}²", curve.curvature, bent * ratio),
                )
            ),
        ]

    def with_halves(self) -> list[tuple[Quantity, float]]:
        """Return the reported numbers with half of their 95 % intervals, by their derivatives."""
        here, free = self._reported(self.values), self.free
        slopes = np.zeros((len(here), len(free)))
        for column, name in zip(slopes.T, free, strict=True):
            change = 1e-6 * self.scales[name] * np.array([1.0, -1.0])
            ends = (self.values[name] + change).clip(*SEARCHES[name]).tolist()
            high, low = (self._reported(self.values | {name: end}) for end in ends)
            rises = [a.value - b.value for a, b in zip(high, low, strict=True)]
            column[:] = np.array(rises) / (ends[0] - ends[1])
        return list(zip(here, self._halves(slopes).tolist(), strict=True))

    def findings(self) -> list[Finding]:
        """Return the numbers that are reported, in the order of ``_reported``."""
        own, kept, unsure = self.own, dict(self.kept), set(self.unsure)
        before = {q.name: q.value for q in self._reported(own)}
        if "bend" in kept:
            kept |= dict.fromkeys(("curvature", "knee"), STRAIGHT)
        if "bend" in unsure or "knee" in kept:
            unsure.add("curvature")
        return [
            make_finding(
                q, half, before[q.name], reason=kept.get(q.name, ""), sure=q.name not in unsure
            )
            for q, half in self.with_halves()
            if q.name not in DERIVED
        ]

    def _first_values(self) -> dict[str, float]:
        """Return coordinates from which the search begins."""
        found, best = dict.fromkeys(SEARCHES, 0.0), np.inf
        found |= {"fall_ratio": 1.0, "breakaway_ratio": 1.1, "stribeck": 0.1, "knee": 0.3}
        torque, speed = self.bench.torque[self.turning], self.speed[self.turning]
        for lag, delay in product(LAGS, DELAYS):
            lagged = self._lagged(self._steps[1], (lag, lag), (delay, delay))[self.turning]
            columns = np.column_stack([lagged, np.ones_like(speed), speed, torque])
            triangle: Array = np.linalg.qr(columns)[1]  # far shorter than the columns
            solution, left = optimize.nnls(triangle[:, :-1], triangle[:, -1])
            if left < best:
                best = left
                found |= dict(
                    zip(("slope", "off_state", "viscous"), solution.tolist(), strict=True)
                )
                found |= {"time_constant": lag, "dead_time": delay, "fall_dead_time": delay}
        lag, delay = found["time_constant"], found["dead_time"]
        if "hysteresis" in self.kept:
            found["hysteresis"] = self.start.hysteresis / self.start.voltage_max
        for loop in () if "hysteresis" in self.kept else LOOPS:
            held = held_volts(self._steps[1], loop * self.top)
            lagged = self._lagged(held, (lag, lag), (delay, delay))[self.turning]
            columns = np.column_stack([lagged, np.ones_like(speed), speed])
            solution, left = optimize.nnls(columns, torque)
            if left < best:
                best = left
                found |= {"slope": float(solution[0]), "off_state": float(solution[1])}
                found |= {"viscous": float(solution[2]), "hysteresis": loop}
        for knee in KNEES:
            held = held_volts(self._steps[1], found["hysteresis"] * self.top)
            beyond = np.maximum(held - knee * self.top, 0.0) ** 2
            linear, bent = (
                self._lagged(each, (lag, lag), (delay, delay))[self.turning]
                for each in (held, beyond)
            )
            columns = np.column_stack([linear, np.ones_like(speed), speed, bent])
            solution, *_ = np.linalg.lstsq(columns, torque)
            left = float(np.linalg.norm(columns @ solution - torque))
            if left < best and solution[0] > 0.0:
                bend = 2.0 * solution[3] * (1.0 - knee) * self.top / solution[0]
                best = left
                found |= {"slope": float(solution[0]), "knee": knee, "bend": float(bend)}
                found |= {"off_state": float(solution[1]), "viscous": float(solution[2])}
        return found

    def _torque(self, values: Mapping[str, float]) -> Array:
        """Return the torque of a slipping clutch [N·m]."""
        curve = self.curve(values)

        def rising(volts: Array) -> Array:
            beyond = np.maximum(volts - curve.knee, 0.0)
            return curve.slope * volts + curve.curvature * beyond * beyond

        lag = values["time_constant"], values["time_constant"] * values["fall_ratio"]
        late, volts = (values["dead_time"], values["fall_dead_time"]), self._steps[1]
        loop = values["hysteresis"] * self.top
        if self.start.lag == "voltage":
            engaged = rising(self._lagged(volts, lag, late, loop))
        else:
            engaged = self._lagged(rising(held_volts(volts, loop)), lag, late)
        return (engaged + curve.off_state) * self._sliding(values) + values["viscous"] * self.speed

    def _sliding(self, values: Mapping[str, float]) -> Array:
        """Return the torque at the rows' speeds over the dynamic torque."""
        square = values["stribeck"] ** 2
        part = square / (square + np.maximum(self.speed, SLOW) ** 2)
        return 1.0 + (values["breakaway_ratio"] - 1.0) * part

    def settled(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return ``settled`` of the result."""
        values, clutch = self.values, self.clutch()
        sliding, viscous = self._sliding(values), values["viscous"] * self.speed
        held = held_volts(self._steps[1], clutch.hysteresis)
        last = np.searchsorted(self._steps[0], self.bench.times, side="right") - 1
        steady = np.array([clutch.dynamic.torque(v) for v in held.tolist()])[last]
        lagged = (self._torque(values) - viscous) / sliding
        rows = self.turning & (np.abs(lagged - steady) < SETTLED * self.size)
        torque = (self.bench.torque - viscous) / sliding
        return self._steps[1][last][rows], torque[rows], self._falls[rows]

    def _lagged(
        self, targets: Array, lag: tuple[float, float], late: tuple[float, float], loop: float = 0.0
    ) -> Array:
        """Return what follows targets, one for each step of the voltage, at the rows' times.

        It does so behind dead times and lags, each of a rise and of a fall [s], and with
        hysteresis, of half a loop's width.
        """
        times = self.bench.times
        rises = np.diff(targets, prepend=targets[0]) >= 0.0
        begin = np.maximum.accumulate(self._steps[0] + np.where(rises, *late))
        before, ends, value = list[float](), list[float](), float(targets[0]) - loop
        for command, passed in zip(targets.tolist(), np.diff(begin, append=np.inf), strict=True):
            before.append(value)
            target = sought(value, command, loop)
            ends.append(target)
            value = target + (value - target) * np.exp(
                -passed / (lag[0] if target > value else lag[1])
            )
        last = (np.searchsorted(begin, times, side="right") - 1).clip(0)
        passed = np.maximum(times - begin[last], 0.0)
        target = np.array(ends)[last]
        ahead = np.array(before)[last] - target
        return target + ahead * np.exp(-passed / np.where(ahead < 0.0, *lag))


def held_volts(volts: Array, loop: float) -> Array:
    """Return voltages behind a hysteresis [V], after each of those that a clutch gets in turn."""
    if loop == 0.0:
        return volts
    held, value = list[float](), 0.0
    for command in volts.tolist():
        value = sought(value, command, loop)
        held.append(value)
    return np.array(held)


def _falling(volts: Array) -> NDArray[np.bool_]:
    """Return whether each of a clutch's voltages in turn is lower than the one before."""
    return np.diff(volts, prepend=0.0) < 0.0


def _covariance(
    left: Array, jacobian: Array, free: list[str]
) -> tuple[Array, dict[str, list[str]]]:
    """Return the covariance of coordinates, and with which each is only seen together."""
    whole = len(left) - len(left) % (BLOCK * BLOCKS)
    parts = left[:whole].reshape(BLOCK * BLOCKS, -1)
    changes, information = jackknife(parts, jacobian[:whole].reshape(*parts.shape, -1))
    normal, size = scaled(information)
    naive = np.diag(np.linalg.inv(normal)) / size**2 * max(float(np.mean(left**2)), 1e-12)
    covariance, diagonal = changes.T @ changes, np.diag_indices(len(free))
    covariance[diagonal] = np.maximum(covariance[diagonal], naive)
    tied = {
        name: [
            other for other, each in zip(free, row, strict=True) if each > TIED and other != name
        ]
        for name, row in zip(free, correlations(information), strict=True)
    }
    return covariance, tied
