"""Many control steps in one call: a compiled law and the worlds in turn.

The law's kernel and the worlds' are called by their addresses, so this kernel serves every law.
"""

from functools import cache
from typing import Any

import numpy as np
from numba import types

from pter_gym._compiled.addresses import address_of, caller_at
from pter_gym._compiled.compiler import compile_kernel
from pter_gym._engine.kernels import ADVANCE_TYPES, advance_kernel
from pter_gym._engine.world import FLAG, FLAGS, SKIP
from pter_gym.params import SLOTS

TERMINATED, TRUNCATED = int(FLAG.terminated), int(FLAG.truncated)

_NUMBERS, _ROWS = types.float64[::1], types.float64[:, ::1]

LAW_TYPES: Any = types.none(
    types.float32[:, ::1], _NUMBERS, _NUMBERS, _ROWS, types.float64, types.float64, _ROWS
)
"""Types of a law's kernel: observations, scales, gains, memory, released, top and volts."""

_act, _advance = caller_at(LAW_TYPES), caller_at(ADVANCE_TYPES)


@cache
def advance_address(declared: bool, /) -> int:
    """Return where ``advance_kernel`` is."""
    return address_of(advance_kernel(declared), ADVANCE_TYPES)


def _build_follow(digest: str) -> Any:
    def follow(
        act: int,
        advance: int,
        skip: int,
        age: int,
        scales: Any,
        gains: Any,
        memory: Any,
        clutches: int,
        top: float,
        worlds: Any,
        words: Any,
        slots: Any,
        obs: Any,
        telemetry: Any,
        config: Any,
        constants: Any,
        left: Any,
    ) -> tuple[int, int]:
        _ = digest
        many, entries = len(left), len(scales)
        seen, none = np.empty((many, entries), np.float32), np.empty((0, entries), np.float32)
        volts, rewards = np.empty((many, SLOTS)), np.empty(many)
        flags = np.empty((FLAGS, many), np.bool_)
        ended, first, last = np.int64(SKIP), np.int64(0), np.int64(len(worlds))
        for t in range(len(telemetry)):
            if (age + t) % skip == 0:
                seen[:, :] = obs[t, :, :entries]
                _act(act, (seen, scales, gains, memory, 0.0, top, volts))
                slots[:, :clutches] = volts[:, :clutches]
            obs[t + 1], flags[:], telemetry[t] = 0.0, False, np.nan
            now, here = obs[t + 1], telemetry[t : t + 1]
            arrays = (worlds, words, slots, now, none, rewards, flags, here, config, constants)
            refused = _advance(advance, (*arrays, ended, first, last))
            if refused >= 0:
                return t, refused
            running = 0
            for i in range(many):
                ends = flags[TERMINATED, i] | flags[TRUNCATED, i]
                left[i] = 0 if ends or left[i] == 0 else left[i] - 1
                running += 1 if left[i] > 0 else 0
            if running == 0:
                return t + 1, -1
        return len(telemetry), -1

    return follow


@cache
def follow_kernel() -> Any:
    """Return the compiled ``follow``, in which a law acts in worlds for up to T control steps.

    ``follow(act, advance, skip, age, scales, gains, memory, clutches, top, worlds, words, slots,
    obs, telemetry, config, constants, left)`` calls the law's kernel, of ``LAW_TYPES``, at the
    address ``act`` in each ``skip``-th control step of an episode, whose ``age`` is the first
    one's, and ``advance_kernel`` at ``advance`` with SKIP. ``obs``, (T + 1, N, O), begins with the
    latest ones, and ``telemetry`` is (T, N, K). ``left``, (N,), are the control steps up to the
    time limit of each episode, 0 once it has ended; when all are 0, it returns. ``Arrays``
    describes the rest.

    Returned are the control steps made, and the first world whose voltages are refused, or −1.
    """
    return compile_kernel(_build_follow)
