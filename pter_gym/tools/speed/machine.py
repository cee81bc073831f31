"""The computer and versions that the numbers were measured with."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pter_gym._internal.computer import available_cores, available_memory
from pter_gym._version import __version__

_PACKAGES = ("gymnasium", "numpy", "numba", "llvmlite", "numba-cuda", "torch", "mujoco", "envpool")


def describe_machine() -> dict[str, Any]:
    """Return CPU, cores available to this process, memory [GiB], operating system and current load."""
    return {
        "processor": _processor(),
        "cores": available_cores(),
        "memory_gib": round(available_memory() / 2**30, 1),
        "system": platform.platform(),
        "load_average_at_start": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
    }


def versions() -> dict[str, str]:
    """Return the versions of Python, this package and the relevant installed packages."""
    found = {"python": platform.python_version(), "pter-gym": __version__}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
