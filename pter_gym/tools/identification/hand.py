# pyright: standard
"""Mass, damper and spring of the hand that moves a machine, from random clutch pulses.

A hand pushes with f = K·(x₀ − x) + B·(v₀ − v) − M·a + d, of which its intent x₀ and its disturbance
d are unknown. Only the machine chose the pulses, so whatever the hand does by itself is
uncorrelated with how the motion changes by them: the pulses are instruments. What it does by itself
is largely predictable from its past, and only what is new in it disturbs the estimate.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.interpolate import BSpline
from scipy.signal import fftconvolve, lfilter

from pter_gym.errors import ParameterError
from pter_gym.hands import NORMAL, HandSpread, HumanArm
from pter_gym.params import Hand, Machine
from pter_gym.tools.identification.findings import Finding, make_finding
from pter_gym.tools.identification.log import ROUNDING, Log
from pter_gym.tools.identification.parameters import Quantity
from pter_gym.tools.identification.pulses import Switches, predict, tip_positions
from pter_gym.tools.identification.windows import SAME

Array = NDArray[np.float64]

REACTION, WATCHED = 0.2, 0.25
"""Time after a switch in which no person reacts, which the fit uses, and how much longer reactions
are looked for [s]."""

REACTIONS = (0.15, 0.5)
"""Accepted times in which no person reacts [s]: a shorter one leaves too little to see."""

KNOT = 0.02
"""Time between knots of the test function, and between test functions [s]."""

SPAN = 6
"""Knots that the support of a test function spans: quintic, so its second derivative is smooth."""

MEMORY = 50
"""Test functions from which the next one's share of the hand's own push is predicted."""

LATEST, DELAYS = 0.04, (0.0, 0.01, -0.01, 0.02, -0.02, 0.03, -0.03)
"""Forces may be recorded earlier or later than angles by so much [s], and what is tried first."""

COARSE = 2e-3
"""Resolution of angles beyond which numbers may be biased [rad]."""

LAGS = (0.1, 0.15, 0.2)
"""After these times, people react to where a pulse has moved the arm [s]."""

PAST = 0.05
"""Time before a switch from which velocities are taken [s]."""

DRAWS = 8
"""Other torques that could have been drawn, for each switch."""

ITERATIONS = 4
"""Estimates, each with instruments and weights by the one before."""

MIN_SWITCHES = 150
"""Fewest usable switches: some 20 s of pulses."""

FINE, UNSEEN = 0.075, 0.5
"""Half of the 95 % interval over the value up to which a number counts as identified, and from
which the log does not tell it."""

SURE = 1.96
"""Half of a 95 % interval over the standard error."""

RARE, UNLIKELY = 0.005, 0.01
"""Chances of a warning of each kind where there is nothing to warn of, and of a direction."""

TINY = 1e-9
"""In place of a push of 0 [N]."""

PLAIN, EVERY = np.ones(1), slice(None)
"""The test function as it is; all switches."""

DIRECTIONS = ((0, 0), (0, 1), (1, 1))
"""Entries xx, xy, yy of a symmetric matrix."""

LIMITS = ((20.0, 3000.0), (1.0, 200.0), (0.1, 10.0))
"""Stiffness, damping and mass between which instruments are predicted [N/m, N·s/m, kg]."""

NAMES = (("stiffness", "N/m"), ("damping", "N·s/m"), ("mass", "kg"))

PLACES = (
    *(name for name, _ in NAMES),
    *(f"{name}_anisotropy.{k}" for name, _ in NAMES[:2] for k in (1, 2)),
)
"""Places in a file of the numbers that come first among the findings."""


@dataclass(frozen=True)
class MeasuredHand:
    """What a log tells of a hand, from how many switches, and warnings in words.

    ``estimates`` are stiffness, damping and mass with half of their 95 % intervals, of which the
    findings leave out what is too uncertain. ``covariance`` is that of the numbers of the file that
    the log tells, ``places``.
    """

    findings: list[Finding]
    estimates: dict[str, tuple[float, float]]
    places: tuple[str, ...]
    covariance: Array
    switches: int
    warnings: tuple[str, ...]

    @property
    def grade(self) -> str:
        """``measured``, ``rough`` or ``not measured``."""
        states = {self._found(name).status for name, _ in NAMES}
        if "kept" in states:
            return "not measured"
        return "measured" if states == {"identified"} and not self.warnings else "rough"

    @property
    def sentence(self) -> str:
        """The grade in words."""
        return f"The hand is {self.grade}, by {self.switches} switches of clutches."

    @property
    def hand(self) -> Hand:
        """The hand."""
        by_name = {each.quantity.name: each.quantity.value for each in self.findings}
        return Hand(
            mass=by_name["mass"],
            damping=by_name["damping"],
            stiffness=by_name["stiffness"],
            damping_anisotropy=(by_name["damping_e"], by_name["damping_f"]),
            stiffness_anisotropy=(by_name["stiffness_e"], by_name["stiffness_f"]),
        )

    @property
    def hands(self) -> HandSpread:
        """The hands that fit the log: their numbers vary together, within their intervals."""
        return HandSpread(
            hand=HumanArm(impedance=self.hand),
            places=tuple(f"impedance.{place}" for place in self.places),
            covariance=tuple(map(tuple, self.covariance.tolist())),
        )

    def _found(self, name: str) -> Finding:
        return next(each for each in self.findings if each.quantity.name == name)


def identify_hand(
    log: Log, machine: Machine, start: Hand = NORMAL, *, reaction: float = REACTION
) -> MeasuredHand:
    """Identify the mass, damper and spring of the hand that moves a machine.

    Parameters
    ----------
    log
        Angles, forces between hand and machine, and voltages with random pulses.
    machine
        The machine. Its clutches only have to be known roughly: they decide how precise the result
        is, and do not bias it.
    start
        What the log does not tell keeps its value.
    reaction
        Time after a switch that is used [s], in which the person does not react to it. Longer ones
        tell the stiffness more precisely.

    Raises
    ------
    ParameterError
        If there are too few pulses, or ``reaction`` is out of range.
    """
    if not REACTIONS[0] <= reaction <= REACTIONS[1]:
        accepted = " to ".join(f"{each:g}" for each in REACTIONS)
        raise ParameterError(f"reaction must be from {accepted} s, got {reaction:g}")
    fit = _HandFit(log, machine, start, reaction)
    fit.begin()
    for _ in range(ITERATIONS - 1):
        fit.improve(fit.motion(fit.early))
    fit.improve(fit.motion(fit.count))
    apart, warnings = fit.differences()
    warnings += [*fit.reactions(), *fit.giving_way(), *fit.limits()]
    estimates = fit.estimates(apart)
    findings = fit.findings(estimates, sure=not warnings)
    warnings += fit.uneven_mass()
    spread = fit.spread(findings)
    return MeasuredHand(findings, estimates, *spread, len(fit.at.rows), tuple(warnings))


class _Estimate(NamedTuple):
    """``theta``, the numbers of a fit, and by how much each switch moves them, (N, 10)."""

    theta: Array
    moves: Array

    @property
    def covariance(self) -> Array:
        """The covariance of the numbers: what switches do to them is uncorrelated."""
        return self.moves.T @ self.moves


class _HandFit:
    """Numbers of a hand, what its log shows after switches, and the means to improve them.

    ``theta`` are xx, xy, yy of stiffness, damping and mass, and by how much forces are later than
    ``delay`` [s].
    """

    def __init__(self, log: Log, machine: Machine, start: Hand, reaction: float) -> None:
        self.log, self.machine, self.start = log, machine, start
        self.stride = max(1, round(KNOT / log.interval))
        self.knot = self.stride * log.interval
        self.early, self.count = (
            int(until / self.knot + 1e-9) for until in (reaction, reaction + WATCHED)
        )
        self.ahead = round(LATEST / log.interval)
        self.past = self.stride * (SPAN + MEMORY)
        rows = _switches(log, self.past, self.stride * self.count + self.ahead)
        if len(rows) < MIN_SWITCHES:
            raise ParameterError(
                f"log must have at least {MIN_SWITCHES} switches of voltages away from its ends "
                f"and gaps, got {len(rows)}"
            )
        self.at = _possible(log, machine, rows)
        self.clear = np.arange(self.past, len(log.volts) - self.ahead)
        self.clear = self.clear[_is_clear(log, self.clear, self.past, self.ahead)]
        tip = tip_positions(machine, log.theta)
        self.tip = tip - tip.mean(axis=0)
        self.delay, self.theta = 0.0, np.zeros(10)
        for k, (name, _) in enumerate(NAMES):
            self.theta[[3 * k, 3 * k + 2]] = getattr(start, name)

    def begin(self) -> None:
        """Begin with the delay of forces with which least of the hand's own push is new.

        From afar, the estimate may find one at which masses are negative, so these come last.
        """
        usual, tried = self.theta, list[tuple[bool, float, float, Array]]()
        motion = self.motion(self.early)
        for self.delay in DELAYS:
            self.theta = usual
            self.improve(motion)
            new = -float(np.linalg.det(self._fresh()[1]))
            tried.append((bool(np.any(MEANS @ self.theta <= 0.0)), new, self.delay, self.theta))
        *_, self.delay, self.theta = min(tried, key=lambda each: each[:2])

    def _fresh(self) -> tuple[Array, Array]:
        """Return how to find what is new in the hand's own push, and its inverse covariance."""
        columns, outcome = self._seen(PLAIN)
        return _whitener((outcome + columns @ self.theta)[self.clear], self.stride)

    def improve(self, motion: list[Array]) -> None:
        """Estimate the numbers, with weights by the present ones, from a predicted motion."""
        whitener, weights = self._fresh()
        columns, outcome = self._seen(whitener)
        count = (motion[0].shape[1] - 1) // self.stride
        at = self.at.rows[:, None] + self.stride * np.arange(1, count + 1)
        self.columns = columns[at] - columns[self.clear].mean(axis=0)
        self.outcome = outcome[at] - outcome[self.clear].mean(axis=0)
        self.instruments = np.einsum("jkdq,de->jkeq", self._instruments(whitener, motion), weights)
        early = (each[:, : self.early] for each in (self.instruments, self.columns, self.outcome))
        self.information, self.pull = _moments(*early)
        self.found = self.estimate()
        self.theta = self.found.theta.copy()
        self.delay = float(np.clip(self.delay + self.theta[-1], -LATEST, LATEST))
        self.theta[-1] = 0.0

    def estimate(self, switches: Any = EVERY) -> _Estimate:
        """Return the numbers by some switches."""
        information, pull = self.information[switches], self.pull[switches]
        inverse = np.linalg.pinv(information.sum(axis=0))
        theta, moves = -inverse @ pull.sum(axis=0), np.zeros_like(self.pull)
        moves[switches] = -(pull + information @ theta) @ inverse.T
        return _Estimate(theta, moves)

    def _kernel(self, whitener: Array, order: int, late: float = 0.0) -> Array:
        """Return the weights of rows, from ``ahead`` to ``past`` ones ago, in a test function.

        It is φ less what its predecessors tell of it, differentiated; for values that are late.
        """
        basis = BSpline.basis_element(self.knot * np.arange(SPAN + 1), extrapolate=False)
        basis = basis.derivative(order) if order else basis
        ages = self.log.interval * np.arange(-self.ahead, self.past + 1) + late
        shifts = self.knot * np.arange(len(whitener))
        return np.nan_to_num(basis(ages[:, None] - shifts)) @ whitener / self.stride

    def _seen(self, whitener: Array) -> tuple[Array, Array]:
        """Return the log through the test function that ends at each row.

        Columns that numbers multiply, (T, 2, 10), and forces, (T, 2).
        """

        def through(values: Array, order: int, late: float = 0.0) -> Array:
            kernel = self._kernel(whitener, order, late)
            return fftconvolve(values, kernel[:, None], axes=0)[self.ahead :][: len(values)]

        moved = [through(self.tip, order) for order in range(3)]
        force = [through(self.log.force, order, self.delay) for order in range(2)]
        return _columns(moved, force[1]), force[0]

    def motion(self, count: int) -> list[Array]:
        """Return how pulses change the motion and the hand's push, by prediction.

        Positions, velocities, accelerations and forces, until so many test functions after a
        switch, of which ``early`` are before any reaction.
        """
        times: Array = self.log.interval * np.arange(self.stride * count + 1, dtype=np.float64)
        hand = self._matrices()
        moved = predict(self.machine, self.at, hand, times)
        pushed = [each @ part for each, part in zip(moved, hand, strict=True)]
        return [*moved, -(pushed[0] + pushed[1] + pushed[2])]

    def _instruments(self, whitener: Array, motion: list[Array]) -> Array:
        """Return the columns as a predicted motion changes them."""
        rows = np.arange(motion[0].shape[1])
        ages = rows[self.stride :: self.stride] - rows[:, None]

        def through(values: Array, order: int) -> Array:
            kernel = self._kernel(whitener, order)[self.ahead :]
            weights = np.where(ages >= 0, kernel[ages.clip(0)], 0.0)
            return np.einsum("jtd,tk->jkd", values, weights, optimize=True)

        return _columns([through(each, 0) for each in motion[:3]], through(motion[3], 1))

    def _matrices(self) -> tuple[Array, Array, Array]:
        """Return stiffness, damping and mass in all directions, within limits."""
        found = list[Array]()
        for k, limits in enumerate(LIMITS):
            xx, xy, yy = self.theta[3 * k : 3 * k + 3]
            sizes, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
            found.append((axes * sizes.clip(*limits)) @ axes.T)
        return found[0], found[1], found[2]

    def differences(self) -> tuple[Array, list[str]]:
        """Return by how much parts of the log differ, and which do, in sentences.

        Half of the largest difference of stiffness, damping and mass.
        """
        rows = self.at.rows
        pushes = np.linalg.norm(self.log.force[rows - 1], axis=1)
        pairs = {
            "The hand differs between the halves of the log: it changed, or a sensor drifts.": (
                rows < np.median(rows)
            ),
            "The hand differs when it pushes harder: it gives way, or tenses.": (
                pushes < np.median(pushes)
            ),
        }
        size, said = np.zeros(3), list[str]()
        for sentence, part in pairs.items():
            one, other = self.estimate(part), self.estimate(~part)
            apart, moves = MEANS @ (one.theta - other.theta), (one.moves - other.moves) @ MEANS.T
            if _differ(apart, moves.T @ moves, RARE):
                said.append(sentence)
                size = np.maximum(size, 0.5 * np.abs(apart))
        return size, said

    def reactions(self) -> list[str]:
        """Return a sentence if the hand's own push depends on where pulses had moved the arm."""
        moved = self._moved()
        past = np.zeros((*moved.shape, len(LAGS)))
        for n, lag in enumerate(LAGS):
            shift = round(lag / self.knot)
            past[:, shift:, :, n] = moved[:, :-shift]
        sentence = (
            "The hand's own push depends on where a pulse moved it 0.1 to 0.2 s ago: it reacts."
        )
        return [sentence] if self._leaves(past) else []

    def giving_way(self) -> list[str]:
        """Return a sentence if the stiffness depends on how hard and where to the hand pushes.

        A hand whose push is limited has none along its push, however hard this is.
        """
        moved, push = self._moved(), self.log.force[self.at.rows - 1]
        size = np.linalg.norm(push, axis=1)
        towards = push / np.maximum(size, TINY)[:, None]
        along = towards[:, None] * np.einsum("jd,jkd->jk", towards, moved)[..., None]
        hard = (stats.rankdata(size) / len(size) - 0.5)[:, None, None]
        more = np.stack([along - 0.5 * moved, hard * moved], axis=-1)
        sentence = "The stiffness depends on how the hand pushes: it gives way, or tenses."
        return [sentence] if self._leaves(more) else []

    def _moved(self) -> Array:
        """Return how far pulses move the hand, as instruments have it: (J, K, 2)."""
        return self.instruments[..., 0] + self.instruments[..., 2]  # along x, along y

    def _leaves(self, more: Array) -> bool:
        """Return whether what the numbers do not explain depends on more instruments."""
        slopes, scores = _moments(more, self.columns, self.outcome)
        scores += slopes @ self.found.theta + self.found.moves @ slopes.sum(axis=0).T
        return _differ(scores.sum(axis=0), scores.T @ scores, RARE)

    def limits(self) -> list[str]:
        """Return what is too coarse or too late, in sentences."""
        turns, said = np.abs(np.diff(self.log.theta, axis=0)), list[str]()
        step = max(self.log.angle_step, float(turns[turns > ROUNDING].min()))
        if step > COARSE:
            said.append(f"Angles come in steps of {1e3 * step:.1f} mrad, which may bias numbers.")
        if abs(self.delay) > 0.99 * LATEST:
            said.append(f"Forces seem to be {1e3 * self.delay:.0f} ms or more later than angles.")
        return said

    def uneven_mass(self) -> list[str]:
        """Return a sentence if the mass depends on the direction."""
        contrast = np.zeros((2, 10))
        contrast[0, [6, 8]], contrast[1, 7] = (0.5, -0.5), 1.0
        if not _differ(
            contrast @ self.theta, contrast @ self.found.covariance @ contrast.T, UNLIKELY
        ):
            return []
        return ["The mass depends on the direction: the file has its mean."]

    def estimates(self, more: Array) -> dict[str, tuple[float, float]]:
        """Return means over directions with half of their intervals, wider by ``more``."""
        means, errors = (
            MEANS @ self.theta,
            np.sqrt(np.diag(MEANS @ self.found.covariance @ MEANS.T)),
        )
        pairs = zip(means.tolist(), (SURE * errors + more).tolist(), strict=True)
        return {name: pair for (name, _), pair in zip(NAMES, pairs, strict=True)}

    def findings(self, estimates: dict[str, tuple[float, float]], *, sure: bool) -> list[Finding]:
        """Return the numbers with their states."""
        found = list[Finding]()
        for name, unit in NAMES:
            (value, half), before = estimates[name], getattr(self.start, name)
            reason = "" if half < UNSEEN * value else "the log does not tell it: pulse for longer"
            told = float(before if reason else value)
            quantity = Quantity(name, unit, told, told, (name,))
            found.append(make_finding(quantity, half, before, reason=reason, sure=sure, most=FINE))
        for k, (name, _) in enumerate(NAMES[:2]):
            found += self._anisotropy(3 * k, name, kept=found[k].status == "kept")
        late = SURE * float(np.sqrt(self.found.covariance[-1, -1]))
        quantity = Quantity("force_delay", "s", self.delay, self.log.interval)
        return [*found, make_finding(quantity, late, 0.0, sure=sure)]

    def _anisotropy(self, first: int, name: str, *, kept: bool) -> list[Finding]:
        """Return (e, f) of the stiffness or the damping; see ``pter_gym.params.Hand``."""
        value, slopes = self._direction(first)
        covariance = slopes @ self.found.covariance @ slopes.T
        reason = (
            ""
            if _differ(value, covariance, UNLIKELY) and not kept
            else f"{name} shows no direction"
        )
        value = np.zeros(2) if reason else value / max(1.0, float(np.linalg.norm(value)))
        halves = SURE * np.sqrt(np.diag(covariance))
        return [
            make_finding(
                Quantity(f"{name}_{letter}", "1", float(each), 1.0, (f"{name}_anisotropy",)),
                *(half, 0.0),
                reason=reason,
                most=FINE,
            )
            for letter, each, half in zip("ef", value, halves.tolist(), strict=True)
        ]

    def _direction(self, first: int) -> tuple[Array, Array]:
        """Return (e, f) of the stiffness or the damping, and its derivative by all numbers."""
        xx, xy, yy = self.theta[first : first + 3]
        value = np.array([xx - yy, 2.0 * xy]) / (xx + yy)
        slopes = np.zeros((2, 10))
        slopes[0, [first, first + 2]] = np.array([1.0 - value[0], -1.0 - value[0]]) / (xx + yy)
        slopes[1, [first, first + 1, first + 2]] = np.array([-value[1], 2.0, -value[1]]) / (xx + yy)
        return value, slopes

    def spread(self, findings: list[Finding]) -> tuple[tuple[str, ...], Array]:
        """Return the places of numbers that the log tells in a file, and their covariance.

        Its diagonal is that of the intervals, which may be wider than the fit's.
        """
        told = [k for k, each in enumerate(findings[: len(PLACES)]) if each.status != "kept"]
        slopes = np.vstack([MEANS, self._direction(0)[1], self._direction(3)[1]])[told]
        covariance = slopes @ self.found.covariance @ slopes.T
        errors = np.array([findings[k].half_width for k in told]) / SURE
        wider = errors / np.sqrt(np.diag(covariance))
        return tuple(PLACES[k] for k in told), wider[:, None] * covariance * wider


MEANS = np.kron(np.eye(3), [0.5, 0.0, 0.5]) @ np.eye(9, 10)
"""Means over all directions of stiffness, damping and mass, by the numbers of a fit."""


def _columns(moved: list[Array], faster: Array) -> Array:
    """Return what each number multiplies, (…, 2, 10), from positions, velocities, accelerations."""
    columns = list[Array]()
    for part in moved:
        for d, e in DIRECTIONS:
            column = np.zeros_like(part)
            column[..., d] = part[..., e]
            column[..., e] = part[..., d]
            columns.append(column)
    return np.stack([*columns, faster], axis=-1)


def _whitener(left: Array, stride: int) -> tuple[Array, Array]:
    """Return the weights of the last values in what is new of each, and its inverse covariance.

    ``left`` has rows of a hand's own push in x and y, (T, 2), of which each ``stride``-th counts.
    """
    left = left - left.mean(axis=0)
    rows = np.arange(stride * MEMORY, len(left), 3)
    past = left[rows[:, None] - stride * np.arange(1, MEMORY + 1)]  # (rows, MEMORY, 2)
    normal = np.einsum("rkd,rld->kl", past, past, optimize=True)
    normal[np.diag_indices(MEMORY)] *= 1.0 + 1e-9
    shares = np.linalg.solve(normal, np.einsum("rkd,rd->k", past, left[rows], optimize=True))
    fresh = left[rows] - np.einsum("rkd,k->rd", past, shares)
    return np.concatenate([[1.0], -shares]), np.linalg.inv(np.cov(fresh.T))


def _moments(instruments: Array, columns: Array, outcome: Array) -> tuple[Array, Array]:
    """Return sums over test functions of instruments with columns, and with the outcome."""
    return (
        np.einsum("jkdq,jkdr->jqr", instruments, columns, optimize=True),
        np.einsum("jkdq,jkd->jq", instruments, outcome, optimize=True),
    )


def _differ(values: Array, covariance: Array, chance: float) -> bool:
    """Return whether values differ from zero, as they would with a chance if they were zero."""
    size = float(values @ np.linalg.pinv(covariance) @ values)
    return bool(size > stats.chi2.ppf(1.0 - chance, len(values)))


def _switches(log: Log, before: int, after: int) -> NDArray[np.int64]:
    """Return the rows with which a voltage changes, clear of gaps and ends by so many rows."""
    rows = np.flatnonzero(_changes(log))
    rows = rows[np.diff(rows, prepend=-before) > 1]
    rows = rows[(rows >= before) & (rows + after < len(log.volts))]
    return rows[_is_clear(log, rows, before, after)]


def _is_clear(log: Log, rows: NDArray[np.int64], before: int, after: int) -> NDArray[np.bool_]:
    """Return whether rows are clear of gaps by so many rows before and after."""
    known = np.concatenate([[0], np.cumsum(log.is_clear(1))])
    return known[rows + after + 1] - known[rows - before] == before + after + 1


def _changes(log: Log) -> NDArray[np.bool_]:
    """Return whether a voltage changes with a row."""
    return np.abs(np.diff(log.volts, axis=0, prepend=log.volts[:1])).max(axis=1) > SAME


def _possible(log: Log, machine: Machine, rows: NDArray[np.int64]) -> Switches:
    """Return switches with other torques that could have been drawn: those of other switches.

    No set of clutches follows itself, so torques of the set before a switch are left out.
    """
    past = max(3, round(PAST / log.interval))
    ramp = np.arange(past) - 0.5 * (past - 1)
    ramp /= (ramp @ ramp) * log.interval
    omega = np.einsum("p,jpi->ji", ramp, log.theta[rows[:, None] + np.arange(-past, 0)])
    after = _torques(machine, log.volts[rows])
    bits = 1 << np.arange(4)
    was, now = ((log.volts[each] > SAME) @ bits for each in (rows - 1, rows))
    rng, drawn = np.random.default_rng(0), np.empty((DRAWS, len(rows)), np.int64)
    for each in np.unique(was):
        here, others = was == each, np.flatnonzero(now != each)
        others = others if len(others) else np.arange(len(rows))
        drawn[:, here] = rng.choice(others, (DRAWS, int(here.sum())))
    return Switches(
        rows=rows,
        theta=log.theta[rows - 1],
        omega=omega,
        held=_held(log, machine)[rows],
        after=np.concatenate([after[None], after[drawn]]),
        lasting=log.interval * (_next(log)[rows] - rows).astype(np.float64),
    )


def _held(log: Log, machine: Machine) -> Array:
    """Return the clutches' torques that have built up by each row, (T, 4)."""
    kept = np.exp(-log.interval / machine.clutch.time_constant)
    torque = _torques(machine, log.volts)
    late = 1 + round(machine.delay / log.interval)
    torque = np.concatenate([np.repeat(torque[:1], late, axis=0), torque[:-late]])
    return np.asarray(lfilter([1.0 - kept], [1.0, -kept], torque, axis=0))


def _next(log: Log) -> NDArray[np.int64]:
    """Return the first row after each with which a voltage changes."""
    changes = np.append(np.flatnonzero(_changes(log)), len(log.volts))
    return changes[np.searchsorted(changes, np.arange(len(log.volts)), "right")]


def _torques(machine: Machine, volts: Array) -> Array:
    """Return the dynamic torques of clutches at voltages, both of shape (N, 4)."""
    levels, place = np.unique(volts, return_inverse=True)
    torque = np.array([machine.clutch.dynamic.torque(each) for each in levels.tolist()])
    return torque[place].reshape(volts.shape) * np.array(machine.slot_scale)
