# pyright: standard
"""From a log to a machine: what is identified, how well, and what the log does not show."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.params import Machine, MachineSpread, find_machine
from pter_gym.params._spread import numbers_of
from pter_gym.tools.identification.findings import (
    Finding,
    derived_finding,
    make_finding,
    origins_of,
)
from pter_gym.tools.identification.first_estimate import first_estimate
from pter_gym.tools.identification.fit import UNSEEN, Fit
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import (
    AT,
    CLUTCH_TERMS,
    NAMES,
    PRODUCTS,
    SCALES,
    SEARCHES,
    TERMS,
    Quantity,
    Shape,
    places,
    quantities,
)
from pter_gym.tools.identification.score_tests import admit_terms, differences
from pter_gym.tools.identification.verdict import MAX_FAR, NEITHER, Verdict, judge
from pter_gym.tools.identification.windows import SLIPPING, Smoothed, cut, experience, smooth

Array = NDArray[np.float64]

MIN_SLIPPING, MIN_LEVELS = 0.3, 3
"""How long a clutch has to slip in all for its torque to be identified [s]; fewest voltages that
tell a straight segment from a quadratic one."""

NORMAL = 1.96
"""Half of the 95 % interval of a normal distribution, in standard deviations."""

WORSE, NO_JUMP = 3.0, 1.03
"""Standard errors by which a fit is surely worse; T_s/T_k up to which clutches do not jump."""

EXPECTED_STEPS = 60
"""About how many steps of progress an identification takes."""

TORQUES = {
    *("torque_25", "torque_50", "torque_75", "torque_100"),
    *("slope", "knee", "curvature", "off_state"),
}
"""Numbers that heat changes."""

ASSUMED = "chosen: stated to pter identify, or that of its start"
"""Provenance of what is not estimated."""


@dataclass(frozen=True, kw_only=True)
class Identification:
    """A machine identified from a log.

    Attributes
    ----------
    log, start
        What was given.
    machine
        The start with the identified numbers, and the delay from a recorded voltage to the motion
        that it causes.
    machines
        The machine and those that fit the log as well; the machine alone if the model does not
        describe the log.
    findings
        The numbers, in the order of ``quantities``.
    products
        Numbers of the file that are products of these.
    fit
        The windows and how well they are predicted.
    verdict
        How well the model describes the log.
    """

    log: Log
    start: Machine
    machine: Machine
    machines: Machine | MachineSpread
    findings: list[Finding]
    products: list[Finding]
    fit: Fit
    verdict: Verdict

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What no log of this kind can show, as sentences."""
        clutch, (a, b) = self.start.clutch, self.fit.shape.offsets(self.fit.p)
        late = 1e3 * self.fit.p[AT["force_delay"]]
        return (
            "The force sensor's gain is exact: all inertias and torques are proportional to it.",
            f"Links are {self.start.arm.length_a:g} m and {self.start.arm.length_b:g} m long.",
            f"Clutches drag with {clutch.viscous:g} N·m·s; more is viscous friction of the axes.",
            f"Constant torques on the axes, {a:.3g} and {b:.3g} N·m, are not in the file.",
            f"The delay of the recorded forces, {late:.2g} ms, is not in the file either.",
            f"Clutches lose {100.0 * clutch.fade:g} % of their torque per joule of heat.",
            f"Clutches have ±{clutch.hysteresis:g} V of hysteresis, which only a bench shows.",
        )

    @property
    def residuals(self) -> Array:
        """Measured less predicted angles [rad], (windows, length, 2); NaN in unused windows."""
        off = -self.fit.here.residual.reshape(self.fit.windows.measured.shape)
        return np.where(self.fit.windows.used[:, None, None], off, np.nan)

    @property
    def origins(self) -> dict[str, str]:
        """Where the numbers of the machine come from, by field."""
        stated = ("arm.length_a", "arm.length_b", "clutch.voltage_max")
        return dict.fromkeys(stated, ASSUMED) | origins_of(
            (*self.findings, *self.products), self.log.name
        )


def identify(
    log: Log,
    start: Machine | str | None = None,
    on_progress: Callable[[float], None] = lambda _: None,
) -> Identification:
    """Identify a machine from a log.

    Parameters
    ----------
    log
        What was recorded.
    start
        The machine, its name or its file: link lengths, the largest voltage, and what the log
        does not show.
    on_progress
        Called with how much of the work is done, 0 to 1.

    Raises
    ------
    ParameterError
        If a voltage exceeds the largest of the start or belongs to a clutch that it lacks, or
        nothing moves.
    """
    start = find_machine(start)
    motion = _checked(log, start)
    slipped, top, levels = experience(log, motion, start)
    live = tuple(int(x) for x in np.flatnonzero(slipped >= MIN_SLIPPING))
    shape = Shape(start, top, live=live)
    p = first_estimate(log, motion, shape)
    kept = {
        name: f"clutch {x + 1} was never on while it slipped"
        for x, name in enumerate(SCALES)
        if x not in live
    }
    if not live:
        of_clutches = "curvature", "knee", "breakaway_ratio", "time_constant", "delay"
        kept |= dict.fromkeys((*of_clutches, *CLUTCH_TERMS), "no clutch slipped while on")
    elif levels < MIN_LEVELS:
        shape = replace(shape, kept_knee=start.clutch.dynamic.knee)
        kept |= dict.fromkeys(
            ("curvature", "knee"), "clutches slipped at fewer than three voltages"
        )
    for axis, fastest in zip("ab", np.abs(motion.omega).max(axis=0), strict=True):
        if fastest < SLIPPING:
            kept |= dict.fromkeys((f"inertia_{axis}", f"viscous_{axis}"), "this link never moves")
    before = shape.coordinates(start)
    p[places(kept)] = before[places(kept)]
    taken = 0

    def step() -> None:
        nonlocal taken
        taken += 1
        on_progress(min(taken / EXPECTED_STEPS, 1.0))

    windows = cut(log, motion, start, math.exp(p[AT["time_constant"]]))
    absent = {name for name in TERMS if before[AT[name]] == 0.0} | kept.keys()
    fit = Fit(windows, shape, [name for name in NAMES if name not in absent], p, step)
    fit.choose_ratio()
    fit.search()
    admit_terms(fit, kept)
    tied = _keep_unseen(fit, kept, before)
    verdict = judge(fit, differences(fit, log, motion), log)
    on_progress(1.0)
    spread, describes = _spread_of(fit, verdict), verdict.grade != NEITHER
    findings = _findings(fit, spread, kept, _unsure(tied, verdict), describes=describes)
    machine = fit.shape.machine(fit.p)
    return Identification(
        log=log,
        start=start,
        machine=machine,
        machines=_machines(fit, spread) if fit.free and describes else machine,
        findings=findings,
        products=_products(fit, spread, findings),
        fit=fit,
        verdict=verdict,
    )


def _checked(log: Log, start: Machine) -> Smoothed:
    """Return the motion of a log, or raise a ParameterError."""
    largest, count = start.clutch.voltage_max, len(start.clutches)
    if log.volts.max() > largest:
        raise ParameterError(
            f"log: V1 to V4 must be at most {largest:g} V, got {log.volts.max():g}: volts?"
        )
    if log.volts[:, count:].any():
        raise ParameterError(
            f"log: voltages from V{count + 1} on must be 0: the machine has {count} clutches"
        )
    motion = smooth(log)
    if np.abs(motion.omega).max() < SLIPPING:
        raise ParameterError(
            f"log: theta_A or theta_B must move faster than {SLIPPING:g} rad/s somewhere"
        )
    return motion


def _keep_unseen(fit: Fit, kept: dict[str, str], before: Array) -> set[str]:
    """Search without coordinates that the log does not show, and add the reasons.

    Returns the names of numbers that it shows only in combination with one that is kept, or that it
    shows so little, but whose values at the start make the fit worse.
    """
    tied, needed = set[str](), set[str]()
    while fit.free:
        errors = dict(zip(fit.free, np.sqrt(np.diag(fit.covariance()[0])), strict=True))
        if _is_straight(fit, errors):
            kept |= dict.fromkeys(("curvature", "knee"), SEARCHES["curvature"].unseen)
            knee = max(fit.shape.start.clutch.dynamic.knee, fit.shape.top)
            fit.shape = replace(fit.shape, kept_knee=knee)
            fit.free = [name for name in fit.free if name not in kept]
            fit.search(1)
            continue
        worst = _worst_seen(fit, errors, needed)
        if worst is None:
            break
        together = fit.tied_to(worst) if errors[worst] ** 2 < UNSEEN else set[str]()
        if not _kept_without_loss(fit, worst, before[AT[worst]]):
            needed.add(worst)
            continue
        kept[worst] = SEARCHES[worst].unseen
        if together:
            kept[worst] += f"; only together with {', '.join(sorted(together))}"
        tied |= together | ({"curvature"} if worst == "knee" else set[str]())
    return tied | needed


def _is_straight(fit: Fit, errors: dict[str, float]) -> bool:
    """Return whether a curvature that is searched is not seen."""
    least = max(2.0 * errors.get("curvature", math.inf), 0.01 * fit.shape.top)
    return "curvature" in fit.free and not abs(fit.p[AT["curvature"]]) > least


def _worst_seen(fit: Fit, errors: dict[str, float], needed: set[str]) -> str | None:
    """Return the coordinate whose error exceeds most what is allowed; None if none does."""
    excess = {name: errors[name] / SEARCHES[name].max_error for name in fit.free}
    excess |= {"breakaway_ratio": math.inf} if fit.has_no_jump else {}
    excess = {name: size for name, size in excess.items() if name not in needed and size > 1.0}
    return max(excess, key=lambda name: excess[name]) if excess else None


def _kept_without_loss(fit: Fit, name: str, value: float) -> bool:
    """Keep a coordinate at a value and search the others; undo it if that is surely a worse fit."""
    free, p, starts, weights = list(fit.free), fit.p.copy(), fit.starts, fit.weights
    factors, place = fit.factors, AT[name]
    costs = fit.costs(factors)
    if name == "breakaway_ratio" and fit.p[place] <= NO_JUMP:
        fit.p[place] = min(value, 1.0)
    elif name != "knee":
        fit.p[place] = value
    fit.free = [each for each in free if each != name]
    fit.search(1)
    more = fit.costs(factors) - costs
    if more.sum() <= WORSE * float(np.linalg.norm(more - more.mean())):
        return True
    fit.free, fit.p, fit.starts, fit.weights = free, p, starts, weights
    fit.search(1)
    return False


def _slopes(fit: Fit, numbers: Callable[[Array], list[float]]) -> Array:
    """Return the derivatives of numbers by the free coordinates, shape (numbers, free)."""
    slopes = np.empty((len(numbers(fit.p)), len(fit.free)))
    for column, name in zip(slopes.T, fit.free, strict=True):
        high, low = fit.shape.around(fit.p, name, 1e-3)
        column[:] = np.subtract(numbers(high), numbers(low)) / (high - low)[AT[name]]
    return slopes


class _Spread(NamedTuple):
    """How far the free coordinates, and the numbers by them, may be off.

    ``slopes`` (numbers, free) are derivatives, ``halves`` half of the 95 % intervals, (numbers,),
    and ``whole`` is the covariance of the coordinates, (free, free). Errors of the model widen each
    coordinate by itself, by what they do to its number.
    """

    slopes: Array
    halves: Array
    whole: Array


def _spread_of(fit: Fit, verdict: Verdict) -> _Spread:
    """Return how far numbers may be off, by the scatter of windows and by errors of the model."""
    here = fit.shape.quantities(fit.p)
    covariance, quantile = fit.covariance() if fit.free else (np.empty((0, 0)), 2.0)
    for each in verdict.differences:
        covariance = covariance + np.outer(each.change, each.change)
    slopes = _slopes(fit, lambda p: [q.value for q in fit.shape.quantities(p)])
    variances = np.einsum("qi,ij,qj->q", slopes, covariance, slopes).clip(0.0)
    wide = np.maximum([verdict.share * q.scale for q in here], fit.bias(slopes, verdict.left))
    names = [q.name for q in here]
    rows = [names.index(name) for name in fit.free]
    rates = np.abs(slopes[rows, range(len(rows))])
    model = np.divide(wide[rows], rates, out=np.zeros_like(rates), where=rates > 0.0)
    whole = (quantile**2 * covariance + np.diag(model**2)) / NORMAL**2
    return _Spread(slopes, np.hypot(quantile * np.sqrt(variances), wide), whole)


def _unsure(tied: set[str], verdict: Verdict) -> set[str]:
    """Return the numbers that are not identified, however narrow their intervals are."""
    unsure = tied | {each.name for each in verdict.differences}
    unsure |= {"breakaway_ratio"} if verdict.far_breakaways > MAX_FAR else set()
    if unsure.intersection(SCALES):  # the others are relative to a mean that is none
        unsure |= {*SCALES, *TORQUES}
    return unsure | (TORQUES if verdict.one_way else set())


def _findings(
    fit: Fit, spread: _Spread, kept: Mapping[str, str], unsure: set[str], *, describes: bool
) -> list[Finding]:
    """Return the numbers with their intervals, none identified if the model does not describe."""
    here, start = fit.shape.quantities(fit.p), quantities(fit.shape.start, 0.0, fit.shape.top)
    findings: list[Finding] = []
    for q, first, half, by_free in zip(
        here, start, spread.halves.tolist(), spread.slopes, strict=True
    ):
        unmoved = "" if by_free.any() else "the log shows none of the numbers from which it follows"
        reason = kept.get(q.name, unmoved)
        sure = describes and q.name not in unsure
        findings.append(make_finding(q, half, first.value, reason=reason, sure=sure))
    return findings


def _by_fields(fit: Fit) -> Array:
    """Return the derivatives of the machine's numbers by the free coordinates."""
    return _slopes(
        fit, lambda p: [each.value for each in numbers_of(fit.shape.machine(p)).values()]
    )


def _products(fit: Fit, spread: _Spread, findings: Sequence[Finding]) -> list[Finding]:
    """Return the numbers of the file that are products of others, with intervals of their own."""
    by_name = {each.quantity.name: each for each in findings}
    numbers, by = numbers_of(fit.shape.machine(fit.p)), _by_fields(fit)
    halves = NORMAL * np.sqrt(np.einsum("qi,ij,qj->q", by, spread.whole, by).clip(0.0))
    by_place = dict(zip(numbers, halves.tolist(), strict=True))
    found: list[Finding] = []
    for field, (unit, *factors) in PRODUCTS.items():
        place = f"clutch.breakaway.{field}"
        value = numbers[place].value
        quantity = Quantity(f"breakaway_{field}", unit, value, abs(value), (place,))
        found.append(
            derived_finding(quantity, by_place[place], [by_name[name] for name in factors])
        )
    return found


def _machines(fit: Fit, spread: _Spread) -> MachineSpread:
    """Return the machines that fit the log: normally distributed, as wide as the intervals."""
    machine, by = fit.shape.machine(fit.p), _by_fields(fit)
    moves = np.flatnonzero(np.abs(by).max(axis=1))
    places = tuple(np.array(list(numbers_of(machine)))[moves].tolist())
    among = by[moves] @ spread.whole @ by[moves].T
    matrix = tuple(tuple(row) for row in (0.5 * (among + among.T)).tolist())
    return MachineSpread(machine=machine, places=places, covariance=matrix)
