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
    """Return the size of a picture [px], or raise a ParameterError that names what is wrong with it."""
    found: list[int] = []
    for name, value in (("width", width), ("height", height)):
        number = whole_number(name, value, at_least=MIN_SIDE)
        if number > MAX_SIDE:
            raise ParameterError(
                f"{name} must be a whole number within [{MIN_SIDE}, {MAX_SIDE}], got {value!r}"
            )
        found.append(number)
    return found[0], found[1]
