"""Functions of one number that the equations share."""

from pter_gym._compiled.compiler import inlined


@inlined
def clamp(x: float, low: float, high: float) -> float:
    """Return x limited to [low, high]."""
    x = x if x > low else low
    return x if x < high else high


@inlined
def sign(x: float) -> float:
    """Return 1 for x ≥ 0 and −1 otherwise."""
    return 1.0 if x >= 0.0 else -1.0
