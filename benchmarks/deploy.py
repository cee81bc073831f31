"""What policies in C cost on a microcontroller, and how they score: instructions, memory, and
episodes in which the compiled program drives the arm.

    python benchmarks/deploy.py [--quick]

takes one or two minutes. It needs Debian's ``gcc-arm-none-eabi`` and ``qemu-system-arm``, and a C
compiler or PyPI's ``ziglang``. The tables are in docs/development/exported-c.md.

The microcontroller is QEMU's Cortex-M4F, which counts instructions, not cycles. In the episodes a
program gets observations over a pipe, one process for each world. For uneven periods and delays the
worlds have control steps of 1 ms, and a program is asked about every tenth: each time up to 1 ms
earlier or later, if the period is uneven, and its voltages are applied a period later, if there is
a delay.
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pter_gym.benchmark import find_policy
from pter_gym.benchmark.episodes import Episodes, find_episodes
from pter_gym.benchmark.rollout import evaluate, record_episode
from pter_gym.controllers import Policy
from pter_gym.tools.deploy import Source, source_of
from pter_gym.tools.hil.session import follow

HERE = Path(__file__).parent
NETWORKS = ("residual", "ppo-standard", "universal", "universal+detector")
POLICIES = (*NETWORKS, "torque-feedback-tuned", "single-dof-tuned", "impedance")
TYPES = (("double", "float"), ("float", "float"), ("float", "int8"))
PERIOD = 10  # ms
TIMINGS = {"exact": (0, 0), "± 1 ms": (1, 0), "a period late": (0, PERIOD), "both": (1, PERIOD)}

ARM = "-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard -std=c99 -O2"
BARE = "-ffreestanding -nostartfiles -Wl,-e,start,-Ttext=0x08000100,-Tbss=0x20000000"
MACHINE = "-M netduinoplus2 -display none -monitor none"
CLOCK = 168e6  # of this machine [Hz]
PER_TICK = 1e9 / CLOCK  # instructions, of 1 ns each with QEMU's -icount shift=0
CYCLES = 2  # for an instruction, at most, but for divisions


@contextmanager
def folder_of(source: Source) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        yield source.write(folder)


def program(folder: Path, main: Path) -> Path:
    compiler = ["cc"] if shutil.which("cc") else [sys.executable, "-m", "ziglang", "cc"]
    files = (main, folder / "pter.c", "-o", folder / "program")
    subprocess.run([*compiler, "-std=c99", "-O2", "-I", folder, *files], check=True)
    return folder / "program"


def firmware(folder: Path, *files: Path, serial: bool = False) -> Path:
    """A program for the microcontroller."""
    sections = ["-Wl,--section-start=.vectors=0x08000000", *(["-DSERIAL"] if serial else [])]
    command = ["arm-none-eabi-gcc", *ARM.split(), *BARE.split(), *sections, "-I", folder]
    files = (HERE / "deploy.c", folder / "pter.c", *files)
    subprocess.run([*command, *files, "-o", folder / "firmware"], check=True)
    return folder / "firmware"


class Cost(NamedTuple):
    """Instructions of each control step, for the observation and the law; bytes; voltages."""

    observe: Any
    act: Any
    flash: int
    ram: int
    stack: int
    volts: Any


def rows_of(source: Source, readings: Any, observations: Any) -> Any:
    """An episode's readings and observations, as deploy.c and operations.cc read them."""
    entries = len(source.policy.layout)
    row = np.dtype([("reading", "<f8", 10), ("observation", "<f4", entries)], align=True)
    rows = np.zeros(len(readings), row)
    rows["reading"], rows["observation"] = readings, observations[: len(rows), :entries]
    return rows


def cost(source: Source, readings: Any, observations: Any) -> Cost:
    """What a policy costs on the microcontroller, for an episode's readings and observations."""
    rows = rows_of(source, readings, observations)
    with folder_of(source) as folder:
        elf = firmware(folder)
        size = subprocess.run(
            ["arm-none-eabi-size", elf], check=True, capture_output=True, text=True
        )
        text, data, zeroed = map(int, size.stdout.splitlines()[1].split()[:3])
        (folder / "rows").write_bytes(rows.tobytes())
        options = "-icount shift=0 -semihosting-config enable=on,target=native -kernel"
        command = ["qemu-system-arm", *MACHINE.split(), *options.split(), elf]
        subprocess.run(command, check=True, cwd=folder, timeout=600)
        out = (folder / "out").read_bytes()
    steps = np.frombuffer(out[:-4], [("volts", "<f4", 4), ("ticks", "<u4", 2)])
    stack = int.from_bytes(out[-4:], "little")
    observe, act = PER_TICK * steps["ticks"].T
    return Cost(observe, act, text + data, data + zeroed, stack, steps["volts"])


def recorded(policy: Any, machine: Any, task: Any, seed: int) -> tuple[Any, Any, Any]:
    """Readings, observations and voltages of an episode."""
    episode = record_episode(policy, machine, task, seed)
    readings: list[Any] = []
    volts = iter(episode.volts)

    def decide(reading: Any) -> Any:
        readings.append(reading)
        return next(volts)

    for _ in follow(machine, task, seed, decide):
        pass
    return np.array(readings), episode.obs, episode.volts


def costs(machine: Any, task: Any, seed: int) -> None:
    print(
        "| Policy | Numbers | Weights | Instructions, mean / most | For the observation | "
        "Of 10 ms at 168 MHz | Flash / RAM / stack [kB] | Voltages differ by [mV] |"
    )
    print("|" + "---|" * 8)
    for name in POLICIES:
        policy = find_policy(name)
        for numbers, weights in TYPES if name in NETWORKS else TYPES[:2]:
            source = source_of(policy, name=name, numbers=numbers, weights=weights)
            readings, observations, _ = recorded(source.policy, machine, task, seed)
            found = cost(source, readings, observations)
            rows = np.ascontiguousarray(observations[:, None, : len(source.policy.layout)])
            memory = source.policy.start(1)
            wanted = [np.float32(source.policy.act(row, memory)[0]) for row in rows]
            differ = np.abs(found.volts - wanted[: len(found.volts)]).max()
            whole = found.observe + found.act
            memory = (f"{each / 1e3:.1f}" for each in (found.flash, found.ram, found.stack))
            print(
                f"| `{name}` | {numbers} | {weights if name in NETWORKS else ''} | "
                f"{whole.mean():,.0f} / {whole.max():,.0f} | {found.observe.mean():,.0f} | "
                f"{CYCLES * whole.max() / (CLOCK * PERIOD * 1e-3):.1%} | {' / '.join(memory)} | "
                f"{1e3 * differ:.2g} |",
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
        return Policy.from_function(self.act, layout, start=self.start)

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
        time_limits=(),
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
        cells += [""] * (1 + len(TYPES) - len(cells))
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print("\n| policy | " + " | ".join(TIMINGS) + " |\n|" + "---|" * (1 + len(TIMINGS)))
    print("\n".join(timed))


if __name__ == "__main__":
    standard = find_episodes("standard", "medium").first(10 if "--quick" in sys.argv else 64)
    costs(standard.machines[0], standard.tasks[0], standard.seeds[0])
    print(flush=True)
    closed_loop(standard)
