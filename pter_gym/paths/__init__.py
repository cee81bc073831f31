"""What to follow: curves in the plane by arc length, stored as chains of circular arcs."""

from pter_gym.paths.arcs import Arcs, Path
from pter_gym.paths.shapes import Arc, Circle, Line, Polyline, Sine, Spline, read_path

__all__ = ["Arc", "Arcs", "Circle", "Line", "Path", "Polyline", "Sine", "Spline", "read_path"]
