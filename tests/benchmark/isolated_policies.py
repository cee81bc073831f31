"""Policies of a user, good and bad, that tests start in processes of their own."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.attacking_policies import TAMPERING, honest
from pter_gym.controllers import Free, Impedance, PerClutch, Policy, device
from pter_gym.controllers._predictive import Honest
from pter_gym.errors import ParameterError

STIFF = Impedance(stiffness=1500.0)
PLANNER = Honest(Free())


class Counting:
    """More voltage with each decision since the reset, held for three control steps; prints, as programs do."""

    sensors = "force"
    frame_skip = 3

    def __init__(self) -> None:
        self.decisions = -1000

    def reset(self) -> None:
        subprocess.run(["echo", "from a program"], check=True)
        self.decisions = 0

    def __call__(self, obs: Any) -> Any:
        print("to stdout", flush=True)  # noqa: T201
        self.decisions += 1
        return np.full((len(obs), 4), 0.1 * (self.decisions % 240))


@device
def beyond(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    return PerClutch(-5.0, 1e9, gains[0], 0.0)


class Beyond:
    def bind(self, machine: Any, layout: Any) -> Policy:
        return Policy(np.array([3.0]), layout, law=beyond)


class Needy:
    def __init__(self, gain: float) -> None:
        self.gain = gain


class Refuses:
    def __init__(self) -> None:
        raise ParameterError("\x1b[2J\u202e owned")


def by_notes(obs: Any) -> Any:
    """Leave a note wherever programs keep files, and engage all clutches where one is left already."""
    kept = [Path.home(), Path.cwd(), Path(tempfile.gettempdir()), Path(os.environ.get("XDG_CACHE_HOME", "."))]
    found = any((place / "note").exists() for place in kept)
    for place in kept:
        (place / "note").touch()
    return np.full((len(obs), 4), 24.0 if found else 0.0)


def wrong_length(obs: Any) -> Any:
    return np.zeros((len(obs), 3))


def raises(obs: Any) -> Any:
    raise LookupError("no such thing")


def dies(obs: Any) -> Any:
    os.abort()


def hangs(obs: Any) -> Any:
    subprocess.Popen(["sleep", "1000"])
    time.sleep(1000.0)


def trickles(obs: Any) -> Any:
    """Write half of a header to the benchmark by itself."""
    os.write(int(sys.argv[1]), b"\x03\x00\x00")
    time.sleep(1000.0)


def answers(obs: Any) -> Any:
    """Answer the benchmark by itself: volts for one world more."""
    os.write(int(sys.argv[1]), b"\x03\0\0\0" + (16 * (len(obs) + 1)).to_bytes(4, "little"))
    time.sleep(1000.0)


def tampers(obs: Any) -> Any:
    """Try all that gains in process."""
    for attack in TAMPERING.values():
        attack(obs)
    return honest(obs)
