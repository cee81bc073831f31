"""Identification of a machine from a log: prediction errors over short windows, by least squares.

The angles at the beginning of each window are measured with noise, the velocities are not measured at all. So each
window's start is estimated together with the machine: to first order it is projected out of the residuals and of their
derivatives, which leaves a small dense problem in the machine's coordinates for SciPy's least squares. Then the starts
are mended, windows that fit badly get less weight, and the search goes on.

Intervals come from a jackknife, to first order: how far the coordinates would go without each pair of neighbouring
windows. Residuals of one window are one error that grows, and not many errors. To these comes what changes when the log
is cut, filtered and simulated in another way.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from pter_gym.tools.identification import parameters as at
from pter_gym.tools.identification.parameters import Shape
from pter_gym.tools.identification.shooting import Inputs, predict
from pter_gym.tools.identification.windows import Windows

Array = NDArray[np.float64]

_OPTIMIZE: Any = optimize
_STATS: Any = stats
_LINEAR: Any = np.linalg

ROUNDS = 3
"""Times that starts and weights are mended."""

EVALUATIONS = 12
"""Most evaluations of the residuals in a round."""

BAD = 2.0
"""Residuals of a window over the median of all from which it gets less weight."""

START_STEPS = (1e-3, 1e-3, 2e-2, 2e-2)
"""Steps of the derivatives by the start of a window [rad, rad/s]."""

START_ERRORS = (0.01, 0.01, 0.3, 0.3)
"""How wrong a start may be [rad, rad/s]: keeps what no angle tells from wandering off."""

RATIOS = (1.0, 1.08, 1.18, 1.3, 1.45, 1.6)
"""Ratios of breakaway to dynamic torque that are tried first."""

WEAKEST = 2
"""Directions in which the search looks around."""

DISTANCES = (-40.0, -12.0, -4.0, 4.0, 12.0, 40.0)
"""How far it looks, over the standard error that independent residuals would have."""

SINGULAR = 1e-12
"""What keeps the equations of a start solvable where a prediction went astray, over their trace."""

UNSEEN = 1e6
"""Variance of a coordinate that no window shows."""

BLOCK = 2
"""Windows whose gradients count as one error."""


@dataclass
class Fit:
    """A search and where it is.

    Attributes
    ----------
    windows, shape
        The log, and what coordinates mean.
    free
        Which coordinates are searched; the others stay.
    p
        Coordinates.
    starts
        Of the windows, as they are estimated.
    weights
        Of the windows.
    spread
        Covariance of the coordinates by choices that a result should not depend on, shape (16, 16).
    """

    windows: Windows
    shape: Shape
    free: list[int]
    p: Array
    starts: Array = field(default_factory=lambda: np.empty(0))
    weights: Array = field(default_factory=lambda: np.empty(0))
    spread: Array = field(default_factory=lambda: np.zeros((len(at.NAMES), len(at.NAMES))))
    on_step: Callable[[], None] = lambda: None
    _known: dict[bytes, tuple[Array, Array, Array]] = field(default_factory=dict[bytes, tuple[Array, Array, Array]])

    def __post_init__(self) -> None:
        """Begin with the starts as they were measured."""
        if not len(self.starts):
            self.starts = self.windows.starts.copy()
            self.weights = self.windows.used.astype(float)

    def search(self, rounds: int = ROUNDS) -> "Fit":
        """Search, mend starts and weights, and search again."""
        for left in range(rounds, 0, -1):
            if self.free:
                self._search_once()
            if self.free and left > 1:
                self._look_around()
            residual, _, correction = self._residual(self.p)
            self.starts = self.starts - np.einsum("wij,wj->wi", self._ways, correction)
            size = np.sqrt(np.mean(residual**2, axis=1))
            moving = self.windows.used & (np.abs(self.windows.ways).sum(axis=(1, 2)) > 0.0)
            usual = max(float(np.median(size[moving])) if moving.any() else 0.0, 1e-12)
            self.weights = self.windows.used * np.minimum(1.0, BAD * usual / np.maximum(size, 1e-12))
            self.weights /= 1.0 + self.shaken() / usual**2
            self._known.clear()
        return self

    def _search_once(self) -> None:
        free = self.free

        def residual(x: Array) -> Array:
            return self._scaled(self._residual(self._with(x))[0]).ravel()

        def jacobian(x: Array) -> Array:
            return self._scaled(self.jacobian(self._with(x))).reshape(-1, len(free))

        low, high = at.LOWEST[free], self.shape.highest[free]
        begin = self.p[free].clip(low + 1e-9, high - 1e-9)
        options: Any = {"bounds": (low, high), "x_scale": at.STEPS[free], "max_nfev": EVALUATIONS}
        found = _OPTIMIZE.least_squares(residual, begin, jacobian, xtol=1e-4, ftol=1e-5, **options)
        self.p = self._with(found.x)

    def _look_around(self) -> None:
        """Go on along the directions that the log shows least, if that is better.

        The sum of squares is rough, as clutches break away at whole substeps: in a long flat valley the
        search by derivatives stops early.
        """
        jacobian = self._scaled(self.jacobian(self.p)) * at.STEPS[self.free]
        sizes, ways = np.linalg.eigh(np.einsum("wij,wik->jk", jacobian, jacobian))
        least = self._sum(self.p)
        unit = np.sqrt(least / max(self.weights.sum() * jacobian.shape[1], 1.0))
        for size, way in list(zip(sizes, ways.T, strict=True))[:WEAKEST]:
            long = min(unit / np.sqrt(max(size, 1e-12)), 0.3)
            here = self.p[self.free]
            tried = [self._with(here + k * long * way * at.STEPS[self.free]) for k in DISTANCES]
            tried = [p.clip(at.LOWEST, self.shape.highest) for p in tried]
            sums = [self._sum(p) for p in tried]
            if min(sums) < least:
                least, self.p = min(sums), tried[int(np.argmin(sums))]

    def _sum(self, p: Array) -> float:
        """Return the weighted sum of squares."""
        return float(np.sum(self._scaled(self._residual(p)[0]) ** 2))

    def _with(self, x: Array) -> Array:
        p = self.p.copy()
        p[self.free] = x
        return p

    def _scaled(self, values: Array) -> Array:
        weights = np.sqrt(self.weights) / self.windows.noise
        return values * weights.reshape(-1, *[1] * (values.ndim - 1))

    def predicted(self, p: Array, starts: Array) -> Array:
        """Return the predicted angles [rad], shape (windows, 2·length); what is not finite becomes large."""
        w = self.windows
        machine = self.shape.machine(p)
        angles = predict(machine, w.inputs, float(p[at.DELAY]), starts, w.length)
        return np.nan_to_num(angles.reshape(len(starts), -1), nan=1e3, posinf=1e3, neginf=-1e3)

    @property
    def _ways(self) -> Array:
        """Changes of a start that are admitted, as columns, shape (windows, 4, 4)."""
        ways = np.zeros((len(self.starts), 4, 4))
        ways[:, 0, 0] = ways[:, 1, 1] = 1.0
        ways[:, 2:, 2:] = self.windows.ways
        return ways

    def _residual(self, p: Array) -> tuple[Array, Array, Array]:
        """Return residuals without what a wrong start makes, the derivatives by the start, and how wrong it is."""
        key = p.tobytes()
        if key not in self._known:
            self.on_step()
            ways = self._ways
            off = self.predicted(p, self.starts) - self.windows.measured.reshape(len(self.starts), -1)
            by_start = np.stack(
                [
                    (
                        self.predicted(p, self.starts + e * ways[:, :, j])
                        - self.predicted(p, self.starts - e * ways[:, :, j])
                    )
                    / (2.0 * e)
                    for j, e in enumerate(START_STEPS)
                ],
                axis=-1,
            )
            residual, correction = self._projected(by_start, off[:, :, None])
            if len(self._known) > 3:
                self._known.clear()
            self._known[key] = residual[:, :, 0], by_start, correction[:, :, 0]
        return self._known[key]

    def _projected(self, by_start: Array, values: Array) -> tuple[Array, Array]:
        """Return values (windows, rows, k) without their part along the derivatives by the start; how large it is."""
        normal = np.einsum("wij,wik->wjk", by_start, by_start)
        largest = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        normal += np.diag(self.windows.noise**2 / np.square(START_ERRORS)) + SINGULAR * largest * np.eye(4)
        along: Array = _LINEAR.solve(normal, np.einsum("wij,wik->wjk", by_start, values))
        return values - np.einsum("wij,wjk->wik", by_start, along), along

    def jacobian(self, p: Array) -> Array:
        """Return the derivatives of the residuals by the free coordinates, shape (windows, 2·length, free)."""
        _, by_start, _ = self._residual(p)
        columns: list[Array] = []
        for i in self.free:
            self.on_step()
            ends: list[Array] = []
            for sign in (1.0, -1.0):
                near = p.copy()
                near[i] = np.clip(p[i] + sign * at.STEPS[i], at.LOWEST[i], self.shape.highest[i])
                ends.append(near)
            change = self.predicted(ends[0], self.starts) - self.predicted(ends[1], self.starts)
            columns.append(change / max(ends[0][i] - ends[1][i], 1e-12))
        return self._projected(by_start, np.stack(columns, axis=-1))[0]

    def covariance(self) -> tuple[Array, float]:
        """Return the covariance of the free coordinates, and by what quantile its roots become a 95 % interval."""
        residual = self._scaled(self._residual(self.p)[0])
        jacobian = self._scaled(self.jacobian(self.p))
        gradients = np.einsum("wij,wi->wj", jacobian, residual)
        squares = np.einsum("wij,wik->wjk", jacobian, jacobian)
        first = np.arange(0, len(gradients), BLOCK)
        sums, parts = np.add.reduceat(gradients, first), np.add.reduceat(squares, first)
        information = parts.sum(axis=0)
        told = np.abs(sums).sum(axis=1) > 0.0
        blocks = int(told.sum())
        size = np.sqrt(np.maximum(np.diag(information), 1e-30))
        scale = np.outer(size, size)
        # how far the coordinates would go without each block; a direction that one block alone shows goes far
        without = (information - parts[told]) / scale + SINGULAR * np.eye(len(size))
        changes = _LINEAR.solve(without, (sums[told] / size)[:, :, None])[:, :, 0] / size
        robust: Array = changes.T @ changes
        inverse: Array = _LINEAR.pinv(information / scale, rcond=1e-10, hermitian=True) / scale
        spread = np.sum(residual**2) / max(self.weights.sum() * residual.shape[1], 1.0)
        naive = inverse * spread
        unseen = np.diag(information) * at.STEPS[self.free] ** 2 < 1.0
        robust[np.diag_indices_from(robust)] = np.maximum(np.diag(robust), np.diag(naive))
        robust += self.spread[np.ix_(self.free, self.free)]
        robust[unseen, unseen] = UNSEEN
        return robust, float(_STATS.t.ppf(0.975, max(blocks - len(self.free), 1)))

    def compare(self, others: Sequence[Windows]) -> None:
        """Find the spread: search on with the log cut in other ways."""
        changes = [
            Fit(o, self.shape, self.free, self.p.copy(), on_step=self.on_step).search(1).p - self.p for o in others
        ]
        # the sum, not the mean: so few changes tell their own size badly
        self.spread = np.sum([np.outer(change, change) for change in changes], axis=0)

    def sizes(self) -> Array:
        """Return the root mean square of each window's residuals [rad], shape (windows,)."""
        return np.sqrt(np.mean(self._residual(self.p)[0] ** 2, axis=1))

    def shaken(self) -> Array:
        """Return the mean square [rad²] by which noise of the forces moves each window's angles, shape (windows,)."""
        moved = [self.moved(inputs) for inputs in self.windows.shaken]
        return np.mean(moved, axis=0) if moved else np.zeros(len(self.starts))

    def moved(self, inputs: Inputs) -> Array:
        """Return the mean square change [rad²] of each window's angles with other inputs, shape (windows,)."""
        other = replace(self, windows=replace(self.windows, inputs=inputs))
        change = other.predicted(self.p, self.starts) - self.predicted(self.p, self.starts)
        return np.mean(self._projected(self._residual(self.p)[1], change[:, :, None])[0] ** 2, axis=(1, 2))

    def disagree(self, groups: Sequence[NDArray[np.bool_]]) -> None:
        """Add to the spread how far the coordinates would go if each group of windows were the whole log.

        To first order; the sum, as in ``compare``.
        """
        residual = self._scaled(self._residual(self.p)[0])
        jacobian = self._scaled(self.jacobian(self.p))
        ridge = np.diag(1.0 / np.square(at.IGNORANCE[self.free]) + 1e-9)
        changes = np.zeros((len(groups), len(at.NAMES)))
        for change, group in zip(changes, groups, strict=True):
            information = np.einsum("wij,wik->jk", jacobian[group], jacobian[group])
            gradient = np.einsum("wij,wi->j", jacobian[group], residual[group])
            change[self.free] = -_LINEAR.solve(information + ridge, gradient)
        self.spread = self.spread + changes.T @ changes

    def misfit(self, p: Array) -> float:
        """Return a sum over the windows that no lone window rules."""
        residual = self._residual(p)[0]
        size = np.mean(residual**2, axis=1)[self.windows.used] / self.windows.noise**2
        return float(np.sum(size / (1.0 + size / 100.0)))


def begin(windows: Windows, shape: Shape, free: list[int], p: Array, on_step: Callable[[], None]) -> Fit:
    """Return a search at the best of several ratios of breakaway to dynamic torque."""
    fit = Fit(windows, shape, free, p, on_step=on_step)
    if at.RATIO in free:
        tried = [np.concatenate([p[: at.RATIO], [ratio], p[at.RATIO + 1 :]]) for ratio in RATIOS]
        fit.p = min(tried, key=fit.misfit)
    return fit
