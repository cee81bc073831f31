# pyright: standard
"""The kernels of the WebAssembly module, which step one world in a page's memory.

Their arguments are addresses; ``pter_gym.tools.web.tables`` describes what is there. After a change
here or in a function that they call, compile them with ``python docs/make/web_module.py`` (it needs
PyPI's ``ziglang``), and commit ``pter_gym/tools/web/static``.
"""

from ctypes import _Pointer as Address
from typing import Any

from numba import types
from numba.np import numpy_support

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import store
from pter_gym._engine.command import given_volts, is_refused, take_command
from pter_gym._engine.episode import record_reset, record_step, start_episode
from pter_gym._engine.hand import recorded
from pter_gym._engine.motion import take_arrangements
from pter_gym._engine.sensors import observe, write_observation
from pter_gym._engine.step import conclude_step, move_worlds
from pter_gym._engine.world import CONFIG, REFUSE, ROW, ROWS
from pter_gym.controllers import CONTROLLERS, Guided, SingleDof
from pter_gym.controllers._gains import RELEASED
from pter_gym.controllers._guided import law_of
from pter_gym.controllers._network import network_on
from pter_gym.controllers._simple import constant, drawn
from pter_gym.params import BASELINE
from pter_gym.paths._projection import point_at
from pter_gym.tasks.path_following._telemetry import COLUMNS

carray: Any = numpy_support.carray

_kinds = [kind for kind in CONTROLLERS.values() if issubclass(kind, Guided)]
GUIDING = dict.fromkeys(law_of(kind(), BASELINE) for kind in _kinds)

LAWS = (constant, drawn, *GUIDING, network_on(None), network_on(law_of(SingleDof(), BASELINE)))
"""The laws of the module, in the order of their numbers."""

NUMBERS = types.CPointer(types.float64)
SINGLES = types.CPointer(types.float32)
WORDS = types.CPointer(types.uint64)
COUNT = types.int32
NUMBER = types.float64


def reset(
    world: Address,
    words: Address,
    observation: Address,
    entries: int,
    telemetry: Address,
    config: Address,
    constants: Address,
) -> int:
    """Start the episode of a seed and an episode number, the two ``words``."""
    w, word = carray(world, (ROWS, 1)), carray(words, 2)
    settings, numbers = carray(config, 1), carray(constants, 1)
    start_episode(w, 0, word[0], word[1], settings, numbers)
    take_arrangements(w, 1, numbers)
    observe(w, 0, settings, numbers)
    write_observation(w, 0, carray(observation, (1, entries)), 0, settings, numbers)
    record_reset(w, 0, carray(telemetry, (1, 1, COLUMNS)), 0, 0, numbers)
    return 0


def step(
    world: Address,
    words: Address,
    observation: Address,
    entries: int,
    telemetry: Address,
    config: Address,
    constants: Address,
    action: Address,
    guides: int,
) -> int:
    """Run a control step; return 1 if the action is refused and nothing has moved.

    A page may have written to the hand's recording since the last control step. ``guides`` says
    that the hand may have more than a push and sines.
    """
    w, word = carray(world, (ROWS, 1)), carray(words, (1, 2))
    settings, numbers = carray(config, 1), carray(constants, 1)
    actions = carray(action, (1, 4))
    low, high, slack = settings[CONFIG.low], settings[CONFIG.high], settings[CONFIG.slack]
    if is_refused(w[ROW.alive, 0], actions, low - slack, high + slack, REFUSE, 0):
        return 1
    substeps = settings[CONFIG.substeps]
    if w[ROW.hand.record_count, 0] > 0.0:
        store(w, ROW.drive, 0, recorded(w, 0, numbers, substeps))
    take_command(w, 0, given_volts(actions, 0, low, high, w[ROW.machine.voltage_max, 0]))
    move_worlds(w, 1, settings, guides != 0)
    conclude_step(w, 1, 1, word, 0, settings, numbers, True)
    write_observation(w, 0, carray(observation, (1, entries)), 0, settings, numbers)
    period = settings[CONFIG.substep] * substeps
    record_step(w, 0, carray(telemetry, (1, 1, COLUMNS)), 0, 0, period, numbers)
    return 0


def _by_number(laws: tuple[Any, ...]) -> Any:
    """Return a compiled function that runs one of several laws."""
    (law, *_), rest = laws, laws[1:]
    others: Any = _by_number(rest) if rest else None

    @inlined
    def last(number: int, obs: Any, scales: Any, gains: Any, memory: Any) -> Any:  # noqa: ARG001
        return law(obs, scales, gains, memory)

    @inlined
    def chosen(number: int, obs: Any, scales: Any, gains: Any, memory: Any) -> Any:
        if number == 0:
            return law(obs, scales, gains, memory)
        return others(number - 1, obs, scales, gains, memory)

    return chosen if rest else last


act_by_number = _by_number(LAWS)


@inlined
def unreleased(volts: float) -> float:
    """Return a voltage [V], 0 for a clutch that the law releases."""
    return volts if volts > RELEASED else 0.0


def act(
    observation: Address,
    entries: int,
    scales: Address,
    gains: Address,
    count: int,
    memory: Address,
    kept: int,
    volts: Address,
) -> int:
    """Write the voltages of a law; ``kept`` sizes its memory.

    Its number among ``LAWS`` comes before its gains.
    """
    out = carray(volts, 4)
    obs, past = carray(observation, entries), carray(memory, kept)
    numbers = carray(gains, count)
    chosen = act_by_number(int(numbers[0]), obs, carray(scales, entries), numbers[1:], past)
    out[0], out[1] = unreleased(chosen.x1), unreleased(chosen.x2)
    out[2], out[3] = unreleased(chosen.x3), unreleased(chosen.x4)
    return 0


def locate(constants: Address, first: int, arcs: int, arc_length: float, point: Address) -> int:
    """Write the point (x, y) of a path at an arc length [m]."""
    out = carray(point, 2)
    out[0], out[1] = point_at(carray(constants, 1), first, arcs, arc_length)
    return 0


ONE_WORLD = (NUMBERS, WORDS, SINGLES, COUNT, NUMBERS, NUMBERS, NUMBERS)

KERNELS = {
    reset: ONE_WORLD,
    step: (*ONE_WORLD, NUMBERS, COUNT),
    act: (SINGLES, COUNT, NUMBERS, NUMBERS, COUNT, NUMBERS, COUNT, NUMBERS),
    locate: (NUMBERS, COUNT, COUNT, NUMBER, NUMBERS),
}
"""The module's functions and the types of their arguments; each returns an int32."""
