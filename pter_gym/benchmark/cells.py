"""Cells of boards and tables: path errors in millimetres, shares, and names that fit."""

from rich.cells import cell_len, chop_cells

from pter_gym.benchmark.intervals import Interval

WIDTH = 80
"""Characters in a line of a table."""

UNRANKED = "†"
"""Mark of a policy without a rank."""


def percent(share: float, digits: int = 3) -> str:
    """Return a share in percent."""
    return f"{100 * share:.{digits}g} %"


def millimetres(error: float, decimals: int = 1, *, signed: bool = False) -> str:
    """Return a number [m] in mm."""
    return f"{1e3 * error:{'+' if signed else ''}.{decimals}f}".replace("-", "−")


def in_brackets(error: Interval, decimals: int = 1, *, signed: bool = False) -> tuple[str, str]:
    """Return a number [m] in mm, and its interval, if it has one: ``1.6`` and `` (1.5 – 1.7)``."""
    value, *ends = (
        millimetres(each, decimals, signed=signed) for each in error if each is not None
    )
    return value, f" ({' – '.join(ends)})" if ends else ""


def with_interval(error: Interval, *, signed: bool = False) -> str:
    """Return a number [m] and its interval, if it has one, in mm: ``1.6 (1.5 – 1.7)``."""
    return "".join(in_brackets(error, signed=signed))


def shorten(text: str, width: int) -> str:
    """Return text of at most so many columns, ≥ 3; a longer one loses its middle."""
    if cell_len(text) <= width:
        return text
    half = (width - 1) // 2
    end = chop_cells(text[::-1], half)[0][::-1]
    return f"{chop_cells(text, width - 1 - half)[0]}…{end}"
