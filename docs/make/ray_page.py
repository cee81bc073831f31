"""Put the scripts of agents/at_scale into docs/at-scale.md, and how fast two workers of Ray are beside one alone.

    python docs/make/ray_page.py              the scripts
    python docs/make/ray_page.py --measured   the scripts, then the table, in some minutes of two idle cores

Each worker has a core of its own. In each turn the first works alone, then the second, then both at once on the same
episodes as before; the median of the turns counts. Needs what agents/at_scale/requirements.txt names, and psutil.
"""

import os
import statistics
import sys
from collections.abc import Sequence
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


def rates(crew: Sequence[Any], worlds: int, which: Sequence[int]) -> Speeds:
    """Let some workers work at once, each on its own share of the episodes."""
    import ray

    return [speed for _, speed in ray.get([crew[k].episodes.remote(k * worlds) for k in which])]


def measure(worlds: int, turns: int, policy: str) -> list[tuple[Speeds, Speeds]]:
    """Return the speeds of two workers in each turn: each alone, then at once."""
    import ray

    sys.path.append(str(SCRIPTS))
    from ray_rollouts import Worker

    cores = sorted(os.sched_getaffinity(0))[:2]
    ray.init(num_cpus=2, include_dashboard=False, _node_ip_address="127.0.0.1")
    crew: list[Any] = [Worker.remote(worlds, policy) for _ in cores]
    ray.get(
        [
            worker.__ray_call__.remote(lambda _, core=core: os.sched_setaffinity(0, {core}))
            for worker, core in zip(crew, cores, strict=True)
        ]
    )
    found = [
        ([*rates(crew, worlds, (0,)), *rates(crew, worlds, (1,))], rates(crew, worlds, (0, 1))) for _ in range(turns)
    ]
    ray.shutdown()
    return found


def measured_block(found: list[tuple[Speeds, Speeds]], worlds: int, policy: str, taken: float) -> str:
    """Return the table of what was measured, and with what."""
    rows = []
    for k in range(2):
        alone, together = ([turn[part][k] for turn in found] for part in range(2))
        ratios = [both / one for one, both in zip(alone, together, strict=True)]
        share = f"{statistics.median(ratios):.2f} ({min(ratios):.2f} … {max(ratios):.2f})"
        rows.append([f"{k + 1}", *(f"{statistics.median(each):,.0f}" for each in (alone, together)), share])
    text = f"{worlds} worlds for each worker under `{policy}`, medians of {len(found)} turns, in brackets all ratios."
    if taken > ALLOWED:
        text += f" The machine was not idle: before the measurement other processes took {taken:.0f} % of its cores."
    head = ["Worker", "Alone [control steps/s]", "Both at once [control steps/s]", "Ratio"]
    return f"{table(head, rows)}\n{fill(text, 120)}\n"


def main(measured: bool = False, worlds: int = 128, turns: int = 15, policy: str = "residual") -> None:
    """Write the scripts, and what is measured if that is asked for."""
    for script in sorted(SCRIPTS.glob("*.py")):
        write_block(PAGE, script.stem, f"```python\n{script.read_text('utf-8')}```\n")
    if measured:
        import psutil

        taken = psutil.cpu_percent(interval=10.0)
        write_block(PAGE, "measured", measured_block(measure(worlds, turns, policy), worlds, policy, taken))


if __name__ == "__main__":
    tyro.cli(main)
