"""The kernels for a CUDA device: the same scalar functions as on a CPU, one thread for each world."""

from typing import Any

import numpy as np
from numba import cuda as numba_cuda

from pter_gym._engine.episode import (
    conclude_step,
    end_step,
    fetch_world,
    has_begun,
    put_back,
    start_episode,
    take_context,
)
from pter_gym._engine.sensing import see, write_observation
from pter_gym._engine.step import given_volts, is_refused, move_worlds, take_command
from pter_gym._engine.world import BASIC_ROWS, CONFIG, ROW, ROWS, Arrays

cuda: Any = numba_cuda

THREADS = 128
"""Threads in a block of the device."""

_ONE = np.uint64(1)


@cuda.jit
def advance(
    worlds: Any,
    words: Any,
    actions: Any,
    obs: Any,
    final_obs: Any,
    rewards: Any,
    flags: Any,
    telemetry: Any,
    config: Any,
    constants: Any,
    ended: int,
    refused: Any,
) -> None:
    """Hold an action of all worlds; the arguments are those of ``pter_gym._engine.kernels.advance_kernel``.

    The number of the first world whose step is refused goes to ``refused``; that world stays where it is.
    """
    world = cuda.grid(1)
    if world >= obs.shape[0]:
        return
    a = Arrays(words, obs, final_obs, rewards, flags, telemetry, config, constants)
    low, high, slack = config[CONFIG.low], config[CONFIG.high], config[CONFIG.slack]
    w = cuda.local.array((ROWS, 1), np.float64)
    fetch_world(w, 0, worlds, world)
    if is_refused(w[ROW.alive, 0], actions, low - slack, high + slack, ended, world):
        cuda.atomic.min(refused, 0, world)
        rewards[world] = np.nan
        return
    take_context(w, 0, constants)
    with_extras = worlds.shape[1] > BASIC_ROWS
    earned = 0.0
    for _ in range(int(config[CONFIG.frame_skip])):
        if w[ROW.alive, 0] != 0.0:
            take_command(w, 0, given_volts(actions, world, low, high, w[ROW.machine.voltage_max, 0]))
            move_worlds(w, 1, config, with_extras)
        conclude_step(w, 1, 1, words, world, config, constants, with_extras)
        earned += w[ROW.reward, 0]
        if w[ROW.alive, 0] == 0.0:
            break
    rode = has_begun(w, 0)
    end_step(w, 0, world, a, 0, ended)
    if rode:
        rewards[world] = earned
    put_back(w, 0, worlds, world)


@cuda.jit
def reset(worlds: Any, words: Any, chosen: Any, seeded: Any, obs: Any, config: Any, constants: Any) -> None:
    """Start new episodes of the chosen worlds, those that are not ``seeded`` the next of their seed; observe all."""
    world = cuda.grid(1)
    if world >= obs.shape[0]:
        return
    w = cuda.local.array((ROWS, 1), np.float64)
    fetch_world(w, 0, worlds, world)
    take_context(w, 0, constants)
    if chosen[world]:
        if not seeded[world]:
            words[world, 1] += _ONE
        start_episode(w, 0, words[world, 0], words[world, 1], config, constants)
        put_back(w, 0, worlds, world)
    see(w, 0, config, constants)
    write_observation(w, 0, obs, world, config, constants)
