"""Episodes in which the program at the other end of a serial line sets the voltages.

All numbers are little-endian. A payload to the partner begins with a uint32. It is 0 before an
episode; then come the uint32 ``VERSION``, the pace and the path's arcs. Otherwise it is the number
of the control step; then come both links' angles and angular velocities, four torques, the hand's
force along and across the path. The partner answers with the first uint32 and its own version, or
four voltages, float32. All else is float64.
"""

import struct
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.records import flat, load
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW
from pter_gym._physics.arm import Vector
from pter_gym.benchmark.episodes import time_limit
from pter_gym.errors import PartnerError
from pter_gym.params import Machine
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tasks.path_following._position import to_path
from pter_gym.tasks.path_following._specification import IDEAL_SENSING, sensing_of
from pter_gym.tools.hil.line import SerialLine

VERSION = 1
"""Version of the protocol, which both sides tell before an episode."""

BEGINNING, READING = struct.Struct("<IId"), struct.Struct("<I10d")
"""What the partner gets: before an episode, with the rows of the path after it; at each step."""

ANSWER, GREETING = struct.Struct("<I4f"), struct.Struct("<II")
"""What it answers."""

HELLO, PATIENCE = 1.0, 20.0
"""Seconds between tries to begin an episode, and until the partner must have answered one."""

SILENCE = 1.0
"""Least seconds without an answer after which the partner is gone."""

Array = NDArray[np.float64]


def follow(
    machine: Machine, task: PathFollowing, seed: int, decide: Callable[[Array], Any]
) -> Iterator[Array]:
    """Yield the telemetry of an episode row by row; ``decide`` turns readings into voltages."""
    batch = Batch(machine, task, 1)
    _, (row,) = batch.reset([seed])
    yield row
    for _ in range(time_limit(task)):
        volts = decide(reading_of(batch, row))[: batch.num_actions]
        _, row, _, terminated, truncated, _ = batch.step_alone(volts)
        yield row
        if terminated or truncated:
            return


def reading_of(batch: Batch, row: Any) -> Array:
    """Return what the sensors of a batch's only world read, (10,), from its last telemetry."""
    world: Any = batch.kernel_arrays()["worlds"][0, :, :1]
    sensing = sensing_of(batch.task, batch.machine)
    if sensing != IDEAL_SENSING:
        return np.array(flat(load(world, ROW.readings[sensing.delay], 0)))
    motion, foot = load(world, ROW.motion, 0), load(world, ROW.foot, 0)
    links = (motion.theta_a, motion.theta_b, motion.omega_a, motion.omega_b)
    force = to_path(Vector(*row[[*COLUMN.force]]), foot.heading)
    return np.array([*links, *load(world, ROW.torque, 0), *force])


class Partner:
    """The program at the other end.

    Parameters
    ----------
    deadline
        Seconds to wait for an answer; without one the last voltages stay.
    real_time
        Whether control steps begin in time with a clock, or as soon as there is an answer.

    Attributes
    ----------
    latencies, missed
        Seconds from readings to answers, of those in time, and how many were not.
    """

    def __init__(self, line: SerialLine, deadline: float, *, real_time: bool) -> None:
        self.line, self.deadline, self.real_time = line, deadline, real_time
        self.latencies = list[float]()
        self.missed = 0

    def drive(self, machine: Machine, task: PathFollowing, seed: int, rows: list[Array]) -> None:
        """Run an episode, whose telemetry ``rows`` gets, or raise a PartnerError."""
        self.voltage_max = machine.clutch.voltage_max
        self.period = task.control_period if self.real_time else 0.0
        self.volts = np.zeros(4, np.float32)
        self.number = self.answered = 0
        ride = follow(machine, task, seed, self.decide)
        rows.append(next(ride))  # may compile, for longer than a partner may be silent
        self.begin(task)
        rows.extend(ride)

    def begin(self, task: PathFollowing) -> None:
        """Tell the partner pace and path until it answers."""
        arcs = np.ascontiguousarray(task.path.arcs.table, "<f8")
        started = time.monotonic()
        while (now := time.monotonic()) - started < PATIENCE:
            self.line.send(BEGINNING.pack(0, VERSION, task.pace) + arcs.tobytes())
            while (number := self.hear(now + HELLO)) is not None:
                if number == 0:
                    self.heard = self.due = time.monotonic()
                    return
        raise PartnerError(
            f"the partner has not answered for {PATIENCE:g} s when an episode with a path of "
            f"{len(arcs)} arcs was to begin"
        )

    def decide(self, reading: Array) -> NDArray[np.float32]:
        """Return the voltages for a reading: those of the newest answer that has come."""
        time.sleep(max(0.0, self.due - time.monotonic()))
        started = time.monotonic()
        self.due = max(self.due, started) + self.period if self.period else started
        self.number += 1
        self.line.send(READING.pack(self.number, *reading))
        while (number := self.hear(started + self.deadline)) is not None:
            if number == self.number:
                self.latencies.append(self.heard - started)
                return self.volts
        self.missed += 1
        silence = max(SILENCE, 3.0 * self.deadline)
        if time.monotonic() - self.heard > silence:
            raise PartnerError(f"the partner has been silent for {silence:g} s")
        return self.volts

    def greet(self, payload: bytes) -> None:
        """Check the answer before an episode, or raise a PartnerError."""
        _, version = GREETING.unpack(payload) if len(payload) == GREETING.size else (0, 0)
        if version != VERSION:
            raise PartnerError(
                f"the partner must speak version {VERSION} of the protocol, with 8 bytes before an "
                f"episode; it speaks version {version}, with {len(payload)} bytes"
            )

    def hear(self, until: float) -> int | None:
        """Return the number of the next answer, or None if there is none in time."""
        payload = self.line.receive(until)
        if payload is None:
            return None
        if payload[:4] == bytes(4):
            self.greet(payload)
            return 0
        if len(payload) != ANSWER.size:
            raise PartnerError(
                f"answers must have {ANSWER.size} bytes, a uint32 and four float32, got "
                f"{len(payload)}"
            )
        number, *volts = ANSWER.unpack(payload)
        if not all(0.0 <= each <= self.voltage_max for each in volts):
            raise PartnerError(
                f"voltages must be numbers from 0 to {self.voltage_max:g}, got {volts} at control "
                f"step {number}"
            )
        if self.answered < number <= self.number:
            self.answered, self.heard = number, time.monotonic()
            self.volts = np.array(volts, np.float32)
        return number
