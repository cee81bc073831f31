"""Whether the model explains a log, where it does not, and what may be wrong with the log."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pter_gym.tools.identification.balance import COARSE, balance
from pter_gym.tools.identification.fit import BLOCK, Fit
from pter_gym.tools.identification.log import Log
from pter_gym.tools.identification.parameters import INERTIA_A, INERTIA_B, RATIO, SLOPES, Shape
from pter_gym.tools.identification.shooting import LogInputs
from pter_gym.tools.identification.windows import Smoothed, lagged, smooth

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_STATS: Any = stats

FAR = 2.0
"""Root mean square of a window's residuals over what the log's noise makes, from which the model
does not explain it.

Noise of the forces is smooth after two integrals, so a window has as few as three independent
residuals, and then 0.7 % of the windows are this far off by chance: P(χ² > 3·2²) with three degrees
of freedom. """

MAX_UNEXPLAINED = 0.1
"""Largest share of such windows in a log that the model explains: some breakaways are always a matter of chance."""

MAX_DIFFERING = 0.25
"""Largest share of numbers that differ between parts of such a log: what is not in the model touches a few at most."""

SHOWS_BREAKAWAY = 0.02
"""Relative change of the breakaway torque that moves an angle by its noise in windows that show a breakaway."""

CHANCE = 0.01
"""Probability of so many unexplained breakaways of one clutch, below which the model does not explain them."""

LEFT = 0.02
"""Share of the load left by the balance of torques, from which other readings of a log are tried."""

BETTER = 0.2
"""What another reading may leave of that, to be reported."""

UNRELATED = 0.5
"""Share of the load left by all readings, from which forces and motion have nothing to do with each other."""

OTHER_SIZE = 2.0
"""Factor between all inertias and torques and those of the start, from which the unit of the forces is questioned."""

NAMED = 3
"""Differences between parts of a log that are named."""

SHIFTS = (-0.1, -0.05, -0.02, 0.02, 0.05, 0.1)
"""Delays of the forces that are tried [s]."""


@dataclass(frozen=True)
class Verdict:
    """Whether the model explains a log.

    Attributes
    ----------
    windows
        How many windows are used.
    share
        Share of them whose residuals are more than ``FAR`` times what the log's noise makes.
    enough
        Whether there are more independent stretches than numbers to identify.
    differing
        Share of the searched numbers that differ between parts of the log.
    breakaways
        Windows that show a breakaway of any clutch and of each: how many are not explained, and of
        how many.
    gaps
        Windows that are left out since they hold a gap of the log.
    where
        At which speed, voltage or position most windows are not explained, if that makes a
        difference.
    hints
        Sentences on what may be wrong with the log.
    """

    windows: int
    share: float
    enough: bool
    differing: float
    breakaways: tuple[tuple[int, int], ...]
    gaps: int
    where: str
    hints: tuple[str, ...]

    @property
    def explained(self) -> bool:
        """Whether numbers may count as identified."""
        return self.enough and self.share <= MAX_UNEXPLAINED and self.differing <= MAX_DIFFERING

    @property
    def breakaways_explained(self) -> bool:
        """Whether the ratio of breakaway to dynamic torque may count as identified."""
        (far, windows), *each = self.breakaways
        by_chance = [_STATS.binom.sf(k - 1, n, MAX_UNEXPLAINED) for k, n in each]
        return self.explained and far <= MAX_UNEXPLAINED * windows and min(by_chance) >= CHANCE

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if not self.enough:
            return f"Nothing is identified: {self.windows} usable windows are too few for so many numbers."
        off = f"in {100 * self.share:.0f} % of {self.windows} windows, angles are further off than {FAR:g} × noise"
        off += f" ({self.gaps} windows with gaps are left out)" if self.gaps else ""
        if self.explained and not self.breakaways_explained:
            (far, windows), *each = self.breakaways
            clutches = ", ".join(f"clutch {x}: {k} of {n}" for x, (k, n) in enumerate(each, 1) if k)
            off += f". It does not explain breakaways: {far} of {windows} windows with one are further off"
            off += f" ({clutches})" if clutches else ""
        if self.explained:
            return f"The model explains the log: {off}."
        if self.differing > MAX_DIFFERING:
            off += (
                f", and {100 * self.differing:.0f} % of the numbers differ between parts of the log"
            )
        return f"The model does not explain the log, so nothing is identified: {off}, {self.where}."


def judge(
    fit: Fit, finer: LogInputs, differences: tuple[str, ...], log: Log, motion: Smoothed
) -> Verdict:
    """Return the verdict on a fit, given inputs with a shorter substep and what differs between parts of the log."""
    windows, used = fit.windows, fit.windows.used
    unavoidable = (
        fit.moved(finer) + fit.shaken()
    )  # by the model's step and noise of the forces [rad²]
    far = fit.sizes() > FAR * np.sqrt(windows.noise**2 + unavoidable)
    share = float(far[used].mean()) if used.any() else 1.0
    enough = int(used.sum()) // BLOCK > len(fit.free)
    differing = len(differences) / max(len(fit.free), 1)
    explained = enough and share <= MAX_UNEXPLAINED and differing <= MAX_DIFFERING
    where = "" if explained or not used.any() else _where(fit, log, motion, far)
    hints = (
        *_oddities(fit, log, differences),
        *(() if explained else other_readings(log, fit.shape)),
    )
    by_ratio = np.abs(fit.jacobian[:, :, RATIO]).max(axis=1) * SHOWS_BREAKAWAY > windows.noise
    shown = used & by_ratio & (RATIO in fit.free)
    parts = [shown, *(shown & each for each in windows.broke_away.T)]
    breakaways = tuple((int(far[part].sum()), int(part.sum())) for part in parts)
    return Verdict(
        int(used.sum()), share, enough, differing, breakaways, windows.gaps, where, hints
    )


def _where(fit: Fit, log: Log, motion: Smoothed, far: Flags) -> str:
    """Return in words in which third of the windows most are not explained, by what tells most."""
    rows = fit.windows.first[:, None] + np.arange(fit.windows.length + 1)
    volts = lagged(log, log.volts, fit.shape.machine(fit.p).clutch.time_constant)
    values = {
        ("the speed of the faster link", "rad/s"): np.abs(motion.omega[rows]).max(axis=(1, 2)),
        ("the highest lagged voltage", "V"): volts[rows].max(axis=(1, 2)),
        ("theta_A", "rad"): log.theta[rows, 0].mean(axis=1),
        ("theta_B", "rad"): log.theta[rows, 1].mean(axis=1),
    }
    used, telling, said = fit.windows.used, MAX_UNEXPLAINED, "everywhere"
    for (name, unit), each in values.items():
        thirds = np.array_split(np.argsort(np.where(used, each, np.inf))[: used.sum()], 3)
        shares = [float(far[third].mean()) if len(third) else 0.0 for third in thirds]
        if max(shares) - min(shares) > telling:
            telling, worst = max(shares) - min(shares), each[thirds[int(np.argmax(shares))]]
            said = f"{100 * max(shares):.0f} % where {name} is {worst.min():.2g} to {worst.max():.2g} {unit}"
    return said


def _oddities(fit: Fit, log: Log, differences: tuple[str, ...]) -> Iterator[str]:
    """Yield what is odd about a log, whatever the model says."""
    if differences:
        more = f", and {len(differences) - NAMED} more" if len(differences) > NAMED else ""
        said = "; ".join(differences[:NAMED])
        yield f"Numbers differ between parts of the log, which makes their intervals wider: {said}{more}."
    if 0.0 < log.volts.max() <= 1.0:
        yield f"No voltage is above {log.volts.max():.3g} V: are V1 to V4 volts, or shares of the largest voltage?"
    sizes = [i for i in (INERTIA_A, INERTIA_B, *SLOPES) if i in fit.free]
    ratios = np.exp((fit.p - fit.shape.coordinates(fit.shape.start))[sizes])
    if sizes and (ratios.min() > OTHER_SIZE or ratios.max() < 1.0 / OTHER_SIZE):
        yield (
            f"All inertias and torques are about {np.exp(np.log(ratios).mean()):.2g} times those of the start: "
            "are F_x and F_y in newtons (1 lbf is 4.448 N), and the lengths in metres?"
        )


def other_readings(log: Log, shape: Shape) -> Iterator[str]:
    """Yield the other reading of a log under which the balance of torques leaves much less, if there is one."""
    usual = balance(log, smooth(log), shape, COARSE)
    if usual is None or usual.left < LEFT:
        return
    least, said = usual.left, ""
    for sentence, other in _readings(log):
        tried = balance(other, smooth(other), shape, COARSE)
        if tried is not None and tried.left < least:
            least, said = tried.left, sentence
    if least < BETTER * usual.left:
        yield f"{said}: then {100 * least:.1f} % of the torques stay unexplained, instead of {100 * usual.left:.0f} %."
    elif least > UNRELATED:
        yield f"{100 * least:.0f} % of the torques stay unexplained: do forces and angles belong to the same motion?"


def _readings(log: Log) -> Iterator[tuple[str, Log]]:
    """Yield other ways to read a log, each with what it would mean."""
    theta, force = log.theta, log.force
    yield "theta_A and theta_B seem to be swapped", replace(log, theta=theta[:, ::-1])
    relative = np.column_stack([theta[:, 0], theta.sum(axis=1)])
    yield (
        "theta_B seems to be measured from link A, not from the x axis (--relative-b)",
        replace(log, theta=relative),
    )
    yield (
        "theta_A and theta_B seem to be in degrees (--degrees)",
        replace(log, theta=np.radians(theta)),
    )
    for x, y in combinations(range(4), 2):
        order = [y if k == x else x if k == y else k for k in range(4)]
        yield f"V{x + 1} and V{y + 1} seem to be swapped", replace(log, volts=log.volts[:, order])
    yield (
        "F_x and F_y seem to have the wrong sign: they are those of the hand on the tip",
        replace(log, force=-force),
    )
    yield "F_x seems to have the wrong sign", replace(log, force=force * [-1.0, 1.0])
    yield (
        "F_y seems to have the wrong sign, or both angles",
        replace(log, force=force * [1.0, -1.0]),
    )
    yield "F_x and F_y seem to be swapped", replace(log, force=force[:, ::-1])
    for shift in SHIFTS:
        when = f"{1e3 * abs(shift):.0f} ms {'late' if shift > 0.0 else 'early'}"
        moved = np.roll(force, -round(shift / log.interval), axis=0)
        yield f"F_x and F_y seem to be recorded about {when}", replace(log, force=moved)
