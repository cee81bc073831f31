"""The process in which an isolated policy acts: observations come through a socket, volts go back."""

import json
import socket
import sys
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np

from pter_gym._engine.batch import checked_actions
from pter_gym.benchmark._isolation import CODEC, HEADER, Kind
from pter_gym.benchmark._naming import find_policy
from pter_gym.benchmark.simulation import sensors_of
from pter_gym.controllers import Policy, bind
from pter_gym.errors import ActionError, ParameterError

LONGEST = 4000
"""Characters of a message that are sent."""


class Host:
    """A policy found by name, and what it is bound to."""

    def __init__(self, name: str) -> None:
        self.name = name

    def find(self, folder: str) -> bytes:
        """Find the policy, also among a folder's modules, and return the sensors that it needs."""
        sys.path.append(folder)
        self.policy = find_policy(self.name)
        return sensors_of(self.policy).encode()

    def answer(self, kind: int, content: bytes) -> bytes:
        """Return the content of the answer to a message."""
        if kind == Kind.DECIDE:
            return self._decide(content)
        if kind == Kind.RESET:
            self.bound.reset()
            return b""
        told = json.loads(content)
        machine = CODEC.from_plain(told["machine"])
        self.bound, self.most = bind(self.policy, machine, CODEC.from_plain(told["layout"])), machine.clutch.voltage_max
        return self.bound.frame_skip.to_bytes(4, "little")

    def _decide(self, content: bytes) -> bytes:
        """Return voltages, float32 (N, 4); those of a compiled law are clipped to the range, as in the kernel."""
        seen = np.frombuffer(bytearray(content), "<f4").reshape(-1, len(self.bound.layout))
        volts = checked_actions(self.bound.act(seen), (len(seen), 4))
        return (np.clip(volts, 0.0, self.most) if isinstance(self.bound, Policy) else volts).astype("<f4").tobytes()


def packed(ask: Callable[..., bytes], *given: Any) -> bytes:
    """Return the answer to a message; errors are answers too."""
    try:
        kind, content = Kind.DONE, ask(*given)
    except (ActionError, ParameterError) as error:
        kind, content = Kind.FAULT, _fault(type(error).__name__, str(error))
    except (Exception, SystemExit) as error:  # noqa: BLE001  (it is anybody's code)
        traceback.print_exc()
        kind, content = Kind.FAULT, _fault("PolicyError", f"has failed: {type(error).__name__}: {error}")
    return HEADER.pack(kind, len(content)) + content


def _fault(error: str, message: str) -> bytes:
    return json.dumps([error, message[:LONGEST].encode("utf-8", "backslashreplace").decode()]).encode()


def main(descriptor: int, name: str, folder: str) -> None:
    """Find a policy, also among the modules of a folder, and answer messages through a socket until there are none."""
    host = Host(name)
    with socket.socket(fileno=descriptor) as own, own.makefile("rwb") as stream:
        stream.write(packed(host.find, folder))
        stream.flush()
        while len(data := stream.read(HEADER.size)) == HEADER.size:
            kind, size = HEADER.unpack(data)
            stream.write(packed(host.answer, kind, stream.read(size)))
            stream.flush()
