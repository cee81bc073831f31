"""``pter``: the commands. Other packages add theirs by the entry-point group ``pter.commands``."""

import ast
import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from inspect import Parameter, Signature, getdoc, signature
from itertools import chain
from pathlib import Path
from shutil import get_terminal_size
from textwrap import fill
from traceback import extract_tb
from types import NoneType, UnionType
from typing import Annotated, Any, TextIO, get_args, get_origin, get_type_hints

import tyro
from rich import console
from rich.table import Table

from pter_gym._commands.terminal import (
    accept_all_characters,
    close_output,
    end_on_interrupt,
    open_streams,
    say,
    terminal,
)
from pter_gym._version import __version__
from pter_gym.errors import DependencyError, ParameterError, PterError, unknown_name
from pter_gym.plugins import COMMANDS, registered

Command = Callable[..., int | Callable[[], None] | None]
"""A function of its options, or a class of them, an instance of which runs when it is called."""

CORE_COMMANDS = {"benchmark": "benchmark:Benchmark"}
"""Commands of the core, each with the file beside this one, and what it is there."""

DESCRIPTION = "PTER, a passive haptic arm with four friction clutches."

NUMBERS = {int: "a whole number", float: "a number"}
"""What an option's value must be, by its type."""

FAILED, INTERRUPTED = 2, 130
"""Exit status after an error, and after Ctrl-C, as shells have it."""


def commands() -> dict[str, EntryPoint]:
    """Return where each command is, in the order of the help: the core's, then registered ones."""
    core = {
        name: EntryPoint(name, f"{__package__}.{place}", COMMANDS)
        for name, place in CORE_COMMANDS.items()
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
            f"{name}, which is {known[name].value}, does not load: {error}; install again"
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

    parameters = list(_parameters(command))
    named = not any(tyro.conf.Positional in get_args(each.annotation) for each in parameters)
    if named and arguments and not arguments[0].startswith("-"):
        option = parameters[0].name
        raise ParameterError(f"{name} takes options only, did you mean --{option} {arguments[0]}?")
    keep.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    keep.__annotations__ = {each.name: each.annotation for each in parameters}
    keep.__doc__ = re.sub(r"\n {8}(?=\S)", " ", getdoc(command) or "")
    shown, printed = Shown(sys.stdout), io.StringIO()
    try:
        with redirect_stdout(shown), redirect_stderr(printed):
            return tyro.cli(keep, prog=f"pter {name}", args=arguments)
    except SystemExit as end:
        if not end.code:
            sys.stdout.write(wrapped(shown.getvalue()))
            sys.stdout.flush()
            raise
    text = reason(in_one_line(printed.getvalue()), command)
    raise ParameterError(f"{text} (`pter {name} --help` explains)")


class Shown(io.StringIO):
    """What is printed for another stream, with the colours and characters that this one has."""

    encoding = ""

    def __init__(self, stream: TextIO) -> None:
        super().__init__()
        self.encoding = stream.encoding
        self._stream = stream

    def isatty(self) -> bool:
        """Return whether the stream is a terminal."""
        return self._stream.isatty()


def wrapped(text: str) -> str:
    """Return a help whose sentences, which tyro prints as a line each, end within the terminal."""
    width = get_terminal_size().columns

    def wrap(line: re.Match[str]) -> str:
        return fill(line[0], width, break_on_hyphens=False, break_long_words=False)

    return re.sub(r"^[A-Za-z].*", wrap, text, flags=re.MULTILINE)


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


def in_one_line(box: str) -> str:
    """Return what tyro says in a box: its first paragraph, and which option may have been meant."""
    lines = (line.strip("│| ") for line in box.splitlines()[1:])
    text = "\n".join(line if line.strip("─-") else "" for line in lines)
    first, *others = text.strip().split("\n\n")
    meant = [each.splitlines()[:2] for each in others if each.startswith("Perhaps")]
    return " ".join([*first.split(), *chain(*meant)])


def reason(text: str, command: Command) -> str:
    """Return why tyro refuses an argument, as errors of this package say it."""
    if found := re.match(r"invalid choice '(.*)' for argument '-*(\S+)'.*?(\(.*?\))", text):
        value, option, choices = found.groups()
        return str(unknown_name(option, value, ast.literal_eval(choices)))
    if text.startswith("Missing from"):
        missing = next(p for p in signature(command).parameters.values() if p.default is p.empty)
        choices = get_args(get_type_hints(command)[missing.name])
        return f"{missing.name} must be given, one of {', '.join(choices)}"
    if found := re.match(r"Error parsing --(\S+): .*'(.*)'", text):
        option, value = found.groups()
        hint = get_type_hints(command)[option.replace("-", "_")]
        kinds = [NUMBERS[kind] for kind in (hint, *get_args(hint)) if kind in NUMBERS]
        return f"{option} must be {kinds[0]}, got {value!r}" if kinds else text
    return text


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
        if not isinstance(error, BrokenPipeError):  # who reads the output has seen enough
            with suppress(OSError):
                complain(reason_of_os_error(error, printed=printed))
        return FAILED


def reason_of_os_error(error: OSError, *, printed: bool = True) -> str:
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
    if name == "help" and rest:
        name, rest = rest[0], ["--help"]
    if name in ("-h", "--help", "help"):
        _print_overview()
        return 0
    try:
        command = load_command(name)
        with warnings.catch_warnings():
            warnings.showwarning = show_warning
            done = command(**parse(name, command, rest))
            return (done() if callable(done) else done) or 0
    except PterError as error:
        complain(str(error))
        return FAILED


def show_warning(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning without the line of code that it comes from."""
    terminal(errors=True).print(f"warning: {message}", soft_wrap=True, markup=False)


def complain(text: str) -> None:
    """Print what is wrong."""
    terminal(errors=True).print(f"error: {text}", style="red", soft_wrap=True, markup=False)


def summary(entry: EntryPoint) -> str:
    """Return the first line of a command's docstring, without importing it: all take seconds."""
    spec = None
    with suppress(ImportError):  # of a package that is no longer there
        spec = find_spec(entry.module)
    source = Path(spec.origin).read_text("utf-8") if spec and spec.origin else ""
    texts = [
        ast.get_docstring(node) or ""
        for node in ast.parse(source).body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == entry.attr
    ]
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
