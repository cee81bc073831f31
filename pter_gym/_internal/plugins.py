"""What other packages and the tools beside the core register by entry points, so the core imports none of them."""

from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any

from pter_gym.errors import DependencyError

COMMANDS = "pter.commands"
"""Entry points that are commands of ``pter``, by name."""

PICTURES = "pter.pictures"
"""Entry points that draw for the core: ``world`` and ``worlds`` for environments, the others for ``pter benchmark``."""


def registered(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, without those whose module is not there."""
    return {entry.name: entry for entry in sorted(entry_points(group=group)) if _exists(entry.module)}


def load_artist(name: str) -> Any:
    """Return what draws, or raise a DependencyError if nothing that can is installed."""
    artists = registered(PICTURES)
    if name not in artists:
        raise DependencyError(f"drawing needs an entry point {name!r} in the group {PICTURES}; none is installed")
    return artists[name].load()


def _exists(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:
        return False
