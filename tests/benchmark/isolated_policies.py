"""Policies of a user, good and bad, that tests start in processes of their own."""

import gc
import os
import struct
import subprocess
import sys
import time
from typing import Any

import numpy as np

from pter_gym.controllers import Free, Impedance, PerClutch, Policy, device
from pter_gym.controllers.predictive import Honest
from pter_gym.engine.batch import Batch

STIFF = Impedance(stiffness=1500.0)
PLANNER = Honest(Free())


def halves(obs: Any) -> Any:
    return 12.0 + 10.0 * obs[:, :4].astype(np.float64) / 3.0


class Counting:
    """More voltage with each decision since the reset; prints, as programs do."""

    sensors = "force"

    def __init__(self) -> None:
        self.decisions = -1000

    def reset(self) -> None:
        print("a new episode")  # noqa: T201
        subprocess.run(["echo", "from a program"], check=True)
        self.decisions = 0

    def __call__(self, obs: Any) -> Any:
        print("to stdout", flush=True)  # noqa: T201
        os.write(1, b"x" * 64)
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


def wrong_length(obs: Any) -> Any:
    return np.zeros((len(obs), 3))


def transposed(obs: Any) -> Any:
    return np.zeros((4, len(obs)))


def flat(obs: Any) -> Any:
    return np.zeros(4 * len(obs))


def not_a_number(obs: Any) -> Any:
    return np.full((len(obs), 4), np.nan)


def too_much(obs: Any) -> Any:
    return np.full((len(obs), 4), 24.5)


def words(obs: Any) -> Any:
    return [["a"] * 4] * len(obs)


def raises(obs: Any) -> Any:
    raise LookupError("no such thing")


def leaves(obs: Any) -> Any:
    sys.exit(3)


def dies(obs: Any) -> Any:
    os.abort()


def hangs(obs: Any) -> Any:
    subprocess.Popen(["sleep", "1000"])
    time.sleep(1000.0)


def babbles(obs: Any) -> Any:
    """Write to all that is open, the pipe to the benchmark too."""
    for descriptor in range(3, 20):
        try:
            os.write(descriptor, b"\xff" * 7)
        except OSError:
            continue
    time.sleep(1000.0)


DONE, FAULT = 4, 6

TOLD = {
    "no JSON": (DONE, b"hello"),
    "no UTF-8": (DONE, b"\xff\xfe\xfd"),
    "unknown sensors": (DONE, b'"smell"'),
    "a list for sensors": (DONE, b'["force"]'),
    "a deep fault": (FAULT, b"[" * 60000),
    "a fault without an error": (FAULT, b"{}"),
    "a fault of an unknown kind": (FAULT, b'{"error": [], "message": "owned"}'),
    "a fault with a list for a message": (FAULT, b'{"error": "ParameterError", "message": []}'),
    "a fault with half a character": (FAULT, b'{"error": "ParameterError", "message": "\\ud800 owned"}'),
    "a fault for terminals": (FAULT, b'{"error": "ParameterError", "message": "\\u001b[2J\\u202e owned"}'),
}
"""Answers that a policy's code gives to the benchmark by itself: their kinds and contents."""


class Tells:
    """Give the answer that the environment names, before the process gives one."""

    def __init__(self) -> None:
        kind, content = TOLD[os.environ["TOLD"]]
        os.write(int(sys.argv[1]), struct.pack("<4I", kind, 0, 1, len(content)) + content)
        time.sleep(1000.0)


class Peeking:
    """Look for worlds in the frames that call it and in all objects; without any, hold the arm."""

    def __call__(self, obs: Any) -> Any:
        frame: Any = sys._getframe()
        found = [item for item in gc.get_objects() if type(item) is Batch]
        while frame is not None:
            found += [value for value in frame.f_locals.values() if type(value) is Batch]
            frame = frame.f_back
        return np.full((len(obs), 4), 24.0 if found else 0.0)
