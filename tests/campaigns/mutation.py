"""Mutation: small faults in physics, task, scores, file readers and records, and whether a test notices each of them.

    python tests/campaigns/mutation.py --size 1000 --processes 2

Draws faults by a seed (``mutants.py`` has the operators), puts one at a time into a copy of the checkout, and runs the
tests that reach its line, the quickest first, until one fails. Nothing is compiled, so a fault in a kernel costs no
compilation, and each run is forked from a process that has loaded the libraries.

First, each test file runs once unchanged: which test reaches which line, and how long it takes. Tests that take longer
than ``--limit`` seconds of processor time as plain Python, or need the compiler, play no part. What was found is kept
in the work folder until a source or that test file changes, and so is which test noticed a fault.

A fault that no test notices is equal if ``equal_mutants.toml`` has it, with the reason, and survives otherwise.
"""

import argparse
import fnmatch
import hashlib
import importlib
import json
import math
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tomllib
import traceback
from collections import Counter, deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import coverage
import hypothesis
import pytest
from _pytest.runner import runtestprotocol

sys.path.insert(0, str(Path(__file__).parent))
from mutants import Mutant, mutants_of

hypothesis.settings.register_profile("campaign", deadline=None, derandomize=True, database=None)

ROOT = Path(__file__).parents[2]
EQUAL = Path(__file__).with_name("equal_mutants.toml")

ROOMS = {
    "physics": ["pter_gym/physics/*.py", "pter_gym/hands/model.py"],
    "task": [
        "pter_gym/tasks/path_following/*.py",
        "pter_gym/paths/*.py",
        *(f"pter_gym/engine/{name}.py" for name in ("episode", "hand", "recording", "sensing", "starts", "step")),
    ],
    "scores": [
        f"pter_gym/benchmark/{name}.py"
        for name in ("measures", "metrics", "pacing", "ranking", "recorded", "statistics", "trajectories")
    ],
    "readers": [
        *(f"pter_gym/internal/{name}.py" for name in ("checks", "codec", "files", "tables")),
        *(f"pter_gym/benchmark/{name}.py" for name in ("episodes", "results", "run_files")),
        *(f"pter_gym/policies/{name}.py" for name in ("cards", "files", "network", "stored_gains")),
        "pter_gym/params/preset.py",
    ],
    "records": ["pter_gym/compiled/layout.py", "pter_gym/compiled/records.py"],
}
"""What may get a fault: every file of these patterns."""

TESTS = [
    "tests/test_*.py",
    *(f"tests/{room}/test_*.py" for room in ("benchmark", "compiled", "conformance", "policies", "properties")),
    "tests/verification/test_*.py",
    "tests/oracle/test_*.py",
]
"""Test files that may notice one."""

BROAD = "tests/conformance/test_traces.py"
"""A test file that looks at all numbers of the simulator: as near to each fault as one that imports its module."""

ALIKE = [
    "-n0",
    "-q",
    "--tb=line",
    "-p",
    "no:cacheprovider",
    "-W",
    "ignore::RuntimeWarning",
    "-W",
    "ignore::pytest.PytestAssertRewriteWarning",
    "-m",
    "not gpu and not agents and not long",
    "--hypothesis-profile=campaign",
]
"""Options of all runs of pytest."""

AHEAD = 8
"""How many further cases of a test function come before one that is a second longer, or before those of the next
nearest files."""

LIBRARIES = "numpy scipy.optimize scipy.stats numba gymnasium matplotlib.figure rich safetensors.numpy"
MEASURING = 900.0
"""Processor time [s] in which a test file has to be measured."""

WAITING = 10
"""How much longer than its processor time a run may take by the clock."""

LIMITS = {resource.RLIMIT_AS: 8 << 30, resource.RLIMIT_FSIZE: 512 << 20}
"""What a run may take of memory and disk, in bytes."""


@dataclass(frozen=True)
class Case:
    """A test that passes without the compiler, how long it takes [s], and the lines that it reaches, by file."""

    name: str
    seconds: float
    lines: dict[str, frozenset[int]]


@dataclass(frozen=True)
class Outcome:
    """What became of a fault: killed, equal, survived, or unreached by all tests."""

    mutant: Mutant
    outcome: str
    by: str
    seconds: float


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
        self.sources = ""
        self.noticed = work / "noticed.txt"

    def files(self, patterns: list[str]) -> list[str]:
        """The files of some patterns, without repetition."""
        return list(dict.fromkeys(name for pattern in patterns for name in fnmatch.filter(self.names, pattern)))

    def measure(self, tests: list[str], files: list[str], limit: float) -> list[Case]:
        """Run each test file once: which test reaches which line of some files, and how long it takes."""
        others = [
            name for name in self.names if name.endswith(".py") and not name.startswith(("docs/", "tests/campaigns/"))
        ]
        others = [name for name in others if not Path(name).name.startswith("test_")]
        self.sources = self._digest(others, str((files, limit)))
        stored = {test: self.work / f"{self._digest([test], self.sources)}.json" for test in tests}

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
            print(
                f"{test}: {seconds:.0f} s{'' if status == 0 else f', ended with {status}: none of its tests count'}",
                flush=True,
            )

        self._run_all([test for test in tests if not stored[test].exists()], run, keep)
        return [
            Case(name, seconds, {file: frozenset(lines) for file, lines in reached.items()})
            for test in tests
            if stored[test].exists()
            for name, (seconds, reached) in json.loads(stored[test].read_text("utf-8")).items()
        ]

    def try_all(self, chosen: list[tuple[Mutant, list[Case]]], *, keep: bool = True) -> list[Outcome]:
        """Run the tests that are chosen for each fault; with ``keep`` tell and remember what notices it."""
        noticed = self._read_noticed() if keep else {}
        outcomes = [Outcome(mutant, "unreached", "", 0.0) for mutant, cases in chosen if not cases]
        known = [mutant for mutant, cases in chosen if cases and mutant.name in noticed]
        outcomes += [Outcome(mutant, "killed", noticed[mutant.name], 0.0) for mutant in known]

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
            mutant = job[0]
            self._write(copy / mutant.file, (self.root / mutant.file).read_text("utf-8"))
            failed = copy / "failed.txt"
            by = failed.read_text("utf-8") if failed.exists() else f"status {status}"
            outcomes.append(Outcome(mutant, "killed" if status else "survived", by if status else "", seconds))
            if keep:
                print(f"{len(outcomes)}: {outcomes[-1].outcome} {seconds:.1f} s: {mutant.name}", flush=True)
            if keep and failed.exists():
                self._write_noticed(mutant.name, by)

        self._run_all([job for job in chosen if job[1] and job[0].name not in noticed], run, judge)
        return outcomes

    def _read_noticed(self) -> dict[str, str]:
        """The test that notices a fault, of those that stand for the present sources."""
        lines = self.noticed.read_text("utf-8").splitlines() if self.noticed.exists() else []
        entries = [line.split("\t") for line in lines]
        return {name: by for key, name, by in entries if key == self._key(by)}

    def _write_noticed(self, name: str, by: str) -> None:
        with self.noticed.open("a", encoding="utf-8") as file:
            file.write(f"{self._key(by)}\t{name}\t{by}\n")

    def _key(self, by: str) -> str:
        """A hash of all sources and of a test's file."""
        file = file_of(by)
        return self._digest([file], self.sources) if (self.root / file).is_file() else ""

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


def file_of(test: str) -> str:
    """The file of a test."""
    return test.partition("::")[0]


def function_of(test: str) -> str:
    """The name of a test without its parameters."""
    return test.partition("[")[0]


def choose(mutant: Mutant, cases: list[Case], budget: float, texts: Mapping[str, str]) -> list[Case]:
    """Tests that reach a fault's statement within a budget [s]; what runs on import is reached by all of its module's.

    Tests in the nearest files come first, and quick ones, and of each function the quickest; further ones wait.
    """
    told = {file: min(nearness(mutant, text), 1 if file == BROAD else 3) for file, text in texts.items()}
    found = [case for case in cases if mutant.file in case.lines]
    if not mutant.at_import:
        found = [case for case in found if not case.lines[mutant.file].isdisjoint(mutant.lines)]
    else:
        near = {file for file, place in told.items() if place < 3}
        found = [case for case in cases if mutant.file in case.lines or file_of(case.name) in near] or cases
    rank: Counter[str] = Counter()
    ordered = []
    for case in sorted(found, key=lambda case: case.seconds):
        place = AHEAD * (told.get(file_of(case.name), 3) + case.seconds) + rank[function_of(case.name)]
        ordered.append((place, case.name, case))
        rank[function_of(case.name)] += 1
    chosen, spent = [], 0.0
    for *_, case in sorted(ordered):
        if chosen and spent + case.seconds > budget:
            break
        chosen.append(case)
        spent += case.seconds
    return chosen


def nearness(mutant: Mutant, text: str) -> int:
    """How near a test file is to a fault, by its text: what it imports, and whether it names what has the fault.

    0 with its module and its name, 1 with its module, 2 with its name, 3 else.
    """
    names = mutant.scope.split(".") if mutant.scope else re.findall(r"^\w+(?=: | = )", mutant.line)
    named = any(re.search(rf"\b{name}\b", text) for name in names if not name.startswith("__"))
    module = Path(mutant.file).with_suffix("").parts
    last, package = module[-1], "[.]".join(module[:-1])
    if re.search(rf"\b{package}[.]{last}\b|\bfrom {package} import [^\n]*\b{last}\b", text):
        return 0 if named else 1
    return 2 if named else 3


def known_equal() -> dict[str, str]:
    """Faults that change no result, and why."""
    entries = tomllib.loads(EQUAL.read_text("utf-8"))["equal"]
    return {entry["mutant"]: entry["why"] for entry in entries}


def sample(campaign: Campaign, rooms: list[str], size: int, seed: int) -> dict[str, list[Mutant]]:
    """Faults of each room, drawn from all of them together."""
    found = {
        room: [
            mutant
            for file in campaign.files(ROOMS[room])
            for mutant in mutants_of(file, (campaign.root / file).read_text("utf-8"))
        ]
        for room in rooms
    }
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


def report(drawn: dict[str, list[Mutant]], outcomes: list[Outcome]) -> str:
    """A table of the rooms."""
    became = {outcome.mutant.name: outcome.outcome for outcome in outcomes}
    rows = {room: Counter(became[mutant.name] for mutant in mutants) for room, mutants in drawn.items()}
    rows["all"] = sum(rows.values(), Counter())
    lines = ["| Room | Faults | Killed | Equal | Survived | Reached by no test | Killed of those that matter, % |"]
    lines.append("|---|---:|---:|---:|---:|---:|---:|")
    for room, count in rows.items():
        cells = [count[kind] for kind in ("killed", "equal", "survived", "unreached")]
        shown = share(count["killed"], count.total() - count["equal"])
        lines.append(f"| {room} | {count.total()} | {' | '.join(map(str, cells))} | {shown} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run a campaign, print its table and what survived."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=1000, help="how many faults")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--rooms", nargs="+", default=list(ROOMS), choices=list(ROOMS))
    parser.add_argument("--tests", nargs="+", default=TESTS, help="patterns of test files")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--limit", type=float, default=4.0, help="of one test, in seconds of processor time")
    parser.add_argument("--budget", type=float, default=40.0, help="of the tests of one fault, likewise")
    parser.add_argument("--work", type=Path, default=Path("pter-mutation"), help="folder for copies and outcomes")
    parser.add_argument("--least", type=float, default=0.95, help="share that must be killed")
    parser.add_argument("--write", action="store_true", help="put the table into docs/robustness.md")
    given = parser.parse_args()

    os.environ.update(NUMBA_DISABLE_JIT="1", OMP_NUM_THREADS="1", MPLBACKEND="Agg")
    for library in LIBRARIES.split():
        importlib.import_module(library)
    campaign = Campaign(ROOT, given.work.resolve(), given.processes)
    drawn = sample(campaign, given.rooms, given.size, given.seed)
    files = campaign.files([pattern for room in ROOMS.values() for pattern in room])
    cases = campaign.measure(campaign.files(given.tests), files, given.limit)

    equal = known_equal()
    mutants = [mutant for mutants in drawn.values() for mutant in mutants]
    texts = {test: (ROOT / test).read_text("utf-8") for test in campaign.files(given.tests)}
    chosen = [(mutant, choose(mutant, cases, given.budget, texts)) for mutant in mutants if mutant.name not in equal]
    unchanged = [
        (replace(mutant, source=(ROOT / mutant.file).read_text("utf-8")), tests) for mutant, tests in chosen[:3]
    ]
    if any(outcome.outcome == "killed" for outcome in campaign.try_all(unchanged, keep=False)):
        sys.exit("tests fail without a fault")
    outcomes = [Outcome(mutant, "equal", "", 0.0) for mutant in mutants if mutant.name in equal]
    outcomes += campaign.try_all(chosen)

    lost = [outcome for outcome in outcomes if outcome.outcome in ("survived", "unreached")]
    killed = sum(outcome.outcome == "killed" for outcome in outcomes)
    text = report(drawn, outcomes)
    print("\n".join(f"{outcome.outcome}: {outcome.mutant.name}" for outcome in lost), text, sep="\n\n")
    plain = [{"mutant": found.mutant.name, "outcome": found.outcome, "by": found.by} for found in outcomes]
    (campaign.work / "outcomes.json").write_text(json.dumps(plain, indent=1, ensure_ascii=False), "utf-8")
    if given.write:
        sys.path.insert(0, str(ROOT / "docs" / "make"))
        from pages import write_block

        write_block(ROOT / "docs" / "robustness.md", "mutation", text)
    sys.exit(killed < given.least * (killed + len(lost)))


if __name__ == "__main__":
    main()
