"""Memory and cores of this computer, or of the process's container if those are fewer."""

import os
import sys
from pathlib import Path

CGROUP = Path("/sys/fs/cgroup")
"""Folder of a container's limits."""


def available_memory() -> int:
    """Return how much memory [B] this process may use."""
    whole = sys.maxsize
    if hasattr(os, "sysconf"):
        whole = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    (limit,) = _limits("memory.max", "max")
    return min(whole, int(limit)) if limit != "max" else whole


def available_cores() -> int:
    """Return how many cores this process may use."""
    whole = os.cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        whole = len(os.sched_getaffinity(0))
    quota, period = _limits("cpu.max", "max 100000")  # microseconds of all cores in each period
    return min(whole, max(1, int(quota) // int(period))) if quota != "max" else whole


def _limits(name: str, unlimited: str) -> list[str]:
    """Return what a file of limits holds."""
    file = CGROUP / name
    return (file.read_text("ascii") if file.is_file() else unlimited).split()
