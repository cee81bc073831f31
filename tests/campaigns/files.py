"""Read damaged files of each format: only typed errors, in bounded time and memory, and nothing is executed.

    python -m tests.campaigns.files --variants 2000 --write

Each variant follows from the seed, the format and its number alone. It is read in this process, under an audit hook
that knows what the reading of good files does; whatever else a variant does is a finding. So are an error of another
kind, a warning, and a variant that takes more than ``MOST_SECONDS`` of processor time or ``MOST_MEMORY``.
"""

import faulthandler
import os
import resource
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import tyro

from pter_gym.errors import PterError

from .corruption import corrupted
from .formats import Format, LeftOut, formats
from .reports import put, table

MOST_SECONDS = 1.0
MOST_MEMORY = 256 << 20
"""Processor time and memory [B] of a reading, beyond what the process has before."""

HANG = 120
"""Seconds after which a reading ends the campaign with its stack, on a computer that may be busy."""

ADDRESSES = 4 << 30
"""Address space that the process may take beyond what it has [B], so that a header cannot take all memory."""

WARM = 3
"""Good readings that tell what reading does, and damaged ones beforehand that load what messages need."""


@dataclass
class Figures:
    """What came of a format."""

    name: str
    refused: "Counter[str]" = field(default_factory=Counter)
    accepted: int = 0
    seconds: float = 0.0
    memory: int = 0
    findings: list[str] = field(default_factory=list)

    @property
    def variants(self) -> int:
        """How many were read."""
        return self.accepted + sum(self.refused.values())


HARMLESS = "builtins.id"
"""An event of the audit hook that executes nothing: somebody asks for an object's address, as some messages do."""


class Auditor:
    """Hears what Python does while a file is read; a hook stays as long as the process."""

    def __init__(self) -> None:
        self._heard: set[tuple[str, ...]] | None = None
        sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self._heard is not None and event != HARMLESS:
            details = arguments if event in ("open", "import", "os.remove", "os.rename", "os.mkdir") else ()
            self._heard.add((event, *map(str, details[:3] if event == "open" else details[:1])))

    @contextmanager
    def listening(self) -> Iterator[set[tuple[str, ...]]]:
        """Collect what is heard."""
        heard = self._heard = set()
        try:
            yield heard
        finally:
            self._heard = None


def campaign(
    folder: Path, variants: int, *, first: int = 0, seed: int = 0, only: Sequence[str] = ()
) -> Iterator[Figures]:
    """Read so many variants of each format, and yield what came of it."""
    auditor = Auditor()
    kinds = formats(folder)
    _limit_addresses()
    for kind in kinds:
        if not only or kind.name in only:
            yield _tried(kind, auditor, range(first, first + variants), seed)


def _tried(kind: Format, auditor: Auditor, numbers: range, seed: int) -> Figures:
    """Read variants of a format; its file is good again afterwards."""
    found = Figures(kind.name)
    beside = {path: path.read_bytes() for path in kind.file.parent.iterdir() if path.is_file()}
    known = _known(kind, auditor, seed)
    for number in numbers:
        _damage(kind, Random(f"{seed} {kind.name} {number}"), beside)
        told = _read(kind, auditor, known, found)
        found.findings += [f"{kind.name} {number}: {each}" for each in told]
    _restore(beside)
    kind.prepare()
    kind.read()
    return found


def _known(kind: Format, auditor: Auditor, seed: int) -> set[tuple[str, ...]]:
    """Return what the reading of the good file does, after everything that messages need is loaded."""
    data = kind.file.read_bytes()
    for damaged in (b"", data[: len(data) // 2], data.replace(b"a", b"b")):
        kind.file.write_bytes(damaged)
        kind.prepare()
        with suppress(PterError, LeftOut):
            kind.read()
    kind.file.write_bytes(data)
    with auditor.listening() as known:
        for _ in range(WARM):
            kind.prepare()
            kind.read()
    return known


def _damage(kind: Format, rng: Random, beside: dict[Path, bytes]) -> None:
    """Write a variant; half of them with what vouches for them."""
    _restore(beside)
    data = corrupted(beside[kind.file], rng, kind.insides)
    kind.file.write_bytes(data)
    if rng.random() < 0.5:
        kind.seal(data)


def _restore(files: dict[Path, bytes]) -> None:
    for path, data in files.items():
        path.write_bytes(data)


def _read(kind: Format, auditor: Auditor, known: set[tuple[str, ...]], found: Figures) -> list[str]:
    """Read what is there, count what came of it, and return what should not have been."""
    kind.prepare()
    findings: list[str] = []
    before = _forget_peak()
    begun = time.process_time()
    faulthandler.dump_traceback_later(HANG, exit=True)
    with auditor.listening() as heard:
        try:
            kind.read()
            found.accepted += 1
        except (PterError, LeftOut) as error:
            found.refused[type(error).__name__] += 1
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            found.refused[type(error).__name__] += 1
            findings.append(f"{type(error).__name__}: {error!s:.200}")
    faulthandler.cancel_dump_traceback_later()
    seconds, memory = time.process_time() - begun, _status("VmHWM") - before
    found.seconds, found.memory = max(found.seconds, seconds), max(found.memory, memory)
    findings += [f"it does {' '.join(each):.200}" for each in sorted(heard - known)]
    if seconds > MOST_SECONDS:
        findings.append(f"it takes {seconds:.2f} s")
    if memory > MOST_MEMORY:
        findings.append(f"it takes {memory >> 20} MB")
    return findings


def _forget_peak() -> int:
    """Let Linux forget how much memory the process had at most, and return what it has now [B]."""
    Path("/proc/self/clear_refs").write_text("5")
    return _status("VmRSS")


def _status(name: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line for line in lines if line.startswith(name)).split()[1])


def figures(found: Sequence[Figures]) -> str:
    """Return what came of the formats as a table in Markdown."""
    header = ["Format", "Variants", "Refused", "Still good", "Longest [ms]", "Most memory [MB]", "Findings"]
    rows: list[list[str]] = []
    for each in found:
        counts = (f"{count:,}" for count in (each.variants, sum(each.refused.values()), each.accepted))
        most = f"{1000 * each.seconds:.0f}", f"{each.memory / 2**20:.0f}", f"{len(each.findings)}"
        rows.append([each.name, *counts, *most])
    return table(header, rows)


def main(
    variants: int = 100,
    first: int = 0,
    seed: int = 0,
    only: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    write: bool = False,
) -> int:
    """Run the campaign and return 1 if there are findings.

    Args:
        variants: Of each format.
        first: Number of the first one.
        seed: Of all damage.
        only: A format; all by default.
        write: Put the table into docs/robustness.md.
    """
    warnings.simplefilter("error")
    found: list[Figures] = []
    with tempfile.TemporaryDirectory() as folder:
        for each in campaign(Path(folder), variants, first=first, seed=seed, only=only):
            found.append(each)
            print(*each.findings, sep="\n", end="\n" if each.findings else "", flush=True)
    put("files", figures(found), write=write)
    return int(any(each.findings for each in found))


def _limit_addresses() -> None:
    """Take no more address space than what there is and ``ADDRESSES``."""
    most = _status("VmSize") + ADDRESSES
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(tyro.cli(main))
