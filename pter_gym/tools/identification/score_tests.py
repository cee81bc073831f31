# pyright: standard
"""Score tests: what the residuals of a fit still show.

A test asks how much of a further change of the predicted angles the residuals contain, beyond what
the free coordinates could do instead. Its error is the larger of that by the noise of angles and
forces and of that by a jackknife over windows: noise alone would make everything significant under
a fine encoder. It takes no search. The changes are those of terms that are not searched at first,
and those of each coordinate in one part of the log only: a number that differs between parts is
none of the machine's.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.tools.identification.fit import Fit, jackknife, scaled
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import AT, LOWEST, SEARCHES, TERMS, along, places
from pter_gym.tools.identification.windows import ENGAGED, Smoothed, comes_again, lagged, slip_rows

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SIGNIFICANT = 4.5
"""Amount over its standard error from which it counts: 200 tests mistake one log in 700."""

STRIBECKS = (0.01, 0.03, 0.1, 0.3)
"""Stribeck velocities that are tested [rad/s]; the angles are linear in the other terms."""

RELEASE = "between rising and falling voltages"

MIN_WINDOWS = 8
"""Fewest windows of a part of a log."""


class Amount(NamedTuple):
    """How much of a change residuals contain, its error, and what the free coordinates do of it."""

    value: float
    error: float
    instead: Array

    @property
    def significance(self) -> float:
        """The amount over its standard error."""
        return self.value / self.error


class Difference(NamedTuple):
    """A number that differs between parts of the log: where, and how far it moves the coordinates.

    ``change`` is the smaller of what its own value in the part and what the rest of the log would
    change, shape (free,).
    """

    name: str
    where: str
    significance: float
    change: Array


def score_test(fit: Fit) -> Callable[[Array], Amount]:
    """Return a test of changes of the angles (windows, 2·length), at a fit as it is now."""
    (residual, jacobian), factors, windows = fit.weighed(), fit.factors[:, None], fit.windows
    inputs = (windows.finer, *windows.shaken)
    stepped, *shaken = (factors * fit.change(fit.p, each) for each in inputs)
    columns = jacobian.reshape(-1, jacobian.shape[2])
    normal, size = scaled(columns.T @ columns)

    def test(angles: Array) -> Amount:
        change = factors * angles
        instead = np.linalg.solve(normal, columns.T @ change.ravel() / size) / size
        own = change - (columns @ instead).reshape(change.shape)
        weights = np.sum(own**2, axis=1)
        total = float(weights.sum())
        if total <= 1e-9 * float(np.sum(change**2)):
            return Amount(0.0, np.inf, instead)
        noise = weights @ (factors[:, 0] * windows.noise) ** 2 + np.sum(own * stepped) ** 2
        noise += np.sum(np.mean(np.sum(own * np.stack(shaken), axis=2) ** 2, axis=0))
        value = -float(np.sum(own * residual)) / total
        changes, _ = jackknife(residual + value * own, own[:, :, None])
        error = max(np.sqrt(noise) / total, np.linalg.norm(changes))
        return Amount(value, float(error), instead)

    return test


def admit_terms(fit: Fit, kept: dict[str, str]) -> None:
    """Search the terms that the residuals ask for, the most significant first; keep the others.

    Adds to ``kept`` why they are: from which size on the log would show them.
    """
    waiting = [name for name in TERMS if name not in fit.free and name not in kept]
    while waiting:
        test, tests = score_test(fit), dict[tuple[str, float], Amount]()
        for name in waiting:
            if name == "stribeck":
                for size in STRIBECKS:
                    tests[name, size] = test(fit.change(fit.p + along(name, size)))
            else:
                tests[name, 1.0] = test(fit.here.jacobian[:, :, AT[name]])
        # a significance below 0 counts only for terms that may be negative
        asked = {
            (name, size): abs(amount.significance)
            if LOWEST[AT[name]] < 0.0
            else amount.significance
            for (name, size), amount in tests.items()
        }
        name, size = max(asked, key=lambda each: asked[each])
        starts = [fit.p + along("stribeck", each) for each in STRIBECKS]
        if asked[name, size] < SIGNIFICANT:
            starts = _nearer(fit, starts) if "stribeck" in waiting else []
            if not starts:
                kept |= {each: _why_unseen(fit, each, tests) for each in waiting}
                return
            name = "stribeck"
        fit.free.append(name)
        if name == "stribeck":  # another ratio of breakaway to dynamic torque explains half of it
            fit.choose_from(starts)
        else:
            fit.p = fit.shape.within(fit.p + along(name, tests[name, size].value))
        fit.search()
        waiting.remove(name)


def _nearer(fit: Fit, starts: Iterable[Array]) -> list[Array]:
    """Return the best of starts at several breakaway ratios, if it fits better than the search.

    The search may have ended at a ratio from which no small step shows the Stribeck effect.
    """
    best = min((fit.p, *map(fit.with_best_ratio, starts)), key=fit.misfit)
    return [] if best is fit.p else [best]


def _why_unseen(fit: Fit, name: str, tests: Mapping[tuple[str, float], Amount]) -> str:
    """Return why a term is kept, by the tests."""
    errors = {size: amount.error for (term, size), amount in tests.items() if term == name}
    if name == "stribeck":
        shown = min((v for v, error in errors.items() if SIGNIFICANT * error <= 1.0), default=9.0)
    else:
        shown = SIGNIFICANT * errors[1.0]
    if not shown < SEARCHES[name].max_error:
        return SEARCHES[name].unseen
    inertias = np.exp(fit.p[places(("inertia_a", "inertia_b"))])
    scale, unit = {
        "stribeck": (1.0, "rad/s"),
        "fall_ratio": (1e2, "% from 1"),
        "force_delay": (1e3, "ms"),
        "off_state": (1.0, "N·m"),
        "offset_a": (inertias[0], "N·m"),
        "offset_b": (inertias[1], "N·m"),
    }[name]
    return f"the log does not require it, and would show {scale * shown:.2g} {unit}"


def differences(fit: Fit, log: Log, motion: Smoothed) -> list[Difference]:
    """Return the numbers that differ between parts of the log, the most significant first."""
    if not fit.free:
        return []
    test = score_test(fit)
    found = [*_between_parts(fit, dict(_parts(fit, log, motion)), test)]
    if "delay" in fit.free:
        found += _at_release(fit, log.interval, test)
    return sorted(found, key=lambda each: -each.significance)


def _between_parts(
    fit: Fit, parts: Mapping[str, Flags], test: Callable[[Array], Amount]
) -> Iterator[Difference]:
    """Yield the numbers that differ in one of the parts."""
    for name, way in zip(fit.free, np.eye(len(fit.free)), strict=True):
        angles = fit.here.jacobian[:, :, AT[name]]
        tests = {where: test(angles * part[:, None]) for where, part in parts.items()}
        if not tests:
            return
        where, amount = max(tests.items(), key=lambda each: abs(each[1].significance))
        if (size := abs(amount.significance)) >= SIGNIFICANT:
            moved = min(way - amount.instead, amount.instead, key=lambda each: abs(each @ way))
            yield Difference(name, where, size, amount.value * moved)


def _at_release(fit: Fit, interval: float, test: Callable[[Array], Amount]) -> Iterator[Difference]:
    """Yield how much later torques fall than they rise, or may fall if the fall ratio hides it."""
    later = 0.5 * interval
    amount = test(fit.change(fit.p, fit.windows.released) / later)
    way, apart = np.eye(len(fit.free))[fit.free.index("delay")], abs(amount.value)
    if (size := abs(amount.significance)) >= SIGNIFICANT:
        yield Difference("delay", RELEASE, size, apart * way)
    elif "fall_ratio" in fit.free and SIGNIFICANT * amount.error > SEARCHES["delay"].max_error:
        yield Difference("delay", f"perhaps {RELEASE}", size, amount.error * way)


def _parts(fit: Fit, log: Log, motion: Smoothed) -> Iterator[tuple[str, Flags]]:
    windows, machine = fit.windows, fit.shape.machine(fit.p)
    rows = windows.first[:, None] + np.arange(windows.length + 1)
    behind = lagged(log, log.volts, machine.clutch.time_constant)
    slip = motion.omega @ slip_rows(machine).T
    halves = {
        "between the halves of the log": windows.first.astype(float),
        "between slow and fast motion": np.abs(motion.omega[rows]).max(axis=(1, 2)),
        "with theta_A": motion.theta[windows.first, 0],
        "with theta_B": motion.theta[windows.first, 1],
    }
    parts = {name: each > np.median(each[windows.used]) for name, each in halves.items()}
    parts["with the direction of slip"] = (behind * slip)[rows].sum(axis=(1, 2)) > 0.0
    parts["where torques fall"] = ((behind - log.volts)[rows] > ENGAGED).any(axis=(1, 2))
    parts["where a voltage comes again"] = comes_again(log)[rows].any(axis=1)
    for x in range(4):
        parts[f"where clutch {x + 1} is on"] = (behind[rows, x] > ENGAGED).any(axis=1)
    for name, part in parts.items():
        if min((windows.used & part).sum(), (windows.used & ~part).sum()) >= MIN_WINDOWS:
            yield name, part
