# pyright: standard
"""``pter identify``: the parameters of a real machine from a log of it."""

import math
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.table import Table

from pter_gym._commands.arguments import check_file, split_numbers
from pter_gym._commands.terminal import conclude, progress_bar, say, terminal, waiting
from pter_gym._internal.files import make_folder
from pter_gym.errors import ParameterError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pter_gym.params import Machine
    from pter_gym.tools.identification import Finding, Log
    from pter_gym.tools.identification.bench import Bench

MACHINE = "baseline"


def identify(
    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG.csv …")],
    machine: Annotated[str, tyro.conf.arg(metavar="NAME|FILE.toml")] = MACHINE,
    lengths: Annotated[str | None, tyro.conf.arg(metavar="A,B")] = None,
    voltage_max: float | None = None,
    columns: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=COLUMN …")] = (),
    degrees: bool = False,
    relative_b: bool = False,
    clutch: bool = False,
    hand: bool = False,
    reaction: float = 0.2,
    pulses: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None,
    force: float = 60.0,
    seconds: float = 600.0,
    out: Path = Path("pter-identified"),
) -> None:
    """Identify a real machine, or the hand that moved it, from logs.

    Grades how well the simulator's model describes them, estimates inertias, friction, torque
    curves, lag and delay with 95 % intervals, and lists what they don't determine. Writes
    machine.toml, which other commands take as --machine, and identified.png. docs/identify.md says
    what to record. With --hand, estimates mass, damping and stiffness of a person's arm instead;
    see docs/measure-a-hand.md.

    Example: pter identify log.csv --lengths 0.5645,0.4454 --out mine

    Args:
        logs: Tables with t_s, V1 to V4, theta_A, theta_B, F_x and F_y; several are joined.
        machine: Machine to start from; parameters that the log doesn't determine keep its values.
        lengths: Measured lengths of links A and B [m]; by default those of the machine to start
            from.
        voltage_max: Largest voltage of the clutches [V]; by default that of the machine to start
            from.
        columns: Names of these columns in the files where they differ, such as theta_A=thetaA.
        degrees: Whether angles, or the speed on a bench, are in degrees where names say no unit.
        relative_b: Whether theta_B is measured from link A instead of the x axis.
        clutch: Whether the log is of one clutch or brake on a bench, with t_s, V, omega and torque;
            writes clutch.toml, a machine with four of these, instead.
        hand: Whether to identify the hand that moved the machine, by random pulses of its clutches;
            writes hand.toml, which other commands take as --hand, instead.
        reaction: With --hand, time after a switch [s] in which the person does not react to it.
        pulses: File for the pulses to give while a hand is recorded, with which no log is read:
            t_s and V1 to V4 for each change. It is a policy for other commands. Also prints how
            long to record.
        force: With --pulses, largest force of the clutches on the hand [N].
        seconds: With --pulses, their duration [s], 20 to 600.
        out: Folder for the results, created if necessary.
    """
    from pter_gym.tools.identification import join_logs, read_log

    if clutch and hand:
        raise ParameterError("hand must be left out with --clutch: a bench has none")
    if pulses is not None:
        if logs or clutch:
            raise ParameterError("pulses must be given without logs: it is for a new log")
        show_pulses(read_start(machine, lengths, voltage_max), pulses, force, seconds, reaction)
        return
    if not logs:
        raise ParameterError("logs must be given: LOG.csv … (`pter identify --help` explains)")
    start, names = read_start(machine, lengths, voltage_max), read_names(columns)
    if clutch:
        if len(logs) != 1 or relative_b:
            raise ParameterError(
                "logs must be one file with --clutch, which has no theta_B: --relative-b is not "
                f"for it, got {len(logs)} files"
            )
        from pter_gym.tools.identification.bench import read_bench

        show_bench(read_bench(logs[0], names, degrees=degrees), logs[0].name, start, out)
        return
    log = join_logs(
        [read_log(path, columns=names, degrees=degrees, relative_b=relative_b) for path in logs]
    )
    for remark in log.remarks:
        say(remark)
    if hand:
        show_hand(log, start, reaction, out)
    else:
        show_machine(log, start, out)


def show_bench(bench: "Bench", log: str, start: "Machine", out: Path) -> None:
    """Identify one clutch on a bench, print its numbers and write a machine with four of these."""
    from pter_gym._internal.files import write_files_atomic
    from pter_gym.params._files import format_machine
    from pter_gym.tools.figures import png
    from pter_gym.tools.identification.bench import identify_clutch
    from pter_gym.tools.identification.findings import origins_of
    from pter_gym.tools.identification.identifying import ASSUMED
    from pter_gym.tools.identification.picture import bench_picture

    make_folder(out)
    found = identify_clutch(bench, start.clutch)
    for sentence in (*bench.remarks, *found.sentences):
        say(sentence)
    show_findings(found.findings)
    drive = "\nVolts are amperes here." if bench.drive == "A" else ""
    title = f"Written by pter identify --clutch: four clutches like the one on the bench.{drive}"
    machine = found.machine(start)
    late = too_late(machine)
    for sentence in late:
        say(sentence)
    origins = origins_of((*found.findings, *found.derived), log)
    text = format_machine(machine, ASSUMED, origins, "\n".join((title, *found.sentences, *late)))
    image = png(bench_picture(found, bench.drive))
    write_files_atomic(out, {"clutch.toml": text.encode(), "identified.png": image})
    file = out / "clutch.toml"
    conclude(
        [file, out / "identified.png"], *(() if late else (f"pter device {quote(str(file))}",))
    )


def show_machine(log: "Log", start: "Machine", out: Path) -> None:
    """Identify a machine, print its numbers and write its files."""
    from pter_gym._internal.files import write_files_atomic
    from pter_gym.params._files import format_machine
    from pter_gym.tools.figures import png
    from pter_gym.tools.identification import identify as search
    from pter_gym.tools.identification.identifying import ASSUMED
    from pter_gym.tools.identification.picture import picture

    make_folder(out)
    with progress_bar() as progress:
        task = progress.add_task("identify", total=100)
        result = search(
            log, start, lambda share: progress.update(task, completed=round(100 * share))
        )
    late = too_late(result.machine)
    title = "\n".join(["Written by pter identify. Assumed:", *result.assumptions, *late])
    text = format_machine(result.machines, ASSUMED, result.origins, title)
    write_files_atomic(out, {"machine.toml": text.encode(), "identified.png": png(picture(result))})
    for sentence in (result.verdict.sentence, *result.verdict.hints):
        say(sentence)
    show_findings(result.findings)
    for assumption in result.assumptions:
        say(f"assumed: {assumption}")
    for sentence in late:
        say(sentence)
    machine = out / "machine.toml"
    commands = () if late else (f"pter device {quote(str(machine))}",)
    conclude([machine, out / "identified.png"], *commands)


def show_pulses(
    machine: "Machine", file: Path, force: float, seconds: float, reaction: float
) -> None:
    """Write random pulses, and print how long a hand has to be recorded with them."""
    import io

    import numpy as np

    from pter_gym._internal.files import write_text_atomic
    from pter_gym.tools.identification.pulses import MIDDLE, forces_around, pulses
    from pter_gym.tools.identification.rehearsal import INTERVAL, minutes_needed

    check_file(file, ".csv", "pulses")
    if not 20.0 <= seconds <= 600.0:
        raise ParameterError(f"seconds must be from 20 to 600, got {seconds:g}")
    if not force > 0.0:
        raise ParameterError(f"force must be > 0 N, got {force:g}")
    in_middle, middle = force / forces_around(machine), np.array(MIDDLE)
    volts = pulses(machine, middle, seconds, INTERVAL, in_middle, 0)
    rows = np.flatnonzero(np.abs(np.diff(volts, axis=0, prepend=-1.0)).max(axis=1) > 0.0)
    table = np.column_stack([INTERVAL * rows, volts[rows]])
    table, text = np.vstack([table, [seconds, 0.0, 0.0, 0.0, 0.0]]), io.StringIO()
    np.savetxt(text, table, "%.6g", ",", header="t_s,V1,V2,V3,V4", comments="")
    write_text_atomic(file, text.getvalue())
    with waiting("rehearsing"):
        needed = minutes_needed(machine, middle, in_middle, reaction)
    shown = ", ".join(f"{name} {max(minutes, 1.0):.0f}" for name, minutes in needed.items())
    say(f"{len(rows)} switches of at most {force:g} N on the hand, in {seconds:g} s.")
    say(f"Minutes until numbers of a usual hand are identified: {shown}.")
    conclude(
        [file],
        f"pter export {quote(str(file))} --c pulses",
        f"pter identify log.csv --hand --reaction {reaction:g}",
    )


def show_hand(log: "Log", machine: "Machine", reaction: float, out: Path) -> None:
    """Identify the hand that moved a machine, print its numbers and write its file."""
    from pter_gym._internal.files import write_text_atomic
    from pter_gym.hands._hand_files import format_hand
    from pter_gym.tools.identification.findings import origins_of
    from pter_gym.tools.identification.hand import identify_hand

    make_folder(out)
    with waiting("identify"):
        found = identify_hand(log, machine, reaction=reaction)
    said = (found.sentence, *found.warnings)
    for sentence in said:
        say(sentence)
    show_findings(found.findings, "docs/measure-a-hand.md")
    title = "\n".join(["Written by pter identify --hand.", *said])
    file = out / "hand.toml"
    write_text_atomic(file, format_hand(found.hands, origins_of(found.findings, log.name), title))
    conclude([file], f"pter benchmark --hand {quote(str(file))}")


def too_late(machine: "Machine") -> tuple[str, ...]:
    """Return what to do with a machine whose delay scenarios do not take, in a sentence."""
    from pter_gym.tasks.path_following import PathFollowing
    from pter_gym.tasks.path_following._specification import MAX_DELAY, sensing_of

    try:
        sensing_of(PathFollowing(), machine)
    except ParameterError:
        most = MAX_DELAY * PathFollowing.control_period
        sentence = (
            f"Scenarios accept a delay of at most {1e3 * most:g} ms, and refuse this machine's "
            f"{1e3 * machine.delay:.3g} ms. With delay = {most:g} in the file, pter device and "
            "others run, but their scores are better than the machine's; a task of your own with "
            f"control_period={machine.delay / MAX_DELAY:.2g} or more simulates the whole delay."
        )
        return (sentence,)
    return ()


def read_start(machine: str, lengths: str | None, voltage_max: float | None) -> "Machine":
    """Return the machine to start from."""
    from dataclasses import replace

    from pter_gym.params import find_machine

    start = find_machine(machine)
    if lengths is not None:
        both = split_numbers("lengths", lengths)
        if len(both) != 2:
            raise ParameterError(
                f"lengths must be two numbers separated by a comma, got {lengths!r}"
            )
        start = replace(start, arm=replace(start.arm, length_a=both[0], length_b=both[1]))
    if voltage_max is not None:
        start = replace(start, clutch=replace(start.clutch, voltage_max=voltage_max))
    return start


def read_names(columns: tuple[str, ...]) -> dict[str, str]:
    """Return names of columns in the files, by their usual names."""
    pairs = [column.partition("=") for column in columns]
    if not all(name and column for name, _, column in pairs):
        raise ParameterError(
            f"columns must be pairs such as theta_A=thetaA, got {' '.join(columns)!r}"
        )
    return {name: column for name, _, column in pairs}


def show_findings(findings: "Sequence[Finding]", page: str = "docs/identify.md") -> None:
    """Print a table of the numbers, which fits a terminal of 80 columns, and why some are kept."""
    table = Table(
        box=None, padding=(0, 1), pad_edge=False, caption=f"±: half of the 95 % interval; {page}"
    )
    table.add_column("number", no_wrap=True)
    for header in ("value", "±", "unit"):
        table.add_column(header, justify="left" if header == "unit" else "right", no_wrap=True)
    table.add_column("state", no_wrap=True)
    for finding in findings:
        q, half = finding.quantity, finding.half_width
        shown = f"{half:.2g}" if finding.status != "kept" and math.isfinite(half) else ""
        table.add_row(q.name, f"{q.value:.4g}", shown, q.unit, finding.status)
    terminal().print(table)
    for finding in findings:
        if finding.reason:
            say(f"{finding.quantity.name} is kept: {finding.reason}")
