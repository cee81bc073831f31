"""Scores of what a device rendered, as functions of time series.

A series has T samples at equal intervals along its first axis; vectors are in the world frame.
``force`` is that of the hand on the device, as a sensor in the handle reads it, unless a function
says otherwise.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.errors import ParameterError

Array = NDArray[np.float64]


class ForceError(NamedTuple):
    """Root mean square of the error of a rendered force [N], along a direction and across it."""

    along: float
    across: float


def force_error(rendered: ArrayLike, desired: ArrayLike, direction: ArrayLike) -> ForceError:
    """Return the error of the rendered force against the desired one.

    Parameters
    ----------
    rendered, desired
        Forces of the device on the hand, (T, 2) [N].
    direction
        The direction that separates the errors, such as the heading of a path: vectors (T,
        2) or (2,) of any length.
    """
    error: Array = np.subtract(rendered, desired)
    unit = np.asarray(direction, np.float64)
    unit = unit / np.linalg.norm(unit, axis=-1, keepdims=True)
    along = (error * unit).sum(axis=-1)
    across = error[..., 1] * unit[..., 0] - error[..., 0] * unit[..., 1]
    return ForceError(math.sqrt((along**2).mean()), math.sqrt((across**2).mean()))


def mean_resisting_force(power: ArrayLike, speed: ArrayLike, slowest: float = 1e-3) -> Array:
    """Return a device's mean force against the motion [N], (…): at 0 V, its drag.

    Parameters
    ----------
    power
        Power of the device on the handle, (T, …) [W]: the force of the device on the hand times the
        velocity, or the power of the clutches on the arm.
    speed
        Speed of the handle, (T, …) [m/s]. Samples that are not above ``slowest`` do not count; 0 if
        none does.
    """
    moves = np.asarray(speed) > slowest
    force = np.divide(
        -np.asarray(power, np.float64), speed, where=moves, out=np.zeros(np.shape(speed))
    )
    return total(force) / np.maximum(moves.sum(axis=0), 1)


def total(values: ArrayLike) -> Array:
    """Return the sum over the first axis in its order: the same bits for one column as for many."""
    array = np.asarray(values)
    return np.add.accumulate(array, axis=0)[-1] if len(array) else np.zeros(array.shape[1:])


def apparent_stiffness(force: ArrayLike, penetration: ArrayLike) -> float:
    """Return the stiffness [N/m] that a wall seems to have: force over depth, by least squares.

    Damping and friction contribute, so it is the wall's own stiffness only for slow pushes into a
    wall without friction.

    Parameters
    ----------
    force, penetration
        Force of the hand into the wall, (T,) [N], and how deep the handle is behind its surface,
        (T,) [m]. Samples at a penetration ≤ 0 are ignored; NaN if no others exist.
    """
    touches = np.asarray(penetration) > 0.0
    depth = np.asarray(penetration, np.float64)[touches]
    square = float(depth @ depth)
    return float(depth @ np.asarray(force)[touches]) / square if square > 0.0 else math.nan


def impedance(force: ArrayLike, velocity: ArrayLike, period: float, frequency: float) -> float:
    """Return ``|F/V|`` [N·s/m] at ω: b for a damper, m·ω for a mass, k/ω for a spring.

    Parameters
    ----------
    force, velocity
        Along one direction, (T,) [N] and [m/s], over a whole number of periods of the motion.
    period, frequency
        The sampling interval [s], and the frequency of the motion [Hz].
    """
    wave = np.exp(-2j * math.pi * frequency * period * np.arange(len(np.asarray(velocity))))
    return float(abs(wave @ np.asarray(force)) / abs(wave @ np.asarray(velocity)))


def z_width(stiffness: float, free_impedance: float, frequency: float) -> float:
    """Return the Z-width [dB]: the stiffest wall's impedance over that in free motion.

    Colgate and Brown, Factors affecting the Z-width of a haptic display (IEEE ICRA 1994); Hayward
    and Astley, Performance measures for haptic interfaces (Robotics Research: The Seventh
    International Symposium, 1996). A Z-width holds for one frequency: a wall's impedance falls with
    the frequency, and a mass's rises.

    Parameters
    ----------
    stiffness, free_impedance, frequency
        As of ``apparent_stiffness`` [N/m] and ``impedance`` [N·s/m], both > 0; frequency [Hz].
    """
    return 20.0 * math.log10(stiffness / (2.0 * math.pi * frequency) / free_impedance)


def spectral_arc_length(
    speed: ArrayLike,
    period: float,
    *,
    cutoff: float = 10.0,
    threshold: float = 0.05,
    padding: int = 4,
) -> float:
    """Return SPARC, the negative arc length of a movement's spectrum: nearer to 0 is smoother.

    Balasubramanian, Melendez-Calderon, Roby-Brami and Burdet, On the analysis of movement
    smoothness (Journal of NeuroEngineering and Rehabilitation 12:112, 2015):
    −∫√((1/ω_c)² + (dV̂/dω)²)dω up to ω_c, where V̂ is the magnitude of the spectrum of the speed
    over its value at 0, and ω_c the last frequency up to ``cutoff`` at which it is at least
    ``threshold``. It is meant for movements from rest to rest, and compares movements of about the
    same duration.

    Parameters
    ----------
    speed, period
        Speed of the handle, (T,) [m/s], T ≥ 1 finite numbers, and the sampling interval [s].
    cutoff, threshold, padding
        Highest frequency [Hz], smallest relative magnitude, and how often the length of the series
        is doubled by zeros after the next power of two. The defaults are the authors'.

    Raises
    ------
    ParameterError
        If there is no speed, or one that is not finite.
    """
    values = np.asarray(speed, np.float64)
    if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
        raise ParameterError(
            f"speed must be a series of at least one finite number [m/s], got {values!r:.80}"
        )
    length = 2 ** (math.ceil(math.log2(len(values))) + padding)
    spectrum = np.abs(np.fft.rfft(values, length))
    if spectrum[0] == 0.0:
        return 0.0
    magnitude = spectrum[: math.floor(cutoff * period * length) + 1] / spectrum[0]
    band = magnitude[: np.flatnonzero(magnitude >= threshold)[-1] + 1]
    return -float(np.hypot(1.0 / max(len(band) - 1, 1), np.diff(band)).sum())
