"""One run of all measurements, as data."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pter_gym._internal.checks import whole_number
from pter_gym.tools.speed.machine import describe_machine, versions
from pter_gym.tools.speed.ours import (
    CPU_SIZES,
    CUDA_SIZES,
    Cuda,
    SingleStep,
    Skipped,
    Sweep,
    all_threads,
    cuda,
    single_steps,
    substeps_per_step,
    sweep,
)
from pter_gym.tools.speed.peers import Ratio, measure_peer, our_loads, peers
from pter_gym.tools.speed.timing import Effort

REFERENCE_WORLDS = 16_384
"""Our worlds beside a peer."""

SINGLE = ("CartPole-v1", "Reacher-v5")
"""Environments beside a single one of ours."""


@dataclass(frozen=True)
class Plan:
    """How much to measure: sizes [worlds], time for rates, comparisons and single steps, and whether to be quick."""

    quick: bool
    cpu_sizes: tuple[int, ...]
    cuda_sizes: tuple[int, ...]
    rates: Effort
    comparisons: Effort
    single_steps: int
    single_rounds: int


@dataclass(frozen=True)
class Speed:
    """All results of one run."""

    plan: Plan
    machine: dict[str, Any]
    versions: dict[str, str]
    substeps_per_step: int
    all_threads: Sweep
    one_thread: Sweep
    cuda: Cuda | None
    single_steps: tuple[SingleStep, ...]
    peers: tuple[Ratio, ...]
    skipped: tuple[Skipped, ...]


def make_plan(*, quick: bool = False, max_worlds: int = CUDA_SIZES[-1]) -> Plan:
    """Return what to measure.

    Parameters
    ----------
    quick
        Small batches and few repetitions: half a minute.
    max_worlds
        Larger batches are left out.

    Raises
    ------
    ParameterError
        If ``max_worlds`` is not a whole number ≥ 1.
    """
    max_worlds = whole_number("max_worlds", max_worlds)
    most = min(max_worlds, REFERENCE_WORLDS) if quick else max_worlds
    return Plan(
        quick=quick,
        cpu_sizes=tuple(worlds for worlds in CPU_SIZES if worlds <= most),
        cuda_sizes=tuple(worlds for worlds in CUDA_SIZES if worlds <= most),
        rates=Effort(0.05, 3) if quick else Effort(0.4, 7),
        comparisons=Effort(0.1, 3) if quick else Effort(0.5, 7),
        single_steps=200 if quick else 400,
        single_rounds=5 if quick else 25,
    )


def measure(plan: Plan, on_progress: Callable[[str], object] = lambda _: None) -> Speed:
    """Measure everything; ``on_progress`` is told what comes next."""
    machine = describe_machine()
    on_progress("our throughput, one thread")
    one = sweep(plan.cpu_sizes, 1, plan.rates)
    on_progress("our throughput, all threads")
    every = sweep(plan.cpu_sizes, all_threads(), plan.rates)
    on_progress("a CUDA device")
    device = cuda(plan.cuda_sizes, plan.rates)
    on_progress("single steps")
    singles, missing = single_steps(SINGLE, plan.single_steps, plan.single_rounds)
    ratios, absent = _beside_peers(plan, on_progress)
    skipped = [*every.skipped, *missing, *absent, *_left_out(plan)]
    if isinstance(device, Skipped):
        skipped.append(device)
    return Speed(
        plan=plan,
        machine=machine,
        versions=versions(),
        substeps_per_step=substeps_per_step(),
        all_threads=every,
        one_thread=one,
        cuda=None if isinstance(device, Skipped) else device,
        single_steps=tuple(singles),
        peers=tuple(ratios),
        skipped=tuple(skipped),
    )


def _beside_peers(plan: Plan, on_progress: Callable[[str], object]) -> tuple[list[Ratio], list[Skipped]]:
    worlds = min(REFERENCE_WORLDS, plan.cpu_sizes[-1])
    ours = our_loads(worlds)
    found: list[Ratio | Skipped] = []
    for peer in peers(plan.quick):
        on_progress(f"{peer.name} and ours in turn")
        found.append(measure_peer(peer, ours, worlds, plan.comparisons))
    for load in ours.values():
        load.close()
    return [row for row in found if isinstance(row, Ratio)], [row for row in found if isinstance(row, Skipped)]


def _left_out(plan: Plan) -> list[Skipped]:
    why = "a quick run" if plan.quick else "not asked for"
    return [Skipped(f"{worlds:,} worlds", why) for worlds in CPU_SIZES if worlds not in plan.cpu_sizes]
