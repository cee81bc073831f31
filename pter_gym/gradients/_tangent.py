# pyright: standard
"""Substeps with their tangents: forward mode, for few parameters and many results.

Each tangent is a lane, and all lanes share the numbers of the substep itself.
"""

from pter_gym._compiled.compiler import inlined, outlined
from pter_gym._compiled.records import flat, load, store
from pter_gym._physics.open_loop import BODY
from pter_gym._physics.order import CYCLE, is_kick, stage_count
from pter_gym._physics.step import MAX_PARTS, MIN_PART
from pter_gym.gradients._adjoint import OMEGA, Kick, aim, drift, kick_stages, lags
from pter_gym.gradients._branchless import Columns, Stage
from pter_gym.gradients._tracing import tangent_of

LANES = "dot.shape[1]"
"""How many tangents there are, in the code of a stage."""

MOTION = frozenset(flat(BODY.motion))
TORQUES = frozenset(
    flat((
        *(BODY.torques, BODY.lagged_volts, BODY.command, BODY.steady, BODY.machine.breakaway),
        *(BODY.machine.dynamic, BODY.machine.voltage_decay, BODY.machine.torque_decay),
        *(BODY.machine.scale, BODY.machine.sliding),
    ))
)  # fmt: skip
"""Rows that vary with the clutches, but for the friction of the axes."""

KICK = MOTION | TORQUES | frozenset(
    flat((
        *(BODY.machine.arm.m11, BODY.machine.arm.m22, BODY.machine.arm.coupling),
        *(BODY.machine.arm.dry_a, BODY.machine.arm.dry_b, BODY.machine.arm.viscous_a),
        *(BODY.machine.arm.viscous_b, BODY.arrangement.dry),
        *(BODY.impact, BODY.omega, BODY.capacity, BODY.span, BODY.switches),
        *(BODY.load.torque_a, BODY.load.torque_b, BODY.load.force_x, BODY.load.force_y),
    ))
)  # fmt: skip


def substep_tangents(arrangement_at: Stage, torque_lanes: int) -> Stage:
    """Return a substep with tangents, for machines with the clutches of ``arrangement_at``.

    Parameters
    ----------
    arrangement_at
        As ``substep_on`` takes it.
    torque_lanes
        How many lanes, the first, may have tangents of the clutches' torques and voltages.

    Returns
    -------
    Callable
        ``advance(body, dot, h, aims)`` does to a body with its command and its load what
        ``open_loop.advance`` does, energies apart, and to ``dot`` (entries, lanes), the tangents of
        its entries by numbers of the motion, the clutches, the inertias, the friction of the axes
        and the load. ``aims`` says whether commands may have changed.
    """
    kick = _kick_tangents(arrangement_at)
    first = f"min({torque_lanes}, {LANES})"
    aim_torques = tangent_of(aim, constants=(False,), active=TORQUES, lanes=first)
    relax = tangent_of(drift, "h", constants=(False,), active=TORQUES, lanes=first)
    turn = tangent_of(drift, "h", constants=(False,), active=MOTION, lanes=LANES)

    @inlined
    def advance(body: Columns, dot: Columns, h: float, aims: bool) -> None:
        for stage in range(stage_count(1)):
            if is_kick(stage):
                kick(body, dot, h)
            else:
                if lags(body) | (aims & (stage < CYCLE)):
                    aim_torques(body, 0, dot)
                relax(body, 0, dot, h)
                turn(body, 0, dot, h)

    return advance


def stages_in_span(stages: Kick) -> tuple[Stage, Stage]:
    """Return a kick over the span in the column as a stage, and a divided kick's next part."""
    find_over, share = stages.find, stages.share

    @inlined
    def find(w: Columns, i: int) -> None:
        find_over(w, i, w[BODY.span, i])

    @inlined
    def take_part(w: Columns, i: int) -> None:
        """Take the kick up to the first change, and find the rest of it."""
        span = w[BODY.span, i]
        first = share(w, i) * span
        find_over(w, i, first)
        store(w, OMEGA, i, load(w, BODY.omega, i))
        find_over(w, i, span - first)

    return find, take_part


def _kick_tangents(arrangement_at: Stage) -> Stage:
    """Return ``kick(body, dot, h)``: a kick of h [s] with tangents, divided at each switch."""
    stages = kick_stages(arrangement_at)
    share = stages.share
    find, part = (tangent_of(stage, active=KICK, lanes=LANES) for stage in stages_in_span(stages))

    @outlined
    def divide(body: Columns, dot: Columns) -> None:
        for _ in range(MAX_PARTS - 1):
            if body[BODY.switches, 0] == 0.0 or not share(body, 0) < 1.0 - MIN_PART:
                break
            part(body, 0, dot)

    @inlined
    def kick(body: Columns, dot: Columns, h: float) -> None:
        body[BODY.span, 0] = h
        for j in range(dot.shape[1]):
            dot[BODY.span, j] = 0.0
        find(body, 0, dot)
        if body[BODY.switches, 0] != 0.0:
            divide(body, dot)
        store(body, OMEGA, 0, load(body, BODY.omega, 0))
        for j in range(dot.shape[1]):
            store(dot, OMEGA, j, load(dot, BODY.omega, j))

    return kick
