"""Kill the commands that write, let the disk run full under them, and let several work in one folder.

    python -m tests.campaigns.kill --kills 200 --write

Each job runs once undisturbed. Then processes that do the same, forked from this one, get into trouble, each time in a
new folder:

- killed: SIGKILL at a random system call that concerns files, up to three times before the job is done at last;
- full: from the first, the second, … file on, nothing more can be written;
- crowded: two or four at once, the first of which is killed in every other crowd.

After each, the files that are there are whole, what was finished is as it was, and a process that was not killed was
right or said in one line what is wrong. In the end, the results are the bytes of the undisturbed job. Needs Linux and
strace.
"""

import io
import os
import random
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import tyro

from .jobs import NOTHING, Job, Kept, jobs, train
from .reports import put, table

CALLS = "openat,write,pwrite64,fsync,ftruncate,rename,renameat,renameat2,unlink,unlinkat,mkdir,flock"
"""System calls at which a process is killed."""

FULL = "fsync,rename,renameat,renameat2"
"""System calls that fail on a full disk, of those that only writers make; all are among ``CALLS``."""

CRASH = 70
"""Exit status after an error that nobody expected."""

PATIENCE = 300.0
"""Seconds after which a process counts as hanging."""

SETTLING = 0.2
"""Seconds in which a thread that is joined has ended for the system, too."""

MOST_KILLS = 3
"""Kills in one folder before the job may go on to its end."""

# --- processes in trouble ---


class Process(NamedTuple):
    """A forked process that does a job, and what it prints."""

    pid: int
    printed: int


class End(NamedTuple):
    """How a process ended: its exit status, minus a signal, and what it printed."""

    status: int
    text: str


def await_threads() -> None:
    """Wait until other threads have ended: a process that is forked meanwhile keeps what they have locked."""
    until = time.monotonic() + SETTLING
    while sum(1 for _ in Path("/proc/self/task").iterdir()) > 1 and time.monotonic() < until:
        time.sleep(0.001)


def fork(work: Callable[[], int]) -> Process:
    """Begin some work in a process of its own, which has all that is loaded here."""
    read, write = os.pipe()
    pid = os.fork()
    if pid:
        os.close(write)
        return Process(pid, read)
    status = CRASH
    try:
        for stream in (1, 2):
            os.dup2(write, stream)
        sys.stdout, sys.stderr = (os.fdopen(stream, "w", buffering=1, closefd=False) for stream in (1, 2))
        status = work()
    except BaseException:  # noqa: BLE001
        traceback.print_exc()
    finally:
        os._exit(status)


def await_end(process: Process) -> End:
    """Wait until a process has ended; one that hangs is killed, and said so."""
    text, until = b"", time.monotonic() + PATIENCE
    while (left := until - time.monotonic()) > 0.0 and select.select([process.printed], [], [], left)[0]:
        part = os.read(process.printed, 1 << 16)
        text += part
        if not part:
            break
    else:
        os.kill(process.pid, signal.SIGKILL)
        text += b"Traceback: it hangs"
    os.close(process.printed)
    return End(os.waitstatus_to_exitcode(os.waitpid(process.pid, 0)[1]), text.decode())


def trace(work: Callable[[], int], *options: str) -> End:
    """Do some work in a process of its own under strace; without that it fails."""

    def traced() -> int:
        until = time.monotonic() + 10.0
        while "TracerPid:\t0\n" in Path("/proc/self/status").read_text("ascii"):
            time.sleep(0.005)
            assert time.monotonic() < until, "strace may not trace"
        return work()

    process = fork(traced)
    words = ["strace", "-f", "-qqq", "-p", str(process.pid), *options]
    tracer = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = await_end(process)
    tracer.wait()
    return end


@cache
def can_trace() -> bool:
    """Return whether there is an strace, and it may trace."""
    return shutil.which("strace") is not None and trace(lambda: 0, "-o", os.devnull).status == 0


def count_calls(work: Callable[[], int]) -> Counter[str]:
    """Return how many of ``CALLS`` the main thread of some undisturbed work makes, by name."""
    with tempfile.NamedTemporaryFile("r") as log:
        trace(work, "-o", log.name, "-e", f"trace={CALLS}", "-e", "signal=none")
        found = [each.groups() for line in log if (each := re.match(r"(\d+) +(\w+)\(", line))]
    return Counter(name for thread, name in found if thread == found[0][0])


def inject(work: Callable[[], int], calls: str, fault: str) -> End:
    """Do some work with a fault at some of its system calls, in the words of strace."""
    return trace(work, "-o", os.devnull, "-e", f"trace={calls}", "-e", f"inject={calls}:{fault}")


# --- the campaign ---


@dataclass
class Campaign:
    """A job in trouble.

    Attributes
    ----------
    name, job
        What is done.
    rng
        Where and when there is trouble.
    work
        Folder for all of it.
    counts
        What happened how often.
    faults
        What was wrong.
    """

    name: str
    job: Job
    rng: random.Random
    work: Path
    counts: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Do the job undisturbed, twice: once to load and compile all, and once to see how long it takes."""
        first = self.folder()
        if self.job.forkable:
            with redirect_stdout(io.StringIO()):
                assert self.job.work(first) == 0
        else:
            end = await_end(fork(partial(self.job.work, first)))
            assert end.status == 0, end.text[-3000:]
        self.wanted = self.job.results(first)
        await_threads()
        second, begun = self.folder(), time.monotonic()
        end = await_end(fork(partial(self.job.work, second)))
        assert end.status == 0, f"undisturbed, in {second}: status {end.status}\n{end.text[-3000:]}"
        self.seconds = time.monotonic() - begun
        assert self.job.results(second) == self.wanted, "even undisturbed the results are others"
        self.calls = count_calls(partial(self.job.work, self.folder()))
        self.files = max(self.calls[name] for name in FULL.split(","))

    def folder(self) -> Path:
        """Return a new folder."""
        return Path(tempfile.mkdtemp(prefix=f"{self.name}-", dir=self.work))

    def kill(self, kills: int) -> None:
        """Kill the job so often, a few times in a folder, and let it end there."""
        while kills > 0:
            folder, before = self.folder(), {}
            for _ in range(min(self.rng.randint(1, MOST_KILLS), kills)):
                end = self.kill_once(folder)
                before = self.look(folder, end, "killed", (0, -signal.SIGKILL), before)
                if end.status == 0:
                    break
                kills -= 1
            self.finish(folder, "killed", before)

    def kill_once(self, folder: Path) -> End:
        """Do the job in a folder, and kill it at a random system call, if it makes so many."""
        (name,) = self.rng.choices(list(self.calls), list(self.calls.values()))
        fault = f"signal=SIGKILL:when={self.rng.randint(1, self.calls[name])}"
        return inject(partial(self.job.work, folder), name, fault)

    def fill(self, fills: int | None = None) -> None:
        """Let the disk run full, by default from each file on, and the job end where there is room."""
        for number in range(self.files if fills is None else fills):
            folder = self.folder()
            fault = f"error=ENOSPC:when={number % self.files + 1}+"
            end = inject(partial(self.job.work, folder), FULL, fault)
            before = self.look(folder, end, "full", (0, 2))
            self.finish(folder, "full", before)

    def crowd(self, crowds: int) -> None:
        """Let several do the job in one folder at once, and kill the first one of every other crowd."""
        for number in range(crowds):
            folder = self.folder()
            processes = [fork(partial(self.job.work, folder)) for _ in range(self.rng.choice((2, 4)))]
            if number % 2:
                time.sleep(self.rng.uniform(0.0, self.seconds))
                os.kill(processes[0].pid, signal.SIGKILL)
            ends = [await_end(process) for process in processes]
            before = [self.look(folder, end, "crowded", (0, 2, -signal.SIGKILL)) for end in ends][-1]
            if not number % 2 and not any(end.status == 0 for end in ends):
                self.faults.append(f"{self.name}: nobody in a crowd ended well: {[end.text[-300:] for end in ends]}")
            self.finish(folder, "crowded", before)

    def look(self, folder: Path, end: End, kind: str, allowed: Iterable[int], before: Kept = NOTHING) -> Kept:
        """Count how a process ended, complain unless it ended as it may, and return what is finished then."""
        told = "killed" if end.status < 0 else {0: "done", 2: "told"}.get(end.status, "crashed")
        self.counts[f"{kind}: {told}"] += 1
        if end.status not in allowed or "Traceback" in end.text or (end.status == 2 and "error: " not in end.text):
            self.faults.append(f"{self.name}, {kind}: status {end.status}\n{end.text[-3000:]}")
        return self.kept(folder, before, kind)

    def kept(self, folder: Path, before: Kept, kind: str) -> Kept:
        """Return what is finished in a folder, and complain if it is not whole, or of before not as before."""
        try:
            found = self.job.finished(folder)
        except Exception as error:  # noqa: BLE001  (whatever it is, it is told)
            self.faults.append(f"{self.name}, {kind}, {folder}: {error!r}")
            return {}
        if other := [name for name in found.keys() & self.wanted.keys() if found[name] != self.wanted[name]]:
            self.faults.append(f"{self.name}, {kind}, {folder}: {other} is not what it is undisturbed")
        if lost := [name for name, value in before.items() if found.get(name) != value]:
            self.faults.append(f"{self.name}, {kind}, {folder}: {lost} is lost or changed")
        return found

    def finish(self, folder: Path, kind: str, before: Kept) -> None:
        """Let the job end in a folder, and compare its results with the undisturbed ones."""
        end = await_end(fork(partial(self.job.work, folder)))
        self.look(folder, end, "after it", (0,), before)
        try:
            found = self.job.results(folder)
        except Exception as error:  # noqa: BLE001
            found = {"error": repr(error)}
        if found == self.wanted:
            self.counts["same results"] += 1
        else:
            differ = [name for name in {**found, **self.wanted} if found.get(name) != self.wanted.get(name)]
            self.faults.append(f"{self.name}, {kind}, {folder}: results differ in {differ}: {found.get('error')}")
        if not self.faults:
            shutil.rmtree(folder)


def run(kills: int, fills: int | None, crowds: int, names: Iterable[str], seed: int, work: Path) -> dict[str, Campaign]:
    """Return the campaigns of some jobs; what happens is shared out evenly."""
    every = jobs(work)
    names = list(names) or list(every)
    if "export" in names:
        assert await_end(fork(partial(train, work))).status == 0
    found: dict[str, Campaign] = {}
    for place, name in enumerate(names):
        campaign = found[name] = Campaign(name, every[name], random.Random(f"{seed} {name}"), work)
        campaign.kill((kills + place) // len(names))
        campaign.fill(None if fills is None else (fills + place) // len(names))
        campaign.crowd((crowds + place) // len(names))
        print(name, f"{campaign.seconds:.1f} s,", campaign.calls.total(), "calls,", dict(campaign.counts), flush=True)
    return found


def figures(found: Mapping[str, Campaign]) -> str:
    """Return what happened as a table in Markdown."""
    columns = {
        "killed": ("killed: killed",),
        "disk full, told in a line": ("full: told",),
        "disk full, not needed": ("full: done",),
        "in a crowd": ("crowded: done", "crowded: told", "crowded: killed"),
        "folders brought to their end": ("same results",),
    }
    rows = [
        [name, *(str(sum(each.counts[part] for part in parts)) for parts in columns.values()), str(len(each.faults))]
        for name, each in found.items()
    ]
    return table(["job", *columns, "faults"], rows)


def main(
    kills: int = 200,
    fills: int | None = None,
    crowds: int = 28,
    names: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    seed: int = 0,
    write: bool = False,
) -> int:
    """Run the campaign, print a table, and return 1 if anything was wrong.

    Args:
        kills: Processes that are killed, of all jobs together.
        fills: Disks that run full; by default from each file on.
        crowds: Folders in which several work at once.
        names: Jobs; all by default.
        seed: Of where and when there is trouble.
        write: Put the table into docs/robustness.md.
    """
    os.environ["OMP_NUM_THREADS"] = "1"  # before torch is loaded: threads of OpenMP do not survive a fork
    work = Path(tempfile.mkdtemp(prefix="kill-"))
    found = run(kills, fills, crowds, names, seed, work)
    faults = [fault for campaign in found.values() for fault in campaign.faults]
    print(*faults, sep="\n")
    put("kill", figures(found), write=write)
    if not faults:
        shutil.rmtree(work)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
