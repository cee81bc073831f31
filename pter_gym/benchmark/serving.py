"""The process in which an isolated policy acts: observations come through a socket, volts go back."""

import json
import socket
import sys
import traceback
from typing import Any

import numpy as np

from pter_gym.benchmark.isolation import CODEC, HEADER, Header, Kind, pack_numbers, pack_text
from pter_gym.benchmark.naming import read_policy
from pter_gym.benchmark.simulation import AnyPolicy, sensors_of
from pter_gym.compiled.layout import Layout
from pter_gym.controllers import BoundPolicy, Policy, bind
from pter_gym.errors import ActionError, ParameterError, PterError
from pter_gym.params import BASELINE, Machine
from pter_gym.tasks.path_following import observation_layout

LONGEST = 4000
"""Characters of a message that are sent."""


class Host:
    """A policy and its bindings."""

    def __init__(self) -> None:
        self.name = ""
        self.policy: AnyPolicy | None = None
        self.bound: list[tuple[BoundPolicy, float]] = []

    def answer(self, header: Header, content: bytes) -> bytes:
        """Return the answer to a message; what goes wrong is an answer, too."""
        try:
            return self._answer(header, content)
        except PterError as error:
            return _fault(type(error).__name__, str(error))
        except (Exception, SystemExit) as error:  # noqa: BLE001  (it is anybody's code)
            traceback.print_exc()
            return _fault("PolicyError", f"policy {self.name!r} has failed: {type(error).__name__}: {error}")

    def _answer(self, header: Header, content: bytes) -> bytes:
        if header.kind == Kind.FIND:
            return pack_text(Kind.DONE, self._find(**json.loads(content)))
        if header.kind == Kind.BIND:
            told = json.loads(content)
            self._bind(CODEC.from_plain(told["machine"]), CODEC.from_plain(told["layout"]))
            return pack_text(Kind.DONE, None, len(self.bound) - 1)
        policy, most = self.bound[header.binding]
        if header.kind == Kind.RESET:
            policy.reset()
            return pack_text(Kind.DONE, None)
        seen = np.frombuffer(bytearray(content), "<f4").reshape(header.rows, header.columns)
        volts = _numbers(policy.act(seen))
        if isinstance(policy, Policy):  # as in a kernel, where a law's voltages beyond the range are clipped
            volts = np.clip(volts, 0.0, most)
        return pack_numbers(Kind.VOLTS, volts.astype(np.float32))

    def _find(self, name: str, seed: int, scenario: str) -> str:
        """Find the policy, bind it once to see that it can act, and return the sensors that it needs."""
        self.name = name
        self.policy = read_policy(name, seed, scenario)
        sensors = sensors_of(self.policy)
        self._bind(BASELINE, observation_layout(BASELINE, sensors))
        return sensors

    def _bind(self, machine: Machine, layout: Layout) -> None:
        """Bind the policy once more."""
        assert self.policy is not None
        bound = bind(self.policy, machine, layout)
        if bound.plans is not None:
            raise ParameterError(f"policies: {self.name!r} plans in the simulated worlds and cannot be isolated")
        self.bound.append((bound, machine.clutch.voltage_max))


def _fault(error: str, message: str) -> bytes:
    """Return a message of an error; what is no text in it is escaped."""
    text = message[:LONGEST].encode("utf-8", "backslashreplace").decode()
    return pack_text(Kind.FAULT, {"error": error, "message": text})


def _numbers(volts: Any) -> Any:
    """Return voltages as an array of real numbers with two axes."""
    try:
        array = np.asarray(volts)
    except (ValueError, TypeError, RuntimeError) as error:  # ragged, or a tensor that is not plain CPU memory
        raise ActionError(f"action must be an array of numbers: {error}") from None
    if array.dtype.kind not in "fiu":
        raise ActionError(f"action must hold real numbers, got dtype {array.dtype}")
    if array.ndim != 2:
        raise ActionError(f"action must have the shape (N, 4), got {array.shape}")
    return array


def main(descriptor: int) -> None:
    """Answer messages until there are no more."""
    host = Host()
    with socket.socket(fileno=descriptor) as own, own.makefile("rwb") as stream:
        while len(data := stream.read(HEADER.size)) == HEADER.size:
            header = Header(*HEADER.unpack(data))
            stream.write(host.answer(header, stream.read(header.size)))
            stream.flush()


if __name__ == "__main__":
    main(int(sys.argv[1]))
