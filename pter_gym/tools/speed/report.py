"""The results of one run, as data for a file and as tables for a terminal."""

from dataclasses import asdict
from typing import Any

from rich.markup import escape
from rich.table import Table

from pter_gym.tools.speed.measurement import Speed
from pter_gym.tools.speed.ours import ID
from pter_gym.tools.speed.peers import Kind


def as_json(speed: Speed) -> dict[str, Any]:
    """Return everything for ``json.dumps``."""
    return {
        "environment": f"{ID}, no telemetry, SAME_STEP, random voltages prepared beforehand",
        **asdict(speed),
    }


def tables(speed: Speed) -> list[Table]:
    """Return tables for a terminal: throughput, peers, single steps, and what is missing."""
    shown = [_throughput(speed), _peers(speed), _singles(speed)]
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


def _skipped(speed: Speed) -> Table:
    table = _table("Skipped", "what", "why")
    for row in speed.skipped:
        table.add_row(row.what, row.why)
    return table
