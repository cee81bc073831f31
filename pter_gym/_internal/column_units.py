"""Units that the names of columns state: ``theta_A [deg]``, ``n/rpm``, ``t, ms``, ``x_mm``."""

import math
import re
import unicodedata
from collections.abc import Mapping

UNITS: Mapping[str, Mapping[str, float]] = {
    "m": {
        "m metre metres meter meters": 1.0,
        "cm": 1e-2,
        "mm millimetre millimetres millimeter millimeters": 1e-3,
    },
    "s": {
        "s sec secs second seconds": 1.0,
        "ms msec msecs millis millisecond milliseconds": 1e-3,
        "µs us usec usecs micros microsecond microseconds": 1e-6,
        "ns nsec nanosecond nanoseconds": 1e-9,
        "min": 60.0,
        "h": 3600.0,
    },
    "V": {
        "V volt volts": 1.0,
        "mV millivolt millivolts": 1e-3,
        "kV": 1e3,
        "A amp amps ampere amperes": 1.0,
        "mA milliamp milliamps milliampere": 1e-3,
    },
    "rad": {
        "rad rads radian radians": 1.0,
        "mrad": 1e-3,
        "deg degs degree degrees °": math.pi / 180.0,
    },
    "rad/s": {
        "rad/s rad/sec rads1 radsec1 rad_s rad_per_s radps radians/s": 1.0,
        "deg/s deg/sec degs1 deg_s deg_per_s dps degrees/s degree/s °/s °s1": math.pi / 180.0,
        "rpm rev/min r/min 1/min /min min1 U/min Umin1 U1/min revmin1": math.pi / 30.0,
        "rps rev/s r/s": 2.0 * math.pi,
    },
    "N": {
        "N newton newtons": 1.0,
        "mN": 1e-3,
        "kN": 1e3,
        "lbf": 4.4482216152605,
        "kgf kp": 9.80665,
    },
    "N·m": {
        "N·m newtonmetre newtonmetres newtonmeter newtonmeters": 1.0,
        "mN·m": 1e-3,
        "kN·m": 1e3,
        "N·cm": 1e-2,
        "N·mm": 1e-3,
        "lbf·in lb·in in·lbf in·lb inlbs": 0.1129848290276167,
        "lbf·ft lb·ft ft·lbf ft·lb ftlbs": 1.3558179483314004,
        "ozf·in oz·in in·ozf in·oz": 7.061551814226e-3,
    },
}
"""Units in which a column may be, by that in which it is returned: all spellings, and the size.

A drive is in volts or amperes; its column says which.
"""

_MULTIPLIED = re.compile(r"[\s·⋅∙•*×^.\u2010-\u2015\u2212-]+")
_BRACKETS = re.compile(r"(.+?)\s*[/,:]?\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))$")
_BEHIND = re.compile(r"\s*/\s*|\s*,\s*|\s+in\s+|_")

_SYMBOL = (
    r"(?:[fpnuµμmcdhkMG]?(?:m|g|N|Pa|V|A|W|J|Hz|s|sec|rad|deg|°|gon|rpm|rps|bar|Ohm|Ω|K|C|T|lsb)"
    r"|min|h|hr|hrs|d|lbf?|lbs|pounds?|ozf?|ounces?|kgf|kp|gf|dyn|in|inch|inches|ft|feet|psi|mils?"
    r"|counts?|cts|ticks?|steps?|turns?|revs?|revolutions?|r|U|%|percent|pct|digits?|frames?|samples?"
    r"|minutes?|hours?|days?|degrees?|grad|radians?|newtons?|volts?|amps?|seconds?|met(?:re|er)s?)"
    r"(?:[\^-]*\d)?"
)
_UNIT_LIKE = re.compile(
    rf"1?/?{_SYMBOL}(?:(?:[·⋅∙•*×./ -]|_?per_?)+{_SYMBOL})*"
    r"|[mkM]?(?:N|kp|p)[cmk]?m|(?:lbf?|ozf?)(?:in|ft)|(?:in|ft)(?:lbs?|lbf|ozf?)|(?:rad|deg|m)_s",
    re.IGNORECASE,
)
"""A unit of anything, or what is counted in place of one."""


def _plain(text: str) -> str:
    """Return a unit without signs of multiplication and powers: ``min⁻¹`` is ``min1``."""
    return _MULTIPLIED.sub("", unicodedata.normalize("NFKC", text))


_SIZES = {
    kind: {
        _plain(spelling): size
        for spellings, size in sizes.items()
        for spelling in spellings.split()
    }
    for kind, sizes in UNITS.items()
}


def size_of(text: str, kind: str) -> float | None:
    """Return the size of a unit over the one in which a column is returned; None if unknown.

    Capitals do not matter, but for M, which is mega in place of milli.
    """
    plain, sizes = _plain(text), _SIZES[kind]
    if plain in sizes:
        return sizes[plain]
    alike = {
        size
        for spelling, size in sizes.items()
        if spelling.lower() == plain.lower()
        and (kind == "s" or (plain[0] == "M") == (spelling[0] == "M"))
    }
    return alike.pop() if len(alike) == 1 else None


def is_known(text: str) -> bool:
    """Return whether a text is a known unit of any column."""
    return any(size_of(text, kind) is not None for kind in UNITS)


def is_like_a_unit(text: str) -> bool:
    """Return whether a text looks like a unit, known or not, or says that there is none."""
    return text in ("", "-", "1") or is_known(text) or bool(_UNIT_LIKE.fullmatch(text))


def split_unit(entry: str, kind: str) -> tuple[str, str]:
    """Return a column's name and the unit that it states, known or not; "" for none.

    In brackets, all but numbers are units. Behind ``/``, a comma, ``in`` or ``_``, what looks like
    one is; behind ``_``, single letters are only where they are units of this column, as the A of
    ``theta_A`` is none.
    """
    if (found := _BRACKETS.match(entry)) and not (text := found[2] or found[3] or "").isdigit():
        return found[1], text.strip() or "-"
    parts = [
        (entry[: sign.start()], sign[0], entry[sign.end() :]) for sign in _BEHIND.finditer(entry)
    ]
    parts = [part for part in parts if all(part)]
    known = [(name, text) for name, _, text in parts if size_of(text, kind) is not None]
    alike = [
        (name, text)
        for name, sign, text in parts
        if _UNIT_LIKE.fullmatch(text) and not (sign == "_" and (len(text) == 1 or text == "in"))
    ]
    return next(iter([*known, *alike]), (entry, ""))


def shown_units(kind: str) -> str:
    """Return the units of a column, for messages."""
    return ", ".join(spellings.split()[0] for spellings in UNITS[kind])
