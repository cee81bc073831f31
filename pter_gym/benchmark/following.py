"""Many control steps in one call: a compiled law and the worlds in turn.

The law's kernel and the worlds' are called by their addresses, so this kernel serves every law.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.addresses import caller_at
from pter_gym._compiled.compiler import compile_kernel
from pter_gym._engine.batch import Batch
from pter_gym._engine.kernels import ADVANCE_TYPES
from pter_gym._engine.world import FLAG, FLAGS, SKIP
from pter_gym.controllers._law_kernel import LAW_TYPES
from pter_gym.controllers._policy import CompiledLaw
from pter_gym.params import SLOTS
from pter_gym.tasks.path_following import TELEMETRY

Array = NDArray[np.float64]
Observations = NDArray[np.float32]

TERMINATED, TRUNCATED = int(FLAG.terminated), int(FLAG.truncated)

_act, _advance = caller_at(LAW_TYPES), caller_at(ADVANCE_TYPES)


class Followed(NamedTuple):
    """What T control steps of a policy return, except rewards.

    Attributes
    ----------
    obs
        Observations, float32 (T, N, len(layout)); zero after the end of an episode.
    telemetry
        float64 (T, N, len(TELEMETRY)); NaN after it.
    left
        Control steps left to each episode, (N,); 0 once it has ended.
    """

    obs: Observations
    telemetry: Array
    left: NDArray[np.int64]


def follow(
    law: CompiledLaw,
    batch: Batch,
    obs: Observations,
    memory: Array,
    age: int,
    left: NDArray[np.int64],
    skip: int,
    steps: int,
) -> Followed:
    """Let a law act for some control steps, as ``Batch.step`` with ``SKIP`` does for each.

    It returns earlier if no episode has a control step left.

    Parameters
    ----------
    law, batch
        The law, which sees the first entries of the observations, and the worlds, with a
        ``frame_skip`` of 1.
    obs
        Latest observations, float32 (N, len(layout)).
    memory
        What the law remembers of each world, (N, M), which it changes.
    age
        Control steps since the episodes began.
    left
        Control steps left to each episode, (N,), up to its time limit; 0 if it has ended.
    skip
        Control steps for which the law's voltages are held.
    steps
        Control steps, ≥ 1.

    Raises
    ------
    ActionError
        If it gives a voltage that is not finite.
    """
    arrays, left = batch.kernel_arrays(), left.copy()
    seen = np.empty((steps + 1, *obs.shape), np.float32)
    telemetry = np.empty((steps, len(obs), len(TELEMETRY)))
    seen[0] = obs
    with law.faults(memory):
        made, refused = follow_kernel()(
            law.address,
            batch.address,
            skip,
            age,
            law.scales,
            law.gains,
            memory,
            law.clutches,
            law.voltage_max,
            arrays["worlds"],
            arrays["words"],
            arrays["slots"],
            seen,
            telemetry,
            arrays["config"],
            arrays["constants"],
            left,
        )
    if refused >= 0:
        batch.raise_refusal(refused)
    return Followed(seen[1 : made + 1], telemetry[:made], left)


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
