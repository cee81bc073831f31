"""How a rate is measured: calls that advance a known number of steps, in blocks, alone or two in turn."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Load:
    """Something to time.

    Attributes
    ----------
    call
        Advances by ``steps`` steps.
    steps
        Steps of one call, over all worlds.
    close
        Ends it.
    """

    call: Callable[[], object]
    steps: int
    close: Callable[[], object]


@dataclass(frozen=True)
class Effort:
    """How long a rate is measured: ``rounds`` blocks of at least ``seconds`` [s] and one call each."""

    seconds: float
    rounds: int


@dataclass(frozen=True)
class Comparison:
    """Median rates [1/s] of two loads that were measured block by block in turn, and the median of their ratios."""

    rate: float
    peer_rate: float
    ratio: float


def block_rate(load: Load, seconds: float) -> float:
    """Return the steps per second [1/s] of calls repeated for some seconds, at least one."""
    calls = 0
    begin = time.perf_counter()
    while True:
        load.call()
        calls += 1
        elapsed = time.perf_counter() - begin
        if elapsed >= seconds:
            return calls * load.steps / elapsed


def rate(load: Load, effort: Effort) -> float:
    """Return the median rate [1/s] of the blocks, after one call that does not count."""
    load.call()
    return statistics.median(block_rate(load, effort.seconds) for _ in range(effort.rounds))


def compare(load: Load, peer: Load, effort: Effort) -> Comparison:
    """Measure two loads in turn, so that other load on the machine affects both."""
    load.call()
    peer.call()
    pairs = [(block_rate(load, effort.seconds), block_rate(peer, effort.seconds)) for _ in range(effort.rounds)]
    return Comparison(
        rate=statistics.median(a for a, _ in pairs),
        peer_rate=statistics.median(b for _, b in pairs),
        ratio=statistics.median(a / b for a, b in pairs),
    )


def seconds_of(call: Callable[[], object]) -> float:
    """Return how long a call takes [s]."""
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin
