"""``pter``: the commands. Other packages add theirs by the entry-point group ``pter.commands``."""

import ast
import io
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, suppress
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from inspect import Parameter, Signature, getdoc, signature
from itertools import dropwhile, takewhile
from pathlib import Path
from traceback import extract_tb
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import tyro
from rich import console
from rich.table import Table

from pter_gym._commands.arguments import names_for
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
from pter_gym.errors import DependencyError, ParameterError, PterError, unknown_name

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
    """Return the arguments of a command, or print its help and exit.

    Raises
    ------
    ParameterError
        In one line, if an argument is missing, unknown or of another kind.
    """

    def keep(**arguments: Any) -> dict[str, Any]:
        return arguments

    parameters = {each.name: each for each in _parameters(command)}
    keep.__signature__ = Signature(list(parameters.values()))  # type: ignore[attr-defined]
    keep.__annotations__ = {each.name: each.annotation for each in parameters.values()}
    keep.__doc__ = re.sub(r"\n {8}(?=\S)", " ", getdoc(command) or "")
    printed = io.StringIO()
    try:
        with redirect_stderr(printed):
            return tyro.cli(keep, prog=f"pter {name}", args=arguments)
    except SystemExit as end:
        if not end.code:
            raise
        metavars = {field: _metavar(each.annotation) for field, each in parameters.items()}
        reason = reason_of_parser(printed.getvalue(), arguments, metavars)
    raise ParameterError(f"{reason} (`pter {name} --help` explains)")


def _parameters(command: Command) -> Iterator[Parameter]:
    """Yield the parameters of a command as its help shows them.

    What is None or empty by default has no default there, and nothing is called ``{None}|…``.
    """
    hints = get_type_hints(command, include_extras=True)
    for each in signature(command).parameters.values():
        hint: Any = hints[each.name]
        if each.default in (None, (), "", Parameter.empty):
            shown: dict[str, Any] = {"help_behavior_hint": ""}
            kinds = [kind for kind in get_args(hint) if kind is not NoneType]
            if get_origin(hint) is UnionType and len(kinds) == 1:
                shown["metavar"] = kinds[0].__name__.upper()
            hint = Annotated[hint, tyro.conf.arg(**shown)]
        yield each.replace(annotation=hint, kind=Parameter.KEYWORD_ONLY)


def _is_ruler(line: str) -> bool:
    return not line.strip("─-")


def _metavar(hint: Any) -> str:
    """Return what the help shows for a value."""
    for each in getattr(hint, "__metadata__", ()):
        if metavar := getattr(each, "metavar", None):
            return metavar
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    choices = get_args(kind) if get_origin(kind) is Literal else ()
    return f"{{{','.join(choices)}}}" if choices else getattr(kind, "__name__", "").upper()


def reason_of_parser(printed: str, arguments: list[str], metavars: Mapping[str, str]) -> str:
    """Return in one line why tyro refuses arguments, from the box that it prints."""
    lines = [line.strip("│ ") for line in printed.splitlines()[1:]]  # without the box's title
    words = dropwhile(_is_ruler, lines)  # there is one here where boxes are not drawn
    first = " ".join(takewhile(lambda line: not _is_ruler(line), words))
    if found := re.match(r"Missing from .*?: (\S+(?: …)?)", first):
        field = next((each for each, name in metavars.items() if name == found[1]), "")
        names = names_for(field) or found[1].strip("{}").split(",")
        return f"{field} must be given: {', '.join(names)}"
    if found := re.match(r"Unrecognized options: ([^, ]+)", first):
        near = re.findall(r"^(--[\w-]+)", "\n".join(lines[1:]), re.MULTILINE)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        return f"there is no {found[1]}{hint}"
    if found := re.match(r"invalid choice '(.*)' for argument '(?:--)?(.*)'\. .*\((.*)\)", first):
        return str(unknown_name(found[2], found[1], re.findall(r"'(.*?)'", found[3])))
    if found := re.match(r"(?:Error parsing|Missing value for argument) '?(?:--)?([\w-]+)", first):
        field = found[1].replace("-", "_")
        place = arguments.index(f"--{found[1]}") + 1 if f"--{found[1]}" in arguments else 0
        given = " ".join(takewhile(lambda each: not each.startswith("--"), arguments[place:]))
        return f"{field} must be {metavars.get(field, 'given')}, got {given!r:.200}"
    return first


def main(arguments: list[str] | None = None) -> int:
    """Run ``pter`` and return its exit status: 2 after an error, 130 after Ctrl-C."""
    open_streams()
    accept_all_characters()
    if arguments is None:
        # as pter_gym/__init__.py sets it for the imports
        if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        end_on_interrupt(INTERRUPTED)
        os.environ.pop("MPLBACKEND", None)  # a notebook's, which may be installed only there
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
