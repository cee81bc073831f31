"""Paths to follow: planar curves parametrised by arc length, stored as chains of circular arcs."""

from typing import TYPE_CHECKING, Any

import lazy_loader

if TYPE_CHECKING:
    from pter_gym.paths._arcs import Arcs, Path, chain, fit_arcs
    from pter_gym.paths._shapes import (
        PATHS,
        Arc,
        Circle,
        Line,
        Polyline,
        Sine,
        Spline,
        find_path,
        read_path,
    )

__all__ = [
    "PATHS",
    "Arc",
    "Arcs",
    "Circle",
    "Line",
    "Path",
    "Polyline",
    "Sine",
    "Spline",
    "chain",
    "find_path",
    "fit_arcs",
    "read_path",
]

lazy: Any = lazy_loader
__getattr__, __dir__, _ = lazy.attach(
    __name__,
    submod_attrs={
        "_arcs": ["Arcs", "Path", "chain", "fit_arcs"],
        "_shapes": [
            "PATHS",
            "Arc",
            "Circle",
            "Line",
            "Polyline",
            "Sine",
            "Spline",
            "find_path",
            "read_path",
        ],
    },
)
