"""What to follow: a path given by arc length, with its heading and curvature at each point."""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from pter_gym._jit import device
from pter_gym.params import preset, require_number


class Path(Protocol):
    """A curve in the plane by its arc length s [m]; ``normal`` errors are positive to the left of the heading."""

    @property
    def length(self) -> float:
        """Total arc length [m]."""
        ...

    def point(self, s: float) -> tuple[float, float]:
        """Return the point (x, y) [m] at an arc length [m]."""
        ...

    def heading(self, s: float) -> float:
        """Return the direction of travel [rad] at an arc length [m]."""
        ...

    def curvature(self, s: float) -> float:
        """Return the curvature [1/m], positive to the left, at an arc length [m]."""
        ...


@dataclass(frozen=True, kw_only=True)
class Line:
    """A straight path (paper section IV-A: "spanning the width of the workspace")."""

    x: float = preset("path", "x")
    y: float = preset("path", "y")
    direction: float = preset("path", "direction")
    length: float = preset("path", "length")

    def __post_init__(self) -> None:
        """Check that the numbers are finite and the length positive."""
        for name in ("x", "y", "direction"):
            require_number(self, name)
        require_number(self, "length", above=0.0)

    def point(self, s: float) -> tuple[float, float]:
        """Return the point (x, y) [m] at an arc length [m]."""
        return self.x + s * math.cos(self.direction), self.y + s * math.sin(self.direction)

    def heading(self, s: float) -> float:  # noqa: ARG002
        """Return the direction of travel [rad]."""
        return self.direction

    def curvature(self, s: float) -> float:  # noqa: ARG002
        """Return the curvature [1/m]: none."""
        return 0.0


class LineModel(NamedTuple):
    """Constants of a line as the kernels see them."""

    start_x: float
    start_y: float
    heading_cos: float
    heading_sin: float
    path_length: float


def line_model(line: Line) -> LineModel:
    """Return the constants of a line for the kernels."""
    return LineModel(line.x, line.y, math.cos(line.direction), math.sin(line.direction), line.length)


@device
def project(line: LineModel, x: float, y: float) -> tuple[float, float]:
    """Return the arc length of the nearest point of the path, not limited to it, and the normal error [m, m]."""
    from_x = x - line.start_x
    from_y = y - line.start_y
    return (
        from_x * line.heading_cos + from_y * line.heading_sin,
        from_y * line.heading_cos - from_x * line.heading_sin,
    )
