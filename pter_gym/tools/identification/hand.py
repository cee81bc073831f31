# pyright: standard
"""Mass, damper and spring of the hand that moves a machine, from random clutch pulses.

A hand pushes with f = K·(x₀ − x) + B·(v₀ − v) − M·a + d, of which its intent x₀ and its disturbance
d are unknown. Only the machine chose the pulses, so whatever the hand does by itself is
uncorrelated with how the motion changes by them: the pulses are instruments.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.interpolate import BSpline

from pter_gym.errors import ParameterError
from pter_gym.hands import NORMAL
from pter_gym.params import Hand, Machine
from pter_gym.tools.identification.findings import Finding, make_finding
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import Quantity
from pter_gym.tools.identification.pulses import Switches, predict, tip_positions
from pter_gym.tools.identification.windows import SAME

Array = NDArray[np.float64]

BEFORE, REACTION, WATCHED = 0.3, 0.2, 0.25
"""Time before a switch that the fit uses [s]; time after it in which no person reacts; and how much
longer reactions are looked for."""

REACTIONS = (0.15, 0.5)
"""Accepted times in which no person reacts [s]: a shorter one leaves too little to see."""

KNOT = 0.02
"""Time between knots of the test functions [s]."""

SPAN = 6
"""Knots that the support of a test function spans: quintic, so its second derivative is smooth."""

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

RARE = 0.005
"""Chance of a warning where there is nothing to warn of."""

DIRECTIONS = ((0, 0), (0, 1), (1, 1))
"""Entries xx, xy, yy of a symmetric matrix."""

LIMITS = ((20.0, 3000.0), (1.0, 200.0), (0.1, 10.0))
"""Stiffness, damping and mass between which instruments are predicted [N/m, N·s/m, kg]."""

NAMES = (("stiffness", "N/m"), ("damping", "N·s/m"), ("mass", "kg"))


@dataclass(frozen=True)
class MeasuredHand:
    """What a log tells of a hand, from how many switches, and warnings in words.

    ``estimates`` are stiffness, damping and mass with half of their 95 % intervals, of which the
    findings leave out what is too uncertain.
    """

    findings: list[Finding]
    estimates: dict[str, tuple[float, float]]
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
    for k in range(ITERATIONS):
        fit.improve(reaction + WATCHED * (k == ITERATIONS - 1))
    halves, apart = fit.halves()
    late = fit.reaction()
    warnings = [*_warnings(apart, late), *fit.uneven_mass()]
    estimates = fit.estimates(halves if apart else np.zeros(3))
    findings = fit.findings(estimates, sure=not (apart or late))
    return MeasuredHand(findings, estimates, len(fit.at.rows), tuple(warnings))


def _warnings(apart: bool, late: float | None) -> list[str]:
    """Return what may be wrong, in sentences."""
    said = list[str]()
    if apart:
        said.append(
            "The hand differs between the halves of the log: it changed, or a sensor drifts. "
            "Intervals hold both halves."
        )
    if late is not None:
        said.append(
            f"From {late:.2g} s after a switch the hand's own push depends on it: the person "
            "reacts, or gives way. Numbers may be off."
        )
    return said


class _HandFit:
    """Numbers of a hand, the windows they come from, and the means to improve them.

    ``theta`` are xx, xy, yy of stiffness, damping and mass, and by how much the forces are late
    [s]; ``covariance`` is theirs.
    """

    def __init__(self, log: Log, machine: Machine, start: Hand, reaction: float) -> None:
        self.machine, self.start, self.interval = machine, start, log.interval
        first = round(BEFORE / log.interval)
        last = round((reaction + WATCHED) / log.interval)
        self.times = log.interval * np.arange(-first, last + 1, dtype=np.float64)
        rows = _switches(log, first, last)
        if len(rows) < MIN_SWITCHES:
            raise ParameterError(
                f"log must have at least {MIN_SWITCHES} switches of voltages away from its ends "
                f"and gaps, got {len(rows)}"
            )
        self.at = _possible(log, machine, rows)
        window = rows[:, None] + np.arange(-first, last + 1)
        tip = tip_positions(machine, log.theta)[window]
        self.force, self.tip = log.force[window], tip - tip[:, :1]
        self.early = self._ends() < reaction + 1e-9
        self.delay, self.theta = 0.0, np.zeros(10)
        for k, name in enumerate(("stiffness", "damping", "mass")):
            self.theta[[3 * k, 3 * k + 2]] = getattr(start, name)

    def _ends(self) -> Array:
        """Return when test functions end [s]."""
        count = int((self.times[-1] - self.times[0]) / KNOT + 1e-9) - SPAN + 1
        return self.times[0] + KNOT * (np.arange(count) + SPAN)

    def _through(self, values: Array, order: int = 0, late: float = 0.0) -> Array:
        """Return ∫ φ⁽ᵒʳᵈᵉʳ⁾·values dt for each test function φ: (N, T, 2) to (N, 2, functions)."""
        basis = BSpline.basis_element(KNOT * np.arange(SPAN + 1), extrapolate=False)
        basis = basis.derivative(order) if order else basis
        begin = self._ends() - KNOT * SPAN + late
        weights = np.nan_to_num(basis(self.times[:, None] - begin)) * self.interval
        return values.transpose(0, 2, 1) @ weights

    def _columns(self, stiff: Array, damped: Array, heavy: Array, late: Array) -> Array:
        """Return what each number multiplies, (N, 2, functions, 10)."""
        columns = list[Array]()
        for part in (stiff, damped, heavy):
            for d, e in DIRECTIONS:
                column = np.zeros_like(part)
                column[:, d] = part[:, e]
                column[:, e] = part[:, d]
                columns.append(column)
        return np.stack([*columns, late], axis=-1)

    def improve(self, until: float) -> None:
        """Estimate the numbers, with instruments (until a time [s]) and weights by the present."""
        self.outcome = self._through(self.force, 0, self.delay)
        stiff, damped, heavy = (self._through(self.tip, order) for order in range(3))
        late = self._through(self.force, 1, self.delay)
        columns = self._columns(stiff, -damped, heavy, -late)
        self.outcome -= self.outcome.mean(axis=0)
        self.columns = columns - columns.mean(axis=0)
        self.instruments = self._instruments(until)
        left = self._left()[:, :, self.early].reshape(-1, self.early.sum())
        covariance = left.T @ left / len(left)
        covariance[np.diag_indices(len(covariance))] *= 1.0 + 1e-9
        self.weights = np.linalg.inv(covariance)
        weighted = np.einsum("jdkq,kl->jdlq", self.instruments[:, :, self.early], self.weights)
        self.information = np.einsum("jdkq,jdkr->jqr", weighted, self.columns[:, :, self.early])
        self.pull = np.einsum("jdkq,jdk->jq", weighted, self.outcome[:, :, self.early])
        inverse = np.linalg.pinv(self.information.sum(axis=0))
        self.theta = -inverse @ self.pull.sum(axis=0)
        self.scores = self.pull + self.information @ self.theta
        self.covariance = inverse @ (self.scores.T @ self.scores) @ inverse.T
        self.delay += float(self.theta[-1].clip(-0.02, 0.02))
        self.theta[-1] = 0.0

    def _left(self) -> Array:
        """Return what the hand does by itself, through the test functions."""
        return self.outcome + self.columns @ self.theta

    def _matrices(self) -> tuple[Array, Array, Array]:
        """Return stiffness, damping and mass in all directions, within limits."""
        found = list[Array]()
        for k, limits in enumerate(LIMITS):
            xx, xy, yy = self.theta[3 * k : 3 * k + 3]
            sizes, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
            found.append((axes * sizes.clip(*limits)) @ axes.T)
        return found[0], found[1], found[2]

    def _instruments(self, until: float) -> Array:
        """Return the columns as pulses change them by prediction."""
        hand = self._matrices()
        motion = predict(self.machine, self.at, hand, self.times, until)
        moved: list[Array] = [each @ part for each, part in zip(motion, hand, strict=True)]
        stiff, damped, heavy = (self._through(each) for each in motion)
        return self._columns(stiff, damped, heavy, self._through(moved[0] + moved[1] + moved[2], 1))

    def halves(self) -> tuple[Array, bool]:
        """Return half of the difference between halves of the log, and whether there is one."""
        whole, found, errors = len(self.scores), list[Array](), np.zeros((3, 3))
        for part in (slice(whole // 2), slice(whole // 2, whole)):
            inverse = np.linalg.pinv(self.information[part].sum(axis=0))
            theta = -inverse @ self.pull[part].sum(axis=0)
            scores = self.pull[part] + self.information[part] @ theta
            found.append(MEANS @ theta)
            errors += MEANS @ inverse @ (scores.T @ scores) @ inverse.T @ MEANS.T
        apart = found[1] - found[0]
        size = float(apart @ np.linalg.pinv(errors) @ apart)
        return 0.5 * np.abs(apart), bool(size > stats.chi2.ppf(1.0 - RARE, 3))

    def reaction(self) -> float | None:
        """Return from when on what the hand does by itself depends on pulses [s], None if never."""
        left, ends = self._left(), self._ends()
        past = left[:, :, ends <= 0.0]
        inverse = np.linalg.pinv(self.information.sum(axis=0))
        moved = self.instruments[..., 0] + self.instruments[..., 2]  # along x, along y
        late = np.flatnonzero(~self.early)
        level = stats.norm.ppf(1.0 - 0.5 * RARE / len(late))
        for k in late:
            known = past.reshape(-1, past.shape[-1])
            now = left[:, :, k].reshape(-1)
            fresh = (now - known @ np.linalg.lstsq(known, now, rcond=None)[0]).reshape(-1, 2)
            slope = np.einsum("jd,jdq->q", moved[:, :, k], self.columns[:, :, k])
            score = np.einsum("jd,jd->j", moved[:, :, k], fresh) - self.scores @ inverse.T @ slope
            if abs(score.sum()) > level * np.linalg.norm(score):
                return float(ends[k] - 0.5 * SPAN * KNOT)
        return None

    def uneven_mass(self) -> list[str]:
        """Return a sentence if the mass depends on the direction."""
        contrast = np.zeros((2, 10))
        contrast[0, [6, 8]], contrast[1, 7] = (0.5, -0.5), 1.0
        if not _differ(contrast @ self.theta, contrast @ self.covariance @ contrast.T):
            return []
        return ["The mass depends on the direction: the file has its mean."]

    def estimates(self, more: Array) -> dict[str, tuple[float, float]]:
        """Return means over directions with half of their intervals, wider by ``more``."""
        means, errors = MEANS @ self.theta, np.sqrt(np.diag(MEANS @ self.covariance @ MEANS.T))
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
        late = SURE * float(np.sqrt(self.covariance[-1, -1]))
        quantity = Quantity("force_delay", "s", self.delay, self.interval)
        return [*found, make_finding(quantity, late, 0.0, sure=sure)]

    def _anisotropy(self, first: int, name: str, *, kept: bool) -> list[Finding]:
        """Return (e, f) of the stiffness or the damping; see ``pter_gym.params.Hand``."""
        xx, xy, yy = self.theta[first : first + 3]
        value = np.array([xx - yy, 2.0 * xy]) / (xx + yy)
        slopes = np.zeros((2, 10))
        slopes[0, [first, first + 2]] = np.array([1.0 - value[0], -1.0 - value[0]]) / (xx + yy)
        slopes[1, [first, first + 1, first + 2]] = np.array([-value[1], 2.0, -value[1]]) / (xx + yy)
        covariance = slopes @ self.covariance @ slopes.T
        reason = "" if _differ(value, covariance) and not kept else f"{name} shows no direction"
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


MEANS = np.kron(np.eye(3), [0.5, 0.0, 0.5]) @ np.eye(9, 10)
"""Means over all directions of stiffness, damping and mass, by the numbers of a fit."""


def _differ(values: Array, covariance: Array) -> bool:
    """Return whether two values differ from zero."""
    size = float(values @ np.linalg.pinv(covariance) @ values)
    return bool(size > stats.chi2.ppf(0.99, len(values)))


def _switches(log: Log, before: int, after: int) -> NDArray[np.int64]:
    """Return the rows with which a voltage changes, clear of gaps and ends by so many rows."""
    rows = np.flatnonzero(np.abs(np.diff(log.volts, axis=0)).max(axis=1) > SAME) + 1
    rows = rows[np.diff(rows, prepend=-before) > 1]
    rows = rows[(rows >= before) & (rows + after < len(log.volts))]
    known = np.concatenate([[0], np.cumsum(log.is_clear(1))])
    return rows[known[rows + after + 1] - known[rows - before] == before + after + 1]


def _possible(log: Log, machine: Machine, rows: NDArray[np.int64]) -> Switches:
    """Return switches with other torques that could have been drawn: those of other switches.

    No set of clutches follows itself, so torques of the set before a switch are left out.
    """
    past = max(3, round(PAST / log.interval))
    ramp = np.arange(past) - 0.5 * (past - 1)
    ramp /= (ramp @ ramp) * log.interval
    omega = np.einsum("p,jpi->ji", ramp, log.theta[rows[:, None] + np.arange(-past, 0)])
    before, after = (_torques(machine, log.volts[each]) for each in (rows - 1, rows))
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
        before=before,
        after=np.concatenate([after[None], after[drawn]]),
    )


def _torques(machine: Machine, volts: Array) -> Array:
    """Return the dynamic torques of clutches at voltages, both of shape (N, 4)."""
    levels, place = np.unique(volts, return_inverse=True)
    torque = np.array([machine.clutch.dynamic.torque(each) for each in levels.tolist()])
    return torque[place].reshape(volts.shape) * np.array(machine.slot_scale)
