# pyright: standard
"""From a log to a machine: what is identified, how well, and what the log does not show."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.params import Machine, MachineSpread, find_machine
from pter_gym.params._spread import numbers_of
from pter_gym.tools.identification.findings import Finding, make_finding, origins_of
from pter_gym.tools.identification.first_estimate import first_estimate
from pter_gym.tools.identification.fit import UNSEEN, Fit
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import (
    AT,
    CLUTCH_TERMS,
    NAMES,
    SCALES,
    SEARCHES,
    TERMS,
    Shape,
    places,
    quantities,
)
from pter_gym.tools.identification.score_tests import admit_terms, compare_parts, parts_of
from pter_gym.tools.identification.verdict import MAX_FAR, NEITHER, Verdict, judge
from pter_gym.tools.identification.windows import SLIPPING, Smoothed, cut, experience, smooth

Array = NDArray[np.float64]

MIN_SLIPPING, MIN_LEVELS = 0.3, 3
"""How long a clutch has to slip in all for its torque to be identified [s]; fewest voltages that
tell a straight segment from a quadratic one."""

NORMAL = 1.96
"""Half of the 95 % interval of a normal distribution, in standard deviations."""

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
    """What a log tells of a machine.

    Attributes
    ----------
    log, start
        What was given.
    machine
        The start with what was identified, and the delay from a recorded voltage to the motion that
        it makes.
    machines
        The machine and those that fit the log as well; the machine alone if the model does not
        describe the log.
    findings
        The numbers, in the order of ``quantities``.
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
    fit: Fit
    verdict: Verdict

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What no log of this kind shows, as sentences."""
        clutch, (a, b) = self.start.clutch, self.fit.shape.offsets(self.fit.p)
        late = 1e3 * self.fit.p[AT["force_delay"]]
        return (
            "The force sensor's gain is exact: all inertias and torques are proportional to it.",
            f"Links are {self.start.arm.length_a:g} m and {self.start.arm.length_b:g} m long.",
            f"Clutches drag with {clutch.viscous:g} N·m·s: more is viscous friction of the axes.",
            f"Constant torques on the axes, {a:.3g} and {b:.3g} N·m, are not in the file.",
            f"The delay of the recorded forces, {late:.2g} ms, is not in the file either.",
            f"Clutches lose {100.0 * clutch.fade:g} % of their torque per joule, as warm as here.",
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
        return dict.fromkeys(stated, ASSUMED) | origins_of(self.findings, self.log.name)


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
        If a voltage exceeds the largest of the start or is of a clutch that it has not, or nothing
        moves.
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
    verdict = judge(fit, compare_parts(fit, parts_of(fit, log, motion)), log)
    on_progress(1.0)
    findings, machines = _results(fit, kept, tied, verdict)
    return Identification(
        log=log,
        start=start,
        machine=fit.shape.machine(fit.p),
        machines=machines,
        findings=findings,
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

    Returns the names of numbers that it shows only in combination with one that is kept.
    """
    tied: set[str] = set()
    while fit.free:
        errors = dict(zip(fit.free, np.sqrt(np.diag(fit.covariance()[0])), strict=True))
        least = max(2.0 * errors.get("curvature", math.inf), 0.01 * fit.shape.top)
        if "curvature" in fit.free and not abs(fit.p[AT["curvature"]]) > least:
            kept |= dict.fromkeys(("curvature", "knee"), SEARCHES["curvature"].unseen)
            knee = max(fit.shape.start.clutch.dynamic.knee, fit.shape.top)
            fit.shape = replace(fit.shape, kept_knee=knee)
        else:
            excess = {name: errors[name] / SEARCHES[name].max_error for name in fit.free}
            excess |= {"breakaway_ratio": math.inf} if fit.has_no_jump else {}
            worst = max(excess, key=lambda name: excess[name])
            if excess[worst] <= 1.0:
                break
            together = fit.tied_to(worst) if errors[worst] ** 2 < UNSEEN else set()
            kept[worst] = SEARCHES[worst].unseen
            if together:
                kept[worst] += f"; only together with {', '.join(sorted(together))}"
                tied |= together
            tied |= {"curvature"} if worst == "knee" else set()
            if worst == "breakaway_ratio" and fit.p[AT[worst]] <= 1.03:
                fit.p[AT[worst]] = min(before[AT[worst]], 1.0)
            elif worst != "knee":
                fit.p[AT[worst]] = before[AT[worst]]
        fit.free = [name for name in fit.free if name not in kept]
        fit.search(1)
    return tied


def _slopes(fit: Fit, numbers: Callable[[Array], list[float]]) -> Array:
    """Return the derivatives of numbers by the free coordinates, shape (numbers, free)."""
    slopes = np.empty((len(numbers(fit.p)), len(fit.free)))
    for column, name in zip(slopes.T, fit.free, strict=True):
        high, low = fit.shape.around(fit.p, name, 1e-3)
        column[:] = np.subtract(numbers(high), numbers(low)) / (high - low)[AT[name]]
    return slopes


def _results(
    fit: Fit, kept: dict[str, str], tied: set[str], verdict: Verdict
) -> tuple[list[Finding], Machine | MachineSpread]:
    """Return the numbers with their intervals, and the machines that fit the log.

    These are normally distributed, with the intervals' widths: errors of the model widen each
    coordinate by itself, by what they do to its number.
    """
    shape, here, machine = fit.shape, fit.shape.quantities(fit.p), fit.shape.machine(fit.p)
    covariance, quantile = fit.covariance() if fit.free else (np.empty((0, 0)), 2.0)
    for each in verdict.differences:
        covariance = covariance + np.outer(each.change, each.change)
    slopes = _slopes(fit, lambda p: [q.value for q in shape.quantities(p)])
    variances = np.einsum("qi,ij,qj->q", slopes, covariance, slopes).clip(0.0)
    wide = np.maximum([verdict.share * q.scale for q in here], fit.bias(slopes, verdict.left))
    halves = np.hypot(quantile * np.sqrt(variances), wide)
    unsure = tied | {each.name for each in verdict.differences}
    unsure |= {"breakaway_ratio"} if verdict.far_breakaways > MAX_FAR else set()
    if unsure.intersection(SCALES):  # the others are relative to a mean that is none
        unsure |= {*SCALES, *TORQUES}
    unsure |= TORQUES if verdict.one_way else set()
    unsure |= {q.name for q in here} if verdict.grade == NEITHER else set()
    start = quantities(shape.start, 0.0, shape.top)
    findings: list[Finding] = []
    for q, first, half, by_free in zip(here, start, halves.tolist(), slopes, strict=True):
        unmoved = "" if by_free.any() else "the log shows none of the numbers from which it follows"
        reason = kept.get(q.name, unmoved)
        sure = q.name not in unsure
        findings.append(make_finding(q, half, first.value, reason=reason, sure=sure))
    if not fit.free or verdict.grade == NEITHER:
        return findings, machine
    names = [q.name for q in here]
    rows = [names.index(name) for name in fit.free]
    rates = np.abs(slopes[rows, range(len(rows))])
    model = np.divide(wide[rows], rates, out=np.zeros_like(rates), where=rates > 0.0)
    whole = (quantile**2 * covariance + np.diag(model**2)) / NORMAL**2
    by = _slopes(fit, lambda p: [number.value for number in numbers_of(shape.machine(p)).values()])
    moves = np.flatnonzero(np.abs(by).max(axis=1))
    fields = tuple(np.array(list(numbers_of(machine)))[moves].tolist())
    among = by[moves] @ whole @ by[moves].T
    matrix = tuple(tuple(row) for row in (0.5 * (among + among.T)).tolist())
    return findings, MachineSpread(machine=machine, places=fields, covariance=matrix)
