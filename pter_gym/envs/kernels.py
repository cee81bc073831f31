"""The block kernel: whole control steps of many worlds on a CPU.

Worlds are stored in blocks of up to 64 lanes, (blocks, rows, lanes). A block is copied into one scratch array, whose
innermost loops over lanes are vectorised, and back. Lanes without a world hold zeros and a copy of valid parameters.
"""

from functools import cache
from typing import Any

import numpy as np

from pter_gym._jit import compile_kernel, device
from pter_gym.controllers.laws import EXTERNAL, built_in
from pter_gym.envs.world import (
    ALIVE,
    CHANGING_ROWS,
    LANES,
    NEXT_STEP,
    PARAM,
    SCRATCH_ROWS,
    WORLD_ROWS,
    aim_torques,
    catch_crossing,
    end_step,
    find_velocity,
    given_volts,
    is_refused,
    move_arm,
    observe_world,
    push_tip,
    record_reset,
    sense_torques,
    start_episode,
    take_command,
)
from pter_gym.physics.model import VOLTAGE_DECAY, VOLTAGE_MAX

law: Any = built_in
"""The law that the kernel below inlines; ``compile_kernel`` binds this name to another one."""


@device
def _first_refused(worlds: Any, actions: Any, low: float, high: float, ended: int) -> int:
    """Return the first world whose step is refused, or −1."""
    for world in range(actions.shape[0]):
        if is_refused(worlds, actions, low, high, ended, world):
            return world
    return -1


@device
def _gather(w: Any, block: Any) -> None:
    for row in range(WORLD_ROWS):
        for i in range(block.shape[1]):
            w[row, i] = block[row, i]


@device
def _scatter(w: Any, i: int, block: Any) -> None:
    for row in range(CHANGING_ROWS):
        block[row, i] = w[row, i]


@device
def _scatter_alive(w: Any, lanes: int, block: Any) -> None:
    for row in range(CHANGING_ROWS):
        for i in range(lanes):
            block[row, i] = w[row, i] if w[ALIVE, i] != 0.0 else block[row, i]


@device
def _count(w: Any, row: int, lanes: int) -> int:
    """Return how many lanes are not zero in a row."""
    count = 0
    for i in range(lanes):
        count += 1 if w[row, i] != 0.0 else 0
    return count


@device
def _substep(w: Any, lanes: int, h: float, aims: bool) -> None:
    """Advance all lanes by one substep; ``aims`` says that the steady torques may have changed."""
    if aims:
        for i in range(lanes):
            aim_torques(w, i)
    for i in range(lanes):
        push_tip(w, i)
    for i in range(lanes):
        find_velocity(w, i, h)
    for i in range(lanes):
        catch_crossing(w, i, h)
    for i in range(lanes):
        move_arm(w, i, h)


@device
def _goes_on(w: Any, lanes: int, ended: int) -> bool:
    """Tell whether there is anything to do for a block."""
    return ended == NEXT_STEP or _count(w, ALIVE, lanes) > 0


@device
def _begin_given(w: Any, lanes: int, actions: Any, begin: int, low: float, high: float) -> None:
    """Begin a control step with the actions of the worlds from ``begin`` on."""
    for i in range(lanes):
        if w[ALIVE, i] != 0.0:
            take_command(w, i, given_volts(actions, begin + i, low, w[PARAM + VOLTAGE_MAX, i] / (high - low)))


@device
def _close(
    w: Any,
    block: Any,
    lanes: int,
    begin: int,
    words: Any,
    inverse_scales: Any,
    obs: Any,
    results: Any,
    telemetry: Any,
    final_obs: Any,
    final_telemetry: Any,
    period: float,
    limit: float,
    ended: int,
) -> None:
    """End a control step of a block and write back the worlds that ended. ``telemetry`` is (1 or 0, N, K)."""
    for i in range(lanes):
        was_alive = w[ALIVE, i] != 0.0
        end_step(
            w,
            i,
            begin + i,
            words,
            inverse_scales,
            obs,
            results,
            telemetry,
            final_obs,
            final_telemetry,
            period,
            limit,
            ended,
        )
        if was_alive and w[ALIVE, i] == 0.0:
            _scatter(w, i, block)


def _build_advance(digest: str) -> Any:
    def advance(
        worlds: Any,
        words: Any,
        actions: Any,
        gains: Any,
        memory: Any,
        scales: Any,
        obs: Any,
        results: Any,
        telemetry: Any,
        final_obs: Any,
        final_telemetry: Any,
        config: Any,
        ended: int,
        steps: int,
        first: int,
        last: int,
    ) -> int:
        _ = digest
        low, high, slack, h, count, limit = config[0], config[1], config[2], config[3], int(config[4]), config[5]
        external = gains[0] == EXTERNAL
        looks = external and first == 0 and (last == 0 or last == worlds.shape[0])
        refused = _first_refused(worlds, actions, low - slack, high + slack, ended) if looks else -1
        if refused >= 0:
            return refused
        w = np.empty((SCRATCH_ROWS, LANES))
        width = worlds.shape[2]
        records = telemetry.shape[0] > 0
        for b in range(first, last):
            begin = b * width
            lanes = min(width, obs.shape[0] - begin)
            _gather(w, worlds[b])
            lags_voltage = _count(w, PARAM + VOLTAGE_DECAY, lanes) > 0
            t = 0
            while t < steps and _goes_on(w, lanes, ended):
                if external:
                    _begin_given(w, lanes, actions, begin, low, high)
                else:
                    for i in range(lanes):
                        if w[ALIVE, i] != 0.0:
                            take_command(w, i, law(obs[begin + i], scales[0], gains, memory[begin + i]))
                for k in range(count):
                    _substep(w, width, h, lags_voltage | (k == 0))
                for i in range(width):
                    sense_torques(w, i, h)
                rows = telemetry[t if records else 0 : t + 1 if records else 0]
                _close(
                    w,
                    worlds[b],
                    lanes,
                    begin,
                    words,
                    scales[1],
                    obs,
                    results,
                    rows,
                    final_obs,
                    final_telemetry,
                    h * count,
                    limit,
                    ended,
                )
                t += 1
            _scatter_alive(w, lanes, worlds[b])
        return -1

    return advance


def _build_reset(digest: str) -> Any:
    def reset(worlds: Any, words: Any, chosen: Any, scales: Any, obs: Any, telemetry: Any) -> None:
        _ = digest
        w = np.empty((SCRATCH_ROWS, LANES))
        width = worlds.shape[2]
        for world in range(obs.shape[0]):
            block = worlds[world // width]
            i = world % width
            for row in range(WORLD_ROWS):
                w[row, i] = block[row, i]
            if chosen[world]:
                start_episode(w, i, words[world, 0], words[world, 1])
                _scatter(w, i, block)
            observe_world(w, i, scales[1], obs, world)
            if telemetry.shape[0] > 0:
                record_reset(w, i, telemetry[world])

    return reset


@cache
def advance_kernel(inlined: Any = built_in) -> Any:
    """Return the compiled ``advance`` with a control law inside.

    ``advance(worlds (B, WORLD_ROWS, lanes), words (N, 2), actions (N, 4), gains, memory (N, M), scales (2, O),
    obs (N, O), results (N, 4), telemetry (T, N, K), final_obs, final_telemetry, config, ended, steps, first, last)``
    runs ``steps`` control steps of the worlds in the blocks first … last − 1.

    With ``gains[0] == EXTERNAL`` the voltages come from ``actions``, otherwise from the law. A call for all blocks or
    for none looks at the actions of all worlds first; the number of the first that is refused is returned before
    anything is touched, −1 when all went well. A call for some blocks does not look.
    ``config`` holds low, high and slack of an action, the substep [s], the substeps in a control step, and the time
    limit in control steps. ``ended`` is REFUSE, SKIP, NEXT_STEP or SAME_STEP. T may be 0, for no telemetry;
    ``final_obs`` and ``final_telemetry`` are written with SAME_STEP only.
    """
    return compile_kernel(_build_advance, law=inlined)


@cache
def reset_kernel() -> Any:
    """Return the compiled ``reset``.

    ``reset(worlds, words (N, 2), chosen (N,), scales (2, O), obs (N, O), telemetry (N or 0, K))`` starts new episodes
    of the chosen worlds from their seeds and episode counts, and writes the present observation of all worlds.
    """
    return compile_kernel(_build_reset)
