"""The adjoint of a rollout: control steps forward on the simulator's own functions, and backward through each substep.

Forward, the state at each control instant is kept. Backward, a control step is simulated again from there, and its
stages are gone through from the last to the first: drift, kick, and what the clutches tend to. A divided kick is gone
through part by part, with the derivative of the instant at which it was divided.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pter_gym._compiled.compiler import compile_kernel, device, outlined
from pter_gym._compiled.records import load, store, width
from pter_gym._physics import step as _step
from pter_gym._physics.arm import Load
from pter_gym._physics.arrangement import Arrangement, Own, sign
from pter_gym._physics.clutch import PerClutch, Torques
from pter_gym._physics.friction import resolve, slip_velocities, torques_on_links
from pter_gym._physics.open_loop import BODY, scratch
from pter_gym._physics.step import (
    MOST_PARTS,
    declared_in,
    papers,
    share_before_change,
    sliding_torques,
    substep_on,
)
from pter_gym.gradients._tracing import Rule, adjoint_of

_STEP: Any = _step
SHORTEST_PART: float = _STEP._SHORTEST_PART

FIRST, LAST = int(BODY.motion.theta_a), int(BODY.lagged_volts.x4) + 1
"""Rows of a body's state: motion, torques, lagged voltages."""

_STATE, _STEADY = LAST - FIRST, width(Torques)
"""How many these are, and of what its clutches tend to."""

_ENERGIES = range(int(BODY.energy.hand_work), int(BODY.energy.residual) + 1)


@device
def momentum_bar(
    m11: float, m12: float, m22: float, omega_a: float, omega_b: float, by_a: float, by_b: float, slip: PerClutch
) -> tuple[float, float]:
    """Return the adjoint of the momentum from which friction leaves the velocities ω, by that of ω.

    It is M⁻¹ times it where all clutches slip, d·dᵀ/(dᵀM·d) times it on a line of direction d, and 0 at rest. On a line
    d is the direction of ω.
    """
    if (slip.x1 == 0.0) | (slip.x2 == 0.0) | (slip.x3 == 0.0) | (slip.x4 == 0.0):
        size = max(abs(omega_a), abs(omega_b))
        if size == 0.0:
            return 0.0, 0.0
        d_a, d_b = omega_a / size, omega_b / size
        inertia = m11 * d_a * d_a + 2.0 * m12 * d_a * d_b + m22 * d_b * d_b
        along = (d_a * by_a + d_b * by_b) / inertia
        return along * d_a, along * d_b
    inverse = 1.0 / (m11 * m22 - m12 * m12)
    return inverse * (m22 * by_a - m12 * by_b), inverse * (m11 * by_b - m12 * by_a)


@device
def capacity_bar(slip: float, by_slip: float) -> float:
    """Return the adjoint of a clutch's largest impulse, by that of an impulse along its slip."""
    return 0.0 if slip == 0.0 else -sign(slip) * by_slip


@device
def resolve_adjoint(
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    c: PerClutch,
    own: Own,
    omega_a: float,
    omega_b: float,
    by_a: float,
    by_b: float,
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return the adjoints of M (3), p (2) and c (4) of ``friction.resolve``, by those of the velocities ω.

    With P of ``momentum_bar``, ω changes by P·(dp − dM·ω − Σ_x W_xᵀ·sign(W_x·ω)·dc_x).
    """
    _ = p_a, p_b, c
    slip = slip_velocities(omega_a, omega_b, own)
    q_a, q_b = momentum_bar(m11, m12, m22, omega_a, omega_b, by_a, by_b, slip)
    along = slip_velocities(q_a, q_b, own)
    return (
        -q_a * omega_a,
        -q_a * omega_b - q_b * omega_a,
        -q_b * omega_b,
        q_a,
        q_b,
        capacity_bar(slip.x1, along.x1),
        capacity_bar(slip.x2, along.x2),
        capacity_bar(slip.x3, along.x3),
        capacity_bar(slip.x4, along.x4),
    )


@device
def resolve_tangent(
    m11: float,
    m12: float,
    m22: float,
    p_a: float,
    p_b: float,
    c: PerClutch,
    own: Own,
    omega_a: float,
    omega_b: float,
    d11: float,
    d12: float,
    d22: float,
    d_a: float,
    d_b: float,
    d1: float,
    d2: float,
    d3: float,
    d4: float,
) -> tuple[float, float]:
    """Return the tangents of the velocities ω of ``friction.resolve``, by those of M (3), p (2) and c (4)."""
    _ = p_a, p_b, c
    slip = slip_velocities(omega_a, omega_b, own)
    less_a, less_b = torques_on_links(sliding_torques(slip, PerClutch(d1, d2, d3, d4)), own)
    by_a = d_a - d11 * omega_a - d12 * omega_b + less_a
    by_b = d_b - d12 * omega_a - d22 * omega_b + less_b
    return momentum_bar(m11, m12, m22, omega_a, omega_b, by_a, by_b, slip)


FRICTION = Rule(resolve, resolve_adjoint, resolve_tangent, 9, 2, (PerClutch, Arrangement))


@device
def load_on(body: Any, i: int) -> Load:
    """Return what acts on the arm."""
    return load(body, BODY.load, i)


aim, drift, _ = substep_on(BODY, load_on)


class Kick(NamedTuple):
    """A kick's stages, as ``substep_on`` makes them, each of a column of an array with the rows ``BODY``.

    Attributes
    ----------
    whole
        All of it.
    find
        Its velocities over a time.
    share
        ``share(w, i)`` is the share of a kick after which a clutch changes, if ``find`` has found that one does.
    """

    whole: Any
    find: Any
    share: Any


def kick_stages(own_in: Any) -> Kick:
    """Return a kick's stages for machines whose clutches ``own_in`` tells."""
    find, _, _ = _STEP._parts_on(BODY, load_on, own_in)

    @outlined
    def share(w: Any, i: int) -> float:
        return share_before_change(
            load(w, BODY.motion, i),
            load(w, BODY.omega, i),
            load(w, BODY.impact, i),
            load(w, BODY.torques, i),
            load(w, BODY.limit, i),
            w[BODY.machine.slip_threshold, i],
            w[BODY.span, i],
            own_in(w, i),
        )

    return Kick(substep_on(BODY, load_on, own_in)[2], find, share)


def stage_adjoint(stage: Any, *scalars: str, constants: tuple[Any, ...] = ()) -> Any:
    """Return the adjoint of a stage of a substep."""
    return adjoint_of(stage, scalars, constants, _ENERGIES, FRICTION)


_aim_half, _aim_whole = (stage_adjoint(aim, constants=(whole,)) for whole in (False, True))
_drift_half, _drift_whole = (stage_adjoint(drift, "h", constants=(whole,)) for whole in (False, True))


@device
def _drift_adjoint(body: Any, bar: Any, h: float, whole: bool, aims: bool) -> None:
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


@device
def move_omega(w: Any, i: int, omega_a: float, omega_b: float) -> None:
    w[BODY.motion.omega_a, i] = omega_a
    w[BODY.motion.omega_b, i] = omega_b


@device
def _take_adjoint(bar: Any) -> None:
    """Pull adjoints back through the step from the velocities of before a kick to those that were found."""
    bar[BODY.omega.a, 0] += bar[BODY.motion.omega_a, 0]
    bar[BODY.omega.b, 0] += bar[BODY.motion.omega_b, 0]
    move_omega(bar, 0, 0.0, 0.0)


def kick_adjoints(stages: Kick) -> tuple[Any, Any]:
    """Return the adjoint of a kick that was not divided, and that of any.

    Each takes a column with the motion before the kick, which has it again afterwards, ``bar`` and the time that the
    kick stands for, and returns the adjoint of that time.
    """
    find, share = stages.find, stages.share
    find_adjoint, share_adjoint = stage_adjoint(find, "h"), stage_adjoint(share)

    @device
    def whole_adjoint(w: Any, i: int, bar: Any, span: float) -> float:
        _take_adjoint(bar)
        return find_adjoint(w, i, bar, span)

    def with_rest(rest_adjoint: Any) -> Any:
        """Return the adjoint of a kick whose rest, after its first part, has another adjoint."""

        @outlined
        def kick_adjoint(w: Any, i: int, bar: Any, span: float) -> float:
            omega_a, omega_b = w[BODY.motion.omega_a, i], w[BODY.motion.omega_b, i]
            find(w, i, span)
            part = share(w, i) if w[BODY.changes, i] != 0.0 else 1.0
            if not part < 1.0 - SHORTEST_PART:
                return whole_adjoint(w, i, bar, span)
            first = part * span
            find(w, i, first)
            move_omega(w, i, w[BODY.omega.a, i], w[BODY.omega.b, i])
            by_rest = rest_adjoint(w, i, bar, span - first)
            move_omega(w, i, omega_a, omega_b)
            by_first = whole_adjoint(w, i, bar, first) - by_rest
            find(w, i, span)
            share_adjoint(w, i, bar, by_first * span)
            return by_rest + by_first * part + find_adjoint(w, i, bar, span)

        return kick_adjoint

    kick_adjoint = whole_adjoint
    for _ in range(MOST_PARTS - 1):
        kick_adjoint = with_rest(kick_adjoint)
    return whole_adjoint, kick_adjoint


@device
def lags(body: Any) -> bool:
    """Return whether it is the voltage that lags, so what clutches tend to changes within a control step."""
    return body[BODY.machine.voltage_decay, 0] != 0.0


@device
def _set_load(body: Any, force: Any, target: Any) -> None:
    store(body, BODY.load, 0, Load(force[0], force[1], 0.0, 0.0, target[0], target[1]))


@device
def _keep(tape: Any, k: int, stage: int, body: Any) -> None:
    """Keep a body's state and what its clutches tend to, if there is a tape."""
    if len(tape) > 0:
        for row in range(_STATE):
            tape[k, stage, row] = body[FIRST + row, 0]
        for row in range(_STEADY):
            tape[k, stage, _STATE + row] = body[BODY.steady.breakaway.x1 + row, 0]


@device
def _bring_back(body: Any, kept: Any, steady: int) -> None:
    """Bring back a state, and as many entries of what clutches tend to."""
    for row in range(_STATE):
        body[FIRST + row, 0] = kept[row]
    for row in range(steady):
        body[BODY.steady.breakaway.x1 + row, 0] = kept[_STATE + row]


def _steps(own_in: Any) -> tuple[Any, Any]:
    """Return ``forward`` and ``backward`` through a control step, for machines whose clutches ``own_in`` tells."""
    stages = kick_stages(own_in)
    kick = stages.whole
    whole_adjoint, kick_adjoint = kick_adjoints(stages)

    @device
    def forward(body: Any, h: float, force: Any, target: Any, tape: Any) -> None:
        """Move a body, which has its command, through a control step with substeps of h [s].

        ``tape`` (substeps + 1, 2, entries) gets what there is before each drift and before each kick; it may be empty.
        """
        count = len(force)
        for k in range(count + 1):
            _keep(tape, k, 0, body)
            if lags(body) | (k == 0):
                aim(body, 0, (k > 0) & (k < count))
            drift(body, 0, h, (k > 0) & (k < count))
            _keep(tape, k, 1, body)
            if k < count:
                _set_load(body, force[k], target[k])
                kick(body, 1, h)
                if len(tape) > 0:
                    tape[k, 1, -1] = body[BODY.span, 0]

    @device
    def backward(
        body: Any, bar: Any, h: float, force: Any, target: Any, tape: Any, by_force: Any, by_target: Any
    ) -> None:
        """Pull adjoints back through a control step, from what ``forward`` has kept of it."""
        count = len(force)
        for k in range(count, -1, -1):
            _bring_back(body, tape[k, 1], _STEADY)
            if k < count:
                _set_load(body, force[k], target[k])
                if tape[k, 1, -1] == h:
                    whole_adjoint(body, 0, bar, h)
                else:
                    kick_adjoint(body, 0, bar, h)
                by_force[k, 0], by_force[k, 1] = bar[BODY.load.force_x, 0], bar[BODY.load.force_y, 0]
                by_target[k, 0], by_target[k, 1] = bar[BODY.load.target_x, 0], bar[BODY.load.target_y, 0]
                store(bar, BODY.load, 0, Load(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
            _bring_back(body, tape[k, 0], 0)
            _drift_adjoint(body, bar, h, (k > 0) & (k < count), lags(body) | (k == 0))

    return forward, backward


forward_step, backward_step = _steps(papers)


def _build_forward(digest: str) -> Any:
    def forward(given: Any, volts: Any, force: Any, target: Any, h: float, states: Any) -> None:
        """Fill the states at the control instants, (steps + 1, entries)."""
        _ = digest
        body = scratch(given)
        for row in range(FIRST, LAST):
            states[0, row - FIRST] = body[row, 0]
        nothing = np.empty((0, 2, 0))
        for n in range(volts.shape[0]):
            store(body, BODY.command, 0, PerClutch(volts[n, 0], volts[n, 1], volts[n, 2], volts[n, 3]))
            forward_step(body, h, force[n], target[n], nothing)
            for row in range(FIRST, LAST):
                states[n + 1, row - FIRST] = body[row, 0]

    return forward


def _build_backward(digest: str) -> Any:
    def backward(
        given: Any,
        volts: Any,
        force: Any,
        target: Any,
        h: float,
        states: Any,
        by_states: Any,
        by_volts: Any,
        by_force: Any,
        by_target: Any,
        bar: Any,
    ) -> None:
        """Fill the adjoints of the inputs, and of a body's entries, by those of the states."""
        _ = digest
        body = scratch(given)
        tape = np.empty((force.shape[1] + 1, 2, _STATE + _STEADY + 1))
        bar[:] = 0.0
        for n in range(volts.shape[0] - 1, -1, -1):
            for row in range(FIRST, LAST):
                bar[row, 0] += by_states[n + 1, row - FIRST]
                body[row, 0] = states[n, row - FIRST]
            store(body, BODY.command, 0, PerClutch(volts[n, 0], volts[n, 1], volts[n, 2], volts[n, 3]))
            forward_step(body, h, force[n], target[n], tape)
            backward_step(body, bar, h, force[n], target[n], tape, by_force[n], by_target[n])
            for clutch in range(4):
                by_volts[n, clutch] = bar[BODY.command.x1 + clutch, 0]
                bar[BODY.command.x1 + clutch, 0] = 0.0
        for row in range(FIRST, LAST):
            bar[row, 0] += by_states[0, row - FIRST]

    return backward


@cache
def kernels(*, papers: bool) -> tuple[Any, Any]:
    """Return ``forward`` and ``backward`` of whole rollouts, for the paper's clutches or other ones."""
    if papers:
        return compile_kernel(_build_forward), compile_kernel(_build_backward)
    forward, backward = _steps(declared_in(BODY))
    declared = {"forward_step": forward, "backward_step": backward}
    return compile_kernel(_build_forward, forward_step=forward), compile_kernel(_build_backward, **declared)
