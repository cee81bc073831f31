"""What this computer has: memory and cores that this process may use."""

import os
import sys
from pathlib import Path


def available_memory() -> int:
    """Return how much memory [B] this machine has, or this process's container if that is less."""
    limit = Path("/sys/fs/cgroup/memory.max")
    text = limit.read_text("ascii").strip() if limit.is_file() else "max"
    pages = (
        os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        if hasattr(os, "sysconf")
        else sys.maxsize
    )
    return min(int(text), pages) if text.isdigit() else pages


def available_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
