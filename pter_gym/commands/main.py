"""``pter``: the commands. Other packages add theirs by the entry-point group ``pter.commands``."""

import sys
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any

import tyro
from rich.console import Console

from pter_gym._version import __version__
from pter_gym.commands.arguments import PATHS
from pter_gym.commands.benchmark import benchmark
from pter_gym.commands.fit import fit
from pter_gym.commands.record import record
from pter_gym.commands.reproduce import reproduce
from pter_gym.commands.speed import speed
from pter_gym.commands.tune import tune
from pter_gym.commands.verify import verify
from pter_gym.errors import PterError

GROUP = "pter.commands"

DESCRIPTION = "PTER, a passive haptic arm with four friction clutches. `pter COMMAND --help` explains a command."

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""


def commands() -> dict[str, Callable[..., Any]]:
    """Return all commands by name: the built-in ones and those of installed packages."""
    found: dict[str, Callable[..., Any]] = {
        "benchmark": benchmark,
        "fit": fit,
        "record": record,
        "reproduce": reproduce,
        "speed": speed,
        "tune": tune,
        "verify": verify,
    }
    for entry in entry_points(group=GROUP):
        found[entry.name] = entry.load()
    return found


def main(arguments: list[str] | None = None) -> int:
    """Run ``pter`` and return its exit status: the command's, else 0; 2 for a wrong argument, 130 after Ctrl-C."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments == ["--version"]:
        Console().print(f"pter {__version__}", highlight=False)
        return 0
    try:
        status = tyro.extras.subcommand_cli_from_dict(
            commands(),
            prog="pter",
            description=DESCRIPTION,
            args=arguments,
            registry=PATHS,
        )
    except PterError as error:
        Console(stderr=True).print(f"error: {error}", style="red", highlight=False, soft_wrap=True, markup=False)
        return 2
    except KeyboardInterrupt:
        Console(stderr=True).print("interrupted; results that were written are whole", highlight=False)
        return INTERRUPTED
    return status if isinstance(status, int) else 0


if __name__ == "__main__":
    sys.exit(main())
