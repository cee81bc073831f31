"""A policy in a process of its own: observations go in, voltages come out, and nothing else is exchanged.

A message is a fixed-size header and the content that it announces: JSON or raw float32 numbers. ``_serving`` is the
other side.
"""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import weakref
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, Self, cast, get_args

import numpy as np
from numpy.typing import NDArray

from pter_gym import params
from pter_gym._compiled.layout import Field, Layout
from pter_gym._internal.checks import is_finite
from pter_gym._internal.codec import Codec, dataclasses_in
from pter_gym._internal.reading import parse_json
from pter_gym.benchmark._naming import is_code
from pter_gym.controllers import BoundPolicy
from pter_gym.errors import ActionError, ParameterError, PolicyError
from pter_gym.params import BASELINE, Machine
from pter_gym.tasks.path_following import Sensors, observation_layout

Observations = NDArray[np.float32]

TIMEOUT = 60.0
"""Default limit on the time for an answer [s]."""

LONGEST = 86400.0
"""Largest limit that may be set [s]."""

MOST_TEXT = 1 << 16
"""Longest text that is read from the process [B]."""

CODEC = Codec([*dataclasses_in(params), Layout, Field])
"""Knows the parts of a machine and of a layout."""

FAULTS = {kind.__name__: kind for kind in (ActionError, ParameterError)}
"""Errors of a policy that leave its process running, by name; any other is a PolicyError and ends it."""

NONSENSE = "has sent something that is not an answer"


class Kind(IntEnum):
    """The kind of a message."""

    BIND = 0  # machine and layout, as JSON
    RESET = 1
    DECIDE = 2  # observations, float32 (N, entries)
    DONE = 3  # the sensors' name; frame_skip as uint32; nothing; volts, float32 (N, 4)
    FAULT = 4  # the name of an error, and its message, as JSON


HEADER = struct.Struct("<2I")
"""Kind and size [B] of what follows."""


class Isolated(BoundPolicy):
    """A policy, for example someone else's code, in its own process: it knows only what it is sent.

    The process is a fresh interpreter. Its working directory, home and temporary directory are one private folder,
    which is removed at the end. It receives the nominal machine and the observation layout, then observations, and
    returns volts. It ends with ``close``, at the end of a ``with`` block, after a PolicyError, or when it is garbage
    collected. It acts for one machine and layout at a time: ``bind`` replaces them.

    Parameters
    ----------
    name
        ``package.module:attribute``, as in ``find_policy``. Policies named otherwise run only the package's own code.
    timeout
        Longest wait [s] for an answer or its next part: when starting, binding or deciding.

    Raises
    ------
    ParameterError
        If there is no such policy, it cannot be bound to the nominal machine, it plans (planners need the worlds), or
        the timeout is out of range.
    PolicyError
        If its process fails.
    """

    def __init__(self, name: str, *, timeout: float = TIMEOUT) -> None:
        given = cast("object", name)
        if not isinstance(given, str) or not is_code(given):
            raise ParameterError(f"name must be a text such as 'package.module:attribute', got {given!r:.200}")
        if not (is_finite(timeout) and 0.0 < timeout <= LONGEST):
            raise ParameterError(f"timeout must lie within (0, {LONGEST:g}] s, got {timeout!r}")
        self.name, self.timeout = name, timeout
        self.process, self._socket, folder = _start(name)
        self._stream = self._socket.makefile("rwb")
        self.close = weakref.finalize(self, _end, self.process, self._socket, self._stream, folder)
        try:
            self.sensors = cast("Sensors", self._answer().decode("latin-1"))
            if self.sensors not in get_args(Sensors):
                raise self._failed(NONSENSE)
            self.bind(BASELINE, observation_layout(BASELINE, self.sensors))
        except BaseException:
            self.close()
            raise

    def bind(self, machine: Machine, layout: Layout) -> Self:
        """Bind the policy to a nominal machine and the layout of the observations that it will get, and return it.

        Raises
        ------
        ParameterError
            If it cannot be bound to these.
        """
        told = {"machine": CODEC.to_plain(machine), "layout": CODEC.to_plain(layout)}
        held = self._ask(Kind.BIND, json.dumps(told).encode(), 4)
        self.layout, self.frame_skip = layout, max(1, int.from_bytes(held, "little"))
        return self

    def reset(self) -> None:
        """Tell the policy that new episodes begin."""
        self._ask(Kind.RESET)

    def act(self, observations: Observations) -> NDArray[np.float32]:
        """Return clutch voltages [V], float32 (N, 4), for observations, float32 (N, entries)."""
        sent = np.ascontiguousarray(observations, "<f4").tobytes()
        return np.frombuffer(self._ask(Kind.DECIDE, sent, 16 * len(observations)), "<f4").reshape(-1, 4)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End its process."""
        self.close()

    def _ask(self, kind: Kind, content: bytes = b"", size: int | None = None) -> bytes:
        """Send a message and return the content of the answer; see ``_answer``."""
        if not self.close.alive:
            raise PolicyError(f"policy {self.name!r} has no process any more: it has failed or was closed")
        return self._answer(HEADER.pack(kind, len(content)) + content, size)

    def _answer(self, message: bytes = b"", size: int | None = None) -> bytes:
        """Send a message and return the content of the answer, which is text or has a given size [B].

        Raises
        ------
        ActionError, ParameterError
            If the policy raised it; its process goes on.
        PolicyError
            If it raised anything else, or its process has ended, is too slow or sends anything else.
        """
        try:
            self._socket.settimeout(self.timeout)
            self._stream.write(message)
            self._stream.flush()
            kind, found = HEADER.unpack(self._stream.read(HEADER.size))
            fits = found == size if size is not None and kind == Kind.DONE else found <= MOST_TEXT
            if kind not in (Kind.DONE, Kind.FAULT) or not fits:
                raise ValueError
            content = self._stream.read(found)
            if len(content) < found:
                raise EOFError
            if kind == Kind.DONE:
                return content
            error, told = map(str, parse_json(content, MOST_TEXT))
        except TimeoutError:
            raise self._failed(f"must answer within {self.timeout:g} s, and did not") from None
        except (ValueError, TypeError):
            raise self._failed(NONSENSE) from None
        except (OSError, EOFError, struct.error):
            self.close()
            raise self._failed(f"has ended its process, with exit status {self.process.returncode}") from None
        except BaseException:  # an answer may still be on its way
            self.close()
            raise
        told = "".join(char if char.isprintable() else ascii(char)[1:-1] for char in told)
        raise FAULTS[error](told) if error in FAULTS else self._failed(told)

    def _failed(self, why: str) -> PolicyError:
        """End the process and return the error to raise."""
        self.close()
        return PolicyError(f"policy {self.name!r} {why}")


START = """
import sys
descriptor, name, *sys.path[:], folder = sys.argv[1:]
from pter_gym.benchmark._serving import main
main(int(descriptor), name, folder)
"""
"""What its process runs: the present folder, the last argument, joins the path when the policy is looked up."""


def _start(name: str) -> tuple["subprocess.Popen[bytes]", socket.socket, str]:
    """Start a process that serves a policy; return it with its socket and its private folder."""
    if os.name != "posix":
        raise PolicyError("isolated policies need Linux or macOS")
    folder, (own, theirs) = mkdtemp(prefix="pter-"), socket.socketpair()
    path = [str(Path(place).absolute()) for place in (*sys.path, ".")]
    rest = {key: value for key, value in os.environ.items() if not key.startswith("XDG_")}
    try:
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-I", "-c", START, str(theirs.fileno()), name, *path],
                stdin=subprocess.DEVNULL,
                stdout=2,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
                cwd=folder,
                env=rest | dict.fromkeys(("HOME", "PWD", "TEMP", "TMP", "TMPDIR"), folder),
            )
    except OSError as error:
        own.close()
        rmtree(folder)
        raise PolicyError(f"policy {name!r}: its process cannot be started: {error}") from error
    return process, own, folder


def _end(process: "subprocess.Popen[bytes]", own: socket.socket, stream: Any, folder: str) -> None:
    """End a process and its children, wait for it, and remove its folder."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    own.close()
    with suppress(OSError):  # what was not sent
        stream.close()
    rmtree(folder, ignore_errors=True)
