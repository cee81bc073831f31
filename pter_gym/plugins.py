"""Entry points through which tools and other packages register; the core imports none of them."""

import sys
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from pter_gym.errors import DependencyError

COMMANDS, PICTURES = "pter.commands", "pter.pictures"
"""Groups: commands of ``pter``; artists for environments, films, boards and force regions."""


def registered(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name."""
    return {entry.name: entry for entry in sorted(entry_points(group=group))}


def load_artist(name: str) -> Any:
    """Return what draws, or raise a DependencyError if nothing that can is installed."""
    if name not in (artists := registered(PICTURES)):
        raise DependencyError(
            f"nothing can draw {name!r}: "
            f"run `{sys.executable} -m pip install -c constraints.txt -e .` in your clone"
        )
    return artists[name].load()
