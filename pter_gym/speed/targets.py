"""The targets for the simulator's speed, and whether they are met."""

from collections.abc import Callable
from dataclasses import dataclass

from pter_gym.speed import peers
from pter_gym.speed.measurement import CARTPOLE, REFERENCE_WORLDS, Speed
from pter_gym.speed.pictures import DEFAULT

FLAT_FROM, FLAT_TO = 4_096, 1_000_000


@dataclass(frozen=True)
class Target:
    """A wish for a number: at least or at most a limit.

    Attributes
    ----------
    name, unit
        What is wished for.
    at_least
        Whether a large number is good; otherwise a small one is.
    limit
        The wish.
    value
        What was measured; None if it was not.
    met
        Whether it is; None if it was not measured.
    """

    name: str
    unit: str
    at_least: bool
    limit: float
    value: float | None

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None if nothing was measured."""
        if self.value is None:
            return None
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def targets(speed: Speed) -> list[Target]:
    """Return all targets with what a run found."""
    rules = _CPU if speed.cuda is None else _CPU + _CUDA
    return [Target(name, unit, at_least, limit, find(speed)) for name, unit, at_least, limit, find in rules]


def flatness(speed: Speed) -> float | None:
    """Return by how much the largest time of an env-step exceeds the smallest, from 4,096 to 1,000,000 worlds."""
    times = {row.worlds: row.nanoseconds_per_step for row in speed.all_threads.rows}
    if FLAT_FROM not in times or FLAT_TO not in times:
        return None
    found = [nanoseconds for worlds, nanoseconds in times.items() if FLAT_FROM <= worlds <= FLAT_TO]
    return max(found) / min(found) - 1.0


def _at_reference(speed: Speed) -> float | None:
    rates = {row.worlds: row.steps_per_second for row in speed.all_threads.rows}
    return rates.get(REFERENCE_WORLDS)


def _ratio(peer: str) -> Callable[[Speed], float | None]:
    def find(speed: Speed) -> float | None:
        ratios = {row.name: row.ratio for row in speed.peers if row.our_worlds == REFERENCE_WORLDS}
        return ratios.get(peer)

    return find


def _single(speed: Speed) -> float | None:
    return next((row.ratio for row in speed.single_steps if row.peer == CARTPOLE), None)


def _pictures(speed: Speed) -> float | None:
    rates = {(row.width, row.height): row.per_second for row in speed.pictures}
    return rates.get(DEFAULT)


def _cuda_rate(speed: Speed) -> float | None:
    rows = speed.cuda.rows if speed.cuda else ()
    return max((row.steps_per_second for row in rows if row.worlds >= FLAT_TO), default=None)


def _cuda_compiling(speed: Speed) -> float | None:
    return speed.cuda.compile_seconds if speed.cuda else None


def _cuda_overhead(speed: Speed) -> float | None:
    return speed.cuda.overhead_microseconds if speed.cuda else None


_Rule = tuple[str, str, bool, float, Callable[[Speed], float | None]]

_CPU: tuple[_Rule, ...] = (
    (f"env-steps, {REFERENCE_WORLDS:,} worlds, all cores", "1/s", True, 8e6, _at_reference),
    (f"env-steps over {peers.REACHER}", "", True, 300.0, _ratio(peers.REACHER)),
    (f"env-steps over {peers.ENVPOOL}", "", True, 120.0, _ratio(peers.ENVPOOL)),
    (f"substeps over {peers.ROLLOUT}", "", True, 400.0, _ratio(peers.ROLLOUT)),
    (f"spread of the time per env-step, {FLAT_FROM:,} to {FLAT_TO:,} worlds", "", False, 0.25, flatness),
    ("memory of a world", "B", False, 1024.0, lambda speed: speed.all_threads.bytes_per_world),
    (f"single env.step over {CARTPOLE}", "", False, 1.0, _single),
    ("substep loop's share of the non-FMA peak", "", True, 0.35, lambda speed: speed.roofline.share),
    (f"pictures of {DEFAULT[0]} × {DEFAULT[1]} px, one core", "1/s", True, 60.0, _pictures),
)

_CUDA: tuple[_Rule, ...] = (
    (f"GPU: env-steps, ≥ {FLAT_TO:,} worlds", "1/s", True, 1e9, _cuda_rate),
    ("GPU: time to compile", "s", False, 5.0, _cuda_compiling),
    ("GPU: overhead of a step", "µs", False, 30.0, _cuda_overhead),
)
