"""A trained network as a law: its inputs, its layers, and the voltages.

Sizes and weights are entries of the gains, so one compiled law runs every network. In this order:
``Network``; the gains of the base controller, if any; for each input its source, its center and its
scale; the delays; the weights of the present in the averages; the sizes of the layers, from the
inputs on; and for each layer its biases, then its weights, input by input.

The memory of a world is ``Memory`` of the base controller's law, ``InputHistory``, a ring of recent
inputs, the averages and two vectors of ``width`` entries for the layers.
"""

from functools import cache
from typing import Annotated, Any, NamedTuple

from pter_gym._compiled.compiler import inlined, outlined
from pter_gym._compiled.records import Entry, entrywise, read, rows, width
from pter_gym._physics.arm import UnitVector, Vector, components
from pter_gym._physics.clutch import PerClutch
from pter_gym._physics.scalars import clamp
from pter_gym.controllers._gains import Entries, Memory
from pter_gym.controllers._laws import Law
from pter_gym.tasks.path_following._actions import volts_of
from pter_gym.tasks.path_following._observation import OBS

INPUT_LIMIT = 10.0
"""Inputs of a network are limited to ±INPUT_LIMIT of their scales."""

DERIVED = ("heading_a_cos", "heading_a_sin", "heading_b_cos", "heading_b_sin")
"""Inputs derived from the observation: cosine and sine of the angle from a link to the path."""

BASE_INPUTS = ("base_1", "base_2", "base_3", "base_4")
"""Inputs that are the voltages of the base controller [V]."""

LANES, FEWEST = 64, 8
"""Most worlds in which a network runs at once, and the fewest for which this is faster."""

TANH_MAX = 20.0
"""Beyond this, tanh is ±1 in float64."""


class Network(NamedTuple):
    """Sizes of a network, and what its outputs mean."""

    base: Annotated[float, Entry("1", "entries of the base controller's gains, 0 without one")]
    inputs: Annotated[float, Entry("1", "inputs at one instant")]
    delays: Annotated[float, Entry("1", "earlier instants whose inputs it sees")]
    averages: Annotated[float, Entry("1", "averages of each input that it sees")]
    ring: Annotated[float, Entry("1", "instants that are remembered")]
    layers: Annotated[float, Entry("1", "layers")]
    width: Annotated[float, Entry("1", "entries of the largest layer, inputs included")]
    normalised: Annotated[
        float, Entry("1", "whether the outputs are the environments' normalised actions")
    ]
    reach: Annotated[float, Entry("V", "voltage of an output of 1")]
    voltage_max: Annotated[float, Entry("V", "largest voltage")]


class InputHistory(NamedTuple):
    """The state of a network other than its vectors."""

    begun: Annotated[float, Entry("1", "whether the episode has begun")]
    newest: Annotated[float, Entry("1", "instant of the ring that was written last")]


HEADER = rows(Network)
HEADER_WIDTH = width(Network)
LAW_WIDTH = width(Memory)
PAST = rows(InputHistory, LAW_WIDTH)
VECTORS = LAW_WIDTH + width(InputHistory)
"""Where the vectors of the memory begin."""


def source_of(name: str, names: tuple[str, ...]) -> float:
    """Return an input's source: the place of an observation's entry, or −1 … −8."""
    return float(names.index(name) if name in names else -1 - (*DERIVED, *BASE_INPUTS).index(name))


def memory_width(network: Network) -> int:
    """Return how many numbers the law remembers of each world."""
    vectors = network.inputs * (network.ring + network.averages) + 2 * network.width
    return VECTORS + int(vectors)


@inlined
def tanh(x: float) -> float:
    """Return tanh x to 1e-13, from arithmetic alone, whose bits are those of any computer.

    With e = exp(−2|x|), which is the 64th power of a Taylor series for exp(−|x|/32),
    tanh |x| = (1 − e)/(1 + e).
    """
    z = (abs(x) if abs(x) < TANH_MAX else TANH_MAX) / -32.0
    e = 1.0
    for k in range(14, 0, -1):
        e = 1.0 + z * (1.0 / k) * e
    for _ in range(6):
        e *= e
    size = (1.0 - e) / (1.0 + e)
    return size if x >= 0.0 else -size


@inlined
def input_value(obs: Entries, scales: Entries, base: PerClutch, source: int) -> float:
    """Return an input of a network in its unit, from its number; see ``source_of``."""
    if source >= 0:
        return obs[source] * scales[source]
    if source <= -5:
        return max(base[-5 - source], 0.0)
    of_b = source <= -3
    cos, sin = float(obs[OBS.heading.cos]), float(obs[OBS.heading.sin])
    cos_link = float(obs[OBS.cos_b] if of_b else obs[OBS.cos_a])
    sin_link = float(obs[OBS.sin_b] if of_b else obs[OBS.sin_a])
    is_cos = (source == -1) | (source == -3)
    along, across = components(Vector(cos, sin), UnitVector(cos_link, sin_link))
    return along if is_cos else across


@inlined
def add_four(out: Entries, table: Entries, k: int, a: float, b: float, c: float, d: float) -> None:
    """Add rows k to k + 3 of a table, times a, b, c and d, in turn; four at once save stores."""
    n = len(out)
    first, second = table[k * n : (k + 1) * n], table[(k + 1) * n : (k + 2) * n]
    third, fourth = table[(k + 2) * n : (k + 3) * n], table[(k + 3) * n : (k + 4) * n]
    for j in range(n):
        out[j] = (((out[j] + first[j] * a) + second[j] * b) + third[j] * c) + fourth[j] * d


@inlined
def add_one(out: Entries, table: Entries, k: int, number: float) -> None:
    """Add row k of a table, times a number."""
    n = len(out)
    row = table[k * n : (k + 1) * n]
    for j in range(n):
        out[j] += row[j] * number


@inlined
def look_back(
    net: Network, gains: Entries, recent: Entries, means: Entries, values: Entries, newest: int
) -> None:
    """Append earlier inputs and averages to the present inputs of a network.

    ``newest`` is where the ring ``recent`` keeps the present ones, or −1 where an episode begins.
    """
    inputs, delays, ring = int(net.inputs), int(net.delays), int(net.ring)
    ages = HEADER_WIDTH + int(net.base) + 3 * inputs
    for k in range(ring):
        if newest < 0 or k == newest:
            for i in range(inputs):
                recent[k * inputs + i] = values[i]
    for k in range(delays):
        at = 0 if newest < 0 else (newest + ring - int(gains[ages + k])) % ring * inputs
        for i in range(inputs):
            values[(1 + k) * inputs + i] = recent[at + i]
    for k in range(int(net.averages)):
        share = gains[ages + delays + k]
        for i in range(inputs):
            mean = means[k * inputs + i]
            mean = values[i] if newest < 0 else mean + share * (values[i] - mean)
            means[k * inputs + i] = mean
            values[(1 + delays + k) * inputs + i] = mean


@inlined
def take_inputs(
    net: Network,
    obs: Entries,
    scales: Entries,
    gains: Entries,
    memory: Entries,
    base: PerClutch,
    values: Entries,
) -> None:
    """Write what a network sees in a world: its present inputs, earlier ones and averages."""
    inputs, ring = int(net.inputs), int(net.ring)
    table, oldest = HEADER_WIDTH + int(net.base), VECTORS + inputs * ring
    for i in range(inputs):
        value = input_value(obs, scales, base, int(gains[table + i]))
        value = (value - gains[table + inputs + i]) / gains[table + 2 * inputs + i]
        values[i] = clamp(value, -INPUT_LIMIT, INPUT_LIMIT)
    begins = memory[PAST.begun] == 0.0
    newest = 0 if begins else (int(memory[PAST.newest]) + 1) % ring
    memory[PAST.begun], memory[PAST.newest] = 1.0, newest
    recent = memory[VECTORS:oldest]
    means = memory[oldest : oldest + inputs * int(net.averages)]
    look_back(net, gains, recent, means, values, -1 if begins else newest)


@inlined
def sizes_at(net: Network) -> int:
    """Return where the sizes of a network's layers are."""
    return HEADER_WIDTH + int(net.base) + 3 * int(net.inputs) + int(net.delays + net.averages)


@outlined
def decide(
    obs: Entries, scales: Entries, gains: Entries, memory: Entries, base: PerClutch
) -> PerClutch:
    """Return a network's voltages [V]; ``base`` are those that it corrects."""
    net = read(gains, HEADER, 0)
    first = VECTORS + int(net.inputs) * int(net.ring + net.averages)
    wide = int(net.width)
    take_inputs(net, obs, scales, gains, memory, base, memory[first : first + wide])

    sizes, layers = sizes_at(net), int(net.layers)
    at = sizes + layers + 1
    here = 0
    for layer in range(layers):
        count, n = int(gains[sizes + layer]), int(gains[sizes + layer + 1])
        values = memory[first + here * wide : first + here * wide + count]
        here = 1 - here
        out = memory[first + here * wide : first + here * wide + n]
        for j in range(n):
            out[j] = gains[at + j]
        weights = gains[at + n : at + n + n * count]
        for k in range(0, count - 3, 4):
            add_four(out, weights, k, values[k], values[k + 1], values[k + 2], values[k + 3])
        for k in range(count - count % 4, count):
            add_one(out, weights, k, values[k])
        at += n + n * count
        if layer < layers - 1:
            for j in range(n):
                out[j] = tanh(out[j])
    out = memory[first + here * wide : first + here * wide + 4]
    return voltage(net, PerClutch(out[0], out[1], out[2], out[3]), base)


@inlined
def run_layers(net: Network, gains: Entries, room: Any) -> int:
    """Run a network in several worlds at once, and return the first row of its outputs.

    ``room``, (2·width, worlds), begins with what the network sees in each. Sums have the order of
    those of ``decide``, and so the same bits.
    """
    sizes, layers, wide = sizes_at(net), int(net.layers), int(net.width)
    at = sizes + layers + 1
    here = 0
    for layer in range(layers):
        count, n = int(gains[sizes + layer]), int(gains[sizes + layer + 1])
        values = room[here * wide : here * wide + count].reshape(-1)
        here = 1 - here
        lanes, weights = room.shape[1], gains[at + n : at + n + n * count]
        for j in range(n):
            room[here * wide + j] = gains[at + j]
        for k in range(0, count - 3, 4):
            for j in range(n):
                a, b = weights[k * n + j], weights[(k + 1) * n + j]
                c, d = weights[(k + 2) * n + j], weights[(k + 3) * n + j]
                add_four(room[here * wide + j], values, k, a, b, c, d)
        for k in range(count - count % 4, count):
            for j in range(n):
                add_one(room[here * wide + j], values, k, weights[k * n + j])
        if layer < layers - 1:
            for j in range(n):
                for i in range(lanes):
                    room[here * wide + j, i] = tanh(room[here * wide + j, i])
        at += n + n * count
    return here * wide


@entrywise
@inlined
def voltage(net: Network, output: float, base: float) -> float:
    """Return the voltage [V] of an output, which is limited to ±1."""
    limited = clamp(output, -1.0, 1.0)
    if net.normalised != 0.0:
        return volts_of(limited, -1.0, 1.0, net.voltage_max)
    return clamp(base + net.reach * limited, 0.0, net.voltage_max)


@inlined
def middle(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:  # noqa: ARG001
    """Return the voltages [V] that a network corrects without a base: the middle of the range."""
    half = 0.5 * gains[HEADER.voltage_max]
    return PerClutch(half, half, half, half)


CORRECTED: dict[Law, Law] = {}
"""For each law that is a network, the law whose voltages it corrects."""


@cache
def network_on(law: Law | None) -> Law:
    """Return the law of a trained network, which may correct another law."""
    base = middle if law is None else _law_within(law)

    @outlined
    def network(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
        """Return the voltages of a trained network."""
        return decide(obs, scales, gains, memory, base(obs, scales, gains, memory))

    CORRECTED[network] = base
    return network


def _law_within(law: Law) -> Law:
    """Return a law whose gains follow the header of a network's."""

    @inlined
    def base(obs: Entries, scales: Entries, gains: Entries, memory: Entries) -> PerClutch:
        """Return the voltages of the law that a network corrects."""
        own = gains[HEADER_WIDTH : HEADER_WIDTH + int(gains[HEADER.base])]
        return law(obs, scales, own, memory)

    return base
