"""How well the model describes a log: ρ, the grade, and what may be wrong with the log."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pter_gym.tools.identification.balance import COARSE, balance
from pter_gym.tools.identification.fit import BLOCK, Fit
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import (
    INERTIA_A,
    INERTIA_B,
    RATIO,
    SLOPES,
    Shape,
)
from pter_gym.tools.identification.windows import GAIN, smooth

Array = NDArray[np.float64]

EXACT, SIMULATION, NEITHER = "exact", "good for simulation", "neither"
"""Grades: noise explains the residuals; the model leaves little of the force; neither is so."""

FAR = 2.0
"""Root mean square of a window's residuals over what noise makes, from which noise does not explain
it.

Noise of the forces is smooth after two integrals, so a window has as few as three independent
residuals, and then 0.7 % of the windows are this far off by chance: P(χ² > 3·2²) with three degrees
of freedom.
"""

NEGLIGIBLE = 0.005
"""Share of the force's effect that an exact model may leave in a window: no sensor is better."""

SMOOTH = 0.02
"""Time over which residuals are averaged for ρ [s]: errors of forces are smoother."""

MAX_FAR = 0.1
"""Largest share of such windows under an exact model: some breakaways are chance."""

MAX_DIFFERING = 0.25
"""Largest share of numbers that differ between parts of the log."""

SHOWS_BREAKAWAY = 0.02
"""Change of the breakaway ratio that moves an angle by its noise in windows with a breakaway."""

MAX_EXACT_RHO = 0.01
"""Largest share of the force that an exact model leaves, whatever the encoder."""

MAX_RHO = 0.03
"""Largest share of the force that a model which is good for simulation leaves."""

LEFT = 0.02
"""Share of the load left by the balance of torques, from which other readings are tried."""

BETTER = 0.2
"""What another reading may leave of that, to be reported."""

UNRELATED = 0.5
"""Share of the load left by all readings, from which forces and motion are unrelated."""

OTHER_SIZE = 2.0
"""Factor from the start to all inertias and torques that questions the unit of forces."""

MAX_LISTED = 3
"""Differences between parts of a log that are named."""

SHIFTS = (-0.1, -0.05, -0.02, 0.02, 0.05, 0.1)
"""Delays of the forces that are tried [s]."""


@dataclass(frozen=True)
class Verdict:
    """How well the model describes a log.

    Attributes
    ----------
    windows, gaps
        How many windows are used, and how many hold a gap of the log.
    far
        Share of them whose residuals noise does not explain.
    far_breakaways
        Share of the windows with a breakaway in which noise alone does not explain them: a wrong
        law near the breakaway goes into the ratio and leaves little.
    rho
        Share of what the force does to the angles that the model leaves.
    enough
        Whether there are more independent stretches than numbers to identify.
    differing
        Share of the searched numbers that differ between parts of the log.
    differences
        Between which parts each of them does.
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
    enough: bool
    differing: float
    differences: Mapping[str, str]
    left: Array
    hints: tuple[str, ...] = ()

    @property
    def grade(self) -> str:
        """One of ``EXACT``, ``SIMULATION`` and ``NEITHER``."""
        if not self.enough or self.differing > MAX_DIFFERING:
            return NEITHER
        if self.far <= MAX_FAR and self.rho <= MAX_EXACT_RHO:
            return EXACT
        return SIMULATION if self.rho <= MAX_RHO else NEITHER

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if not self.enough:
            return f"Nothing is identified: {self.windows} usable windows are too few."
        left = f"it leaves {100 * self.rho:.2g} % of the hand's force unexplained"
        left += f" ({self.gaps} windows with gaps are left out)" if self.gaps else ""
        if self.grade == EXACT:
            far = f"in {100 * self.far:.0f} % of {self.windows} windows, residuals exceed noise"
            return f"The model is exact: {far}; {left}."
        if self.grade == SIMULATION:
            return f"The model is good for simulation: {left}, in {self.windows} windows."
        differing = (
            f", and {100 * self.differing:.0f} % of the numbers differ between parts of the log"
        )
        return (
            f"The model does not describe the log, so nothing is identified: {left}"
            f"{differing if self.differing > MAX_DIFFERING else ''}."
        )


def judge(fit: Fit, differences: Mapping[str, str], log: Log) -> Verdict:
    """Return the verdict on a fit, given which numbers differ between which parts of the log."""
    windows, used = fit.windows, fit.windows.used
    driven = fit.change(fit.p, windows.harder) / GAIN
    errors = [fit.change(fit.p, inputs) for inputs in (windows.finer, *windows.shaken)]

    def squares(rows: int) -> tuple[Array, Array, Array]:
        """Return mean squares of means over rows: of residuals, of noise, of the force's effect."""
        left, effect, step, *shaken = (
            _mean_squares(angles, rows, windows.length)
            for angles in (fit.residual, driven, *errors)
        )
        return left, windows.noise**2 / rows + step + np.mean(shaken, axis=0), effect

    left, noise, effect = squares(1)
    far = left > FAR**2 * (noise + NEGLIGIBLE**2 * effect)
    moved = SHOWS_BREAKAWAY * np.abs(fit.jacobian[:, :, RATIO]).max(axis=1)
    breakaways = used & (moved > windows.noise) & (RATIO in fit.free)
    unexplained = left > FAR**2 * noise
    left, noise, effect = squares(max(1, round(SMOOTH / log.interval)))
    all_left, all_noise, all_effect = (
        float((fit.trust * each)[used].sum()) for each in (left, noise, effect)
    )
    verdict = Verdict(
        windows=int(used.sum()),
        gaps=windows.gaps,
        far=float(far[used].mean()) if used.any() else 1.0,
        far_breakaways=float(unexplained[breakaways].mean()) if breakaways.any() else 0.0,
        rho=float(np.sqrt(max(all_left - all_noise, 0.0) / max(all_effect, 1e-300))),
        enough=int(used.sum()) // BLOCK > len(fit.free),
        differing=len(differences) / max(len(fit.free), 1),
        differences=differences,
        left=np.sqrt(np.maximum(left - noise, 0.0)),
    )
    readings = other_readings(log, fit.shape) if verdict.grade == NEITHER else ()
    return replace(verdict, hints=(*_oddities(fit, log, differences), *readings))


def _mean_squares(angles: Array, rows: int, length: int) -> Array:
    """Return each window's mean square of angles (windows, 2·length), averaged over rows first."""
    count = length // rows
    parts = angles.reshape(len(angles), length, 2)[:, : count * rows]
    return np.mean(parts.reshape(len(angles), count, rows, 2).mean(axis=2) ** 2, axis=(1, 2))


def _oddities(fit: Fit, log: Log, differences: Mapping[str, str]) -> Iterator[str]:
    """Yield what is odd about a log, whatever the grade."""
    if differences:
        more = len(differences) - MAX_LISTED
        listed = [f"{name} differs {where}" for name, where in differences.items()][:MAX_LISTED]
        where = "; ".join(listed) + (f", and {more} more" if more > 0 else "")
        yield f"Numbers differ between parts of the log, so their intervals are wider: {where}."
    if 0.0 < log.volts.max() <= 1.0:
        yield f"No voltage is above {log.volts.max():.3g} V: are V1 to V4 volts, or shares?"
    sizes = [i for i in (INERTIA_A, INERTIA_B, *SLOPES) if i in fit.free]
    ratios = np.exp((fit.p - fit.shape.coordinates(fit.shape.start))[sizes])
    if sizes and (ratios.min() > OTHER_SIZE or ratios.max() < 1.0 / OTHER_SIZE):
        yield (
            f"Inertias and torques are {np.exp(np.mean(np.log(ratios))):.2g} times the start's: "
            "are F_x and F_y in newtons (1 lbf is 4.448 N), and the lengths in metres?"
        )


def other_readings(log: Log, shape: Shape) -> Iterator[str]:
    """Yield the reading of a log under which the balance of torques leaves much less, if any."""
    usual = balance(log, smooth(log), shape, COARSE)
    if usual is None or usual.left < LEFT:
        return
    least, reading = usual.left, ""
    for sentence, other in _readings(log):
        other_balance = balance(other, smooth(other), shape, COARSE)
        if other_balance is not None and other_balance.left < least:
            least, reading = other_balance.left, sentence
    if least < BETTER * usual.left:
        left = f"{100 * least:.1f} % of the torques stay unexplained"
        yield f"{reading}: then {left}, instead of {100 * usual.left:.0f} %."
    elif least > UNRELATED:
        left = f"{100 * least:.0f} % of the torques stay unexplained"
        yield f"{left}: do forces and angles belong to the same motion?"


def _readings(log: Log) -> Iterator[tuple[str, Log]]:
    """Yield other ways to read a log, each with what it would mean."""
    theta, force = log.theta, log.force
    yield "theta_A and theta_B seem to be swapped", replace(log, theta=theta[:, ::-1])
    yield (
        "theta_B seems to be measured from link A, not from the x axis (--relative-b)",
        replace(log, theta=np.column_stack([theta[:, 0], theta.sum(axis=1)])),
    )
    degrees = np.radians(theta)
    yield "theta_A and theta_B seem to be in degrees (--degrees)", replace(log, theta=degrees)
    for x, y in combinations(range(4), 2):
        order = np.arange(4)
        order[[x, y]] = y, x
        yield f"V{x + 1} and V{y + 1} seem to be swapped", replace(log, volts=log.volts[:, order])
    for name, signs in (("F_x and F_y seem", -1.0), ("F_x seems", [-1, 1]), ("F_y seems", [1, -1])):
        yield f"{name} to have the wrong sign", replace(log, force=force * signs)
    yield "F_x and F_y seem to be swapped", replace(log, force=force[:, ::-1])
    for shift in SHIFTS:
        when = f"{1e3 * abs(shift):.0f} ms {'late' if shift > 0.0 else 'early'}"
        moved = np.roll(force, -round(shift / log.interval), axis=0)
        yield f"F_x and F_y seem to be recorded about {when}", replace(log, force=moved)
