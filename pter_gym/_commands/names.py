"""The names that arguments accept, from where they are declared."""

import inspect
from collections.abc import Callable
from typing import Any

from rich.table import Table

from pter_gym.scenarios import PACES, SCENARIOS

Names = dict[str, list[str]]


def scenarios() -> Names:
    """Return the scenarios."""
    return {"scenarios": list(SCENARIOS)}


def paces() -> Names:
    """Return the commanded paces."""
    return {"paces": list(PACES)}


def tunable() -> Names:
    """Return the controllers whose gains can be searched."""
    from pter_gym.benchmark.tuned import TUNABLE

    return {"controllers": list(TUNABLE)}


def machines() -> Names:
    """Return the named machines."""
    from pter_gym.params import MACHINES

    return {"machines": list(MACHINES)}


def policies() -> Names:
    """Return all that acts: controllers, those with tuned gains, and trained policies."""
    from pter_gym.benchmark.tuned import TUNED
    from pter_gym.controllers import CONTROLLERS

    return {"controllers": list(CONTROLLERS), "tuned": list(TUNED), **trained()}


def trained() -> Names:
    """Return the trained policies that the package ships."""
    from pter_gym.policies import shipped_policies

    return {"trained": list(shipped_policies())}


NAMES: dict[str, Callable[[], Names]] = {
    "controller": tunable,
    "policies": policies,
    "policy": trained,
    "scenario": scenarios,
    "scenarios": scenarios,
    "pace": paces,
    "paces": paces,
    "machine": machines,
}
"""What an argument of a name accepts, whatever the command."""


def names_of(command: Callable[..., Any]) -> Names:
    """Return the names that the arguments of a command accept, by kind; its module's ``names`` tells of its own."""
    found: Names = getattr(inspect.getmodule(command), "names", dict)()
    for name in inspect.signature(command).parameters:
        found |= NAMES[name]() if name in NAMES else {}
    return found


def names_table(command: Callable[..., Any]) -> Table:
    """Return the names that the arguments of a command accept, to print below its help."""
    table = Table.grid(padding=(0, 2))
    for kind, names in names_of(command).items():
        table.add_row(kind, ", ".join(names))
    return table
