"""Kill the commands that write, let the disk run full under them, and let several work in one folder.

    python -m tests.campaigns.kill --kills 200 --page docs/robustness.md

Each job runs once undisturbed. Then processes that do the same, forked from this one, get into trouble, each time in a
new folder:

- killed: SIGKILL at a random system call that concerns files, up to three times before the job is done at last; at
  random times where there is no strace;
- full: from the first, the second, … file on, nothing more can be written; or files grow no longer, from a random
  moment on;
- crowded: two or four at once, the first of which is killed in every other crowd.

After each, the files that are there are whole, what was finished is as it was, and whoever was not killed was right or
said in one line what is wrong. In the end, the results are the bytes of the undisturbed job. Linux only.
"""

import hashlib
import io
import os
import random
import re
import resource
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
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import tyro

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

ELSEWHERE = re.compile(r"what was to be written is in '([^']+)'")

JOURNAL, GAINS, TRIALS, DRAWS = "a #?%b.db", "gains.toml", 5, 4
"""Of the search for gains: its files, its trials and the draws of each."""

Digests = dict[str, str]
Kept = Mapping[str, object]
NOTHING: Kept = MappingProxyType({})


class Job(NamedTuple):
    """Something that writes.

    Attributes
    ----------
    work
        Does it in a folder, or goes on with it there, and returns the exit status.
    finished
        What is finished in a folder, by name; raises unless all that is there is whole.
    results
        What must be the same at the end, by name. What is finished under such a name is so at once.
    """

    work: Callable[[Path], int]
    finished: Callable[[Path], Kept]
    results: Callable[[Path], Kept]


def digests(folder: Path, pattern: str = "**/*") -> Digests:
    """SHA-256 of the files in a folder by name, without hidden ones and logs."""
    found = sorted(path for path in folder.glob(pattern) if path.is_file())
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in found
        if not path.name.startswith((".", "progress", "events"))
    }


def command(*words: str) -> Callable[[Path], int]:
    """A command of `pter`; FOLDER in its words is the folder."""

    def work(folder: Path) -> int:
        from pter_gym.commands.main import main

        return main([word.replace("FOLDER", str(folder)) for word in words])

    return work


# --- the jobs ---


class OneThread(ThreadPoolExecutor):
    """One thread in place of more: where two of a forked process are the first to use torch, it may crash."""

    def __init__(self, _: int, **rest: Any) -> None:
        """Take what several threads would."""
        super().__init__(1, **rest)


def train(folder: Path) -> int:
    """Train for six rollouts, with a checkpoint after each."""
    from pter_agents import ppo, prepare, training
    from pter_agents.algorithms import load_settings, settings_from
    from pter_gym.errors import PterError

    ppo.ThreadPoolExecutor = OneThread
    prepare.SAMPLE_WORLDS, prepare.SAMPLE_STEPS = 16, 20
    small = {"worlds": 16, "steps": 8, "contexts": 4, "hidden": [8], "value_hidden": [8], "episode": 20}
    arguments = training.Arguments(
        algorithm="residual",
        scenario="standard",
        pace="brisk",
        steps=6 * 16 * 8,
        seed=3,
        settings=settings_from("residual", {**vars(load_settings("residual")), **small, "minibatch": 64, "epochs": 2}),
        checkpoint_every=1,
        validate_every=2,
        validation_episodes=2,
    )
    run = folder / "run"
    try:
        training.train(arguments, run, resume=(run / training.RUN).exists())
    except PterError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    return 0


def trained(folder: Path) -> Kept:
    """Return the checkpoints that were reached; description, scores and checkpoints must be whole."""
    from pter_agents.checkpoints import checkpoints
    from pter_agents.training import RUN, RunFolder

    run = folder / "run"
    if not (run / RUN).exists():
        return {}
    RunFolder(run).read()
    RunFolder(run).scores()
    steps = [0]
    for path in checkpoints(run):
        with np.load(path, allow_pickle=False) as archive:
            assert all(archive[name].size for name in archive.files)
        steps.append(int(path.stem.split("-")[1]))
    return {str(step): "reached" for step in range(0, steps[-1] + 1, 16 * 8)}


def tuned(folder: Path) -> Kept:
    """Return the finished trials; the journal and the file of gains must be whole."""
    from pter_gym.benchmark.tuned import read_table
    from pter_gym.tuning.search import open_journal

    if (folder / GAINS).exists():
        read_table(folder / GAINS)
    if not (folder / JOURNAL).exists():
        return {}
    storage = open_journal(folder / JOURNAL)
    trials = [trial for study in storage.get_all_studies() for trial in storage.get_all_trials(study._study_id)]
    return {str(trial.number): (trial.params, trial.value) for trial in trials if trial.value is not None}


def tuned_rightly(folder: Path) -> Kept:
    """Return what was asked for; each trial must have a value of its gains, judged once more."""
    from pter_gym.benchmark.tuned import read_table
    from pter_gym.scenarios import find_pace
    from pter_gym.tuning import Examination
    from pter_gym.tuning.search import REDUCTION, RUNGS, gains_at, make

    rungs = [Examination("standard", "brisk", -(-DRAWS // REDUCTION**k), 0) for k in range(RUNGS)]
    found: Any = tuned(folder)
    assert len(found) >= TRIALS, f"{len(found)} trials"
    for params, value in found.values():
        tried = make("impedance", gains_at(params, find_pace("brisk")))
        assert value in [rung.judge(tried).value for rung in rungs], "a trial has a value that is not that of its gains"
    return {"command": read_table(folder / GAINS)["standard"]["impedance"]["brisk"]["command"]}


def benchmarked(folder: Path) -> Kept:
    """Return the runs that are finished, and the pictures; none may be left out."""
    from pter_gym.benchmark.results import SUMMARY, ResultsFolder

    left_out = ResultsFolder(folder).read().left_out
    assert not left_out, left_out
    return {name: digest for name, digest in digests(folder).items() if name != SUMMARY}


def exported(folder: Path) -> Kept:
    """Return what is written of a policy; if its card is there, which is the last, it must be a whole one."""
    from pter_gym.policies import load_policy

    if (folder / "policies" / "mine.json").exists():
        load_policy("mine", folder / "policies")
    return digests(folder)


def jobs(work: Path) -> dict[str, Job]:
    """Return all jobs by name; what they need is made in a folder."""

    def writer(*words: str) -> Job:
        """Job whose files are there as they are in the end, or not at all."""
        return Job(command(*words), digests, digests)

    trial = ("--trials", str(TRIALS), "--starts", "1", "--episodes", str(DRAWS), "--pace", "brisk")
    few = ("--policies", "locked,impedance", "--paces", "brisk", "--episodes", "4")
    few_steps = ("--scenario", "standard", "--level", "random", "--steps", "300")
    return {
        "train": Job(train, trained, digests),
        "export": Job(
            command("export", str(work / "run"), "--name", "mine", "--out", "FOLDER/policies"), exported, digests
        ),
        "tune": Job(
            command("tune", "impedance", *trial, "--storage", f"FOLDER/{JOURNAL}", "--out", f"FOLDER/{GAINS}"),
            tuned,
            tuned_rightly,
        ),
        "benchmark": Job(command("benchmark", "--scenario", "standard", *few, "--out", "FOLDER"), benchmarked, digests),
        "record": writer("record", *few_steps, "--out", "FOLDER"),
        "fit": writer("fit", "--budget", "300", "--held-out", "--out", "FOLDER/preset.toml"),
        "reproduce": writer("reproduce", "fig3", "--out", "FOLDER"),
    }


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
    while select.select([process.printed], [], [], max(until - time.monotonic(), 0.0))[0]:
        part = os.read(process.printed, 1 << 16)
        text += part
        if not part:
            break
    else:
        os.kill(process.pid, signal.SIGKILL)
        text += b"Traceback: it hangs"
    os.close(process.printed)
    return End(os.waitstatus_to_exitcode(os.waitpid(process.pid, 0)[1]), text.decode())


def traced(work: Callable[[], int]) -> int:
    """Do some work as soon as this process is traced."""
    while "TracerPid:\t0\n" in Path("/proc/self/status").read_text("ascii"):
        time.sleep(0.005)
    return work()


def strace(process: Process, *options: str) -> subprocess.Popen[bytes]:
    """Begin to trace a process."""
    words = ["strace", "-f", "-qqq", "-p", str(process.pid), *options]
    return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def trace(job: Job, folder: Path, *options: str) -> End:
    """Do a job under strace."""
    process = fork(partial(traced, partial(job.work, folder)))
    tracer = strace(process, *options)
    end = await_end(process)
    tracer.wait()
    return end


@cache
def can_trace() -> bool:
    """Return whether there is an strace, and it may trace."""
    if shutil.which("strace") is None:
        return False
    process = fork(partial(traced, lambda: 0))
    refused = strace(process, "-o", os.devnull).wait()
    if refused:
        os.kill(process.pid, signal.SIGKILL)
    await_end(process)
    return not refused


def count_calls(job: Job, folder: Path) -> Counter[str]:
    """Return how many of ``CALLS`` the main thread of an undisturbed job makes, by name."""
    with tempfile.NamedTemporaryFile("r") as log:
        trace(job, folder, "-o", log.name, "-e", f"trace={CALLS}", "-e", "signal=none")
        found = [each.groups() for line in log if (each := re.match(r"(\d+) +(\w+)\(", line))]
    return Counter(name for thread, name in found if thread == found[0][0])


def kill_at_call(job: Job, folder: Path, name: str, number: int) -> End:
    """Do a job that is killed at the first, the second, … system call of a name, if it makes so many."""
    return trace(
        job, folder, "-o", os.devnull, "-e", f"trace={name}", "-e", f"inject={name}:signal=SIGKILL:when={number}"
    )


def fill_at_call(job: Job, folder: Path, number: int) -> End:
    """Do a job on a disk that is full from a file on."""
    return trace(
        job, folder, "-o", os.devnull, "-e", f"trace={FULL}", "-e", f"inject={FULL}:error=ENOSPC:when={number}+"
    )


def kill_after(job: Job, folder: Path, seconds: float) -> End:
    """Do a job that is killed after a time."""
    process = fork(partial(job.work, folder))
    time.sleep(seconds)
    os.kill(process.pid, signal.SIGKILL)
    return await_end(process)


def fill_after(job: Job, folder: Path, seconds: float, size: int) -> End:
    """Do a job whose files, after a time, grow no longer than to a size [B]."""
    process = fork(partial(job.work, folder))
    time.sleep(seconds)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    return await_end(process)


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
        """Do the job undisturbed, twice: once here, which loads and compiles all, and once to see how long it takes."""
        first = self.folder()
        with redirect_stdout(io.StringIO()):
            assert self.job.work(first) == 0
        self.wanted = self.job.results(first)
        await_threads()
        second, begun = self.folder(), time.monotonic()
        end = await_end(fork(partial(self.job.work, second)))
        assert end.status == 0, f"undisturbed, in {second}: status {end.status}\n{end.text[-3000:]}"
        self.seconds = time.monotonic() - begun
        assert self.job.results(second) == self.wanted, "even undisturbed the results are others"
        self.sizes = sorted(path.stat().st_size for path in second.rglob("*") if path.is_file())
        self.calls = count_calls(self.job, self.folder()) if can_trace() else Counter[str]()
        self.files = max(self.calls[name] for name in FULL.split(",")) if can_trace() else len(self.sizes)

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
        """Do the job in a folder, and kill it at a random system call, or time."""
        if not self.calls:
            return kill_after(self.job, folder, self.rng.uniform(0.0, self.seconds))
        (name,) = self.rng.choices(list(self.calls), list(self.calls.values()))
        return kill_at_call(self.job, folder, name, self.rng.randint(1, self.calls[name]))

    def fill(self, fills: int | None = None) -> None:
        """Let the disk run full, by default at each call that writes a file, and the job end where there is room."""
        for number in range(2 * self.files if fills is None else fills):
            folder = self.folder()
            if can_trace() and number % 2 == 0:
                end = fill_at_call(self.job, folder, number // 2 % self.files + 1)
            else:
                size = self.rng.randrange(self.rng.choice(self.sizes) + 1)
                end = fill_after(self.job, folder, self.rng.uniform(0.0, self.seconds), size)
            before = self.look(folder, end, "full", (0, 2))
            for found in ELSEWHERE.findall(end.text):
                self.counts["kept elsewhere"] += any(Path(found).iterdir())
                shutil.rmtree(found)
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
        assert train(work) == 0
    found: dict[str, Campaign] = {}
    for place, name in enumerate(names):
        campaign = found[name] = Campaign(name, every[name], random.Random(f"{seed} {name}"), work)
        campaign.kill((kills + place) // len(names))
        campaign.fill(None if fills is None else (fills + place) // len(names))
        campaign.crowd((crowds + place) // len(names))
        print(name, f"{campaign.seconds:.1f} s,", campaign.calls.total(), "calls,", dict(campaign.counts), flush=True)
    return found


def table(found: Mapping[str, Campaign]) -> str:
    """Return what happened as a table in Markdown."""
    columns = {
        "killed": ("killed: killed",),
        "disk full, told in a line": ("full: told",),
        "disk full, not needed": ("full: done",),
        "kept elsewhere": ("kept elsewhere",),
        "in a crowd": ("crowded: done", "crowded: told", "crowded: killed"),
        "folders brought to their end": ("same results",),
    }
    lines = [f"| job | {' | '.join(columns)} | faults |", f"|---|{'---:|' * (len(columns) + 1)}"]
    for name, campaign in found.items():
        numbers = [sum(campaign.counts[each] for each in parts) for parts in columns.values()]
        lines.append(f"| {name} | {' | '.join(map(str, numbers))} | {len(campaign.faults)} |")
    return "".join(f"{line}\n" for line in lines)


def main(
    kills: int = 200,
    fills: int | None = None,
    crowds: int = 28,
    names: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    seed: int = 0,
    page: Path | None = None,
) -> int:
    """Run the campaign, print a table, and return 1 if anything was wrong.

    Args:
        kills: Processes that are killed, of all jobs together.
        fills: Disks that run full; by default one at each call that writes a file, and as many at random.
        crowds: Folders in which several work at once.
        names: Jobs; all by default.
        seed: Of where and when there is trouble.
        page: Page to write the table into, between its markers.
    """
    os.environ["OMP_NUM_THREADS"] = "1"  # before torch is loaded: threads of OpenMP do not survive a fork
    work = Path(tempfile.mkdtemp(prefix="kill-"))
    found = run(kills, fills, crowds, names, seed, work)
    faults = [fault for campaign in found.values() for fault in campaign.faults]
    print(table(found), *faults, sep="\n")
    if page:
        from docs.make.pages import write_block

        write_block(page, "kill", table(found))
    if not faults:
        shutil.rmtree(work)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
