"""What policies in C cost and how they score: memory, time, and episodes in which the compiled
program drives the arm.

    python benchmarks/deploy.py [--quick]

takes about ten minutes; it needs PyPI's ``ziglang``. The tables are in docs/deploy.md.

A program gets observations over a pipe, one process for each world. For uneven periods and delays
the worlds have control steps of 1 ms, and a program is asked about every tenth: each time up to 1
ms earlier or later, if the period is uneven, and its voltages are applied a period later, if there
is a delay."""

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pter_gym.benchmark import find_policy
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.benchmark.rollout import record_episode
from pter_gym.benchmark.runs import evaluate
from pter_gym.controllers import Policy
from pter_gym.tools.deploy import Source, source_of

HERE = Path(__file__).parent
POLICIES = ("residual", "ppo-standard", "torque-feedback-tuned", "single-dof-tuned", "impedance")
NETWORKS = POLICIES[:2]
TYPES = (("double", "float"), ("float", "float"), ("float", "int8"))
PERIOD = 10  # ms
MICROCONTROLLER = ("-target", "thumb-freestanding-eabihf", "-mcpu")
CPUS = ("cortex_m4", "cortex_m4+vfp4d16sp")
TIMINGS = {"exact": (0, 0), "± 1 ms": (1, 0), "a period late": (0, PERIOD), "both": (1, PERIOD)}


def zig(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "ziglang", *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True, **options)


@contextmanager
def folder_of(source: Source) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        yield source.write(folder)


def program(folder: Path, main: Path) -> Path:
    zig("cc", "-std=gnu99", "-O2", "-I", folder, main, folder / "pter.c", "-o", folder / "program")
    return folder / "program"


def memory(folder: Path, cpu: str) -> tuple[int, int, int]:
    """Flash, static RAM and the sum of all stack frames [B] of a microcontroller's program."""
    elf = folder / "program.elf"
    target = (*MICROCONTROLLER, cpu)
    files = ("-cflags", "-std=c99", "--", HERE / "deploy.c", folder / "pter.c")
    zig(
        "build-exe",
        *target,
        "-O",
        "ReleaseFast",
        "-fstrip",
        "-I",
        folder,
        *files,
        f"-femit-bin={elf}",
    )
    told = zig(
        "cc",
        *target[:2],
        f"-mcpu={cpu}",
        "-O2",
        "-std=c99",
        "-Wframe-larger-than=0",
        "-c",
        folder / "pter.c",
        "-o",
        folder / "pter.o",
    )
    frames = sum(map(int, re.findall(r"stack frame size \((\d+)\)", told.stderr)))
    data = elf.read_bytes()
    first, size, count = (int.from_bytes(data[at : at + 2], "little") for at in (28, 42, 44))
    headers = np.frombuffer(data, "<u4", count * size // 4, first).reshape(count, -1)
    loaded = headers[
        headers[:, 0] == 1
    ]  # PT_LOAD: type, offset, addresses, size in the file, in memory, flags
    writable = (loaded[:, 6] & 2) != 0
    return int(loaded[:, 4].sum()), int(loaded[writable, 5].sum()), frames


def costs(observations: Any) -> None:
    print(
        "| policy | numbers | weights | step, median / worst [µs] "
        "| M4 flash, RAM, stack [kB] | with FPU [kB] |"
    )
    print("|---|---|---|---|---|---|")
    for name in POLICIES:
        for numbers, weights in TYPES if name in NETWORKS else TYPES[:2]:
            source = source_of(find_policy(name), name=name, numbers=numbers, weights=weights)
            rows = np.ascontiguousarray(observations[:, : len(source.policy.layout)])
            with folder_of(source) as folder:
                times = subprocess.run(
                    [program(folder, HERE / "deploy.c")],
                    input=rows.tobytes(),
                    capture_output=True,
                    check=True,
                )
                median, worst = (float(each) / 1e3 for each in times.stdout.split())
                kilobytes = (
                    " / ".join(f"{each / 1e3:.1f}" for each in memory(folder, cpu)) for cpu in CPUS
                )
                kind = weights if name in NETWORKS else "-"
                print(
                    f"| {name} | {numbers} | {kind} | {median:.1f} / {worst:.1f} "
                    f"| {' | '.join(kilobytes)} |",
                    flush=True,
                )


class Compiled:
    """A policy in another process."""

    def __init__(self, path: Path, entries: int) -> None:
        self.process = subprocess.Popen(
            [path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.entries = entries

    def reset(self) -> None:
        self.process.stdin.write("\n")

    def __call__(self, observation: Any) -> Any:
        self.process.stdin.write(
            ",".join(f"{each:.9g}" for each in observation[: self.entries]) + "\n"
        )
        self.process.stdin.flush()
        return np.array(self.process.stdout.readline().split(","), np.float32)

    def close(self) -> None:
        self.process.communicate()


class Timed:
    """One program for each world, asked every ``period`` control steps, give or take ``jitter``.

    Its voltages come ``delay`` control steps later.
    """

    def __init__(
        self, programs: list[Any], period: int = 1, jitter: int = 0, delay: int = 0
    ) -> None:
        self.programs = programs
        self.period, self.jitter, self.delay = period, jitter, delay

    def bind(self, machine: Any, layout: Any) -> Policy:
        return Policy.of_function(self.act, layout, start=self.start)

    def start(self, worlds: int) -> Any:
        """Begin episodes in all worlds; the programs remember them."""
        for program in self.programs:
            program.reset()
        self.random = np.random.default_rng(0)
        self.step = 0
        self.decided = np.zeros(len(self.programs), int)
        self.due = np.zeros(len(self.programs), int)
        self.volts = np.zeros((len(self.programs), 4), np.float32)
        self.pending: list[tuple[int, int, Any]] = []
        return None

    def act(self, observations: Any, memory: Any) -> Any:
        for world, row in enumerate(observations):
            if self.step >= self.due[world]:
                self.pending.append((self.step + self.delay, world, self.programs[world](row)))
                self.decided[world] += 1
                late = self.random.integers(-self.jitter, self.jitter + 1)
                self.due[world] = self.decided[world] * self.period + late
        for when, world, volts in self.pending:
            if when <= self.step:
                self.volts[world] = volts
        self.pending = [each for each in self.pending if each[0] > self.step]
        self.step += 1
        return self.volts.copy()


def told(scores: Any) -> str:
    return f"{1e3 * scores['path_error_m'].mean():.3f} / {scores['completed'].mean():.0%}"


def closed_loop(episodes: Episodes) -> None:
    fine = replace(
        episodes,
        tasks=tuple(replace(task, control_period=1e-3) for task in episodes.tasks),
        limits=(),
    )
    print("| policy | Python | C, double | C, float | C, float, int8 |\n|---|---|---|---|---|")
    timed: list[str] = []
    for name in POLICIES:
        python = find_policy(name)
        cells = [told(evaluate(python, episodes))]
        for numbers, weights in TYPES if name in NETWORKS else TYPES[:2]:
            source = source_of(python, name=name, numbers=numbers, weights=weights)
            with folder_of(source) as folder, ExitStack() as stack:
                path, entries = program(folder, folder / "main.c"), len(source.policy.layout)
                programs = [Compiled(path, entries) for _ in range(len(episodes))]
                for each in programs:
                    stack.callback(each.close)
                cells.append(told(evaluate(Timed(programs), episodes)))
                if numbers == "double":
                    times = [Timed(programs, PERIOD, *timing) for timing in TIMINGS.values()]
                    timed.append(
                        f"| {name} | "
                        + " | ".join(told(evaluate(each, fine)) for each in times)
                        + " |"
                    )
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print("\n| policy | " + " | ".join(TIMINGS) + " |\n|" + "---|" * (1 + len(TIMINGS)))
    print("\n".join(timed))


if __name__ == "__main__":
    standard = find_episodes("standard", "medium").first(10 if "--quick" in sys.argv else 64)
    task = standard.tasks[0]
    costs(record_episode(find_policy("residual"), standard.machines[0], task, 0).obs)
    print(flush=True)
    closed_loop(standard)
