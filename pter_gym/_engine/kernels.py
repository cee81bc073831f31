"""The block kernel: whole control steps of many worlds on a CPU.

Worlds are stored in blocks of up to ``LANES``, (blocks, rows, lanes). A block is copied into one
scratch array, whose innermost loops over lanes are vectorised, and back; the next one is fetched
from memory meanwhile. Worlds that share constants read them from one place. Lanes without a world
start at zero, with the constants of another one, and run along; nothing reads them.
"""

from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.np import numpy_support
from numpy.typing import NDArray

from pter_gym._compiled.addresses import (
    address_of,
    caller,
    double,
    export,
    flag,
    single,
    unsigned,
    whole,
)
from pter_gym._compiled.compiler import compile_kernel, compiled, entry_of, inlined
from pter_gym._compiled.records import Records, entrywise, load, store
from pter_gym._engine.command import given_volts, is_refused, take_command
from pter_gym._engine.episode import (
    end_step,
    fetch_world,
    put_back,
    record_reset,
    start_episode,
    take_context,
)
from pter_gym._engine.judgement import was_alive
from pter_gym._engine.motion import no_arrangements, take_arrangements
from pter_gym._engine.sensors import observe, write_observation
from pter_gym._engine.step import conclude_step, move_declared, move_worlds
from pter_gym._engine.world import (
    BASIC_ROWS,
    CONFIG,
    CONSTANTS,
    LANES,
    NEXT_STEP,
    REFUSE,
    ROW,
    ROWS,
    STORED_ROWS,
    Arrays,
    Pay,
)
from pter_gym._physics.arm import Vector
from pter_gym._physics.step import Energy, count_nonzero

_WORLDS, _TELEMETRY = types.float64[:, :, ::1], types.float64[:, :, ::1]
_WORDS, _NUMBERS = types.uint64[:, ::1], types.float64[::1]
_OBS, _FLAGS = types.float32[:, ::1], types.boolean[:, ::1]

ADVANCE_TYPES: Any = types.int64(
    _WORLDS,
    _WORDS,
    types.float64[:, ::1],
    _OBS,
    _OBS,
    _NUMBERS,
    _FLAGS,
    _TELEMETRY,
    _NUMBERS,
    _NUMBERS,
    *(types.int64,) * 3,
)
"""Types of the arguments and of the value of ``advance_kernel``."""

RESET_TYPES: Any = types.none(
    _WORLDS, _WORDS, types.boolean[::1], types.boolean, _OBS, _TELEMETRY, _NUMBERS, _NUMBERS
)
"""Types of the arguments of ``reset_kernel``."""

arrange: Any = no_arrangements
"""What the kernel reads of the clutches; for declared ones it is ``take_arrangements``."""


step: Any = None
"""What ``alone`` calls; ``compile_kernel`` binds it."""

_carray: Any = numpy_support.carray


@compiled
def _scratch() -> Any:
    """Return room for a block whose rows begin at cache lines, so eight numbers never take two."""
    room = np.empty((ROWS, LANES + 8))
    return room[:, -room.ctypes.data % 64 // 8 :]


@inlined
def _first_refused(worlds: Records, actions: Records, low: float, high: float, ended: int) -> int:
    """Return the first world whose step is refused, or −1."""
    width = worlds.shape[2]
    for world in range(actions.shape[0]):
        if is_refused(
            worlds[world // width, ROW.alive, world % width], actions, low, high, ended, world
        ):
            return world
    return -1


@inlined
def _gather(w: Records, worlds: Records, b: int) -> None:
    """Read the stored rows of all lanes of a block."""
    for row in range(worlds.shape[1]):
        for i in range(worlds.shape[2]):
            w[row, i] = worlds[b, row, i]


@inlined
def _clear(w: Records, worlds: Records) -> None:
    """Set to zero what is not stored, and what commands set: lanes without a world have none."""
    for row in range(worlds.shape[1], STORED_ROWS):
        for i in range(worlds.shape[2]):
            w[row, i] = 0.0
    for i in range(worlds.shape[2]):
        store(w, ROW.start_velocity, i, Vector(0.0, 0.0))
        store(w, ROW.energy, i, Energy(0.0, 0.0, 0.0, 0.0))


@inlined
def _take_contexts(w: Records, width: int, constants: Any, present: float) -> float:
    """Read the constants of all lanes; those of ``present`` are there.

    Return whose they are, or −1 for several.
    """
    first = w[ROW.context_at, 0]
    others = 0
    for i in range(width):
        others += 1 if w[ROW.context_at, i] != first else 0
    if others > 0:
        many = CONSTANTS.end - CONSTANTS.first
        for i in range(width):
            begin = int(w[ROW.context_at, i])
            own = constants[begin : begin + many]  # so no place is looked at for being negative
            for row in range(many):
                w[CONSTANTS.first + row, i] = own[row]
        return -1.0
    if first != present:
        begin = int(first)
        for row in range(CONSTANTS.first, CONSTANTS.end):
            value = constants[begin + row - CONSTANTS.first]
            for i in range(width):
                w[row, i] = value
    return first


@inlined
def _scatter_alive(w: Records, lanes: int, worlds: Records, b: int) -> None:
    """Write the lanes that are alive back to their block."""
    if count_nonzero(w, ROW.alive, lanes) == lanes:
        for row in range(worlds.shape[1]):
            for i in range(lanes):
                worlds[b, row, i] = w[row, i]
    else:
        for i in range(lanes):
            if w[ROW.alive, i] != 0.0:
                put_back(w, i, worlds, b * worlds.shape[2] + i)


@inlined
def _after_resets(w: Records, lanes: int, present: float) -> float:
    """Return ``present``, or −1 where a lane may have drawn other constants."""
    for i in range(lanes):
        present = present if w[ROW.draws, i] == 1.0 else -1.0
    return present


@inlined
def _begin_given(
    w: Records, lanes: int, actions: Records, begin: int, low: float, high: float
) -> None:
    """Begin a control step with the actions of the worlds from ``begin`` on."""
    for i in range(lanes):
        take_command(
            w, i, given_volts(actions, begin + i, low, high, w[ROW.machine.voltage_max, i])
        )


@entrywise
@inlined
def added(x: float, y: float) -> float:
    """Return a sum."""
    return x + y


@inlined
def _close(
    w: Records, worlds: Records, b: int, lanes: int, a: Arrays, ended: int, k: int, held: int
) -> None:
    """End a control step of a block, and write back the worlds that ended.

    It is step ``k`` of the ``held`` ones of an action, whose reward terms add up. A world that ends
    earlier than the last of them, or begins a new episode, is done: it is written back, and runs
    along in its lane like one that has ended.
    """
    width = worlds.shape[2]
    begin = b * width
    conclude_step(
        w, width, lanes, a.words, begin, a.config, a.constants, worlds.shape[1] > BASIC_ROWS
    )
    for i in range(lanes):
        if k > 0:
            store(w, ROW.terms, i, added(load(w, ROW.terms, i), load(w, ROW.before.terms, i)))
            w[ROW.reward, i] += w[ROW.before.reward, i]
        if held > 1:
            store(w, ROW.before, i, Pay(load(w, ROW.terms, i), w[ROW.reward, i]))
        began = was_alive(w, i)
        over = w[ROW.alive, i] == 0.0 if began else k == 0
        if over or (began and k + 1 == held):
            end_step(w, i, begin + i, a, ended)
        begins = w[ROW.alive, i] != 0.0
        if over and (held > 1 if begins else began):
            put_back(w, i, worlds, begin + i)
            w[ROW.alive, i] = 0.0


def _build_advance(digest: str) -> Any:
    def advance(
        worlds: Records,
        words: NDArray[np.uint64],
        actions: Records,
        obs: Records,
        final_obs: Records,
        rewards: Records,
        flags: Records,
        telemetry: NDArray[np.float64],
        config: Records,
        constants: Records,
        ended: int,
        first: int,
        last: int,
    ) -> int:
        _ = digest
        a = Arrays(words, obs, final_obs, rewards, flags, telemetry, config, constants)
        low, high, slack = config[CONFIG.low], config[CONFIG.high], config[CONFIG.slack]
        held = int(config[CONFIG.frame_skip])
        looks = first == 0 and (last == 0 or last == worlds.shape[0])
        refused = _first_refused(worlds, actions, low - slack, high + slack, ended) if looks else -1
        if refused >= 0:
            return refused
        w = _scratch()
        _clear(w, worlds)
        present = -1.0
        width = worlds.shape[2]
        for b in range(first, last):
            begin = b * width
            lanes = min(width, obs.shape[0] - begin)
            _gather(w, worlds, b)
            present = _take_contexts(w, width, constants, present)
            for k in range(held):
                if ended != NEXT_STEP and count_nonzero(w, ROW.alive, lanes) == 0:
                    break
                _begin_given(w, lanes, actions, begin, low, high)
                arrange(w, width, constants)
                move_worlds(w, width, config, worlds.shape[1] > BASIC_ROWS)
                _close(w, worlds, b, lanes, a, ended, k, held)
            _scatter_alive(w, lanes, worlds, b)
            present = _after_resets(w, lanes, present)
        return -1

    return advance


def _build_alone(digest: str) -> Any:
    def alone(table: int) -> int:
        _ = digest
        at = _carray(whole(table), (10, 4))
        arrays = (
            _carray(double(at[0, 0]), (at[0, 1], at[0, 2], at[0, 3])),
            _carray(unsigned(at[1, 0]), (at[1, 1], at[1, 2])),
            _carray(double(at[2, 0]), (at[2, 1], at[2, 2])),
            _carray(single(at[3, 0]), (at[3, 1], at[3, 2])),
            _carray(single(at[4, 0]), (at[4, 1], at[4, 2])),
            _carray(double(at[5, 0]), (at[5, 1],)),
            _carray(flag(at[6, 0]), (at[6, 1], at[6, 2])),
            _carray(double(at[7, 0]), (at[7, 1], at[7, 2], at[7, 3])),
            _carray(double(at[8, 0]), (at[8, 1],)),
            _carray(double(at[9, 0]), (at[9, 1],)),
        )
        return step((*arrays, np.int64(REFUSE), np.int64(0), np.int64(1)))

    return alone


def _build_reset(digest: str) -> Any:
    def reset(
        worlds: Records,
        words: NDArray[np.uint64],
        chosen: Records,
        all_seen: bool,
        obs: Records,
        telemetry: NDArray[np.float64],
        config: Records,
        constants: Records,
    ) -> None:
        _ = digest
        w = _scratch()  # of the same type as above, for which all functions are compiled already
        for world in range(obs.shape[0]):
            if not (chosen[world] or all_seen):
                continue
            i = world % worlds.shape[2]
            fetch_world(w, i, worlds, world)
            if chosen[world]:
                start_episode(w, i, words[world, 0], words[world, 1], config, constants)
            else:
                take_context(w, i, constants)
            observe(w, i, config, constants)
            if chosen[world]:
                put_back(w, i, worlds, world)
            write_observation(w, i, obs, world, config, constants)
            if telemetry.shape[0] > 0:
                record_reset(w, i, telemetry, 0, world, constants)

    return reset


@cache
def advance_kernel(declared: bool, /) -> Any:
    """Return the compiled ``advance`` for the paper's clutches or ``declared`` others.

    ``advance(worlds, words, actions, obs, final_obs, rewards, flags, telemetry, config, constants,
    ended, first, last)`` runs ``frame_skip`` control steps of the worlds in the blocks from first
    to last − 1 with one action (N, 4). ``worlds`` is (B, BASIC_ROWS or STORED_ROWS, lanes),
    ``ended`` is REFUSE, SKIP, NEXT_STEP or SAME_STEP, and ``Arrays`` describes what is not
    described here.

    A call for all blocks or for none looks at the actions of all worlds first; the number of the
    first that is refused is returned before anything is touched, −1 when all went well. A call for
    some blocks does not look.
    """
    others: dict[str, Any] = (
        {"move_worlds": move_declared, "arrange": take_arrangements} if declared else {}
    )
    return compile_kernel(_build_advance, **others)


@cache
def advance_caller(declared: bool, /) -> Any:
    """Return a compiled function of a tuple of arguments that calls ``advance_kernel``."""
    symbol = f"pter_advance_{'declared' if declared else 'paper'}"
    export(advance_kernel(declared), ADVANCE_TYPES, symbol)
    return caller(ADVANCE_TYPES, symbol)


@cache
def advance_address(declared: bool, /) -> int:
    """Return where ``advance_kernel`` is."""
    return address_of(advance_kernel(declared), ADVANCE_TYPES)


@cache
def alone_kernel(declared: bool, /) -> Any:
    """Return a kernel that makes a step of one world with REFUSE.

    Its argument is the address of a table of the ten arrays of ``advance_kernel``, in its order:
    to look at each of them would take numba as long as the step itself.
    """
    return entry_of(
        compile_kernel(_build_alone, step=advance_caller(declared)), types.int64(types.int64)
    )


@cache
def reset_kernel() -> Any:
    """Return the compiled ``reset``.

    ``reset(worlds, words, chosen, all_seen, obs, telemetry, config, constants)`` starts new
    episodes of the worlds in ``chosen``, (N,), from their seeds and episode counts, and writes the
    present observation of these or of all worlds; see ``Arrays``.
    """
    return compile_kernel(_build_reset)
