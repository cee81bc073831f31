"""The proof of exported C by Frama-C's Eva: nothing undefined, and voltages within their range."""

import os
import re
import shutil
import subprocess
import time
from typing import Literal, NamedTuple

from pter_gym._internal.files import FilePath, expand_path
from pter_gym.errors import DataError, DependencyError, ProofError

DRIVER = "prove.c"
"""What is proven: the control loop with any readings."""

MachineModel = Literal["gcc_x86_64", "gcc_x86_32", "gcc_x86_16", "ppc_32"]
"""Sizes of types; an ``int`` of ``gcc_x86_16`` has 16 bits, and numbers of ``ppc_32`` begin with
their highest byte."""

ALARM = re.compile(r"\[eva:alarm\] (\S+): Warning:\s+(.*?)\n(?=\[)", re.DOTALL)
ASSERTIONS = re.compile(r"Assertions +(\d+) valid +(\d+) unknown +(\d+) invalid")


def command_for(file: str, machine: MachineModel = "gcc_x86_64") -> tuple[str, ...]:
    """Return the command, in the folder of a program, that proves it."""
    numbers = ("-warn-special-float", "none")  # NaN and infinities may come up
    return ("frama-c", "-eva", "-eva-precision", "2", *numbers, "-machdep", machine, file, DRIVER)


class Proof(NamedTuple):
    """That a program is proven: version of Frama-C, and seconds that it took."""

    version: str
    seconds: float

    def __str__(self) -> str:
        """Return what is proven, in a sentence."""
        return (
            "proven for every reading: voltages within their range, nothing undefined "
            f"(Frama-C {self.version}, {self.seconds:.0f} s)"
        )


def prove(folder: FilePath, file: str = "pter.c", machine: MachineModel = "gcc_x86_64") -> Proof:
    """Prove a program in a folder, which ``Source.write`` has written with its driver.

    Raises
    ------
    ProofError
        If something may be undefined, or a voltage beyond its range.
    DependencyError
        If Frama-C is not installed; the message says how to go on.
    DataError
        If Frama-C cannot read the program.
    """
    command = command_for(file, machine)
    if shutil.which(command[0]) is None:
        raise DependencyError(
            f"a proof needs Frama-C (package frama-c-base of Debian and Ubuntu); then run, in "
            f"{str(folder)!r}: {' '.join(command)}"
        )
    begin = time.perf_counter()
    place = expand_path("c", folder)
    run = subprocess.run(
        command,
        cwd=place,
        env={**os.environ, "PWD": str(place)},  # which Frama-C goes by
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - begin
    found = ASSERTIONS.search(run.stdout)
    if run.returncode or found is None:
        last = (run.stdout + run.stderr).strip().splitlines()[-1:]
        raise DataError(f"Frama-C cannot read {file}: {''.join(last)}")
    alarms = [f"{place}: {' '.join(text.split())}" for place, text in ALARM.findall(run.stdout)]
    valid, unknown, invalid = map(int, found.groups())
    if alarms or unknown or invalid or not valid:
        raise ProofError("\n".join(["not proven:", *alarms]))
    told = subprocess.run([command[0], "-version"], capture_output=True, text=True, check=True)
    return Proof(told.stdout.split()[0], seconds)
