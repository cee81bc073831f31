"""Mutation: small faults in physics, task, scores, file readers and records, and whether a test notices each of them.

    python -m tests.campaigns.mutation --size 1000 --processes 2 --write

Draws faults by a seed (``mutants.py`` has the operators), puts one at a time into a copy of the checkout, and runs the
tests that reach its line, the quickest first, until one fails. Nothing is compiled, so a fault in a kernel costs no
compilation, and each run is forked from a process that has loaded the libraries.

First, each test file runs once unchanged: which test reaches which line, and how long it takes. Tests that take longer
than ``--limit`` seconds of processor time as plain Python, or need the compiler, play no part. What was found is kept
in the work folder until a source or that test file changes.

A fault that no test notices is equal if ``equal_mutants.toml`` has it, with the reason, and survives otherwise.
"""

import fnmatch
import hashlib
import importlib
import json
import math
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tomllib
import traceback
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import coverage
import hypothesis
import pytest
import tyro
from _pytest.runner import runtestprotocol

from .choosing import Case, choose, file_of, function_of
from .mutants import Mutant, mutants_of

hypothesis.settings.register_profile("campaign", deadline=None, derandomize=True, database=None)

ROOT = Path(__file__).parents[2]
EQUAL = Path(__file__).with_name("equal_mutants.toml")

ROOMS = {
    "physics": ["pter_gym/_physics/*.py", "pter_gym/hands/_model.py"],
    "task": [
        "pter_gym/tasks/path_following/*.py",
        "pter_gym/paths/*.py",
        *(f"pter_gym/_engine/{name}.py" for name in ("episode", "hand", "recording", "sensing", "starts", "step")),
    ],
    "scores": [
        f"pter_gym/benchmark/*{name}.py"
        for name in ("measures", "metrics", "pacing", "ranking", "recorded", "statistics", "trajectories")
    ],
    "readers": [
        *(f"pter_gym/_internal/{name}.py" for name in ("checks", "codec", "files", "tables")),
        *(f"pter_gym/benchmark/*{name}.py" for name in ("episodes", "results", "run_files")),
        *(f"pter_gym/policies/*{name}.py" for name in ("cards", "files", "network", "stored_gains")),
        "pter_gym/params/_preset.py",
    ],
    "records": ["pter_gym/_compiled/layout.py", "pter_gym/_compiled/records.py"],
}
"""What may get a fault: every file of these patterns."""

TESTS = [
    "tests/test_*.py",
    *(f"tests/{room}/test_*.py" for room in ("benchmark", "compiled", "conformance", "policies", "properties")),
    "tests/verification/test_*.py",
]
"""Test files that may notice one."""

ALIKE = [
    *("-n0", "-q", "--tb=line", "-p", "no:cacheprovider", "--hypothesis-profile=campaign"),
    *("-W", "ignore::RuntimeWarning", "-W", "ignore::pytest.PytestAssertRewriteWarning"),
    *("-m", "not gpu and not agents and not long"),
]
"""Options of all runs of pytest."""

LIBRARIES = "numpy scipy.optimize scipy.stats numba gymnasium matplotlib.figure rich safetensors.numpy"
MEASURING = 900.0
"""Processor time [s] in which a test file has to be measured."""

WAITING = 10
"""How much longer than its processor time a run may take by the clock."""

LIMITS = {resource.RLIMIT_AS: 8 << 30, resource.RLIMIT_FSIZE: 512 << 20}
"""What a run may take of memory and disk, in bytes."""


@dataclass(frozen=True)
class Outcome:
    """What became of a fault: killed, equal, survived, or unreached by all tests."""

    mutant: Mutant
    outcome: str
    by: str = ""


class Measuring:
    """A plugin of pytest: runs each test in a process of its own, with a limit [s]; keeps time and reached lines."""

    def __init__(self, limit: float, files: list[str]) -> None:
        self.limit, self.files = math.ceil(limit), files
        self.found: dict[str, tuple[float, dict[str, list[int]]]] = {}
        self.slow: set[str] = set()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> bool:
        if function_of(item.nodeid) in self.slow:
            return True
        reached = Path("reached.json")
        reached.unlink(missing_ok=True)
        pid = os.fork()
        if pid == 0:
            try:
                self._run(item, reached)
            finally:
                os._exit(0)
        _, status, usage = os.wait4(pid, 0)
        if os.WIFSIGNALED(status):
            self.slow.add(function_of(item.nodeid))
        elif reached.exists():
            self.found[item.nodeid] = usage.ru_utime + usage.ru_stime, json.loads(reached.read_text("utf-8"))
        return True

    def _run(self, item: pytest.Item, reached: Path) -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (self.limit, self.limit))
        signal.alarm(WAITING * self.limit)
        tracer = coverage.Coverage(data_file=None, include=self.files, config_file=False)
        tracer.set_option("run:disable_warnings", ["no-data-collected"])  # a test of constants reaches no line
        tracer.start()
        reports = runtestprotocol(item, log=False)
        tracer.stop()
        if len(reports) == 3 and all(report.passed for report in reports):
            data = tracer.get_data()
            lines = {file: data.lines(str(Path(file).resolve())) or [] for file in self.files}
            reached.write_text(json.dumps({file: found for file, found in lines.items() if found}), "utf-8")


class Selection:
    """A plugin of pytest that keeps chosen tests, in their order, and notes the first that fails."""

    def __init__(self, names: list[str], note: Path) -> None:
        self.order = {name: place for place, name in enumerate(names)}
        self.note = note

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        chosen = [item for item in items if item.nodeid in self.order]
        items[:] = sorted(chosen, key=lambda item: self.order[item.nodeid])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.note.write_text(report.nodeid, "utf-8")


class Campaign:
    """Copies of a checkout, one for each process, and what runs in them."""

    def __init__(self, root: Path, work: Path, processes: int = 1) -> None:
        self.root, self.work = root, work
        self.copies = [work / f"copy-{number}" for number in range(processes)]
        listed = ["git", "-C", str(root), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(listed, check=True, capture_output=True).stdout.decode().split("\0")
        self.names = [name for name in names if name and (root / name).is_file()]
        for copy in self.copies:
            shutil.rmtree(copy, ignore_errors=True)
            for name in self.names:
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(root / name, copy / name)
        self.writes = 0

    def files(self, patterns: list[str]) -> list[str]:
        """The files of some patterns, without repetition."""
        return list(dict.fromkeys(name for pattern in patterns for name in fnmatch.filter(self.names, pattern)))

    def measure(self, tests: list[str], files: list[str], limit: float) -> list[Case]:
        """Run each test file once: which test reaches which line of some files, and how long it takes."""
        others = [
            name for name in self.names if name.endswith(".py") and not name.startswith(("docs/", "tests/campaigns/"))
        ]
        others = [name for name in others if not Path(name).name.startswith("test_")]
        sources = self._digest(others, str((files, limit)))
        stored = {test: self.work / f"{self._digest([test], sources)}.json" for test in tests}

        def run(test: str, copy: Path) -> int:
            def body() -> int:
                measuring = Measuring(limit, files)
                pytest.main([*ALIKE, test, f"--basetemp={copy / 'tmp'}"], plugins=[measuring])
                (copy / "measured.json").write_text(json.dumps(measuring.found), "utf-8")
                return 0

            return self._fork(copy, body, MEASURING)

        def keep(test: str, copy: Path, status: int, seconds: float) -> None:
            if status == 0:
                (copy / "measured.json").replace(stored[test])
            ended = f", ended with {status}: none of its tests count" if status else ""
            print(f"{test}: {seconds:.0f} s{ended}", flush=True)

        self._run_all([test for test in tests if not stored[test].exists()], run, keep)
        return [
            Case(name, seconds, {file: frozenset(lines) for file, lines in reached.items()})
            for test in tests
            if stored[test].exists()
            for name, (seconds, reached) in json.loads(stored[test].read_text("utf-8")).items()
        ]

    def try_all(self, chosen: list[tuple[Mutant, list[Case]]]) -> list[Outcome]:
        """Run the tests that are chosen for each fault, and tell which one notices it."""
        outcomes = [Outcome(mutant, "unreached") for mutant, cases in chosen if not cases]

        def run(job: tuple[Mutant, list[Case]], copy: Path) -> int:
            mutant, cases = job
            self._write(copy / mutant.file, mutant.source)
            (copy / "failed.txt").unlink(missing_ok=True)

            def body() -> int:
                files = list(dict.fromkeys(file_of(case.name) for case in cases))
                selection = Selection([case.name for case in cases], copy / "failed.txt")
                return int(pytest.main([*ALIKE, "-x", *files, f"--basetemp={copy / 'tmp'}"], plugins=[selection]))

            return self._fork(copy, body, 10.0 + 2.0 * sum(case.seconds for case in cases))

        def judge(job: tuple[Mutant, list[Case]], copy: Path, status: int, seconds: float) -> None:
            mutant, failed = job[0], copy / "failed.txt"
            self._write(copy / mutant.file, (self.root / mutant.file).read_text("utf-8"))
            by = failed.read_text("utf-8") if failed.exists() else f"status {status}"
            outcomes.append(Outcome(mutant, "killed", by) if status else Outcome(mutant, "survived"))
            print(f"{len(outcomes)}: {outcomes[-1].outcome} {seconds:.1f} s: {mutant.name}", flush=True)

        self._run_all([job for job in chosen if job[1]], run, judge)
        return outcomes

    def _digest(self, names: list[str], more: str) -> str:
        found = hashlib.sha256(more.encode())
        for name in names:
            found.update(name.encode() + (self.root / name).read_bytes())
        return found.hexdigest()[:16]

    def _write(self, path: Path, source: str) -> None:
        """Write a source with a time of its own, by which Python knows compiled files."""
        self.writes += 1
        path.write_text(source, "utf-8")
        os.utime(path, (self.writes, self.writes))

    def _fork(self, copy: Path, body: Callable[[], int], seconds: float) -> int:
        """Start a process in a copy, with limits on time, memory and files; return its number."""
        pid = os.fork()
        if pid:
            return pid
        code = 70
        try:
            os.setpgid(0, 0)
            os.chdir(copy)
            log = os.open(copy / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(log, 1)
            os.dup2(log, 2)
            cpu = math.ceil(seconds)
            for what, most in {**LIMITS, resource.RLIMIT_CPU: cpu}.items():
                resource.setrlimit(what, (most, most))
            signal.alarm(WAITING * cpu)
            paths = [str(copy), str(copy / "agents")]
            sys.path[:0] = paths
            os.environ["PYTHONPATH"] = os.pathsep.join(paths)
            code = body()
        except BaseException:  # noqa: BLE001 - the parent's code must never run here
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)

    def _run_all(self, jobs: list[Any], run: Callable[[Any, Path], int], end: Callable[..., None]) -> None:
        """Run jobs in a process for each copy: ``run`` starts one, ``end`` gets its status and seconds."""
        free, waiting, running = list(self.copies), deque(jobs), {}
        while waiting or running:
            while waiting and free:
                job, copy = waiting.popleft(), free.pop()
                running[run(job, copy)] = job, copy
            pid, status, usage = os.wait4(-1, 0)
            job, copy = running.pop(pid)
            with suppress(ProcessLookupError):  # what a test started ends with it
                os.killpg(pid, signal.SIGKILL)
            end(job, copy, status, usage.ru_utime + usage.ru_stime)
            free.append(copy)


def known_equal() -> dict[str, str]:
    """Faults that change no result, and why."""
    entries = tomllib.loads(EQUAL.read_text("utf-8"))["equal"]
    return {entry["mutant"]: entry["why"] for entry in entries}


def sample(campaign: Campaign, rooms: list[str], size: int, seed: int) -> dict[str, list[Mutant]]:
    """Faults of each room, drawn from all of them together."""

    def of(file: str) -> list[Mutant]:
        return mutants_of(file, (campaign.root / file).read_text("utf-8"))

    found = {room: [each for file in campaign.files(ROOMS[room]) for each in of(file)] for room in rooms}
    every = [mutant for mutants in found.values() for mutant in mutants]
    drawn = set(random.Random(seed).sample([mutant.name for mutant in every], min(size, len(every))))
    return {room: [mutant for mutant in mutants if mutant.name in drawn] for room, mutants in found.items()}


def share(killed: int, counted: int) -> str:
    """A share in % with its 95 % interval (Wilson)."""
    if not counted:
        return ""
    z, p = 1.96, killed / counted
    centre = (p + z * z / (2 * counted)) / (1 + z * z / counted)
    half = z * math.sqrt(p * (1 - p) / counted + (z / (2 * counted)) ** 2) / (1 + z * z / counted)
    return f"{100 * p:.1f} ({100 * (centre - half):.1f} … {100 * (centre + half):.1f})"


def counted(drawn: dict[str, list[Mutant]], outcomes: list[Outcome]) -> list[list[str]]:
    """A row for each room, and for all."""
    became = {outcome.mutant.name: outcome.outcome for outcome in outcomes}
    counts = {room: Counter(became[mutant.name] for mutant in mutants) for room, mutants in drawn.items()}
    counts["all"] = sum(counts.values(), Counter())
    rows: list[list[str]] = []
    for room, count in counts.items():
        cells = [count.total(), *(count[kind] for kind in ("killed", "equal", "survived", "unreached"))]
        rows.append([room, *map(str, cells), share(count["killed"], count.total() - count["equal"])])
    return rows


def main(
    size: int = 1000,
    seed: int = 0,
    rooms: tuple[str, ...] = tuple(ROOMS),
    tests: tuple[str, ...] = tuple(TESTS),
    processes: int = 1,
    limit: float = 4.0,
    budget: float = 40.0,
    work: Path = Path("pter-mutation"),
    least: float = 0.95,
    again: bool = False,
    write: bool = False,
) -> int:
    """Run a campaign, print its table and what survived, and return 1 if too many did.

    Args:
        size: How many faults.
        seed: Of the draw.
        rooms: Where they are.
        tests: Patterns of the files that may notice them.
        processes: How many run at once.
        limit: Of one test, in seconds of processor time.
        budget: Of the tests of one fault, likewise.
        work: Folder for copies and what was found.
        least: Share that must be killed.
        again: Try only what the last run in the work folder did not kill: tests or entries were added since.
        write: Put the table into docs/robustness.md.
    """
    os.environ.update(NUMBA_DISABLE_JIT="1", OMP_NUM_THREADS="1", MPLBACKEND="Agg")
    for library in LIBRARIES.split():
        importlib.import_module(library)
    assert "pter_gym" not in sys.modules, "processes that are forked would not load the package with its fault"
    campaign = Campaign(ROOT, work.resolve(), processes)
    drawn = sample(campaign, list(rooms), size, seed)
    files = campaign.files(list(tests))
    cases = campaign.measure(files, campaign.files([pattern for room in ROOMS.values() for pattern in room]), limit)

    equal = known_equal()
    mutants = [mutant for mutants in drawn.values() for mutant in mutants]
    last = json.loads((campaign.work / "outcomes.json").read_text("utf-8")) if again else []
    killed_by = {
        each["mutant"]: each["by"] for each in last if each["outcome"] == "killed" and each["mutant"] not in equal
    }
    texts = {test: (ROOT / test).read_text("utf-8") for test in files}
    left = [mutant for mutant in mutants if mutant.name not in equal and mutant.name not in killed_by]
    chosen = [(mutant, choose(mutant, cases, budget, texts)) for mutant in left]
    unchanged = [(replace(each, source=(ROOT / each.file).read_text("utf-8")), found) for each, found in chosen[:3]]
    if any(outcome.outcome == "killed" for outcome in campaign.try_all(unchanged)):
        sys.exit("tests fail without a fault")
    outcomes = [Outcome(mutant, "equal") for mutant in mutants if mutant.name in equal] + campaign.try_all(chosen)
    outcomes += [Outcome(each, "killed", killed_by[each.name]) for each in mutants if each.name in killed_by]

    lost = [outcome for outcome in outcomes if outcome.outcome in ("survived", "unreached")]
    killed = sum(outcome.outcome == "killed" for outcome in outcomes)
    plain = [{"mutant": found.mutant.name, "outcome": found.outcome, "by": found.by} for found in outcomes]
    (campaign.work / "outcomes.json").write_text(json.dumps(plain, indent=1, ensure_ascii=False), "utf-8")
    print(*(f"{outcome.outcome}: {outcome.mutant.name}" for outcome in lost), sep="\n")
    from .reports import put, table

    header = ["Room", "Faults", "Killed", "Equal", "Survived", "Reached by no test", "Killed of those that matter, %"]
    put("mutation", table(header, counted(drawn, outcomes)), write=write)
    return int(killed < least * (killed + len(lost)))


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
