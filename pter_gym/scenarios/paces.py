"""Commanded paces by name."""

from types import MappingProxyType
from typing import Any

from pter_gym._internal.checks import builtin, is_finite, names_in
from pter_gym.errors import ParameterError, unknown_name

PACES = MappingProxyType({"slow": 0.12, "medium": 0.25, "brisk": 0.5})
"""Commanded mean speeds along the path [m/s] at which each scenario is scored."""


SLOWEST = 0.001
"""Slowest commanded pace [m/s]: 1 m takes 17 min."""


def find_pace(pace: float | str, field: str = "pace") -> float:
    """Return a commanded pace [m/s] given as itself, also in text, or by its name in ``PACES``.

    Raises
    ------
    ParameterError
        If there is no such pace; the message names the field and suggests the nearest name.
    """
    speed: Any = builtin(pace)
    if isinstance(pace, str):
        if pace in PACES:
            return PACES[pace]
        try:
            speed = float(pace)
        except ValueError:
            raise unknown_name(field, pace, (*PACES, f"a speed ≥ {SLOWEST:g} m/s")) from None
    if not is_finite(speed) or speed < SLOWEST:
        accepted = f"{', '.join(PACES)}, or a speed ≥ {SLOWEST:g} m/s"
        raise ParameterError(f"{field} must be one of {accepted}, got {pace!r}")
    return float(speed)


def name_of_pace(pace: float | str, field: str = "pace") -> str:
    """Return the name of a commanded pace, or its speed as text; raises as ``find_pace``."""
    speed = find_pace(pace, field)
    return next((name for name, named in PACES.items() if named == speed), str(speed))


def names_of_paces(paces: object) -> list[str]:
    """Return the names of paces, also of a single one; raises as ``find_pace``."""
    several: Any = builtin(paces)
    listed = names_in("paces", [several] if isinstance(several, int | float) else several)
    return [name_of_pace(pace, "paces") for pace in listed]


def title_of_pace(pace: str) -> str:
    """Return a commanded pace as tables show it: ``medium (0.25 m/s)``, or ``0.3 m/s``."""
    speed = f"{find_pace(pace):g} m/s"
    return f"{pace} ({speed})" if pace in PACES else speed
