"""A library of human arms and tremors, from ``presets/hands.toml`` with its sources."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from pter_gym._internal.codec import tuple_of
from pter_gym._internal.reading import read_toml
from pter_gym.params import Hand

Matrix = tuple[tuple[float, float], tuple[float, float]]
"""A symmetric matrix in the plane."""

HandGrade = Literal["measured", "derived", "order of magnitude"]
"""Read where the numbers are printed, computed from such or commonly cited ones, or chosen."""


@dataclass(frozen=True, kw_only=True)
class LibraryArm:
    """Mass, damper and spring of a human arm at the hand, in the horizontal plane.

    Attributes
    ----------
    mass, damping, stiffness
        Symmetric positive definite matrices [kg], [N·s/m], [N/m].
    axes
        Whether they are in body axes (x to the right, y ahead) or in principal axes: then only the
        smallest and largest values over all directions are known, and the matrices are diagonal.
    posture
        Posture or activity of the person.
    grade, provenance
        Where the numbers come from.
    source
        The study that the numbers come from, or that suggested them, and the DOI where it was seen.
    """

    name: str
    mass: Matrix
    damping: Matrix
    stiffness: Matrix
    axes: Literal["body", "own"]
    posture: str
    grade: HandGrade
    provenance: str
    source: str

    @property
    def hand(self) -> Hand:
        """The hand for the simulator: axes, ``own`` ones too, along the world's; mean mass."""
        damping, stiffness = _anisotropy(self.damping), _anisotropy(self.stiffness)
        return replace(
            self.isotropic_hand, damping_anisotropy=damping, stiffness_anisotropy=stiffness
        )

    @property
    def isotropic_hand(self) -> Hand:
        """The same with damping and stiffness averaged over all directions: half of each trace."""
        mass, damping, stiffness = (
            0.5 * (m[0][0] + m[1][1]) for m in (self.mass, self.damping, self.stiffness)
        )
        return Hand(mass=mass, damping=damping, stiffness=stiffness)


def _anisotropy(matrix: Matrix) -> tuple[float, float]:
    """Return (e, f) of a matrix; see ``Hand``."""
    (xx, xy), (_, yy) = matrix
    return (xx - yy) / (xx + yy), 2.0 * xy / (xx + yy)


@dataclass(frozen=True, kw_only=True)
class LibraryTremor:
    """A tremor of the free hand.

    Attributes
    ----------
    band
        Lowest and highest frequency [Hz].
    acceleration
        Smallest and largest amplitude of the hand's acceleration [m/s²].
    grade, provenance
        Where the numbers come from.
    source
        The study that the numbers come from, or that suggested them, and the DOI where it was seen.
    """

    name: str
    band: tuple[float, float]
    acceleration: tuple[float, float]
    grade: HandGrade
    provenance: str
    source: str

    @property
    def middle(self) -> tuple[float, float]:
        """The geometric means of frequency [Hz] and acceleration [m/s²]."""
        return math.sqrt(math.prod(self.band)), math.sqrt(math.prod(self.acceleration))


def _entries(kind: type[Any], tables: dict[str, dict[str, Any]]) -> Mapping[str, Any]:
    """Return the entries of one kind by name."""
    return MappingProxyType(
        {
            name: kind(name=name, **{key: tuple_of(value) for key, value in table.items()})
            for name, table in tables.items()
        }
    )


_LIBRARY = read_toml(Path(__file__).parents[1] / "presets" / "hands.toml", "hands")

LIBRARY_ARMS: Mapping[str, LibraryArm] = _entries(LibraryArm, _LIBRARY["arms"])
"""Human arms by name."""

LIBRARY_TREMORS: Mapping[str, LibraryTremor] = _entries(LibraryTremor, _LIBRARY["tremors"])
"""Tremors by name."""
