"""What the residuals of a fit still tell: score tests.

A test asks how much of a further change of the predicted angles the residuals contain, beyond what
the free coordinates could do instead. Its error is the larger of that by the noise of angles and
forces and of that by a jackknife over windows: noise alone would make everything significant under
a fine encoder. It takes no search. The changes are those of terms that are not searched at first,
and those of each coordinate in one part of the log only: a number that differs between parts is
none of the machine's.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym.tools.identification import parameters as at
from pter_gym.tools.identification.fit import SINGULAR, Fit, jackknife
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import COORDINATES
from pter_gym.tools.identification.windows import ENGAGED, Smoothed, lagged, slip_rows

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LINEAR: Any = np.linalg

SIGNIFICANT = 4.5
"""Amount over its standard error from which it counts: 200 tests mistake one log in 700."""

SIZES = {i: (0.01, 0.03, 0.1, 0.3) if i == at.STRIBECK else (0.1,) for i in at.TERMS}
"""Changes of the coordinates of terms that are tested: one where its size makes no difference."""

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


class Evidence:
    """The residuals of a fit as it is now, and what noise makes of them."""

    def __init__(self, fit: Fit) -> None:
        """Weigh residuals and changes as the fit does."""
        self._fit, self._factors = fit, fit.factors()
        self._residual, self._jacobian = fit.weighed()
        inputs = (*fit.windows.shaken, fit.windows.finer)
        changes = [self._weighed(fit.change(fit.p, other)) for other in inputs]
        self._shaken, self._stepped = np.stack(changes[:-1]), changes[-1]

    def _weighed(self, change: Array) -> Array:
        return self._factors[:, None] * change

    def term(self, i: int, size: float) -> Amount:
        """Test a change of a coordinate that is not searched."""
        change = self._fit.change(self._fit.p + size * np.eye(at.COUNT)[i])
        return self._tested(self._weighed(change))

    def part(self, column: int, part: Flags) -> Amount:
        """Test a change of a free coordinate in a part of the windows only, shape (windows,)."""
        return self._tested(self._jacobian[:, :, column] * part[:, None])

    def _tested(self, change: Array) -> Amount:
        """Return the amount of a weighted change (windows, 2·length) in the residuals."""
        columns = self._jacobian.reshape(-1, self._jacobian.shape[2])
        size = np.sqrt(np.maximum(np.sum(columns**2, axis=0), 1e-30))
        normal = columns.T @ columns / np.outer(size, size) + SINGULAR * np.eye(len(size))
        along: Array = _LINEAR.solve(normal, columns.T @ change.ravel() / size) / size
        own = change - (columns @ along).reshape(change.shape)
        weights = np.sum(own**2, axis=1)
        total = float(weights.sum())
        if total <= 1e-9 * float(np.sum(change**2)) or total == 0.0:
            return Amount(0.0, np.inf, along)
        white = weights @ (self._factors * self._fit.windows.noise) ** 2
        forces = np.sum(np.mean(np.sum(own * self._shaken, axis=2) ** 2, axis=0))
        step = np.sum(own * self._stepped) ** 2
        value = -float(np.sum(own * self._residual)) / total
        changes, _ = jackknife(self._residual + value * own, own[:, :, None])
        error = max(np.sqrt(white + forces + step) / total, np.linalg.norm(changes))
        return Amount(value, float(error), along)


def admit_terms(fit: Fit, kept: dict[int, str]) -> None:
    """Search the terms that the residuals ask for, the most significant first; keep the others.

    Adds to ``kept`` why they are: from which size on the log would show them.
    """
    waiting = [i for i in at.TERMS if i not in fit.free and i not in kept]
    while waiting:
        evidence = Evidence(fit)
        tests = {(i, size): evidence.term(i, size) for i in waiting for size in SIZES[i]}
        significance = {test: _asked(test[0], amount) for test, amount in tests.items()}
        i, size = max(significance, key=lambda test: significance[test])
        if significance[i, size] < SIGNIFICANT:
            kept |= {i: _unseen(fit, i, {n: tests[i, n] for n in SIZES[i]}) for i in waiting}
            return
        fit.p[i] += size * (1.0 if i == at.STRIBECK else tests[i, size].value)
        fit.p = fit.p.clip(at.LOWEST, fit.shape.highest)
        fit.free = sorted([*fit.free, i])
        fit.search()
        waiting.remove(i)


def _asked(i: int, amount: Amount) -> float:
    """Return how significantly residuals ask for a term, some of which cannot be negative."""
    return abs(amount.significance) if at.LOWEST[i] < 0.0 else amount.significance


def _unseen(fit: Fit, i: int, tests: dict[float, Amount]) -> str:
    """Return why a term is kept, by the tests of its sizes."""
    if i == at.STRIBECK:
        sizes = [size for size, test in tests.items() if SIGNIFICANT * test.error <= 1.0]
        shown = min(sizes, default=np.inf)
    else:
        ((size, test),) = tests.items()
        shown = SIGNIFICANT * test.error * size
    if not shown < COORDINATES[i].max_error:
        return COORDINATES[i].unseen
    unit = {at.STRIBECK: "rad/s", at.FALL_RATIO: "% from 1"}.get(i, "N·m")
    scale = {at.FALL_RATIO: 100.0} | dict(zip(at.OFFSET, np.exp(fit.p[:2]), strict=True))
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
    evidence = Evidence(fit)
    for column, i in enumerate(fit.free):
        tests = [(name, evidence.part(column, part)) for name, part in parts]
        name, amount = max(tests, key=lambda test: abs(test[1].significance))
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
    engaged: Flags = np.any(behind[rows] > ENGAGED, axis=1)
    slip = motion.omega @ slip_rows(machine).T
    speed = np.abs(motion.omega[rows]).max(axis=(1, 2))
    braked = (behind * slip)[rows].sum(axis=(1, 2))
    falls = ((behind - log.volts)[rows] > ENGAGED).any(axis=(1, 2))
    halves = {
        "between the halves of the log": windows.first.astype(float),
        "between slow and fast motion": speed,
        "with theta_A": motion.theta[windows.first, 0],
        "with theta_B": motion.theta[windows.first, 1],
    }
    used = windows.used
    parts = [(name, values > np.median(values[used])) for name, values in halves.items()]
    parts += [("with the direction of slip", braked > 0.0), ("where torques fall", falls)]
    parts += [(f"where clutch {x} is on", each) for x, each in enumerate(engaged.T, 1)]
    for name, part in parts:
        if min((used & part).sum(), (used & ~part).sum()) >= MIN_WINDOWS:
            yield name, part
