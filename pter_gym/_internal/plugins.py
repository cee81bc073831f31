"""What other packages and the tools beside the core register by entry points, so the core imports none of them."""

import ast
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pter_gym.errors import DependencyError

COMMANDS = "pter.commands"
"""Entry points that are commands of ``pter``, by name."""

PICTURES = "pter.pictures"
"""Entry points that draw for the core: ``world`` and ``worlds`` for environments, the others for ``pter benchmark``."""


def registered(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, without those whose module is not there."""
    return {entry.name: entry for entry in sorted(entry_points(group=group)) if file_of(entry.module)}


def load_artist(name: str) -> Any:
    """Return what draws, or raise a DependencyError if nothing that can is installed."""
    artists = registered(PICTURES)
    if name not in artists:
        raise DependencyError(f"nothing installed can draw {name!r}: run `pip install -e .` again where the source is")
    return artists[name].load()


def summary(entry: EntryPoint) -> str:
    """Return the first line of a function's docstring from its file: to import all that is registered takes seconds."""
    path = file_of(entry.module)
    for node in ast.parse(path.read_text(encoding="utf-8")).body if path else []:
        if isinstance(node, ast.FunctionDef) and node.name == entry.attr:
            return (ast.get_docstring(node) or "").partition("\n")[0]
    return ""


def file_of(module: str) -> Path | None:
    """Return the file of a module, None if there is none; nothing but its outermost package is looked up."""
    package, *parts = module.split(".")
    spec = find_spec(package)
    for folder in (spec.submodule_search_locations if spec else None) or ():
        for path in (Path(folder, *parts).with_suffix(".py"), Path(folder, *parts, "__init__.py")):
            if path.exists():
                return path
    return None
