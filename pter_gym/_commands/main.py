"""``pter``: the commands. Other packages add theirs by the entry-point group ``pter.commands``."""

import ast
import functools
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from pathlib import Path
from traceback import extract_tb
from typing import Any

import tyro
from rich import console
from rich.table import Table

from pter_gym._internal.plugins import COMMANDS, registered
from pter_gym._internal.terminal import (
    accept_all_characters,
    close_output,
    end_on_interrupt,
    open_streams,
    say,
    terminal,
)
from pter_gym._version import __version__
from pter_gym.errors import DependencyError, PterError, unknown_name

Command = Callable[..., int | None]

CORE_COMMANDS = ("benchmark",)
"""Commands of the core: command NAME is the function NAME in NAME.py, beside this file."""

DESCRIPTION = "PTER, a passive haptic arm with four friction clutches."

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""


def commands() -> dict[str, EntryPoint]:
    """Return where each command is, in the order of the help: the core's, then registered ones."""
    core = {
        name: EntryPoint(name, f"{__package__}.{name}:{name}", COMMANDS) for name in CORE_COMMANDS
    }
    return core | registered(COMMANDS)


def load_command(name: str) -> Command:
    """Return a command, or raise a ParameterError with the nearest names."""
    known = commands()
    if name not in known:
        raise unknown_name("COMMAND", name, known)
    try:
        return known[name].load()
    except ModuleNotFoundError as error:
        raise DependencyError(
            f"{name}, which is {known[name].value}, does not load: {error}"
        ) from None


def parse(name: str, command: Command, arguments: list[str]) -> dict[str, Any]:
    """Return the arguments of a command, or print its help or an error and exit, as tyro does."""

    @functools.wraps(command)
    def keep(**arguments: Any) -> dict[str, Any]:
        return arguments

    return tyro.cli(keep, prog=f"pter {name}", args=arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run ``pter`` and return its exit status: 2 after an error, 130 after Ctrl-C."""
    open_streams()
    accept_all_characters()
    if arguments is None:
        if (
            signal.getsignal(signal.SIGINT) is signal.SIG_DFL
        ):  # as pter_gym/__init__.py sets it for the imports
            signal.signal(signal.SIGINT, signal.default_int_handler)
        end_on_interrupt(INTERRUPTED)
        os.environ.pop(
            "MPLBACKEND", None
        )  # a notebook's, which may be installed for the notebook only
    try:
        status = _run(sys.argv[1:] if arguments is None else arguments)
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        terminal(errors=True).print("interrupted; files that were written are complete")
        return INTERRUPTED
    except OSError as error:  # of a file, or of where the output goes
        printed = close_output() if arguments is None else True
        with suppress(OSError):
            complain(reason_of(error, printed=printed))
        return 2


def reason_of(error: OSError, *, printed: bool = True) -> str:
    """Return what is wrong: with a file, which some errors do not name, or with the output."""
    if error.filename:
        return str(error)
    if isinstance(error, FileNotFoundError):
        return "the current folder is no longer there"
    last = extract_tb(error.__traceback__)[-1]
    if not printed or last.filename in (__file__, console.__file__):
        return f"not everything could be printed: {error.strerror}"
    where = f"{last.filename}, line {last.lineno}"
    return f"a file could not be read or written: {error.strerror or error} (in {where})"


def _run(arguments: list[str]) -> int:
    name, *rest = arguments or ["--help"]
    if name == "--version":
        say(f"pter {__version__}")
        return 0
    if name in ("-h", "--help"):
        _print_overview()
        return 0
    try:
        command = load_command(name)
        return command(**parse(name, command, rest)) or 0
    except PterError as error:
        complain(str(error))
        return 2


def complain(text: str) -> None:
    """Print what is wrong."""
    terminal(errors=True).print(f"error: {text}", style="red", soft_wrap=True, markup=False)


def summary(entry: EntryPoint) -> str:
    """Return the first line of a command's docstring, without importing it: all take seconds."""
    spec = None
    with suppress(ImportError):  # of a package that is no longer there
        spec = find_spec(entry.module)
    source = Path(spec.origin).read_text("utf-8") if spec and spec.origin else ""
    functions = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    texts = [ast.get_docstring(node) or "" for node in functions if node.name == entry.attr]
    return texts[0].partition("\n")[0] if texts else ""


def _print_overview() -> None:
    """Print all commands, on one screen."""
    screen = terminal()
    screen.print(f"usage: pter COMMAND …\n\n{DESCRIPTION}\n")
    table = Table.grid(padding=(0, 2))
    for name, entry in commands().items():
        table.add_row(f"  {name}", summary(entry))
    screen.print(table)
    screen.print("\n`pter COMMAND --help` explains a command; `pter --version` prints the version.")


if __name__ == "__main__":
    sys.exit(main())
