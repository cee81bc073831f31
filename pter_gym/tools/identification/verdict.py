# pyright: standard
"""How well the model describes a log: ρ, the grade, and what may be wrong with the log."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pter_gym.tools.identification.findings import MAX_REL_HALF_WIDTH
from pter_gym.tools.identification.fit import BLOCK, Fit
from pter_gym.tools.identification.log import Log, angle_step
from pter_gym.tools.identification.parameters import AT, SCALES, places
from pter_gym.tools.identification.score_tests import Difference
from pter_gym.tools.identification.windows import GAIN, has_one_way

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

EXACT, SIMULATION, NEITHER = "exact", "good for simulation", "neither"
"""Grades: noise explains the residuals; the model leaves little of the force; neither is so."""

FAR = 2.0
"""Root mean square of a window's residuals over what noise makes, from which noise does not explain
it. Noise of the forces is smooth after two integrals, so a window has as few as three independent
residuals, and 0.7 % of the windows are this far off by chance: P(χ² > 3·2²)."""

NEGLIGIBLE = 0.005
"""Share of the force's effect that an exact model may leave in a window: no sensor is better."""

SMOOTH = 0.02
"""Time over which residuals are averaged for ρ [s]: errors of forces are smoother."""

MAX_FAR = 0.1
"""Largest share of windows that noise does not explain under an exact model, as some breakaways are
chance."""

SHOWS_BREAKAWAY = 0.02
"""Change of the breakaway ratio that moves an angle by its noise in windows with a breakaway."""

MAX_EXACT_RHO, MAX_RHO = 0.01, 0.03
"""Largest shares of the force that models leave which are exact, and good for simulation."""

SURE = 2.0
"""Standard errors of ρ² between ρ and the ends of what may be left."""

OTHER_SIZE, MAX_LISTED = 2.0, 3
"""Factor from the start to all inertias and torques that questions the unit of forces; differences
between parts of a log that are named."""


@dataclass(frozen=True)
class Verdict:
    """How well the model describes a log.

    Attributes
    ----------
    windows, gaps
        How many windows are used, and how many hold a gap of the log.
    far, far_breakaways
        Share of them, and of those with a breakaway, whose residuals noise does not explain: a
        wrong law near the breakaway goes into the ratio and leaves little.
    rho, rho_low, rho_high
        Share of what the force does to the angles that the model leaves, and the ends of its 95 %
        interval.
    enough
        Whether there are more independent stretches than numbers to identify.
    differences
        The searched numbers that differ between parts of the log.
    one_way
        Whether clutches slipped while their voltages only rose, or only fell.
    left
        Root mean square of the angles that the model leaves in each window [rad].
    hints
        Sentences on what may be wrong with the log.
    """

    windows: int
    gaps: int
    far: float
    far_breakaways: float
    rho: float
    rho_low: float
    rho_high: float
    enough: bool
    differences: Sequence[Difference]
    one_way: bool
    left: Array
    hints: tuple[str, ...] = ()

    @property
    def grade(self) -> str:
        """One of ``EXACT``, ``SIMULATION`` and ``NEITHER``: by what is surely left, and may be."""
        if not self.enough or self.rho_low > MAX_RHO or self.rho_high >= 1.0:
            return NEITHER
        exact = self.far <= MAX_FAR and self.rho_high <= MAX_EXACT_RHO
        return EXACT if exact else SIMULATION

    @property
    def share(self) -> float:
        """Least half of an interval over the scale of its number, for errors of the model."""
        return max(2.0 * self.rho_high, NEGLIGIBLE)

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if not self.enough:
            return f"Nothing is identified: {self.windows} usable windows are too few."
        left = f"it leaves {100 * self.rho:.2g} % of the hand's force unexplained"
        left += f" ({100 * self.rho_low:.2g} to {100 * self.rho_high:.2g} %)"
        left += f" ({self.gaps} windows with gaps are left out)" if self.gaps else ""
        if self.grade == EXACT:
            far = f"in {100 * self.far:.0f} % of {self.windows} windows, residuals exceed noise"
            return f"The model is exact: {far}; {left}."
        if self.grade == SIMULATION:
            return f"The model is good for simulation: {left}, in {self.windows} windows."
        return f"The model does not describe the log: {left}."


def judge(fit: Fit, differences: Sequence[Difference], log: Log) -> Verdict:
    """Return the verdict on a fit, given which numbers differ between which parts of the log."""
    windows, used, residual = fit.windows, fit.windows.used, fit.here.residual
    driven = fit.change(fit.p, windows.harder) / GAIN
    errors = [fit.change(fit.p, inputs) for inputs in (windows.finer, *windows.shaken)]

    def squares(rows: int, *others: Array) -> list[Array]:
        """Return mean squares of means over rows: of residuals, errors, the force's effect."""
        left, effect, step, *shaken = (
            _mean_squares(angles, rows, windows.length) for angles in (residual, driven, *errors)
        )
        rest = [_mean_squares(angles, rows, windows.length) for angles in others]
        return [left, step + np.mean(shaken, axis=0), effect, *rest]

    left, noise, effect = squares(1)
    noise += windows.noise**2
    far = left > FAR**2 * (noise + NEGLIGIBLE**2 * effect)
    breaks = np.abs(fit.here.jacobian[:, :, AT["breakaway_ratio"]]).max(axis=1)
    breakaways = used & (SHOWS_BREAKAWAY * breaks > windows.noise)
    breakaways &= "breakaway_ratio" in fit.free
    unexplained = left > FAR**2 * noise
    rows, encoder = max(1, round(SMOOTH / log.interval)), log.angle_step or angle_step(*log.theta.T)
    left, noise, effect, *rounding = squares(rows, *fit.rounding(encoder))
    noise += np.mean(rounding, axis=0) + max(windows.noise**2 - encoder**2 / 12.0, 0.0) / rows
    low, middle, high = share_left(*(used * fit.trust * each for each in (left - noise, effect)))
    verdict = Verdict(
        windows=int(used.sum()),
        gaps=windows.gaps,
        far=float(far[used].mean()) if used.any() else 1.0,
        far_breakaways=float(unexplained[breakaways].mean()) if breakaways.any() else 0.0,
        rho=middle,
        rho_low=low,
        rho_high=high,
        enough=int(used.sum()) // BLOCK > len(fit.free),
        differences=differences,
        one_way=bool(fit.shape.live) and has_one_way(log),
        left=np.sqrt(np.maximum(left - noise, 0.0)),
    )
    return replace(verdict, hints=tuple(_hints(fit, log, verdict)))


def share_left(left: Array, whole: Array) -> tuple[float, float, float]:
    """Return the lower end of ρ, ρ, and its upper end, by squares in windows less those of noise.

    The error is that of a ratio of sums over pairs of neighbouring windows.
    """
    total = max(float(whole.sum()), 1e-300)
    squared = float(left.sum()) / total
    pairs = np.add.reduceat(left - squared * whole, np.arange(0, len(left), BLOCK))
    error = SURE * float(np.linalg.norm(pairs)) / total
    middle = max(squared, 0.0)
    ends = max(middle - error, 0.0), middle, middle + error
    low, rho, high = (float(np.sqrt(each)) for each in ends)
    return low, rho, high


def _mean_squares(angles: Array, rows: int, length: int) -> Array:
    """Return each window's mean square of angles (windows, 2·length), averaged over rows first."""
    count = length // rows
    parts = angles.reshape(len(angles), length, 2)[:, : count * rows]
    return np.mean(parts.reshape(len(angles), count, rows, 2).mean(axis=2) ** 2, axis=(1, 2))


def _hints(fit: Fit, log: Log, verdict: Verdict) -> Iterator[str]:
    """Yield what may be wrong with a log."""
    if differences := verdict.differences:
        more = len(differences) - MAX_LISTED
        listed = [f"{each.name} differs {each.where}" for each in differences][:MAX_LISTED]
        where = "; ".join(listed) + (f", and {more} more" if more > 0 else "")
        yield f"Numbers differ between parts of the log, so their intervals are wider: {where}."
    if verdict.one_way:
        yield "Voltages only rise or fall, so heat may hide in the torque curve: repeat the first."
    if 0.0 < log.volts.max() <= 1.0:
        yield f"No voltage is above {log.volts.max():.3g} V: are V1 to V4 in volts?"
    sizes = places(n for n in ("inertia_a", "inertia_b", *SCALES) if n in fit.free)
    ratios = np.exp((fit.p - fit.shape.coordinates(fit.shape.start))[sizes])
    if sizes and (ratios.min() > OTHER_SIZE or ratios.max() < 1.0 / OTHER_SIZE):
        yield (
            f"Inertias and torques are {np.exp(np.mean(np.log(ratios))):.2g} times the start's: "
            "are F_x and F_y in newtons (1 lbf is 4.448 N), and the lengths in metres?"
        )
    if verdict.grade == NEITHER and verdict.enough:
        yield (
            "Check the signs of F_x and F_y and their frame, the order of axes and clutches, "
            "--degrees, --relative-b, and that all columns share one clock."
        )
    elif verdict.enough and verdict.share > MAX_REL_HALF_WIDTH:
        yield (
            f"Up to {100 * verdict.rho_high:.2g} % of the force is unexplained, too much to call a "
            "number identified: the machine has something that the model lacks."
        )
