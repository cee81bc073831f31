"""What one run measured, as data for a file and as tables for a terminal."""

from dataclasses import asdict
from typing import Any

from rich.markup import escape
from rich.table import Table

from pter_gym.speed.measurement import Speed
from pter_gym.speed.ours import ID
from pter_gym.speed.peers import Kind
from pter_gym.speed.roofline import Roofline
from pter_gym.speed.targets import targets


def as_json(speed: Speed) -> dict[str, Any]:
    """Return everything, with the targets and whether they are met, for ``json.dumps``."""
    return {
        "environment": f"{ID}, no telemetry, SAME_STEP, random voltages prepared beforehand",
        **asdict(speed),
        "targets": [{**asdict(target), "met": target.met} for target in targets(speed)],
    }


def tables(speed: Speed) -> list[Table]:
    """Return what a terminal shows: throughput, peers, single steps, the substep loop, the targets, what is missing."""
    shown = [_throughput(speed), _peers(speed), _singles(speed), _roofline(speed.roofline)]
    shown += [_pictures(speed)] if speed.pictures else []
    shown.append(_targets(speed))
    return [*shown, _skipped(speed)] if speed.skipped else shown


def _table(title: str, *headers: str, caption: str = "") -> Table:
    table = Table(title=title, caption=caption, box=None, padding=(0, 1), title_justify="left", caption_justify="left")
    for k, header in enumerate(headers):
        table.add_column(escape(header), justify="left" if k == 0 else "right")
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
    table.add_row("time of a substep of one world \\[ns]", f"{roofline.nanoseconds_per_substep:.2f}")
    table.add_row("peak without FMA [Gop/s]", f"{roofline.peak / 1e9:.1f}, {roofline.peak_width} numbers in a vector")
    table.add_row("share of the peak", f"{100.0 * roofline.share:.1f} %")
    table.add_row("the same for a whole env-step", f"{100.0 * roofline.share_of_step:.1f} %")
    if roofline.widths:
        table.add_row(
            "loops of the kernel that LLVM vectorised",
            f"{len(roofline.widths)}, widths {', '.join(map(str, sorted(set(roofline.widths))))}",
        )
    return table


def _pictures(speed: Speed) -> Table:
    table = _table("Pictures of one world that moves, on one core", "size [px]", "[1/s]")
    for row in speed.pictures:
        table.add_row(f"{row.width} × {row.height}", f"{row.per_second:.0f}")
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
