"""A policy in a process of its own, which gets observations and gives volts; nothing else crosses.

A message is a header of fixed size and what it announces: raw float32 numbers, or JSON. ``serving`` is the other side.
"""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
import weakref
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple, Self, cast, get_args

import numpy as np
from numpy.typing import NDArray

from pter_gym import params
from pter_gym.benchmark.naming import find_policy, is_code
from pter_gym.benchmark.simulation import AnyPolicy
from pter_gym.compiled.layout import Field, Layout
from pter_gym.controllers import BoundPolicy
from pter_gym.errors import ActionError, DataError, ParameterError, PolicyError, PterError
from pter_gym.internal.checks import whole_number
from pter_gym.internal.codec import Codec, dataclasses_in
from pter_gym.internal.reading import parse_json
from pter_gym.params import Machine
from pter_gym.tasks.path_following import Sensors

Observations = NDArray[np.float32]

TIMEOUT = 60.0
"""Longest time that a policy may take for an answer [s]: to start, to be bound or for a decision."""

LONGEST = 86400.0
"""Longest time that may be given to it [s]."""

MOST_TEXT = 1 << 16
"""Longest text that is read from a policy's process [B]."""

CODEC = Codec([*dataclasses_in(params), Layout, Field])
"""Knows the parts of a machine and of a layout."""

FAULTS: dict[str, type[PterError]] = {
    kind.__name__: kind for kind in (ActionError, DataError, ParameterError, PolicyError)
}
"""Errors that cross, by name."""


class Kind(IntEnum):
    """What a message is."""

    FIND = 0  # text: what to find
    BIND = 1  # text: machine and layout
    RESET = 2
    DECIDE = 3  # numbers: observations
    DONE = 4  # text: what was found
    VOLTS = 5  # numbers
    FAULT = 6  # text: the name of an error, and its message


HEADER = struct.Struct("<4I")
"""Kind, number of the binding, rows and columns; text is one row of bytes."""


class Header(NamedTuple):
    """What a message announces."""

    kind: int
    binding: int = 0
    rows: int = 0
    columns: int = 0

    @property
    def size(self) -> int:
        """Bytes that follow."""
        return self.rows * self.columns * (4 if self.kind in (Kind.DECIDE, Kind.VOLTS) else 1)


def pack_text(kind: Kind, content: object, binding: int = 0) -> bytes:
    """Return a message of plain data."""
    data = json.dumps(content).encode()
    return HEADER.pack(kind, binding, 1, len(data)) + data


def pack_numbers(kind: Kind, numbers: NDArray[np.float32], binding: int = 0) -> bytes:
    """Return a message of numbers, (rows, columns)."""
    return HEADER.pack(kind, binding, *numbers.shape) + np.ascontiguousarray(numbers, "<f4").tobytes()


class Session:
    """A process with a policy in it, from its start to its end.

    Parameters
    ----------
    name
        What the user wrote, for messages.
    timeout
        Longest time for an answer [s].

    Raises
    ------
    PolicyError
        If this system cannot start such a process.
    """

    def __init__(self, name: str, timeout: float) -> None:
        if os.name != "posix":
            raise PolicyError("isolated policies need Linux or macOS")
        self.name, self.timeout = name, timeout
        try:
            self.process, self._socket = _start()
        except OSError as error:
            raise PolicyError(f"policy {name!r}: its process cannot be started: {error}") from error
        self.close = weakref.finalize(self, _end, self.process, self._socket, os.getpid())

    def ask(self, message: bytes) -> tuple[Header, bytes]:
        """Return the answer to a message.

        Raises
        ------
        PterError
            What the other process tells of.
        ActionError
            If volts have a wrong shape; the process is ended.
        PolicyError
            If the policy has failed, or its process has ended, is too slow or gives no answer; the process is ended.
        """
        if not self.close.alive:
            raise PolicyError(f"policy {self.name!r} has no process any more: it has failed or was closed")
        try:
            header, content = self._exchange(message)
        except TimeoutError:
            self.close()
            raise PolicyError(f"policy {self.name!r} must answer within {self.timeout:g} s, and did not") from None
        except (OSError, EOFError):
            self.close()
            status = self.process.returncode
            raise PolicyError(f"policy {self.name!r}: its process has ended with exit status {status}") from None
        except BaseException:
            self.close()
            raise
        if header.kind == Kind.FAULT:
            raise self._fault(content)
        return header, content

    def read_text(self, content: bytes) -> Any:
        """Return the plain data of an answer; end the process and raise a PolicyError if there are none."""
        try:
            return parse_json(content, MOST_TEXT)
        except ValueError:
            raise self.no_answer() from None

    def no_answer(self) -> PolicyError:
        """End the process, and return the error for an answer that is none."""
        self.close()
        return PolicyError(f"policy {self.name!r}: its answer is none")

    def _fault(self, content: bytes) -> PterError:
        """Return the error that the process tells of; a PolicyError ends it."""
        told = self.read_text(content)
        try:
            kind, message = FAULTS[told["error"]], told["message"]
        except (KeyError, TypeError):
            return self.no_answer()
        if not isinstance(message, str):
            return self.no_answer()
        if kind is PolicyError:
            self.close()
        return kind(_printable(message))

    def _exchange(self, message: bytes) -> tuple[Header, bytes]:
        """Send a message and return the answer; its size is looked at before it is read."""
        deadline = time.monotonic() + self.timeout
        asked = Header(*HEADER.unpack_from(message))
        self._socket.settimeout(self.timeout)
        self._socket.sendall(message)
        header = Header(*HEADER.unpack(self._read(HEADER.size, deadline)))
        decides = asked.kind == Kind.DECIDE
        if header.kind not in (Kind.FAULT, Kind.VOLTS if decides else Kind.DONE):
            raise self.no_answer()
        if header.kind == Kind.VOLTS and header[2:] != (asked.rows, 4):
            raise ActionError(f"action must have the shape {(asked.rows, 4)}, got {header[2:]}")
        if header.kind != Kind.VOLTS and header.size > MOST_TEXT:
            raise PolicyError(f"policy {self.name!r}: its answer must have at most {MOST_TEXT} B, got {header.size}")
        return header, self._read(header.size, deadline)

    def _read(self, size: int, deadline: float) -> bytes:
        """Return so many bytes, or raise a TimeoutError, or an EOFError if there will be no more."""
        found = bytearray()
        while len(found) < size:
            self._socket.settimeout(max(deadline - time.monotonic(), 1e-6))
            part = self._socket.recv(size - len(found))
            if not part:
                raise EOFError
            found += part
        return bytes(found)


def _start() -> tuple["subprocess.Popen[bytes]", socket.socket]:
    """Start a process that serves a policy, and return it with the socket to it."""
    paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
    own, theirs = socket.socketpair()
    try:
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-m", "pter_gym.benchmark.serving", str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=2,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
                env={**os.environ, "PYTHONPATH": paths},
            )
    except BaseException:
        own.close()
        raise
    return process, own


def _end(process: "subprocess.Popen[bytes]", own: socket.socket, owner: int) -> None:
    """End a process and those that it has started, and wait for it; a forked copy of its owner leaves it alone."""
    own.close()
    if os.getpid() == owner:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _printable(text: str) -> str:
    """Return a text with escapes for what no terminal should be sent."""
    return "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text)


class IsolatedPolicy(BoundPolicy):
    """A policy that acts in another process, bound there under a number."""

    def __init__(self, session: Session, layout: Layout, number: int) -> None:
        self.layout = layout
        self._session = session
        self._number = number

    def reset(self) -> None:
        """Tell it that new episodes begin."""
        self._session.ask(HEADER.pack(Kind.RESET, self._number, 0, 0))

    def act(self, observations: Observations) -> NDArray[np.float32]:
        """Return clutch voltages [V], float32 (N, 4), for observations, float32 (N, entries)."""
        header, content = self._session.ask(pack_numbers(Kind.DECIDE, observations, self._number))
        return np.frombuffer(content, "<f4").reshape(header.rows, header.columns)


class Isolated:
    """A policy in a process of its own: a controller that knows no more than what it is sent.

    The process is a fresh interpreter. It gets the nominal machine and the layout of the observations, then
    observations, and gives volts. It ends with ``close``, at the end of a ``with`` block, with a PolicyError, or when
    nobody needs it.

    Parameters
    ----------
    name
        ``package.module:attribute``, the path of an exported policy, or a built-in name. The attribute is a controller
        or a callable from observations to volts; a class is called without arguments to make one.
    seed, scenario
        As in ``find_policy``, for built-in names.
    timeout
        Longest time for an answer [s]: to start, to be bound, for a decision.

    Raises
    ------
    ParameterError
        If there is no such policy, it cannot be bound to the nominal machine, or it plans: planners need the worlds.
        Or if another argument is not what it must be; then nothing has started.
    PolicyError
        If its process fails.
    """

    def __init__(self, name: str, *, seed: int = 0, scenario: str = "standard", timeout: float = TIMEOUT) -> None:
        _check(name, scenario, timeout)
        self.name = name
        self._seed, self._scenario = whole_number("seed", seed, at_least=0), scenario
        self._session = Session(name, timeout)
        try:
            _, content = self._session.ask(
                pack_text(Kind.FIND, {"name": name, "seed": self._seed, "scenario": scenario})
            )
            self.sensors: Sensors = _told_sensors(self._session, content)
        except BaseException:
            self.close()
            raise

    @property
    def inside(self) -> AnyPolicy | None:
        """The built-in or exported policy that acts there, to tell its content; None for code."""
        return None if is_code(self.name) else find_policy(self.name, self._seed, self._scenario)

    def bind(self, machine: Machine, layout: Layout) -> IsolatedPolicy:
        """Return the policy for a nominal machine and the layout of the observations that it will get.

        Raises
        ------
        ParameterError
            If it cannot be bound to these.
        """
        content = {"machine": CODEC.to_plain(machine), "layout": CODEC.to_plain(layout)}
        header, _ = self._session.ask(pack_text(Kind.BIND, content))
        return IsolatedPolicy(self._session, layout, header.binding)

    def close(self) -> None:
        """End its process."""
        self._session.close()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End its process."""
        self.close()


def _check(name: Any, scenario: Any, timeout: Any) -> None:
    """Raise a ParameterError unless a policy and a scenario are named and the time is one."""
    if not isinstance(name, str):
        raise ParameterError(f"name must be a text such as 'package.module:attribute', got {name!r}")
    if not isinstance(scenario, str):
        raise ParameterError(f"scenario must be the name of one, got {scenario!r}")
    if not isinstance(timeout, (int, float)) or not 0.0 < timeout <= LONGEST:
        raise ParameterError(f"timeout must lie within (0, {LONGEST:g}] s, got {timeout!r}")


def _told_sensors(session: Session, content: bytes) -> Sensors:
    """Return what a policy's observations must hold, as its process says."""
    told = session.read_text(content)
    if told not in get_args(Sensors):
        raise session.no_answer()
    return cast(Sensors, told)
