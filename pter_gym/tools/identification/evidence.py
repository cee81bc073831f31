# pyright: standard
"""What the residuals of a fit still tell: score tests.

A test asks how much of a further change of the predicted angles the residuals contain, beyond what
the free coordinates could do instead. Its error is the larger of that by the noise of angles and
forces and of that by a jackknife over windows: noise alone would make everything significant under
a fine encoder. It takes no search. The changes are those of terms that are not searched at first,
and those of each coordinate in one part of the log only: a number that differs between parts is
none of the machine's.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.tools.identification import parameters as at
from pter_gym.tools.identification.fit import Fit, jackknife, scaled
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import COORDINATES
from pter_gym.tools.identification.windows import ENGAGED, Smoothed, lagged, slip_rows

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LINEAR: Any = np.linalg

SIGNIFICANT = 4.5
"""Amount over its standard error from which it counts: 200 tests mistake one log in 700."""

STRIBECKS = (0.01, 0.03, 0.1, 0.3)
"""Stribeck velocities that are tested [rad/s]; the angles are linear in the other terms."""

MIN_WINDOWS = 8
"""Fewest windows of a part of a log."""


class Amount(NamedTuple):
    """How much of a change residuals contain, its error, and what the free coordinates do of it."""

    value: float
    error: float
    along: Array

    @property
    def significance(self) -> float:
        """The amount over its standard error."""
        return self.value / self.error


def test_of(fit: Fit) -> Callable[[Array], Amount]:
    """Return a test of changes of the angles (windows, 2·length), at a fit as it is now."""
    (residual, jacobian), factors, windows = fit.weighed(), fit.factors()[:, None], fit.windows
    inputs = (windows.finer, *windows.shaken)
    stepped, *shaken = (factors * fit.change(fit.p, each) for each in inputs)
    columns = jacobian.reshape(-1, jacobian.shape[2])
    normal, size = scaled(columns.T @ columns)

    def test(angles: Array) -> Amount:
        change = factors * angles
        along: Array = _LINEAR.solve(normal, columns.T @ change.ravel() / size) / size
        own = change - (columns @ along).reshape(change.shape)
        weights = np.sum(own**2, axis=1)
        total = float(weights.sum())
        if total <= 1e-9 * float(np.sum(change**2)):
            return Amount(0.0, np.inf, along)
        noise = weights @ (factors[:, 0] * windows.noise) ** 2 + np.sum(own * stepped) ** 2
        noise += np.sum(np.mean(np.sum(own * np.stack(shaken), axis=2) ** 2, axis=0))
        value = -float(np.sum(own * residual)) / total
        changes, _ = jackknife(residual + value * own, own[:, :, None])
        error = max(np.sqrt(noise) / total, np.linalg.norm(changes))
        return Amount(value, float(error), along)

    return test


def admit_terms(fit: Fit, kept: dict[int, str]) -> None:
    """Search the terms that the residuals ask for, the most significant first; keep the others.

    Adds to ``kept`` why they are: from which size on the log would show them.
    """
    waiting = [i for i in at.TERMS if i not in fit.free and i not in kept]
    while waiting:
        test, tests = test_of(fit), dict[tuple[int, float], Amount]()
        for i in waiting:
            if i == at.STRIBECK:
                for size in STRIBECKS:
                    tests[i, size] = test(fit.change(fit.p + size * np.eye(at.COUNT)[i]))
            else:
                tests[i, 1.0] = test(fit.here.jacobian[:, :, i])
        asked = {each: _asked(each[0], amount) for each, amount in tests.items()}
        i, size = max(asked, key=lambda each: asked[each])
        if asked[i, size] < SIGNIFICANT:
            kept |= {i: _unseen(fit, i, tests) for i in waiting}
            return
        fit.p[i] += size if i == at.STRIBECK else tests[i, size].value
        fit.p = fit.p.clip(at.LOWEST, fit.shape.highest)
        fit.free = sorted([*fit.free, i])
        fit.search()
        waiting.remove(i)


def _asked(i: int, amount: Amount) -> float:
    """Return how significantly residuals ask for a term, some of which cannot be negative."""
    return abs(amount.significance) if at.LOWEST[i] < 0.0 else amount.significance


def _unseen(fit: Fit, i: int, tests: dict[tuple[int, float], Amount]) -> str:
    """Return why a term is kept, by the tests."""
    errors = {size: amount.error for (term, size), amount in tests.items() if term == i}
    if i == at.STRIBECK:
        shown = min((v for v, error in errors.items() if SIGNIFICANT * error <= 1.0), default=9.0)
    else:
        shown = SIGNIFICANT * errors[1.0]
    if not shown < COORDINATES[i].max_error:
        return COORDINATES[i].unseen
    unit = {at.STRIBECK: "rad/s", at.FALL_RATIO: "% from 1", at.FORCE_DELAY: "ms"}.get(i, "N·m")
    scale = {at.FALL_RATIO: 1e2, at.FORCE_DELAY: 1e3}
    scale |= dict(zip(at.OFFSET, np.exp(fit.p[:2]), strict=True))
    return f"the log does not ask for it, and would show {scale.get(i, 1.0) * shown:.2g} {unit}"


def find_differences(fit: Fit, log: Log, motion: Smoothed) -> dict[str, str]:
    """Return numbers that differ between parts of the log, and where, most significant first.

    Adds to the fit's spread how far coordinates would go if the number had a value of its own in
    the part that tells less of it.
    """
    differences: list[tuple[float, str, str]] = []
    parts = list(_parts(fit, log, motion))
    if not (fit.free and parts):
        return {}
    test = test_of(fit)
    for column, i in enumerate(fit.free):
        angles = fit.here.jacobian[:, :, i]
        tests = [(name, test(angles * part[:, None])) for name, part in parts]
        name, amount = max(tests, key=lambda each: abs(each[1].significance))
        if abs(amount.significance) >= SIGNIFICANT:
            differences.append((abs(amount.significance), COORDINATES[i].quantity, name))
            own = np.eye(len(fit.free))[column] - amount.along
            change = np.zeros(at.COUNT)
            change[fit.free] = amount.value * min(
                own, amount.along, key=lambda way: abs(float(way[column]))
            )
            fit.spread = fit.spread + np.outer(change, change)
    return {quantity: name for _, quantity, name in sorted(differences, reverse=True)}


def _parts(fit: Fit, log: Log, motion: Smoothed) -> Iterator[tuple[str, Flags]]:
    """Yield parts of the windows, with their names, in which the model must hold as in others."""
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
    for x in range(4):
        parts[f"where clutch {x + 1} is on"] = (behind[rows, x] > ENGAGED).any(axis=1)
    for name, part in parts.items():
        if min((windows.used & part).sum(), (windows.used & ~part).sum()) >= MIN_WINDOWS:
            yield name, part
