"""From a log to a machine: what is identified, how well, and what the log does not show."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.errors import ParameterError
from pter_gym.params import SLOTS, Machine, find_machine
from pter_gym.tools.identification import parameters as at
from pter_gym.tools.identification import reasons
from pter_gym.tools.identification.balance import SLIPPING, first_estimate
from pter_gym.tools.identification.estimation import Fit, begin
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import Quantity, Shape, quantities
from pter_gym.tools.identification.verdict import Verdict, judge
from pter_gym.tools.identification.windows import ENGAGED, OTHERS, Motion, cut, holding, lagged, slip_rows, smooth

Array = NDArray[np.float64]

SURE = 0.05
"""Half of the 95 % interval over the scale, up to which a number counts as identified."""

SEEN = 0.1
"""How long a clutch has to slip at a voltage for the log to show it [s]."""

ENOUGH = 0.3
"""How long it has to slip in all [s]."""

FEWEST_LEVELS = 3
"""Fewest voltages that tell a straight segment from a quadratic one."""

STEPS_IN_ALL = 45
"""About how many steps of progress an identification takes."""

TORQUES = ("torque_25", "torque_50", "torque_75", "torque_100")

ALONG = 0.2
"""Share of the largest change, over the numbers' scales, from which a number is part of what a log leaves open."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One number of the result.

    Attributes
    ----------
    quantity
        Name, unit, meaning, value and scale.
    low, high
        95 % interval, in the unit; equal to the value where that was kept.
    before
        Value of the start.
    status
        ``identified``: within ±5 % of its scale, by a model that explains the log. ``uncertain``: used, but less sure.
        ``kept``: the log does not show it, so it is that of the start.
    relative
        Whether it is known only relative to the inertia of link A, as the log has no forces.
    reason, remedy
        Why it is kept, and what experiment would show it.
    """

    quantity: Quantity
    low: float
    high: float
    before: float
    status: str
    relative: bool = False
    reason: str = ""
    remedy: str = ""

    @property
    def share(self) -> float:
        """Half of the interval over the scale."""
        return 0.5 * (self.high - self.low) / max(self.quantity.scale, 1e-300)

    @property
    def state(self) -> str:
        """The status in words."""
        return self.status + (", relative" if self.relative else "")


@dataclass(frozen=True, kw_only=True)
class Identification:
    """What a log tells of a machine.

    Attributes
    ----------
    log, start
        What was given.
    machine
        The start with what was identified.
    delay
        From a recorded voltage to the motion that it makes [s].
    findings
        The numbers, in the order of ``quantities``.
    fit
        The windows and how well they are predicted.
    verdict
        Whether the model explains the log, and where it does not.
    slipped
        How long each clutch slipped while it was on [s], shape (4,).
    breakaways
        How often each clutch broke away, shape (4,).
    """

    log: Log
    start: Machine
    machine: Machine
    delay: float
    findings: list[Finding]
    fit: Fit
    verdict: Verdict
    slipped: Array
    breakaways: NDArray[np.int64]

    @property
    def residuals(self) -> Array:
        """Measured less predicted angles [rad], shape (windows, length, 2); NaN for windows that are not used."""
        windows = self.fit.windows
        off = windows.measured - self.fit.predicted(self.fit.p).reshape(windows.measured.shape)
        return np.where(windows.used[:, None, None], off, np.nan)


def identify(
    log: Log, start: Machine | str | None = None, on_progress: Callable[[float], None] = lambda _: None
) -> Identification:
    """Identify a machine from a log.

    Parameters
    ----------
    log
        With forces; or without, but with ``free``: then stretches are used in which nobody touches the handle, and
        inertias and torques are found relative to the inertia of link A, which is that of the start.
    start
        The machine, its name or its preset: link lengths, the largest voltage, and what the log does not show.
    on_progress
        Called with how much of the work is done, 0 to 1.

    Raises
    ------
    ParameterError
        If the log has neither forces nor ``free``, a voltage exceeds the largest of the start or is of a clutch that it
        has not, or nothing moves.
    """
    start = find_machine(start)
    motion = _checked(log, start)
    slipped, top = experience(log, motion, start)
    live = tuple(int(x) for x in np.flatnonzero(slipped >= ENOUGH))
    shape = Shape(start, top, live=live)
    p = first_estimate(log, motion, shape)
    windows = cut(log, motion, start, float(np.exp(p[at.TIME_CONSTANT])))
    breakaways = count_breakaways(log, motion, start)
    why = _hopeless(log, live, breakaways)
    if levels(log, motion, start) < FEWEST_LEVELS:
        shape = replace(shape, kept_knee=start.clutch.dynamic.knee)
        why |= dict.fromkeys((at.EXTRA, at.KNEE), reasons.FEW_LEVELS)
    before = shape.coordinates(start)
    p[list(why)] = before[list(why)]
    taken = 0

    def step() -> None:
        nonlocal taken
        taken += 1
        on_progress(min(taken / STEPS_IN_ALL, 1.0))

    free = [i for i in range(len(at.NAMES)) if i not in why]
    fit = begin(windows, shape, free, p, step).search()
    unsure = _without_unseen(fit, why, before)
    fit.compare([cut(log, motion, start, float(np.exp(fit.p[at.TIME_CONSTANT])), other) for other in OTHERS])
    verdict, groups = judge(fit, log, motion)
    if fit.free and not verdict.explained:
        fit.disagree(groups)
    on_progress(1.0)
    return Identification(
        log=log,
        start=start,
        machine=fit.shape.machine(fit.p),
        delay=float(fit.p[at.DELAY]),
        findings=_findings(fit, why, unsure if verdict.explained else None, log),
        fit=fit,
        verdict=verdict,
        slipped=slipped,
        breakaways=breakaways,
    )


def _checked(log: Log, start: Machine) -> Motion:
    """Return the motion of a log, or raise a ParameterError."""
    if log.force is None and (log.free is None or not log.free.any()):
        raise ParameterError(
            "log must have the columns F_x and F_y, or free with 1 where nobody touches the handle: "
            "otherwise what the hand does and what the machine does cannot be told apart"
        )
    if log.volts.max() > start.clutch.voltage_max:
        raise ParameterError(
            f"log: voltages must be at most voltage_max of the machine, {start.clutch.voltage_max:g} V, "
            f"got {log.volts.max():g}: are these volts?"
        )
    there = len(start.clutches)
    if log.volts[:, there:].any():
        raise ParameterError(f"log: voltages from V{there + 1} on must be 0: the machine has {there} clutches")
    motion = smooth(log)
    if np.abs(motion.omega).max() < SLIPPING:
        raise ParameterError(f"log: theta_A or theta_B must move faster than {SLIPPING:g} rad/s somewhere")
    return motion


def experience(log: Log, motion: Motion, start: Machine) -> tuple[Array, float]:
    """Return how long each clutch slipped while it was on [s], and the highest voltage at which one slipped [V]."""
    behind = lagged(log, log.volts, start.clutch.time_constant)
    slips = (np.abs(motion.omega @ slip_rows(start).T) > SLIPPING) & (behind > ENGAGED)
    if log.force is None and log.free is not None:
        slips &= log.free[:, None]
    at_work = np.sort(np.where(slips, np.minimum(behind, log.volts), 0.0).ravel())
    enough = round(SEEN / log.interval)
    top = float(at_work[-enough]) if len(at_work) > enough else 0.0
    if top <= ENGAGED:
        top = max(float(log.volts.max()), 1.0)
    nearest = log.volts[(log.volts >= top) & (log.volts <= 1.15 * top)]
    return log.interval * slips.sum(axis=0), float(nearest.min()) if len(nearest) else top


def levels(log: Log, motion: Motion, start: Machine) -> int:
    """Return at how many voltages, at least half a volt apart, clutches slipped."""
    slips = (np.abs(motion.omega @ slip_rows(start).T) > SLIPPING) & (log.volts > ENGAGED)
    slips &= lagged(log, log.volts, start.clutch.time_constant) > 0.5 * log.volts
    _, counts = np.unique(np.round(2.0 * log.volts[slips]), return_counts=True)
    return int((counts * log.interval >= SEEN).sum())


def count_breakaways(log: Log, motion: Motion, start: Machine) -> NDArray[np.int64]:
    """Return how often each clutch held and then slipped while it was on."""
    rows = np.arange(0, len(log.theta), max(1, motion.half // 2))
    held, _ = holding(log, motion, start, start.clutch.time_constant, rows)
    behind = lagged(log, log.volts, start.clutch.time_constant)[rows]
    slips = (np.abs(motion.omega @ slip_rows(start).T)[rows] > SLIPPING) & (behind > ENGAGED)
    state = np.where(held, 1, np.where(slips, 2, 0))
    events = np.zeros(SLOTS, np.int64)
    for x in range(SLOTS):
        told = state[state[:, x] > 0, x]
        events[x] = int(((told[:-1] == 1) & (told[1:] == 2)).sum())
    return events


def _hopeless(log: Log, live: tuple[int, ...], breakaways: NDArray[np.int64]) -> dict[int, str]:
    """Return the coordinates that a log cannot show, each with the reason."""
    why: dict[int, str] = {}
    if log.force is None:
        why[at.INERTIA_A] = reasons.NO_FORCES
        why[at.RATIO] = reasons.NO_FORCES_RATIO
    elif not breakaways.any():
        why[at.RATIO] = reasons.NO_BREAKAWAY
    for x, place in enumerate(at.SLOPES):
        if x not in live:
            why[place] = reasons.NEVER_SLIPPED.format(x + 1)
    if (log.volts == log.volts[0]).all():
        why |= dict.fromkeys((at.TIME_CONSTANT, at.DELAY), reasons.NO_STEPS)
    if not live:
        why |= dict.fromkeys((at.EXTRA, at.KNEE, at.RATIO, at.TIME_CONSTANT, at.DELAY), reasons.NO_CLUTCH)
    return why


def _without_unseen(fit: Fit, why: dict[int, str], before: Array) -> set[str]:
    """Search without coordinates that the log does not show, which keep their values; add the reasons.

    Returns the names of numbers that it shows only in combination with one that is kept.
    """
    unsure: set[str] = set()
    while fit.free:
        covariance, _ = fit.covariance()
        errors = dict(zip(fit.free, np.sqrt(np.diag(covariance)), strict=True))
        if at.EXTRA in fit.free and _is_straight(fit, errors[at.EXTRA]):
            why |= dict.fromkeys((at.EXTRA, at.KNEE), reasons.STRAIGHT.format(fit.shape.top))
            knee = max(fit.shape.start.clutch.dynamic.knee, fit.shape.top)
            fit.shape = replace(fit.shape, kept_knee=knee)
        else:
            excess = {i: errors[i] / at.IGNORANCE[i] for i in fit.free if i != at.EXTRA}
            excess |= {at.RATIO: math.inf} if fit.without_jump else {}
            worst = max(excess, key=lambda i: excess[i]) if excess else 0
            if not excess or excess[worst] <= 1.0:
                break
            together = _left_open(fit, worst)
            why[worst], fit.p[worst] = reasons.unseen(worst, fit.p[worst], before[worst])
            if together:
                shown = (f"{name} {change:+.2g} %" for name, change in together.items() if name not in TORQUES)
                why[worst] += reasons.TOGETHER.format(", ".join(shown))
                unsure |= set(together)
        fit.free = [i for i in fit.free if i not in why]
        fit.search(1)
    return unsure


def _left_open(fit: Fit, worst: int) -> dict[str, float]:
    """Return the changes of numbers [%] that together are hardly seen, if a coordinate is not unseen by itself."""
    way = fit.weakest()
    if abs(way[worst]) < ALONG * at.STEPS[worst]:
        return {}
    high, low = (_numbers(fit, (fit.p + e * way).clip(at.LOWEST, fit.shape.highest)) for e in (1.0, -1.0))
    changes = {a.name: (a.value - b.value) / max(a.scale, 1e-300) for a, b in zip(high, low, strict=True)}
    largest = max(map(abs, changes.values()))
    found = {name: change / largest for name, change in changes.items() if abs(change) > ALONG * largest}
    alone = set(found) <= {reasons.NAMES[worst], "slope", *TORQUES}
    return {} if alone or len(found) < 2 else found


def _is_straight(fit: Fit, error: float) -> bool:
    """Tell whether nothing is seen of the curve's quadratic segment."""
    extra = abs(float(fit.p[at.EXTRA]))
    return not extra > max(2.0 * error, 0.01 * fit.shape.top)


def _numbers(fit: Fit, p: Array) -> list[Quantity]:
    return quantities(fit.shape.machine(p), float(p[at.DELAY]), fit.shape.top)


def _findings(fit: Fit, why: dict[int, str], unsure: set[str] | None, log: Log) -> list[Finding]:
    """Return the numbers with their intervals; ``unsure`` is None if the model does not explain the log."""
    here = _numbers(fit, fit.p)
    start = quantities(fit.shape.start, 0.0, fit.shape.top)
    covariance, quantile = fit.covariance() if fit.free else (np.empty((0, 0)), 2.0)
    columns: list[Array] = []
    for i in fit.free:
        unit = np.eye(len(fit.p))[i]
        ends = [(fit.p + e * at.STEPS[i] * unit).clip(at.LOWEST, fit.shape.highest) for e in (1e-3, -1e-3)]
        width = float(ends[0][i] - ends[1][i])
        columns.append(
            np.array([(a.value - b.value) / width for a, b in zip(*(_numbers(fit, p) for p in ends), strict=True)])
        )
    slopes = np.stack(columns, axis=1) if columns else np.zeros((len(here), 0))
    errors = quantile * np.sqrt(np.maximum(np.einsum("qi,ij,qj->q", slopes, covariance, slopes), 0.0))
    kept = {name: why[i] for name, i in reasons.OWNERS.items() if i in why}
    if "knee" in kept:
        kept["curvature"] = kept["knee"]
    if not fit.shape.live:
        kept |= {q.name: reasons.NO_CLUTCH for q in here if q.name.startswith(("torque_", "slope"))}
    found: list[Finding] = []
    for q, before, error, by_free in zip(here, start, errors, slopes, strict=True):
        reason = kept.get(q.name, "") or ("" if by_free.any() else reasons.UNMOVED)
        sure = unsure is not None and q.name not in unsure and error <= SURE * q.scale
        found.append(
            Finding(
                quantity=q,
                low=max(q.value - (0.0 if reason else float(error)), q.least),
                high=q.value + (0.0 if reason else float(error)),
                before=before.value,
                status="kept" if reason else "identified" if sure else "uncertain",
                relative=log.force is None and q.name in reasons.SCALED and not reason,
                reason=reason,
                remedy=reasons.remedy(q.name) if reason or (unsure is not None and not sure) else "",
            )
        )
    return found
