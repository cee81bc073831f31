"""One run of all measurements, as data for a file and as tables for a terminal."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from rich.table import Table

from pter_gym.internal.checks import whole_number
from pter_gym.speed.machine import describe_machine, versions
from pter_gym.speed.ours import (
    CPU_SIZES,
    CUDA_SIZES,
    ID,
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
from pter_gym.speed.peers import Kind, Ratio, measure_peer, our_loads, peers
from pter_gym.speed.roofline import Roofline, measure_roofline
from pter_gym.speed.targets import CARTPOLE, REACHER, REFERENCE_WORLDS, targets
from pter_gym.speed.timing import Effort


@dataclass(frozen=True)
class Plan:
    """How much to measure: sizes [worlds], time for rates, comparisons and single steps, and whether to hurry."""

    quick: bool
    cpu_sizes: tuple[int, ...]
    cuda_sizes: tuple[int, ...]
    rates: Effort
    comparisons: Effort
    single_steps: int
    single_rounds: int
    roofline_rounds: int


@dataclass(frozen=True)
class Speed:
    """All that one run measured."""

    plan: Plan
    machine: dict[str, Any]
    versions: dict[str, str]
    substeps_per_step: int
    all_threads: Sweep
    one_thread: Sweep
    cuda: Cuda | None
    single_steps: tuple[SingleStep, ...]
    peers: tuple[Ratio, ...]
    roofline: Roofline
    skipped: tuple[Skipped, ...]

    def as_json(self) -> dict[str, Any]:
        """Return everything, with the targets and whether they are met, for ``json.dumps``."""
        return {
            "environment": f"{ID}, no telemetry, SAME_STEP, random voltages prepared beforehand",
            **asdict(self),
            "targets": [{**asdict(target), "met": target.met} for target in targets(self)],
        }


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
        If ``max_worlds`` is no whole number of at least 1.
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
        roofline_rounds=3 if quick else 15,
    )


def measure(plan: Plan, on_progress: Callable[[str], object] = lambda _: None) -> Speed:
    """Measure everything; ``on_progress`` hears what comes next."""
    machine = describe_machine()
    on_progress("our throughput, one thread")
    one = sweep(plan.cpu_sizes, 1, plan.rates)
    on_progress("our throughput, all threads")
    every = sweep(plan.cpu_sizes, all_threads(), plan.rates)
    on_progress("a CUDA device")
    device = cuda(plan.cuda_sizes, plan.rates)
    on_progress("single steps")
    singles, missing = single_steps((CARTPOLE, REACHER), plan.single_steps, plan.single_rounds)
    ratios, absent = _beside_peers(plan, on_progress)
    on_progress("the substep loop and the peak of the arithmetic")
    roofline = measure_roofline(plan.roofline_rounds, compile_anew=not plan.quick)
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
        roofline=roofline,
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
    sizes = [worlds for worlds in CPU_SIZES if worlds not in plan.cpu_sizes]
    why = "not asked for" if not plan.quick else "a quick run"
    rows = [Skipped(f"{worlds:,} worlds", why) for worlds in sizes]
    return [*rows, Skipped("loops that LLVM vectorised in the block kernel", why)] if plan.quick else rows


def tables(speed: Speed) -> list[Table]:
    """Return what a terminal shows: throughput, peers, single steps, the substep loop, the targets, what is missing."""
    shown = [_throughput(speed), _peers(speed), _singles(speed), _roofline(speed.roofline), _targets(speed)]
    return [*shown, _skipped(speed)] if speed.skipped else shown


def _table(title: str, *headers: str, caption: str = "") -> Table:
    table = Table(title=title, caption=caption, box=None, padding=(0, 1), title_justify="left", caption_justify="left")
    for k, header in enumerate(headers):
        table.add_column(header, justify="left" if k == 0 else "right")
    return table


def _throughput(speed: Speed) -> Table:
    table = _table(
        "Whole env-steps",
        "worlds",
        "all threads [M/s]",
        "[ns]",
        "one thread [M/s]",
        "[ns]",
        caption=f"{speed.substeps_per_step} substeps each; {speed.machine['cores']} threads at most; "
        f"{speed.all_threads.bytes_per_world:.0f} bytes a world; load average {speed.machine['load_average_at_start']}",
    )
    for every, one in zip(speed.all_threads.rows, speed.one_thread.rows, strict=True):
        rates = [text for row in (every, one) for text in _rate_texts(row.steps_per_second)]
        table.add_row(f"{every.worlds:,}", *rates)
    for row in speed.cuda.rows if speed.cuda else ():
        table.add_row(f"{row.worlds:,} on the GPU", *_rate_texts(row.steps_per_second), "", "")
    return table


def _rate_texts(rate: float) -> tuple[str, str]:
    return f"{rate / 1e6:.4g}", f"{1e9 / rate:.4g}"


def _peers(speed: Speed) -> Table:
    table = _table("Beside peers, in turn", "", "worlds", "peer [1/s]", "ours [1/s]", "ratio")
    for row in speed.peers:
        table.add_row(
            f"{row.name} ({row.version}){'' if row.kind == Kind.ENV_STEPS else ', substeps'}",
            f"{row.worlds:,}",
            f"{row.steps_per_second:,.0f}",
            f"{row.our_steps_per_second:,.0f}",
            f"{row.ratio:.3g}",
        )
    return table


def notes(speed: Speed) -> list[str]:
    """Return what each peer does in one step, for a reader who compares."""
    return [f"{row.name}: {row.one_step}." for row in speed.peers]


def _singles(speed: Speed) -> Table:
    table = _table("One env.step through gymnasium.make, in turn", "peer", "ours [µs]", "peer [µs]", "ours over peer")
    for row in speed.single_steps:
        table.add_row(row.peer, f"{row.microseconds:.2f}", f"{row.peer_microseconds:.2f}", f"{row.ratio:.3f}")
    return table


def _roofline(roofline: Roofline) -> Table:
    table = _table("The substep loop on one thread", "", "")
    counts = f"{roofline.operations_per_substep:.0f}, {roofline.operations_per_step:.0f}"
    table.add_row("operations of a substep, of an env-step", counts)
    table.add_row("time of a substep of one world [ns]", f"{roofline.nanoseconds_per_substep:.2f}")
    table.add_row("peak without FMA [Gop/s]", f"{roofline.peak / 1e9:.1f}, {roofline.peak_width} numbers in a vector")
    table.add_row("share of the peak", f"{100.0 * roofline.share:.1f} %")
    table.add_row("the same for a whole env-step", f"{100.0 * roofline.share_of_step:.1f} %")
    if roofline.widths:
        table.add_row(
            "loops of the kernel that LLVM vectorised",
            f"{len(roofline.widths)}, widths {', '.join(map(str, sorted(set(roofline.widths))))}",
        )
    return table


def _targets(speed: Speed) -> Table:
    table = _table("Targets", "", "wanted", "measured", "")
    words = {True: "met", False: "missed", None: "not measured"}
    for target in targets(speed):
        wanted = f"{'≥' if target.at_least else '≤'} {target.limit:,.4g} {target.unit}".strip()
        measured = "" if target.value is None else f"{target.value:,.4g} {target.unit}".strip()
        table.add_row(target.name, wanted, measured, words[target.met])
    return table


def _skipped(speed: Speed) -> Table:
    table = _table("Skipped", "what", "why")
    for row in speed.skipped:
        table.add_row(row.what, row.why)
    return table
