from ._arcs import Arcs as Arcs, Path as Path, chain as chain, fit_arcs as fit_arcs
from ._shapes import (
    PATHS as PATHS,
    Arc as Arc,
    Circle as Circle,
    Line as Line,
    Polyline as Polyline,
    Sine as Sine,
    Spline as Spline,
    find_path as find_path,
    read_path as read_path,
)
