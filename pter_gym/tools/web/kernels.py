"""The kernels of the WebAssembly module: one world in a page's memory, moved by the functions that
move all worlds.

They get addresses; ``pter_gym.tools.web.tables`` says what is there. After a change here, or in a
function that they call, run ``python docs/make/web_module.py``, which compiles them (it needs
PyPI's ``ziglang``), and commit ``pter_gym/tools/web/static``.
"""

from typing import Any, NamedTuple

from numba import types
from numba.np import numpy_support

from pter_gym._compiled.records import store, write
from pter_gym._engine.episode import record_reset, record_step, start_episode
from pter_gym._engine.step import (
    conclude_step,
    given_volts,
    is_refused,
    move_declared,
    move_worlds,
    observe,
    recorded,
    take_arrangements,
    take_command,
    write_observation,
)
from pter_gym._engine.world import CONFIG, REFUSE, ROW, ROWS
from pter_gym._physics.clutch import lag_left
from pter_gym.controllers._gains import IMPEDANCE
from pter_gym.controllers._laws import built_in, built_in_declared
from pter_gym.paths._arcs import (
    SEGMENT,
    ArcSegment,
    biarc,
    end_of,
    heading_through,
    mirrored,
    parts_of,
)
from pter_gym.paths._projection import SEGMENT_WIDTH, point_at
from pter_gym.tasks.path_following._telemetry import COLUMNS

carray: Any = numpy_support.carray

NUMBERS: Any = types.CPointer(types.float64)
SINGLES: Any = types.CPointer(types.float32)
WORDS: Any = types.CPointer(types.uint64)
COUNT: Any = types.int32
NUMBER: Any = types.float64


MAX_ARCS = 10
"""Most arcs between two points of a smooth curve: a pair, each of which turns less than 2π and is cut into five."""


class ModuleKernel(NamedTuple):
    """A kernel, the types of its arguments and that of its value."""

    function: Any
    arguments: tuple[Any, ...]
    value: Any = types.int32


def reset(
    world: Any, words: Any, seen: Any, entries: int, told: Any, shared: Any, constants: Any
) -> int:
    """Start an episode from its seed and number, the two ``words``, and write observation and telemetry."""
    w, word = carray(world, (ROWS, 1)), carray(words, 2)
    config, numbers = carray(shared, 1), carray(constants, 1)
    start_episode(w, 0, word[0], word[1], config, numbers)
    take_arrangements(w, 1, numbers)
    observe(w, 0, config, numbers)
    write_observation(w, 0, carray(seen, (1, entries)), 0, config, numbers)
    record_reset(w, 0, carray(told, (1, 1, COLUMNS)), 0, 0, numbers)
    return 0


def step(
    world: Any,
    words: Any,
    seen: Any,
    entries: int,
    told: Any,
    shared: Any,
    constants: Any,
    action: Any,
    guides: int,
) -> int:
    """Run a control step and write observation and telemetry; return 1 if it is refused and nothing
    has moved.

    A page may have written to the hand's recording since the last control step. ``guides`` says
    that the hand may have more than a push and sines.
    """
    w, word = carray(world, (ROWS, 1)), carray(words, (1, 2))
    config, numbers = carray(shared, 1), carray(constants, 1)
    actions = carray(action, (1, 4))
    low, high, slack = config[CONFIG.low], config[CONFIG.high], config[CONFIG.slack]
    if is_refused(w[ROW.alive, 0], actions, low - slack, high + slack, REFUSE, 0):
        return 1
    if w[ROW.hand.record_count, 0] > 0.0:
        store(w, ROW.drive, 0, recorded(w, 0, numbers, config[CONFIG.substeps]))
    take_command(w, 0, given_volts(actions, 0, low, high, w[ROW.machine.voltage_max, 0]))
    if w[ROW.arrangement.number, 0] == 0.0:
        move_worlds(w, 1, config, guides != 0)
    else:
        move_declared(w, 1, config, guides != 0)
    conclude_step(w, 1, 1, word, 0, config, numbers, True)
    write_observation(w, 0, carray(seen, (1, entries)), 0, config, numbers)
    record_step(
        w,
        0,
        carray(told, (1, 1, COLUMNS)),
        0,
        0,
        config[CONFIG.substep] * config[CONFIG.substeps],
        numbers,
    )
    return 0


def act(
    seen: Any,
    entries: int,
    scales: Any,
    gains: Any,
    count: int,
    memory: Any,
    kept: int,
    volts: Any,
    declared: int,
) -> int:
    """Write the voltages of a built-in law, a trained network among them, which keeps ``kept``
    numbers in ``memory``.

    ``declared`` says that it is told of other clutches than the paper's.
    """
    out = carray(volts, 4)
    obs, past = carray(seen, entries), carray(memory, kept)
    scale, gain = carray(scales, entries), carray(gains, count)
    guides = (declared != 0) & (gain[0] >= IMPEDANCE)
    wanted = (
        built_in_declared(obs, scale, gain, past) if guides else built_in(obs, scale, gain, past)
    )
    out[0], out[1], out[2], out[3] = wanted.x1, wanted.x2, wanted.x3, wanted.x4
    return 0


def locate(constants: Any, first: int, arcs: int, arc_length: float, point: Any) -> int:
    """Write the point (x, y) of a path at an arc length [m]."""
    out = carray(point, 2)
    out[0], out[1] = point_at(carray(constants, 1), first, arcs, arc_length)
    return 0


def join(points: Any, count: int, table: Any) -> int:
    """Write the arcs of a smooth curve through points (count, 2), and return their number.

    There is room for ``MAX_ARCS`` of them for each point. No point is where the one before it is.
    """
    given, arcs = carray(points, (count, 2)), carray(table, MAX_ARCS * SEGMENT_WIDTH * count)
    heading, start, rows = 1.0 + 0.0j, 0.0, 0
    for k in range(1, count):
        before, here = complex(given[k - 1, 0], given[k - 1, 1]), complex(given[k, 0], given[k, 1])
        ends = k == count - 1
        after = here if ends else complex(given[k + 1, 0], given[k + 1, 1])
        if k == 1:
            heading = (here - before) / abs(here - before)
            heading = (
                heading if ends else mirrored(heading_through(before, here, after), here - before)
            )
        following = (
            mirrored(heading, here - before) if ends else heading_through(before, here, after)
        )
        for piece in biarc(before, heading, here, following):
            point, direction, curvature, length = piece
            parts = parts_of(curvature, length)
            step = length / parts
            for _ in range(parts):
                arc = ArcSegment(
                    point.real, point.imag, direction.real, direction.imag, curvature, start, step
                )
                write(arcs[rows * SEGMENT_WIDTH : (rows + 1) * SEGMENT_WIDTH], SEGMENT, arc)
                point, direction = end_of(point, direction, curvature, step)
                start += step
                rows += 1
        heading = following
    return rows


def decay(time: float, time_constant: float) -> float:
    """Return the part of a clutch's lag that a time [s] leaves."""
    return lag_left(time, time_constant)


ONE_WORLD = (NUMBERS, WORDS, SINGLES, COUNT, NUMBERS, NUMBERS, NUMBERS)

KERNELS = (
    ModuleKernel(reset, ONE_WORLD),
    ModuleKernel(step, (*ONE_WORLD, NUMBERS, COUNT)),
    ModuleKernel(act, (SINGLES, COUNT, NUMBERS, NUMBERS, COUNT, NUMBERS, COUNT, NUMBERS, COUNT)),
    ModuleKernel(locate, (NUMBERS, COUNT, COUNT, NUMBER, NUMBERS)),
    ModuleKernel(join, (NUMBERS, COUNT, NUMBERS)),
    ModuleKernel(decay, (NUMBER, NUMBER), NUMBER),
)
