# pyright: standard
"""The fit of a machine to the windows of a log: prediction errors, by least squares.

The angles at the beginning of each window are measured with noise, the velocities are not measured
at all. So each window's start is estimated together with the machine: to first order it is
projected out of the residuals and of their derivatives (variable projection), which leaves a small
dense problem in the machine's coordinates. The derivatives are exact: a simulation carries them
along. Then the starts are corrected, windows that fit badly get less weight, and the search goes
on.

Intervals come from a jackknife, to first order: how far the coordinates would go without each pair
of neighbouring windows. Residuals of one window are one error that grows, and not many errors.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from pter_gym.tools.identification.parameters import (
    AT,
    COUNT,
    LOWEST,
    MAX_ERRORS,
    Shape,
    along,
    places,
)
from pter_gym.tools.identification.shooting import LogInputs, differentiate, predict
from pter_gym.tools.identification.windows import Windows

Array = NDArray[np.float64]

ROUNDS, MAX_EVALUATIONS, TOLERANCE = 3, 8, 1e-5
"""Times that starts and weights are corrected; simulations in between; share of the sum that ends
them if a step gains less."""

BAD = 4.0
"""Residuals of a window over the median of all at which it has a quarter of the weight."""

START_ERRORS = (0.01, 0.01, 0.3, 0.3)
"""How wrong a start may be [rad, rad/s]: keeps what no angle tells from wandering off."""

MIN_RATIO, RATIOS = 1.001, (1.02, 1.08, 1.18, 1.3, 1.45, 1.6)
"""Lower bound of T_s/T_k in the search, as the simulator ignores less than 1; and what is tried at
first, and where the search has come down to that bound."""

SINGULAR, UNSEEN = 1e-12, 1e6
"""What keeps equations solvable, over their size; variance of a coordinate that no window shows."""

PRIOR = 4.0
"""How far from the first estimate the search expects a coordinate, over its ``max_error``: what no
window shows stays near it."""

TIED = 0.9
"""Correlation of errors from which a log shows two coordinates only together."""

BLOCK = 2
"""Windows whose gradients count as one error."""


class Point(NamedTuple):
    """What one simulation of all windows tells.

    ``residual`` is predicted less measured angles [rad] but for what a wrong start makes, (windows,
    2·length); ``jacobian`` (…, 22) and ``by_start`` (…, 4) are derivatives by the coordinates and
    by admitted changes of a start; ``correction`` is how wrong each start is, (windows, 4).
    """

    residual: Array
    jacobian: Array
    by_start: Array
    correction: Array


@dataclass
class Fit:
    """A search and where it is.

    Of the coordinates ``p``, those in ``free`` are searched; ``on_step`` is called at each
    simulation. Each window has an estimated start, and a weight by what noise of the forces makes
    of it. ``usual`` is the root mean square of a usual window's residuals [rad].
    """

    windows: Windows
    shape: Shape
    free: list[str]
    p: Array
    on_step: Callable[[], None] = lambda: None
    starts: Array = field(init=False)
    weights: Array = field(init=False)
    usual: float = 1e-12
    _first: Array = field(init=False)
    _known: dict[bytes, Point] = field(default_factory=dict[bytes, Point])

    def __post_init__(self) -> None:
        """Begin with the starts as they were measured."""
        self.starts, self.weights = self.windows.starts.copy(), self.windows.used.astype(float)
        self._first = self.p.copy()

    def search(self, rounds: int = ROUNDS) -> "Fit":
        """Search, correct starts and weights, and search again."""
        for _ in range(rounds):
            if self.has_no_jump:
                self.choose_ratio()
            self._set_usual()
            if self.free:
                self._minimise()
            self._set_usual()
            by_forces = [self.change(self.p, each) for each in self.windows.shaken]
            moved = np.mean(np.square(by_forces), axis=(0, 2))
            self.weights = self.windows.used / (1.0 + moved / self.usual**2)
            self._correct_starts()
        return self

    @property
    def here(self) -> Point:
        """What a simulation at the coordinates tells."""
        return self._at(self.p)

    @property
    def has_no_jump(self) -> bool:
        """Whether the ratio of breakaway to dynamic torque is as small as can be."""
        ratio = float(self.p[AT["breakaway_ratio"]])
        return "breakaway_ratio" in self.free and ratio <= MIN_RATIO + 1e-6

    def choose_ratio(self) -> None:
        """Take the best of several ratios of breakaway to dynamic torque, if it is searched."""
        self.p = self.with_best_ratio(self.p)

    def with_best_ratio(self, p: Array) -> Array:
        """Return coordinates at the best of several breakaway ratios, if that is searched."""
        if "breakaway_ratio" not in self.free:
            return p
        before = float(p[AT["breakaway_ratio"]])
        tried = [p + along("breakaway_ratio", ratio - before) for ratio in RATIOS]
        return min([p, *tried], key=self.misfit)

    def choose_from(self, starts: Iterable[Array]) -> None:
        """Search from each of some coordinates, and take what leaves least."""
        found = list[tuple[float, Array]]()
        for self.p in starts:
            self._minimise()
            left = self.weights * self.trust * np.mean(self.here.residual**2, axis=1)
            found.append((float(left.sum()), self.p))
        self.p = min(found, key=lambda each: each[0])[1]

    def misfit(self, p: Array) -> float:
        """Return a sum over the windows that no lone window rules."""
        size = np.mean(self._near(p) ** 2, axis=1)[self.windows.used] / self.error**2
        return float(np.sum(size / (1.0 + size / 100.0)))

    @property
    def error(self) -> float:
        """Size of an ordinary residual [rad]: of the noise, or of the model's own errors."""
        return max(self.windows.noise, self.usual)

    def _set_usual(self) -> None:
        """Set the median root mean square of the residuals of windows in which something moves."""
        moving = self.windows.used & self.windows.uncertain[:, 2:, 2:].any(axis=(1, 2))
        self.usual = float(np.median(self.sizes()[moving])) if moving.any() else 1e-12
        self._known.clear()

    def _correct_starts(self) -> None:
        """Correct the starts of windows which that brings closer to the measured angles."""
        before, off = self.starts, self._apart(self.p, self.windows.inputs)
        self.starts = before - np.einsum("wij,wj->wi", self.windows.uncertain, self.here.correction)
        closer = np.sum(self._apart(self.p, self.windows.inputs) ** 2 - off**2, axis=1) < 0.0
        self.starts = np.where(closer[:, None], self.starts, before)
        self._known.clear()

    def _minimise(self) -> None:
        """Run ``least_squares`` within the bounds; windows that fit badly count for less."""
        free, low = places(self.free), LOWEST.copy()
        low[AT["breakaway_ratio"]] = MIN_RATIO
        low, high = low[free] + 1e-9, self.shape.highest[free] - 1e-9
        weights, prior = np.sqrt(self.weights) / self.error, 1.0 / (PRIOR * MAX_ERRORS)

        def coordinates(x: Array) -> Array:
            p = self.p.copy()
            p[free] = x
            return p

        def residual(x: Array) -> Array:
            point, far = self._at(coordinates(x)), prior[free] * (x - self._first[free])
            left = (weights * np.sqrt(self._trust(point)))[:, None] * point.residual
            return np.concatenate([left.ravel(), far])

        def jacobian(x: Array) -> Array:
            point = self._at(coordinates(x))
            # trust² is the derivative of trust·s by a sum of squares s
            factors = weights * self._trust(point) ** 1.5
            by = factors[:, None, None] * point.jacobian[:, :, free]
            return np.concatenate([by.reshape(-1, len(x)), np.diag(prior[free])])

        solution = optimize.least_squares(
            residual,
            self.p[free].clip(low, high),
            jacobian,  # pyright: ignore[reportArgumentType]
            bounds=(low - 1e-12, high + 1e-12),
            x_scale="jac",
            ftol=TOLERANCE,
            max_nfev=MAX_EVALUATIONS,
        )
        self.p = coordinates(solution.x)

    def _trust(self, point: Point) -> Array:
        return 1.0 / (1.0 + np.mean(point.residual**2, axis=1) / (BAD * self.usual) ** 2)

    def costs(self, factors: Array) -> Array:
        """Return the squares that pairs of neighbouring windows leave, each window weighed so."""
        squares = np.sum((factors[:, None] * self.here.residual) ** 2, axis=1)
        return np.add.reduceat(squares, np.arange(0, len(squares), BLOCK))

    @property
    def trust(self) -> Array:
        """Share in which each window counts, shape (windows,): less if it is far off the others."""
        return self._trust(self.here)

    @property
    def factors(self) -> Array:
        """Factors of the residuals of each window [1/rad], shape (windows,)."""
        return np.sqrt(self.weights) * self.trust / self.error

    def weighed(self) -> tuple[Array, Array]:
        """Return residuals and their derivatives by the free coordinates, times ``factors``."""
        factors = self.factors[:, None]
        by_free = factors[:, :, None] * self.here.jacobian[:, :, places(self.free)]
        return factors * self.here.residual, by_free

    def _apart(self, p: Array, inputs: LogInputs) -> Array:
        """Return the predicted less the measured angles [rad], (windows, 2·length), all finite."""
        w = self.windows
        return _off(predict(self.shape, p, inputs, self.starts, w.length), w.measured)

    def _at(self, p: Array) -> Point:
        """Return what a simulation at coordinates tells."""
        key = p.tobytes()
        if key not in self._known:
            self.on_step()
            w, rows = self.windows, self.windows.measured[0].size
            angles, by, by_start = differentiate(self.shape, p, w.inputs, self.starts, w.length)
            off = _off(angles, w.measured)[:, :, None]
            by_start = np.nan_to_num(by_start.reshape(-1, rows, 4)) @ w.uncertain
            columns = np.nan_to_num(by.reshape(-1, rows, COUNT))
            left, along_start = self._projected(by_start, np.concatenate([off, columns], axis=2))
            if len(self._known) > 3:
                self._known.clear()
            self._known[key] = Point(left[:, :, 0], left[:, :, 1:], by_start, along_start[:, :, 0])
        return self._known[key]

    def _projected(self, by_start: Array, values: Array) -> tuple[Array, Array]:
        """Return values (windows, rows, k) without their part along the start, and that part."""
        across = np.swapaxes(by_start, 1, 2)
        normal = across @ by_start
        largest = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        normal += np.diag(self.error**2 / np.square(START_ERRORS)) + SINGULAR * largest * np.eye(4)
        along_start = np.linalg.solve(normal, across @ values)
        return values - by_start @ along_start, along_start

    def _near(self, p: Array, inputs: LogInputs | None = None) -> Array:
        """Return the residuals [rad] at other coordinates or inputs, projected as here."""
        off = self._apart(p, inputs or self.windows.inputs)
        return self._projected(self.here.by_start, off[:, :, None])[0][:, :, 0]

    def change(self, p: Array, inputs: LogInputs | None = None) -> Array:
        """Return the change of the residuals [rad] at other coordinates or inputs."""
        return self._near(p, inputs) - self.here.residual

    def rounding(self, step: float) -> Iterator[Array]:
        """Yield what encoders of a step [rad] make of the residuals [rad], wherever they are 0.

        At the recorded encoder's zero, predictions within half a step would be explained by it.
        """
        measured = self.windows.measured.reshape(self.here.residual.shape)
        angles = (self._apart(self.p, self.windows.inputs) + measured) / max(step, 1e-12)
        for zeros in np.random.default_rng(0).random((len(self.windows.shaken), len(angles), 2)):
            shifted = angles + np.tile(zeros, angles.shape[1] // 2)
            off = step * (np.round(shifted) - shifted)
            yield self._projected(self.here.by_start, off[:, :, None])[0][:, :, 0]

    def covariance(self) -> tuple[Array, float]:
        """Return the covariance of the free coordinates, and the quantile of 95 % intervals.

        No variance is less than noise of the forces makes: with few breakaways, a jackknife finds
        too little.
        """
        residual, jacobian = self.weighed()
        changes, information = jackknife(residual, jacobian)
        normal, size = scaled(information, 1e-10)
        covariance = changes.T @ changes
        naive = np.diag(np.linalg.inv(normal)) / size**2
        variance = np.sum(residual**2) / max(self.weights.sum() * residual.shape[1], 1.0)
        diagonal = np.diag_indices_from(covariance)
        by_force = [self.factors[:, None] * self.change(self.p, w) for w in self.windows.shaken]
        pulls = np.einsum("wij,swi->sj", jacobian, by_force) / size
        shaken = np.mean(np.square(np.linalg.solve(normal, pulls.T).T / size), axis=0)
        floor = np.maximum(variance * naive, shaken)
        covariance[diagonal] = np.maximum(np.diag(covariance), floor)
        unseen = size * MAX_ERRORS[places(self.free)] < 1.0
        covariance[unseen], covariance[:, unseen] = 0.0, 0.0
        covariance[unseen, unseen] = UNSEEN
        return covariance, float(stats.t.ppf(0.975, max(len(changes) - len(self.free), 1)))

    def tied_to(self, name: str) -> set[str]:
        """Return the free coordinates that the log shows only together with one."""
        columns = self.weighed()[1].reshape(-1, len(self.free))
        shared = correlations(columns.T @ columns)[self.free.index(name)] > TIED
        return {each for each, too in zip(self.free, shared, strict=True) if too and each != name}

    def bias(self, slopes: Array, left: Array) -> Array:
        """Return how far errors of the model can have moved numbers, if all windows agree.

        Parameters
        ----------
        slopes
            Derivatives of the numbers by the free coordinates, shape (numbers, free).
        left
            Root mean square of the angles that the model leaves in each window [rad]: what it left
            and what went into the numbers are taken to be of one size.
        """
        _, jacobian = self.weighed()
        normal, size = scaled(np.einsum("wij,wik->jk", jacobian, jacobian, optimize=True))
        shares = np.linalg.solve(normal, (slopes / size).T).T / size
        by_window = np.linalg.norm(np.einsum("qk,wik->wqi", shares, jacobian), axis=2)
        return (self.factors * left * np.sqrt(jacobian.shape[1])) @ by_window

    def sizes(self) -> Array:
        """Return the root mean square of each window's residuals [rad], shape (windows,)."""
        return np.sqrt(np.mean(self.here.residual**2, axis=1))


def scaled(information: Array, least: float = SINGULAR) -> tuple[Array, Array]:
    """Return a matrix over the roots of its diagonal, made regular, and these roots."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-30))
    return information / np.outer(size, size) + least * np.eye(len(size)), size


def correlations(information: Array) -> Array:
    """Return the sizes of the correlations of coordinates, of which there is some information."""
    inverse = np.linalg.inv(scaled(information)[0])
    return np.abs(inverse) / np.sqrt(np.outer(np.diag(inverse), np.diag(inverse)))


def jackknife(residual: Array, jacobian: Array) -> tuple[Array, Array]:
    """Return the coordinates' changes without each informative block, and the information."""
    first = np.arange(0, len(residual), BLOCK)
    gradients = np.add.reduceat(np.einsum("wij,wi->wj", jacobian, residual), first)
    parts = np.add.reduceat(np.swapaxes(jacobian, 1, 2) @ jacobian, first)
    information, told = parts.sum(axis=0), gradients.any(axis=1)
    normal, size = scaled(information)
    without = normal - parts[told] / np.outer(size, size)
    steps = np.linalg.solve(without, (gradients[told] / size)[:, :, None])[:, :, 0]
    return steps / size, information


def _off(angles: Array, measured: Array) -> Array:
    finite = np.nan_to_num(angles, nan=1e3, posinf=1e3, neginf=-1e3)
    return (finite - measured).reshape(len(measured), -1)
