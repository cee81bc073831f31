"""Put the scripts of agents/at_scale into docs/at-scale.md, and how fast two workers of Ray are beside one alone.

    python docs/make/ray_page.py              the scripts
    python docs/make/ray_page.py --measured   the scripts, then the table, in some minutes of two idle cores

Each worker has a core of its own. In each turn the first works alone, then the second, then both at once on the same
episodes as before; the median of the turns counts. Two processes without Ray do the same before, which tells what is
due to the machine. Needs what agents/at_scale/requirements.txt names, and psutil.
"""

import multiprocessing
import os
import statistics
import sys
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from textwrap import fill
from typing import Any

import tyro
from pages import ROOT, table, write_block

PAGE = ROOT / "docs" / "at-scale.md"
SCRIPTS = ROOT / "agents" / "at_scale"
ALLOWED = 5.0
"""Share of the cores [%] that other processes may take of a machine that counts as idle."""

Speeds = list[float]
"""Control steps a second of each worker."""


class Plain:
    """A worker in a process of its own, without Ray."""

    def __init__(self, core: int, worlds: int, policy: str) -> None:
        own = multiprocessing.get_context("spawn")
        self.pipe, other = own.Pipe()
        own.Process(target=serve, args=(other, core, worlds, policy), daemon=True).start()

    def start(self, seed: int) -> None:
        """Begin with some episodes."""
        self.pipe.send(seed)

    def speed(self) -> float:
        """Wait until they have ended [control steps/s]."""
        return self.pipe.recv()


class OnRay:
    """The same worker as an actor of Ray."""

    def __init__(self, core: int, worlds: int, policy: str) -> None:
        self.worker: Any = worker_class().remote(worlds, policy)
        self.wait(self.worker.__ray_call__.remote(lambda _: os.sched_setaffinity(0, {core})))

    def start(self, seed: int) -> None:
        """Begin with some episodes."""
        self.found = self.worker.episodes.remote(seed)

    def speed(self) -> float:
        """Wait until they have ended [control steps/s]."""
        return self.wait(self.found)[1]

    @staticmethod
    def wait(reference: Any) -> Any:
        """Return what Ray has found."""
        import ray

        return ray.get(reference)


def worker_class() -> Any:
    """Return the actor class of the script."""
    sys.path.append(str(SCRIPTS))
    from ray_rollouts import Worker

    return Worker


def serve(pipe: Connection, core: int, worlds: int, policy: str) -> None:
    """Be a worker without Ray until the parent ends."""
    os.sched_setaffinity(0, {core})
    worker = worker_class().__ray_metadata__.modified_class(worlds, policy)
    with suppress(EOFError):
        while True:
            pipe.send(worker.episodes(pipe.recv())[1])


def rates(crew: Sequence[Plain | OnRay], worlds: int, which: Sequence[int]) -> Speeds:
    """Let some workers work at once, each on its own share of the episodes."""
    for k in which:
        crew[k].start(k * worlds)
    return [crew[k].speed() for k in which]


def measure(crew: Sequence[Plain | OnRay], worlds: int, turns: int) -> list[tuple[Speeds, Speeds]]:
    """Return the speeds of two workers in each turn: each alone, then at once."""
    rates(crew, worlds, (0, 1))
    return [
        ([*rates(crew, worlds, (0,)), *rates(crew, worlds, (1,))], rates(crew, worlds, (0, 1))) for _ in range(turns)
    ]


def measured_rows(name: str, found: list[tuple[Speeds, Speeds]]) -> list[list[str]]:
    """Return a line for each worker."""
    rows = []
    for k in range(2):
        alone, together = ([turn[part][k] for turn in found] for part in range(2))
        ratios = [both / one for one, both in zip(alone, together, strict=True)]
        share = f"{statistics.median(ratios):.2f} ({min(ratios):.2f} … {max(ratios):.2f})"
        rows.append([f"{name}, {k + 1}", *(f"{statistics.median(each):,.0f}" for each in (alone, together)), share])
    return rows


def write_measured(worlds: int, turns: int, policy: str) -> None:
    """Measure without Ray, then with it, and write the table."""
    import psutil
    import ray

    taken = psutil.cpu_percent(interval=10.0)
    cores = sorted(os.sched_getaffinity(0))[:2]
    rows = measured_rows("process", measure([Plain(core, worlds, policy) for core in cores], worlds, turns))
    ray.init(num_cpus=2, include_dashboard=False, _node_ip_address="127.0.0.1")
    rows += measured_rows("Ray", measure([OnRay(core, worlds, policy) for core in cores], worlds, turns))
    ray.shutdown()
    text = f"{worlds} worlds for each worker under `{policy}`, medians of {turns} turns, in brackets all ratios."
    text += f" The machine has {os.cpu_count()} cores."
    if taken > ALLOWED:
        text += f" It was not idle: before the measurement other processes took {taken:.0f} % of them."
    head = ["Worker", "Alone [control steps/s]", "Both at once [control steps/s]", "Ratio"]
    write_block(PAGE, "measured", f"{table(head, rows)}\n{fill(text, 120)}\n")


def main(measured: bool = False, worlds: int = 128, turns: int = 15, policy: str = "residual") -> None:
    """Write the scripts, and what is measured if that is asked for."""
    for script in sorted(SCRIPTS.glob("*.py")):
        write_block(PAGE, script.stem, f"```python\n{script.read_text('utf-8')}```\n")
    if measured:
        write_measured(worlds, turns, policy)


if __name__ == "__main__":
    tyro.cli(main)
