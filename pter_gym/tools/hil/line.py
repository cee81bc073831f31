"""A serial line or pseudo-terminal on Linux or macOS, and frames on it.

A frame is a payload and its CRC-32 without zero bytes (COBS: consistent overhead byte stuffing),
then a zero byte, so a reader that has lost bytes finds the next frame.
"""

import os
import select
import shlex
import subprocess
import time
import zlib
from contextlib import suppress
from pathlib import Path

from pter_gym.errors import DependencyError, ParameterError, PartnerError

LARGEST = 8192
"""Largest frame [B]."""

RUN = 254
"""Longest run of bytes in a block of COBS."""

PATIENCE = 1.0
"""Seconds in which a line must take what is written, and a program must end."""


def framed(payload: bytes) -> bytes:
    """Return a payload as a frame."""
    data, out = payload + zlib.crc32(payload).to_bytes(4, "little"), bytearray()
    for run in data.split(b"\0"):
        whole = len(run) // RUN * RUN
        for at in range(0, whole, RUN):
            out += bytes([RUN + 1]) + run[at : at + RUN]
        out += bytes([len(run) - whole + 1]) + run[whole:]
    return bytes(out) + b"\0"


def payload_of(frame: bytes) -> bytes | None:
    """Return the payload of a frame without its zero byte, or None if it is broken."""
    data, at = bytearray(), 0
    while at < len(frame):
        code = frame[at]
        data += frame[at + 1 : at + code]
        at += code
        if code <= RUN and at < len(frame):
            data.append(0)
    payload, check = bytes(data[:-4]), bytes(data[-4:])
    is_whole = at == len(frame) and zlib.crc32(payload).to_bytes(4, "little") == check
    return payload if is_whole else None


class SerialLine:
    """A serial port at ``baud``, or a pseudo-terminal as standard input and output of a program.

    ``broken`` counts the frames that were skipped because their checksum was wrong.
    """

    def __init__(self, partner: str, baud: int) -> None:
        self.broken = 0
        self._bytes = bytearray()
        self._program: subprocess.Popen[bytes] | None = None
        try:
            if Path(partner).is_char_device():
                self._end = os.open(partner, os.O_RDWR | os.O_NOCTTY)
                make_raw(self._end, baud)
            else:
                self._end, other = os.openpty()
                with os.fdopen(other):
                    make_raw(other, baud)
                    self._program = subprocess.Popen(
                        shlex.split(partner) or [partner], stdin=other, stdout=other
                    )
        except (OSError, ValueError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            raise ParameterError(
                f"partner must be a serial port or a command, got {partner!r}: {why}"
            ) from None
        os.set_blocking(self._end, False)

    def send(self, payload: bytes) -> None:
        """Write a frame, or raise a PartnerError if the line is cut or takes nothing."""
        rest = framed(payload)
        while rest:
            if not select.select([], [self._end], [], PATIENCE)[1]:
                raise PartnerError(f"the line has accepted no bytes for {PATIENCE:g} s")
            try:
                rest = rest[os.write(self._end, rest) :]
            except OSError as error:
                raise self._cut(error) from None

    def receive(self, until: float) -> bytes | None:
        """Return the next frame's payload, or None if there is none at a ``time.monotonic``.

        Raises a PartnerError if the line is cut.
        """
        while (remaining := until - time.monotonic()) > 0.0:
            frame, zero, rest = self._bytes.partition(b"\0")
            if zero or len(frame) > LARGEST:
                self._bytes = rest
                payload = payload_of(bytes(frame))
                if zero and payload is not None:
                    return payload
                self.broken += bool(frame)
                continue
            if not select.select([self._end], [], [], remaining)[0]:
                return None
            try:
                data = os.read(self._end, LARGEST)
            except OSError as error:
                raise self._cut(error) from None
            if not data:
                raise self._cut("nobody is at its other end")
            self._bytes += data
        return None

    def _cut(self, why: object) -> PartnerError:
        status = ""
        if self._program:
            with suppress(subprocess.TimeoutExpired):
                status = f"; the program has ended with status {self._program.wait(PATIENCE)}"
        return PartnerError(f"the line was cut: {why}{status}")

    def close(self) -> None:
        """Close the line, and end the program at its other end."""
        os.close(self._end)
        if self._program:
            with suppress(subprocess.TimeoutExpired):
                self._program.wait(PATIENCE)
            self._program.kill()
            self._program.wait()


def make_raw(end: int, baud: int) -> None:
    """Set 8 bits, no parity, no flow control, and no byte with a meaning of its own."""
    try:
        import termios
        import tty
    except ImportError as error:
        raise DependencyError("pter hil needs termios, which Linux and macOS have") from error
    speed = getattr(termios, f"B{baud}", 0)
    if not speed:
        raise ParameterError(f"baud must be a rate that serial ports have, got {baud!r}")
    try:
        tty.setraw(end)
        mode = termios.tcgetattr(end)
        mode[1] = 0  # an emulator may turn the translation of line ends on again
        mode[2] |= termios.CLOCAL | termios.CREAD
        mode[4:6] = [speed, speed]
        termios.tcsetattr(end, termios.TCSANOW, mode)
    except termios.error as error:
        raise OSError(*error.args) from None
