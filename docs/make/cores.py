"""Runs of a study: a line of a file for each that is finished, and a process on a core of its own for each to come."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue
from threading import Lock
from time import monotonic
from typing import Any

from pter_gym._internal.files import write_text_atomic


def finished(script: Path) -> list[tuple[Any, Any]]:
    """Return the runs of a study and their results, as JSON has them."""
    file = script.with_suffix(".jsonl")
    lines = file.read_text("utf-8").splitlines() if file.exists() else []
    return [(run, result) for run, result in map(json.loads, lines)]


def perform(
    script: Path, done: dict[Any, Any], runs: Iterable[Any], minutes: float, tell: Callable[[Any, Any], str]
) -> None:
    """Do what is not done: the script is given ``--only`` and a run, and prints its result last.

    Parameters
    ----------
    script
        Of the study; its runs are in a file of the same name.
    done
        Results by run, to which the new ones are added.
    runs
        All that are wanted, tuples that JSON can hold, in their order.
    minutes
        After which no run begins.
    tell
        Returns a line about a run and its result.
    """
    cores: Queue[int] = Queue()
    for core in os.sched_getaffinity(0):
        cores.put(core)
    last, lock = monotonic() + 60.0 * minutes, Lock()

    def attempt(run: Any) -> None:
        if monotonic() > last:
            return
        core = cores.get()
        words = ["taskset", "-c", str(core), sys.executable, str(script), "--only", json.dumps(run)]
        quiet = {**os.environ, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        found = subprocess.run(words, env=quiet, capture_output=True, text=True, check=False)
        cores.put(core)
        if found.returncode:
            print(f"{run}: {found.stderr[-2000:]}", flush=True)
            return
        with lock:
            done[run] = json.loads(found.stdout.splitlines()[-1])
            lines = "".join(f"{json.dumps([each, done[each]])}\n" for each in sorted(done))
            write_text_atomic(script.with_suffix(".jsonl"), lines)
        print(tell(run, done[run]), flush=True)

    with ThreadPoolExecutor(cores.qsize()) as pool:
        list(pool.map(attempt, [run for run in runs if run not in done]))
