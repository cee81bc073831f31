"""The paper's units, to and from SI. Everything inside the package is SI."""

INCH = 0.0254
"""One inch in metres (exact)."""

POUND_FORCE = 4.4482216152605
"""One pound-force in newtons (exact)."""

INCH_POUND = INCH * POUND_FORCE
"""One inch-pound of torque in newton-metres."""


def to_inches(metres: float) -> float:
    """Return a length, speed or acceleration in m, m/s, m/s² as in, in/s, in/s²."""
    return metres / INCH


def to_inch_pounds(newton_metres: float) -> float:
    """Return a torque in N·m as in·lbf."""
    return newton_metres / INCH_POUND


def from_inch_pounds(inch_pounds: float) -> float:
    """Return a torque in in·lbf as N·m."""
    return inch_pounds * INCH_POUND
