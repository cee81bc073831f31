"""Identification of a machine from a log: prediction errors over short windows, by least squares.

The angles at the beginning of each window are measured with noise, the velocities are not measured at all. So each
window's start is estimated together with the machine: to first order it is projected out of the residuals and of their
derivatives, which leaves a small dense problem in the machine's coordinates for Gauss–Newton. The derivatives are
exact: a simulation carries them along. Then the starts are mended, windows that fit badly get less weight, and the
search goes on.

Intervals come from a jackknife, to first order: how far the coordinates would go without each pair of neighbouring
windows. Residuals of one window are one error that grows, and not many errors. To these comes what changes when the log
is cut, filtered and simulated in another way.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pter_gym.tools.identification import parameters as at
from pter_gym.tools.identification.parameters import Shape
from pter_gym.tools.identification.shooting import Inputs, differentiate, predict
from pter_gym.tools.identification.windows import Windows

Array = NDArray[np.float64]

_STATS: Any = stats
_LINEAR: Any = np.linalg

ROUNDS = 3
"""Times that starts and weights are mended."""

ITERATIONS = 8
"""Most Gauss–Newton steps in a round."""

DAMPINGS = (1e-6, 1e-2, 0.3, 10.0)
"""Of a step, over the information on each coordinate: tried until the sum is less."""

CLOSE = 1e-5
"""Share of the sum that ends a round if a step gains less."""

BAD = 4.0
"""Residuals of a window over the median of all at which it has a quarter of the weight."""

START_ERRORS = (0.01, 0.01, 0.3, 0.3)
"""How wrong a start may be [rad, rad/s]: keeps what no angle tells from wandering off."""

LEAST_RATIO = 1.001
"""Ratio of breakaway to dynamic torque from which the search goes up: at 1 and below nothing depends on it."""

RATIOS = (1.02, 1.08, 1.18, 1.3, 1.45, 1.6)
"""Ratios that are tried at first, and where the search has come down to the least."""

SINGULAR = 1e-12
"""What keeps the equations of a start solvable where a prediction went astray, over their trace."""

NULL = 1e-10
"""Information along a null vector, over the largest: all that its coordinates may do is then unknown."""

UNSEEN = 1e6
"""Variance of a coordinate that no window shows."""

BLOCK = 2
"""Windows whose gradients count as one error."""


class Point(NamedTuple):
    """What one simulation of all windows tells.

    Attributes
    ----------
    residual, jacobian
        Less what a wrong start makes [rad], and by all coordinates, shapes (windows, 2·length) and (…, 16).
    by_start
        Derivatives of the angles by the admitted changes of a start, shape (windows, 2·length, 4).
    correction
        How wrong each start is, shape (windows, 4).
    """

    residual: Array
    jacobian: Array
    by_start: Array
    correction: Array


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
        Of the windows, by what noise of the forces makes of them.
    usual
        Root mean square of a usual window's residuals [rad].
    spread
        Covariance of the coordinates by choices that a result should not depend on, shape (16, 16).
    """

    windows: Windows
    shape: Shape
    free: list[int]
    p: Array
    starts: Array = field(default_factory=lambda: np.empty(0))
    weights: Array = field(default_factory=lambda: np.empty(0))
    usual: float = 1.0
    spread: Array = field(default_factory=lambda: np.zeros((len(at.NAMES), len(at.NAMES))))
    on_step: Callable[[], None] = lambda: None
    _known: dict[bytes, Point] = field(default_factory=dict[bytes, Point])

    def __post_init__(self) -> None:
        """Begin with the starts as they were measured."""
        if not len(self.starts):
            self.starts = self.windows.starts.copy()
            self.weights = self.windows.used.astype(float)

    def search(self, rounds: int = ROUNDS) -> "Fit":
        """Search, mend starts and weights, and search again."""
        for _ in range(rounds):
            if self.without_jump:
                self.choose_ratio()
            self.usual = self._usual()
            if self.free:
                self._search_once()
            self.usual = self._usual()
            self.weights = self.windows.used / (1.0 + self.shaken() / self.usual**2)
            self.starts = self.starts - np.einsum("wij,wj->wi", self._ways, self._at(self.p).correction)
            self._known.clear()
        return self

    @property
    def without_jump(self) -> bool:
        """Whether the ratio of breakaway to dynamic torque is as small as can be."""
        return bool(at.RATIO in self.free and self.p[at.RATIO] <= LEAST_RATIO + 1e-6)

    def choose_ratio(self) -> None:
        """Take the best of several ratios of breakaway to dynamic torque, if it is searched."""
        if at.RATIO in self.free:
            tried = [np.concatenate([self.p[: at.RATIO], [r], self.p[at.RATIO + 1 :]]) for r in RATIOS]
            self.p = min([self.p, *tried], key=self.misfit)

    def _usual(self) -> float:
        """Return the median root mean square of the residuals of windows in which something moves [rad]."""
        moving = self.windows.used & (np.abs(self.windows.ways).sum(axis=(1, 2)) > 0.0)
        return max(float(np.median(self.sizes()[moving])) if moving.any() else 0.0, 1e-12)

    def _search_once(self) -> None:
        """Go down by damped Gauss–Newton steps within the bounds."""
        lowest = np.where(np.arange(len(self.p)) == at.RATIO, LEAST_RATIO, at.LOWEST)
        low, high = lowest[self.free] + 1e-9, self.shape.highest[self.free] - 1e-9
        self.p = self._with(self.p[self.free].clip(low, high))
        for _ in range(ITERATIONS):
            here = self._at(self.p)
            x, least = self.p[self.free], self._sum(here.residual)
            residual, jacobian = self._weighed(here)
            gradient = np.einsum("wij,wi->j", jacobian, residual)
            information = np.einsum("wij,wik->jk", jacobian, jacobian, optimize=True)
            inside = ~((x <= low) & (gradient > 0.0) | (x >= high) & (gradient < 0.0))
            told = np.diag(information) + 1e-9 / at.STEPS[self.free] ** 2
            for damping in DAMPINGS:
                damped = (information + np.diag(damping * told))[np.ix_(inside, inside)]
                step = np.zeros(len(x))
                step[inside] = -_LINEAR.solve(damped, gradient[inside])
                tried = self._with((x + step).clip(low, high))
                total = self._sum(self._near(tried))
                if total < least:
                    break
            else:
                return
            self.p = tried
            if total > (1.0 - CLOSE) * least:
                return

    def _with(self, x: Array) -> Array:
        p = self.p.copy()
        p[self.free] = x
        return p

    def _told(self, residual: Array) -> Array:
        """Return how much of each window's sum of squares counts: no lone window rules, shape (windows,)."""
        return 1.0 / (1.0 + np.mean(residual**2, axis=1) / (BAD * self.usual) ** 2)

    def _sum(self, residual: Array) -> float:
        """Return what the search makes small."""
        sums = np.sum((residual / self.windows.noise) ** 2, axis=1)
        return float(np.sum(self.weights * self._told(residual) * sums))

    def _weighed(self, here: Point) -> tuple[Array, Array]:
        """Return residuals and their derivatives by the free coordinates, times the roots of the windows' weights."""
        weights = np.sqrt(self.weights) * self._told(here.residual) / self.windows.noise
        return weights[:, None] * here.residual, weights[:, None, None] * here.jacobian[:, :, self.free]

    def predicted(self, p: Array, inputs: Inputs | None = None) -> Array:
        """Return the predicted angles [rad], shape (windows, 2·length); what is not finite becomes large."""
        w = self.windows
        angles = predict(self.shape.machine(p), inputs or w.inputs, float(p[at.DELAY]), self.starts, w.length)
        return _finite(angles.reshape(len(self.starts), -1))

    @property
    def _ways(self) -> Array:
        """Changes of a start that are admitted, as columns, shape (windows, 4, 4)."""
        ways = np.zeros((len(self.starts), 4, 4))
        ways[:, 0, 0] = ways[:, 1, 1] = 1.0
        ways[:, 2:, 2:] = self.windows.ways
        return ways

    def _at(self, p: Array) -> Point:
        """Return what a simulation at coordinates tells."""
        key = p.tobytes()
        if key not in self._known:
            self.on_step()
            w, rows = self.windows, self.windows.measured[0].size
            angles, by, by_start = differentiate(self.shape, p, w.inputs, self.starts, w.length)
            off = _finite(angles.reshape(-1, rows)) - w.measured.reshape(-1, rows)
            by_start = np.nan_to_num(by_start.reshape(-1, rows, 4)) @ self._ways
            told = np.concatenate([off[:, :, None], np.nan_to_num(by.reshape(-1, rows, by.shape[-1]))], axis=2)
            left, along = self._projected(by_start, told)
            if len(self._known) > 3:
                self._known.clear()
            self._known[key] = Point(left[:, :, 0], left[:, :, 1:], by_start, along[:, :, 0])
        return self._known[key]

    def _projected(self, by_start: Array, values: Array) -> tuple[Array, Array]:
        """Return values (windows, rows, k) without their part along the derivatives by the start; how large it is."""
        across = np.swapaxes(by_start, 1, 2)
        normal = across @ by_start
        largest = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        normal += np.diag(self.windows.noise**2 / np.square(START_ERRORS)) + SINGULAR * largest * np.eye(4)
        along: Array = _LINEAR.solve(normal, across @ values)
        return values - by_start @ along, along

    def _near(self, p: Array, inputs: Inputs | None = None) -> Array:
        """Return the residuals [rad] at other coordinates or inputs, with the derivatives by the start of here."""
        here = self._at(self.p)
        off = self.predicted(p, inputs) - self.windows.measured.reshape(here.residual.shape)
        return self._projected(here.by_start, off[:, :, None])[0][:, :, 0]

    def covariance(self) -> tuple[Array, float]:
        """Return the covariance of the free coordinates, and by what quantile its roots become a 95 % interval."""
        residual, jacobian = self._weighed(self._at(self.p))
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
        sizes, ways = np.linalg.eigh(information / scale)
        inverse = (ways / np.maximum(sizes, NULL * sizes.max(initial=0.0)) @ ways.T) / scale
        spread = np.sum(residual**2) / max(self.weights.sum() * residual.shape[1], 1.0)
        naive = inverse * spread
        unseen = np.diag(information) * at.STEPS[self.free] ** 2 < 1.0
        robust[np.diag_indices_from(robust)] = np.maximum(np.diag(robust), np.diag(naive))
        robust += self.spread[np.ix_(self.free, self.free)]
        robust[unseen, unseen] = UNSEEN
        return robust, float(_STATS.t.ppf(0.975, max(blocks - len(self.free), 1)))

    def weakest(self) -> Array:
        """Return the null vector of the information, or what is nearest to one: a change of coordinates, shape (16,).

        The log tells least about changes along it; the largest of them is one of ``parameters.STEPS``.
        """
        jacobian = self._weighed(self._at(self.p))[1] * at.STEPS[self.free]
        _, ways = np.linalg.eigh(np.einsum("wij,wik->jk", jacobian, jacobian, optimize=True))
        way = np.zeros(len(at.NAMES))
        way[self.free] = ways[:, 0] / ways[np.abs(ways[:, 0]).argmax(), 0]
        return way * at.STEPS

    def compare(self, others: Sequence[Windows]) -> None:
        """Find the spread: search on with the log cut in other ways."""
        changes = [
            Fit(o, self.shape, self.free, self.p.copy(), on_step=self.on_step).search(1).p - self.p for o in others
        ]
        # the sum, not the mean: so few changes tell their own size badly
        self.spread = np.sum([np.outer(change, change) for change in changes], axis=0)

    def sizes(self) -> Array:
        """Return the root mean square of each window's residuals [rad], shape (windows,)."""
        return np.sqrt(np.mean(self._at(self.p).residual ** 2, axis=1))

    def shaken(self) -> Array:
        """Return the mean square [rad²] by which noise of the forces moves each window's angles, shape (windows,)."""
        moved = [self.moved(inputs) for inputs in self.windows.shaken]
        return np.mean(moved, axis=0) if moved else np.zeros(len(self.starts))

    def moved(self, inputs: Inputs) -> Array:
        """Return the mean square change [rad²] of each window's angles with other inputs, shape (windows,)."""
        return np.mean((self._near(self.p, inputs) - self._at(self.p).residual) ** 2, axis=1)

    def disagree(self, groups: Sequence[NDArray[np.bool_]]) -> None:
        """Add to the spread how far the coordinates would go if each group of windows were the whole log.

        To first order; the sum, as in ``compare``.
        """
        residual, jacobian = self._weighed(self._at(self.p))
        ridge = np.diag(1.0 / np.square(at.IGNORANCE[self.free]) + 1e-9)
        changes = np.zeros((len(groups), len(at.NAMES)))
        for change, group in zip(changes, groups, strict=True):
            information = np.einsum("wij,wik->jk", jacobian[group], jacobian[group])
            gradient = np.einsum("wij,wi->j", jacobian[group], residual[group])
            change[self.free] = -_LINEAR.solve(information + ridge, gradient)
        self.spread = self.spread + changes.T @ changes

    def misfit(self, p: Array) -> float:
        """Return a sum over the windows that no lone window rules."""
        size = np.mean(self._near(p) ** 2, axis=1)[self.windows.used] / self.windows.noise**2
        return float(np.sum(size / (1.0 + size / 100.0)))


def _finite(angles: Array) -> Array:
    return np.nan_to_num(angles, nan=1e3, posinf=1e3, neginf=-1e3)


def begin(windows: Windows, shape: Shape, free: list[int], p: Array, on_step: Callable[[], None]) -> Fit:
    """Return a search at the best of several ratios of breakaway to dynamic torque."""
    fit = Fit(windows, shape, free, p, on_step=on_step)
    fit.choose_ratio()
    return fit
