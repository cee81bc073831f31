"""The command line: help on one screen, examples that work, errors in the user's words, and Ctrl-C."""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pter_gym._commands.arguments import as_typed
from pter_gym._commands.main import INTERRUPTED, commands, load_command, main, parse
from pter_gym._commands.names import names_of, names_table
from pter_gym.errors import ParameterError

EXAMPLE = re.compile(r"Example: `?pter ([^\n`]+)")


def example_of(name: str) -> tuple[str, ...]:
    """Return the words after ``pter`` of the one example in a command's help."""
    (found,) = EXAMPLE.findall(load_command(name).__doc__ or "")
    return tuple(shlex.split(found))


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Return what is printed of an argument that is refused."""
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("error: ")
    return printed.err


# --- help ---


@pytest.mark.parametrize("name", commands())
def test_the_example_in_a_help_is_understood(name: str) -> None:
    first, *arguments = example_of(name)
    assert first == name
    command = load_command(name)
    given = parse(name, command, arguments)
    known = {word for kind in names_of(command).values() for word in kind}
    for key in ("policies", "policy", "scenario", "pace", "paces", "controller", "figures"):
        value: Any = given.get(key)
        words = value if isinstance(value, tuple) else str(value or "").split(",")
        assert {word for word in words if word} <= known | {"all"}, key


@pytest.mark.parametrize("name", ["benchmark", "tune", "reproduce"])
def test_help_shows_example_and_names(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "--help"]) == 0
    given = capsys.readouterr().out
    shown = " ".join(re.sub(r"[│\s]+", " ", given).split())
    assert f"Example: pter {' '.join(example_of(name))}" in shown
    for names in names_of(load_command(name)).values():
        assert all(each in shown for each in names)
    assert "\nnames\n" in given


def test_names_are_those_that_are_declared() -> None:
    from pter_gym.benchmark._naming import is_built_in
    from pter_gym.policies import shipped_policies
    from pter_gym.scenarios import PACES, SCENARIOS

    names = names_of(load_command("benchmark"))
    assert names["scenarios"] == list(SCENARIOS)
    assert names["paces"] == list(PACES)
    assert names["trained"] == list(shipped_policies())
    acting = [each for kind in ("controllers", "tuned", "planners", "trained") for each in names[kind]]
    assert all(map(is_built_in, acting))
    assert names_table(load_command("benchmark")).row_count == len(names)


# --- errors ---

REFUSED = {
    "benchmarl": ("COMMAND", "'benchmark'"),
    "benchmark --scenario standad": ("--scenario", "'standard'"),
    "benchmark --scenario standard --paces slw": ("--paces", "'slow'"),
    "benchmark --scenario standard --policies residul": ("--policies", "'residual'"),
    "benchmark --policies impedence": ("--policies", "'impedance'"),
    "benchmark --scenario paper --time-constants x": ("--time-constants", "numbers separated by commas"),
    "tune impedence": ("CONTROLLER", "'impedance'"),
    "tune impedance --pace slw": ("--pace", "'slow'"),
    "tune impedance --out gains.json": ("--out", "must end in .toml"),
    "fit --out preset.json": ("--out", "must end in .toml"),
    "fit --budget 3": ("--budget", "≥ 1000"),
    "fit --seed -1": ("--seed", "≥ 0"),
    "record --scenario standad": ("--scenario", "'standard'"),
    "record --level expart": ("--level", "'expert'"),
    "reproduce fig33": ("FIGURES", "'fig3'"),
    "speed --max-worlds 0": ("--max-worlds", "≥ 1"),
    "identify log.csv": ("LOG", "'log.csv' does not exist"),
    "identify log.csv --machine basline": ("LOG", "'log.csv' does not exist"),
    "play --machine basline": ("--machine", "'baseline'"),
    "watch impedance --out film.avi": ("--out", ".mp4"),
    "train residual --scenario standad": ("--scenario", "'standard'"),
    "train residual --config own.toml": ("--config", "'own.toml' does not exist"),
    "export nowhere": ("RUN", "run.json"),
    "verify nowhere": ("RESULTS", "nowhere"),
}


@pytest.mark.parametrize("line", REFUSED)
def test_an_error_names_the_argument_and_what_is_near(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    argument, near = REFUSED[line]
    message = refused(line.split(), capsys)
    assert message.startswith(f"error: {argument} ")
    assert near in message
    assert len(message.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_option_is_told_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["benchmark", "--polices", "impedance"])
    assert end.value.code == 2
    printed = capsys.readouterr().err
    assert "--polices" in printed
    assert "--policies" in printed


def some(policies: str = "", time_constants: str = "", seed: int = 0) -> None:
    """Take arguments."""


@pytest.mark.parametrize(
    ("message", "typed"),
    [
        ("policy must be one", "--policies must be one"),
        ("policies: there is no 'x'", "--policies: there is no 'x'"),
        ("Arguments.seed must be ≥ 0", "--seed must be ≥ 0"),
        ("time_constants must be numbers", "--time-constants must be numbers"),
        ("Machine.seeds_of_flax must be", "Machine.seeds_of_flax must be"),
        ("policy x is refused", "policy x is refused"),
        ("pace must be slow", "pace must be slow"),
    ],
)
def test_a_field_becomes_an_argument(message: str, typed: str) -> None:
    assert as_typed(message, some) == typed
    assert as_typed(message, None) == message


# --- interrupts ---

SLOW = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a process in the background ignores interrupts
import numpy as np
from pter_gym._commands import main as module
from pter_gym._compiled import pipeline
from pter_gym._compiled.compiler import compile_kernel

def factory(digest):
    def kernel(x):
        digest
        return x + 1.0
    return kernel

finish = pipeline._PartLibrary.__mro__[1]._optimize_final_module

def long(self):
    print("begun", flush=True)
    time.sleep(60.0)  # as LLVM may take, which hears no interrupt
    finish(self)

pipeline._PartLibrary.__mro__[1]._optimize_final_module = long

def command():
    compile_kernel(factory)(1.0)

module.load_command = lambda name: command
sys.argv = ["pter", "anything"]
sys.exit(module.main())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_ctrl_c_ends_a_command_that_compiles(tmp_path: Path) -> None:
    settings = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=settings
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == INTERRUPTED
    assert errors.splitlines()[-1] == "interrupted; files that were written are complete"


def test_an_unknown_command_is_refused() -> None:
    with pytest.raises(ParameterError, match="did you mean 'verify'"):
        load_command("verfy")
