"""The hand that pushes the tip: a constant push along the path and a multi-sine disturbance across it (paper Eq. 5)."""

import math
from dataclasses import dataclass
from typing import Any

from pter_gym._jit import device
from pter_gym.params import preset, quantity, require, require_flag, require_number, require_numbers
from pter_gym.preset import PRESET

SINES = 5
"""Number of sines in the disturbance (paper Eq. 5)."""

EQ5_FREQUENCIES = tuple(2.0**n / 2.0 for n in range(SINES))
"""Frequencies of Eq. 5 [Hz]: sin(2ⁿπt) for n = 0 … 4."""


@dataclass(frozen=True, kw_only=True)
class MultiSineHand:
    """A constant force along the path and a sum of five sines across it (paper section IV-A, Eq. 5).

    The default is Eq. 5: equal amplitudes Fmax/5, frequencies 2ⁿ/2 Hz, phases 0. Neither force is printed in the paper.
    """

    push: float = preset("hand", "push")
    amplitudes: tuple[float, ...] = quantity(
        "N",
        f"Fmax/5 each, by Eq. 5; Fmax is {PRESET.provenance['hand.force_max']}",
        default=(PRESET.hand.force_max / SINES,) * SINES,
    )
    frequencies: tuple[float, ...] = quantity("Hz", "published: Eq. 5", default=EQ5_FREQUENCIES)
    phases: tuple[float, ...] = quantity("rad", "published: Eq. 5", default=(0.0,) * SINES)
    random_phases: bool = quantity("1", "chosen: False is Eq. 5; True draws the phases at each reset", default=False)

    def __post_init__(self) -> None:
        """Check that forces and frequencies are finite and that there are five of each."""
        require_number(self, "push")
        for name in ("amplitudes", "frequencies", "phases"):
            require_numbers(self, name, f"a tuple of {SINES} finite numbers", count=SINES)
        require(min(self.frequencies) >= 0.0, self, "frequencies", self.frequencies, "≥ 0")
        require_flag(self, "random_phases")

    def normal_force(self, time: float) -> float:
        """Return the force across the path [N] at a time [s] (Eq. 5)."""
        waves = zip(self.amplitudes, self.frequencies, self.phases, strict=True)
        return sum(a * math.sin(2.0 * math.pi * f * time + phase) for a, f, phase in waves)


def eq5(force_max: float, push: float) -> MultiSineHand:
    """Return the hand of the paper's standard test: ``Fmax`` of Eq. 5 [N] and the constant tangential force [N]."""
    return MultiSineHand(push=push, amplitudes=(force_max / SINES,) * SINES)


@device
def unit_vector(angle: float) -> tuple[float, float]:
    """Return (cos, sin) of an angle [rad]."""
    return math.cos(angle), math.sin(angle)


@device
def turn(cos: float, sin: float, by_cos: float, by_sin: float) -> tuple[float, float]:
    """Turn a unit vector by another one."""
    return cos * by_cos - sin * by_sin, sin * by_cos + cos * by_sin


@device
def sum_of_sines(w: Any, first: int, amplitude: int, i: int) -> float:
    """Return the disturbance [N] of world i (paper Eq. 5).

    ``first`` and ``amplitude`` are the first rows of the sines' unit vectors (cos and sin in turn) and amplitudes [N].
    """
    total = 0.0
    for k in range(SINES):
        total += w[amplitude + k, i] * w[first + 2 * k + 1, i]
    return total


@device
def advance_sines(w: Any, first: int, rotation: int, i: int) -> None:
    """Move the sines of world i on by a substep; ``rotation`` is the first row of their turns per substep."""
    for k in range(SINES):
        w[first + 2 * k, i], w[first + 2 * k + 1, i] = turn(
            w[first + 2 * k, i], w[first + 2 * k + 1, i], w[rotation + 2 * k, i], w[rotation + 2 * k + 1, i]
        )


@device
def renew_sines(w: Any, first: int, i: int) -> None:
    """Bring the unit vectors of the sines of world i back to unit length."""
    for k in range(SINES):
        cos = w[first + 2 * k, i]
        sin = w[first + 2 * k + 1, i]
        scale = 1.5 - 0.5 * (cos * cos + sin * sin)
        w[first + 2 * k, i] = cos * scale
        w[first + 2 * k + 1, i] = sin * scale
