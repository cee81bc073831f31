# pyright: standard
"""The adjoint of a rollout: control steps forward, then backward through each stage.

Forward, the state at each control instant is kept. Backward, a control step is simulated again from
there, and its stages are gone through from the last to the first: drift, kick, and what the
clutches tend to. A divided kick is gone through part by part, with the derivative of the instant at
which it was divided.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import types

from pter_gym._compiled.compiler import compile_kernel, inlined, outlined
from pter_gym._compiled.records import load, store, width
from pter_gym._physics.arm import Load, PerLink
from pter_gym._physics.clutch import PerClutch, Torques
from pter_gym._physics.open_loop import BODY, Array, scratch
from pter_gym._physics.order import CYCLE, is_kick, is_whole, stage_count
from pter_gym._physics.step import (
    MAX_PARTS,
    MIN_PART,
    arrangement_from,
    kick_finder,
    paper_clutches,
    share_before_switch,
    substep_on,
)
from pter_gym.gradients._branchless import Columns, Stage
from pter_gym.gradients._tracing import adjoint_of

FIRST, LAST = int(BODY.motion.theta_a), int(BODY.lagged_volts.x4) + 1
"""Rows of a body's state: motion, torques, lagged voltages."""

OMEGA = PerLink(BODY.motion.omega_a, BODY.motion.omega_b)
"""Rows of its angular velocities."""

_STATE, _STEADY = LAST - FIRST, width(Torques)
"""How many these are, and of what its clutches tend to."""


@inlined
def load_on(body: Columns, i: int) -> Load:
    """Return what acts on the arm."""
    return load(body, BODY.load, i)


aim, drift, _ = substep_on(BODY, load_on)


class Kick(NamedTuple):
    """A kick's stages, as ``substep_on`` makes them, on columns with the rows ``BODY``.

    Attributes
    ----------
    whole
        All of it.
    find
        Its velocities over a time.
    share
        ``share(w, i)`` is the share of a kick after which a clutch changes, if ``find`` has found
        that one does.
    """

    whole: Stage
    find: Stage
    share: Stage


def kick_stages(arrangement_at: Stage) -> Kick:
    """Return a kick's stages for the clutches of ``arrangement_at``."""
    find = kick_finder(BODY, load_on, arrangement_at)

    @outlined
    def share(w: Columns, i: int) -> float:
        return share_before_switch(
            load(w, BODY.motion, i),
            load(w, BODY.omega, i),
            load(w, BODY.impact, i),
            load(w, BODY.torques, i),
            load(w, BODY.capacity, i),
            w[BODY.machine.slip_threshold, i],
            w[BODY.machine.sliding.creeps, i],
            w[BODY.span, i],
            arrangement_at(w, i),
        )

    return Kick(substep_on(BODY, load_on, arrangement_at)[2], find, share)


_aim_half, _aim_whole = (adjoint_of(aim, constants=(whole,)) for whole in (False, True))
_drift_half, _drift_whole = (adjoint_of(drift, "h", constants=(whole,)) for whole in (False, True))


@inlined
def _drift_adjoint(body: Columns, bar: Columns, h: float, whole: bool, aims: bool) -> None:
    """Pull adjoints back through a drift, and through the aim before it if there is one."""
    if whole:
        _drift_whole(body, 0, bar, h)
    else:
        _drift_half(body, 0, bar, h)
    if aims:
        if whole:
            _aim_whole(body, 0, bar)
        else:
            _aim_half(body, 0, bar)


@inlined
def _take_adjoint(bar: Columns) -> None:
    """Pull adjoints back from the velocities after a kick to those that ``find`` stores."""
    bar[BODY.omega.a, 0] += bar[OMEGA.a, 0]
    bar[BODY.omega.b, 0] += bar[OMEGA.b, 0]
    store(bar, OMEGA, 0, PerLink(0.0, 0.0))


def kick_adjoints(stages: Kick) -> tuple[Stage, Stage]:
    """Return the adjoint of a kick that was not divided, and that of any.

    Each takes a column with the motion before the kick, which has it again afterwards, ``bar`` and
    the time that the kick stands for, and returns the adjoint of that time.
    """
    find, share = stages.find, stages.share
    find_adjoint, share_adjoint = adjoint_of(find, "h"), adjoint_of(share)

    @inlined
    def whole_adjoint(w: Columns, i: int, bar: Columns, span: float) -> float:
        _take_adjoint(bar)
        return find_adjoint(w, i, bar, span)

    def with_rest(rest_adjoint: Stage) -> Stage:
        """Return the adjoint of a kick whose rest, after its first part, has another adjoint."""

        @outlined
        def kick_adjoint(w: Columns, i: int, bar: Columns, span: float) -> float:
            before = load(w, OMEGA, i)
            find(w, i, span)
            part = share(w, i) if w[BODY.switches, i] != 0.0 else 1.0
            if not part < 1.0 - MIN_PART:
                return whole_adjoint(w, i, bar, span)
            first = part * span
            find(w, i, first)
            store(w, OMEGA, i, load(w, BODY.omega, i))
            by_rest = rest_adjoint(w, i, bar, span - first)
            store(w, OMEGA, i, before)
            by_first = whole_adjoint(w, i, bar, first) - by_rest
            find(w, i, span)
            share_adjoint(w, i, bar, by_first * span)
            return by_rest + by_first * part + find_adjoint(w, i, bar, span)

        return kick_adjoint

    kick_adjoint = whole_adjoint
    for _ in range(MAX_PARTS - 1):
        kick_adjoint = with_rest(kick_adjoint)
    return whole_adjoint, kick_adjoint


@inlined
def lags(body: Columns) -> bool:
    """Return whether the voltage lags, so that steady torques change within a control step."""
    return body[BODY.machine.voltage_decay.rise, 0] != 0.0


@inlined
def _set_load(body: Columns, force: Array, target: Array) -> None:
    store(body, BODY.load, 0, Load(force[0], force[1], 0.0, 0.0, target[0], target[1]))


@inlined
def _bring_back(body: Columns, kept: Array) -> None:
    """Bring back the state before a stage, and what clutches tend to in it."""
    for row in range(_STATE):
        body[FIRST + row, 0] = kept[row]
    for row in range(_STEADY):
        body[BODY.steady.breakaway.x1 + row, 0] = kept[_STATE + row]


def _forward_on(kick: Stage) -> Stage:
    """Return ``forward`` through a control step whose kicks are ``kick``."""

    @inlined
    def forward(body: Columns, h: float, force: Array, target: Array, tape: Array) -> None:
        """Move a body, which has its command, through a control step with substeps of h [s].

        ``tape`` (stages, entries) gets the state before each stage, what clutches tend to in it,
        and the span of a kick's last part; it may be empty.
        """
        count = len(force)
        for stage in range(stage_count(count)):
            if len(tape) > 0:
                for row in range(_STATE):
                    tape[stage, row] = body[FIRST + row, 0]
            if is_kick(stage):
                _set_load(body, force[stage // CYCLE], target[stage // CYCLE])
                kick(body, 1, h)
            else:
                whole = is_whole(stage, count)
                if lags(body) | (stage < CYCLE):
                    aim(body, 0, whole)
                drift(body, 0, h, whole)
            if len(tape) > 0:
                for row in range(_STEADY):
                    tape[stage, _STATE + row] = body[BODY.steady.breakaway.x1 + row, 0]
                tape[stage, -1] = body[BODY.span, 0]

    return forward


def _backward_on(stages: Kick) -> Stage:
    """Return ``backward`` through a control step with those kicks."""
    whole_adjoint, kick_adjoint = kick_adjoints(stages)

    @inlined
    def backward(
        body: Columns,
        bar: Columns,
        h: float,
        force: Array,
        target: Array,
        tape: Array,
        by_force: Array,
        by_target: Array,
    ) -> None:
        """Pull adjoints back through a control step, from what ``forward`` has kept of it."""
        count = len(force)
        for stage in range(stage_count(count) - 1, -1, -1):
            _bring_back(body, tape[stage])
            if is_kick(stage):
                k = stage // CYCLE
                _set_load(body, force[k], target[k])
                if tape[stage, -1] == h:
                    whole_adjoint(body, 0, bar, h)
                else:
                    kick_adjoint(body, 0, bar, h)
                by_load = load(bar, BODY.load, 0)
                by_force[k, 0], by_force[k, 1] = by_load.force_x, by_load.force_y
                by_target[k, 0], by_target[k, 1] = by_load.target_x, by_load.target_y
                store(bar, BODY.load, 0, Load(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
            else:
                whole = is_whole(stage, count)
                _drift_adjoint(body, bar, h, whole, lags(body) | (stage < CYCLE))

    return backward


_ROWS, _LAYERS = types.float64[:, ::1], types.float64[:, :, ::1]
_INPUTS = _ROWS, _ROWS, _LAYERS, _LAYERS, types.float64

FORWARD_TYPES = types.none(*_INPUTS, _ROWS)
BACKWARD_TYPES = types.none(*_INPUTS, _ROWS, _ROWS, _ROWS, _LAYERS, _LAYERS, _ROWS)
"""Types of the arguments of the kernels."""

forward_step: Any = None
backward_step: Any = None
"""What the kernels below call; ``compile_kernel`` binds these names."""


def _build_forward(digest: str) -> Stage:
    def forward(
        start: Array, volts: Array, force: Array, target: Array, h: float, states: Array
    ) -> None:
        """Fill the states at the control instants, (steps + 1, entries)."""
        _ = digest
        body = scratch(start)
        for row in range(FIRST, LAST):
            states[0, row - FIRST] = body[row, 0]
        nothing = np.empty((0, 0))
        for n in range(volts.shape[0]):
            store(
                body, BODY.command, 0, PerClutch(volts[n, 0], volts[n, 1], volts[n, 2], volts[n, 3])
            )
            forward_step(body, h, force[n], target[n], nothing)
            for row in range(FIRST, LAST):
                states[n + 1, row - FIRST] = body[row, 0]

    return forward


def _build_backward(digest: str) -> Stage:
    def backward(
        start: Array,
        volts: Array,
        force: Array,
        target: Array,
        h: float,
        states: Array,
        by_states: Array,
        by_volts: Array,
        by_force: Array,
        by_target: Array,
        bar: Any,
    ) -> None:
        """Fill the adjoints of the inputs, and of a body's entries, by those of the states."""
        _ = digest
        body = scratch(start)
        tape = np.empty((stage_count(force.shape[1]), _STATE + _STEADY + 1))
        bar[:] = 0.0
        for n in range(volts.shape[0] - 1, -1, -1):
            for row in range(FIRST, LAST):
                bar[row, 0] += by_states[n + 1, row - FIRST]
                body[row, 0] = states[n, row - FIRST]
            store(
                body, BODY.command, 0, PerClutch(volts[n, 0], volts[n, 1], volts[n, 2], volts[n, 3])
            )
            forward_step(body, h, force[n], target[n], tape)
            backward_step(body, bar, h, force[n], target[n], tape, by_force[n], by_target[n])
            for clutch in range(4):
                by_volts[n, clutch] = bar[BODY.command.x1 + clutch, 0]
                bar[BODY.command.x1 + clutch, 0] = 0.0
        for row in range(FIRST, LAST):
            bar[row, 0] += by_states[0, row - FIRST]

    return backward


@cache
def kernels(*, has_paper_clutches: bool) -> tuple[Stage, Stage]:
    """Return ``forward`` and ``backward`` of rollouts, for the paper's or declared clutches."""
    stages = kick_stages(paper_clutches if has_paper_clutches else arrangement_from(BODY))
    forward, backward = _forward_on(stages.whole), _backward_on(stages)
    backward_kernel = compile_kernel(_build_backward, forward_step=forward, backward_step=backward)
    return compile_kernel(_build_forward, forward_step=forward), backward_kernel
