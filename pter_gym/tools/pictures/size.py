"""Sizes of pictures [px]."""

from pter_gym._internal.checks import whole_number
from pter_gym.errors import ParameterError

WIDTH, HEIGHT = 840, 600
"""Of the picture of one world."""

TILE_WIDTH, TILE_HEIGHT = 320, 240
"""Of each picture of many worlds."""

MIN_SIDE, MAX_SIDE = 32, 8192
"""Limits of both."""


def check_size(width: object, height: object) -> tuple[int, int]:
    """Return the size of a picture [px], or raise a ParameterError that names the wrong side."""
    return _check_side("width", width), _check_side("height", height)


def _check_side(name: str, value: object) -> int:
    side = whole_number(name, value, at_least=MIN_SIDE)
    if side > MAX_SIDE:
        accepted = f"a whole number within [{MIN_SIDE}, {MAX_SIDE}]"
        raise ParameterError(f"{name} must be {accepted}, got {value!r}")
    return side
