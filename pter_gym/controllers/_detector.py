"""Which clutch has failed, from what a policy observes, and policies that go on without it."""

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import compiled, inlined, outlined
from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import Entry, entrywise, flat, read, rows, width, write
from pter_gym._internal.fields import require, require_kind, require_number
from pter_gym._physics.arrangement import Arrangement
from pter_gym._physics.clutch import Curve, PerClutch, curve_torque, product
from pter_gym._physics.friction import slip_velocities
from pter_gym._physics.model import arrangement_of, curve_of
from pter_gym.controllers._gains import Entries
from pter_gym.controllers._laws import Law, is_ours, physical
from pter_gym.controllers._policy import Controller, Policy, sensors_of
from pter_gym.errors import ParameterError
from pter_gym.params import SLOTS, Machine, find_machine
from pter_gym.tasks.path_following._observation import OBS, Sensors, observation_layout

LEAST = 3.0
"""Torque [N·m] that a clutch should exert before one that does not is suspected."""

DEAD, HOLDS = 0.1, 2.0
"""A dead clutch reads less than this share of the torque that it should have; one that is stuck on
reads more than ``LEAST`` beyond so many times the torque that it can have."""

SLIPS = 0.05
"""Slip velocity [rad/s] from which on a clutch surely slips, whatever noise there is."""

IN_A_ROW = 8.0
"""Observations in a row after which a suspicion becomes a verdict."""


class Watch(NamedTuple):
    """What a detector remembers of one world."""

    begun: Annotated[float, Entry("1", "whether the episode has begun")]
    named: Annotated[float, Entry("1", "number of the clutch that has failed, 0 for none")]
    expected: Annotated[PerClutch, Entry("N·m", "torque that a clutch should exert")]
    suspicion: Annotated[PerClutch, Entry("1", "observations in a row that speak against one")]


class Watched(NamedTuple):
    """What a detector knows of the machine."""

    size: Annotated[float, Entry("1", "gains of the law for one machine")]
    left: Annotated[float, Entry("1", "what a period leaves of the clutches' lag")]
    curve: Curve
    scale: PerClutch
    arrangement: Arrangement


WATCH, WATCHED = rows(Watch), rows(Watched)
MEMORY_WIDTH, HEADER_WIDTH = width(Watch), width(Watched)


@entrywise
@inlined
def after_lag(expected: float, steady: float, left: float) -> float:
    """Return the torque [N·m] of a clutch after a period that leaves a part of the lag."""
    return steady + left * (expected - steady)


@entrywise
@inlined
def suspected(before: float, expected: float, torque: float, slip: float) -> float:
    """Return the observations in a row that speak against a clutch, after one with its torque."""
    reading = abs(torque)
    is_dead = (expected > LEAST) & (abs(slip) > SLIPS) & (reading < DEAD * expected)
    holds = reading > HOLDS * expected + LEAST
    return before + 1.0 if is_dead | holds else 0.0


@entrywise
@inlined
def observed(obs: Entries, scales: Entries, at: float) -> float:
    """Return an entry of an observation in its unit."""
    return physical(obs, scales, at)


@inlined
def look(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> float:
    """Return the number of the clutch that was the first to fail, 0 for none."""
    known = read(gains, WATCHED, 0)
    before = read(memory, WATCH, 0)
    steady = product(known.scale, curve_torque(known.curve, observed(obs, scales, OBS.volts)))
    left = known.left if before.begun > 0.0 else 0.0
    expected = after_lag(before.expected, steady, left)
    slip = slip_velocities(
        physical(obs, scales, OBS.omega_a), physical(obs, scales, OBS.omega_b), known.arrangement
    )
    torque = observed(obs, scales, OBS.torque)
    suspicion = suspected(before.suspicion, expected, torque, slip)
    named = before.named
    for k in range(SLOTS):
        named = k + 1.0 if (named == 0.0) & (suspicion[k] >= IN_A_ROW) else named
    write(memory, WATCH, Watch(1.0, named, expected, suspicion))
    return named


@inlined
def only_looking(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
    """Return no voltages."""
    look(obs, scales, gains, memory)
    return PerClutch(0.0, 0.0, 0.0, 0.0)


@cache
def watching(law: Law) -> Law:
    """Return a law that has the gains for the machine that is left, by what a detector says.

    Its gains are ``Watched``, then those of the law for the machine as it should be and for those
    without one clutch; its memory is ``Watch``, then the law's.
    """

    def watched(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
        """Return the voltages of a law for the clutches that have not failed."""
        size = int(gains[WATCHED.size])
        first = HEADER_WIDTH + size * int(look(obs, scales, gains, memory))
        return law(obs, scales, gains[first : first + size], memory[MEMORY_WIDTH:])

    watched.__module__ = law.__module__
    return (outlined if is_ours(law) else compiled)(watched)


def without(machine: Machine, clutch: int) -> Machine:
    """Return a machine without one of its clutches, by its number from 1."""
    scale = list(machine.clutch_scale)
    scale[clutch - 1] = 0.0
    return replace(machine, clutch_scale=tuple(scale))


def known_of(machine: Machine, period: float, size: int) -> NDArray[np.float64]:
    """Return what a detector knows of a machine, (…,); see ``Watched``."""
    clutch = machine.clutch
    left = math.exp(-period / clutch.time_constant)
    scale = PerClutch(*machine.slot_scale)
    known = Watched(size, left, curve_of(clutch.dynamic), scale, arrangement_of(machine))
    return np.array(flat(known))


@dataclass(frozen=True)
class FailureDetector:
    """Names the clutch of a machine that is dead or stuck on, if its torque sensors show one.

    A clutch that slips exerts its dynamic torque, so one that should exert some and reads none is
    dead; no clutch exerts much more than its breakaway torque, so one that does is stuck on. A
    clutch that sticks or should exert little tells nothing, nor can a weak clutch be told from one
    of another material.

    Attributes
    ----------
    machine
        The machine as it should be.
    period
        Time from one observation to the next [s].
    """

    machine: Machine
    period: float = 0.01

    def start(self, worlds: int) -> NDArray[np.float64]:
        """Return what is remembered of each world whose episode begins, (N, 10)."""
        return self._policy.start(worlds)

    def look(
        self, observations: NDArray[np.float32], memory: NDArray[np.float64]
    ) -> NDArray[np.intp]:
        """Return the number of the clutch that was the first to fail in each world, 0 for none.

        Parameters
        ----------
        observations
            Those of a control instant with torque sensors, (N, entries ≥ 24); later entries are not
            looked at.
        memory
            From ``start``, (N, 10), which changes.

        Returns
        -------
        clutches
            Shape (N,). A clutch that is named once remains so.
        """
        entries = len(self._policy.layout)
        self._policy.act(np.ascontiguousarray(observations[:, :entries]), memory)
        return memory[:, int(WATCH.named)].astype(np.intp)

    @cached_property
    def _policy(self) -> Policy:
        known = known_of(self.machine, self.period, 0)
        layout = observation_layout(self.machine, "torque")
        return Policy.from_law(only_looking, known, self.machine, layout, memory=Watch)


@dataclass(frozen=True)
class FaultTolerant:
    """A control law or a trained policy that goes on without a clutch once that has failed.

    A ``FailureDetector`` looks at each observation. When it names a clutch, the policy continues as
    if it were bound to the machine without it, and keeps what it remembers.

    Attributes
    ----------
    controller
        The law or the trained policy.
    period
        Control period [s].
    """

    controller: Controller
    period: float = 0.01

    def __post_init__(self) -> None:
        """Check the fields."""
        require_kind(self, "controller", Controller)
        require_number(self, "period", above=0.0)

    @property
    def sensors(self) -> Sensors:
        """The sensors that it needs: those of the controller, and torque sensors."""
        own = sensors_of(self.controller)
        return "torque" if own == "encoders" else own

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return the policy for a nominal machine.

        Raises
        ------
        ParameterError
            If the observation has no torque sensors, or the controller is no compiled law, does not
            act at every control step of this period, cannot be bound to the machine without one of
            its clutches, or then is the same.
        """
        machine = find_machine(machine)
        if "torque_1" not in layout.names:
            raise ParameterError(
                'a detector needs torque sensors: sensors="torque" or sensors="force"'
            )
        clutches = range(1, 1 + len(machine.clutches))
        machines = machine, *(without(machine, clutch) for clutch in clutches)
        policies = [self.controller.bind(each, layout) for each in machines]
        healthy, laws = policies[0], [each.law for each in policies if each.law is not None]
        accepted = "a compiled law that acts at every control step"
        require(len(laws) > 0 and healthy.frame_skip == 1, self, "controller", accepted)
        healthy.check_period(self.period)
        law, *others = laws
        alike = all(
            each.function is law.function and each.gains.size == law.gains.size for each in others
        )
        differ = alike and any((each.gains != law.gains).any() for each in others)
        accepted = "one law that depends on what clutches the machine has"
        require(differ, self, "controller", accepted)
        gains = {"detector": known_of(machine, self.period, law.gains.size)}
        gains |= {name: law.gains[slice(*ends)] for name, ends in law.parts.items()}
        gains |= {f"without_{k}": each.gains for k, each in zip(clutches, others, strict=True)}
        policy = Policy.from_law(
            watching(law.function),
            gains,
            machine,
            layout,
            memory=Watch,
            more_memory=healthy.start(1).shape[1],
            frame_skip=1,
            control_period=self.period,
        )

        def start(worlds: int, episodes: Any = None) -> NDArray[np.float64]:
            watch = np.zeros((worlds, MEMORY_WIDTH))
            return np.hstack([watch, healthy.start(worlds, episodes)])

        return replace(policy, start=start, made=partial(self.bind, machine, layout))
