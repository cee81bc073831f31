"""Typed errors.

Each message names the field and the accepted range; no state has changed when one is raised.
"""

import difflib
import re
import sys
from collections.abc import Iterable

import gymnasium

__all__ = [
    "ActionError",
    "DataError",
    "DependencyError",
    "DivergenceError",
    "LawIndexError",
    "ParameterError",
    "PartnerError",
    "ProofError",
    "PterError",
    "ResetNeededError",
    "StorageError",
]

ACTING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029]")
"""Characters that ring, move the cursor or change colours on a terminal."""


def printable(text: str) -> str:
    r"""Return text whose control characters are escaped, as in ``\x1b``; lines stay lines."""
    return ACTING.sub(lambda match: repr(match[0])[1:-1], text)


class PterError(Exception):
    """Base of all errors that this package raises deliberately."""

    def __str__(self) -> str:
        """Return the message; control characters, as a file's name may have them, are escaped."""
        return printable(super().__str__())


class ParameterError(PterError, ValueError):
    """A parameter is non-physical, out of range, unknown or of the wrong shape."""


class LawIndexError(ParameterError, IndexError):
    """A compiled law reads or writes beyond its observation, gains or memory."""


class ActionError(PterError, gymnasium.error.InvalidAction, ValueError):
    """An action has a wrong shape or type, is not finite, or lies outside the action space."""


class DivergenceError(PterError, ArithmeticError):
    """A motion has grown beyond the range of floating point; use a smaller substep."""


class ResetNeededError(PterError, gymnasium.error.ResetNeeded):
    """A step was requested before the first reset or after the end of an episode."""


class DependencyError(PterError, gymnasium.error.DependencyNotInstalled):
    """An optional package is needed; the message names the extra that installs it."""


class DataError(PterError, RuntimeError):
    """A stored file is missing or damaged."""


class StorageError(PterError, OSError):
    """A file cannot be written, as on a full disk."""


class ProofError(PterError, AssertionError):
    """Exported code could not be proven; the message says where and what may go wrong."""


class PartnerError(PterError, RuntimeError):
    """The partner of ``pter hil`` has ended, is late with an answer, or sends an invalid one."""


def needs_extra(feature: str, extra: str) -> DependencyError:
    """Return the error for a missing optional package, with the command that installs it."""
    return DependencyError(
        f"{feature} needs the extra {extra}: "
        f"run `{sys.executable} -m pip install -c constraints.txt -e '.[{extra}]'` in your clone"
    )


def unknown_name(field: str, name: object, known: Iterable[str]) -> ParameterError:
    """Return the error for an unknown name, with the known ones and the nearest."""
    known = list(known)
    if name == "":
        return ParameterError(f"{field} must be given, one of {', '.join(known)}")
    return ParameterError(
        f"{field} must be among {', '.join(known)}, got {name!r:.200}{nearest(name, known)}"
    )


def nearest(name: object, known: Iterable[str]) -> str:
    """Return the end of a message: the known names nearest to one, or nothing if none is near."""
    listed, text = list(known), str(name)
    near = [each for each in listed if text and each.startswith(text)]
    near = near or difflib.get_close_matches(text, listed, n=3, cutoff=0.5)
    return f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
