"""Branch coverage of the package and the agents, by room.

    python -m tests.campaigns.covered --write

Runs the tests twice. Without the compiler, chosen tests run the code of the kernels as plain Python, which takes
hundreds of times as long; only this can tell which branches of a kernel are reached. With it, all tests of the
gate run, for everything else. A branch counts if one of both reached it. Fails below ``--least`` per cent.
"""

import json
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import tyro

from .reports import ROOT, put, table

# The checkers count warnings, and NumPy warns when unsigned integers wrap around, as the random numbers want. Lanes
# that pad a block hold any numbers, of which it warns too.
LEGS = {
    "plain": [
        *("-n0", "-m", "not agents and not gpu and not long and not slow", "-k", "not checker"),
        *("-W", "ignore::RuntimeWarning", "tests/properties"),
        *(f"tests/benchmark/test_{name}.py" for name in ("leaderboard", "metrics", "statistics")),
        *(f"tests/conformance/test_{name}.py" for name in ("contract", "one_world", "philox", "traces")),
        *(f"tests/verification/test_{name}.py" for name in ("arcs", "controllers", "friction", "substep", "task")),
    ],
    "compiled": ["-m", "not gpu and not long", "-n", "auto"],
}


def run(*arguments: str, plain: bool = False) -> int:
    """Run coverage.py, with or without the compiler."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": str(int(plain))}
    return subprocess.run([sys.executable, "-m", "coverage", *arguments], cwd=ROOT, env=environment).returncode


def percent(covered: int, there: int) -> str:
    """A share in %; of nothing, all is covered."""
    return f"{100 * covered / there if there else 100:.1f}"


def by_room(files: dict[str, dict]) -> list[list[str]]:
    """A row for each room: files, lines and branches in %, and its files below 95 %."""
    rooms: dict[str, list] = defaultdict(list)
    for file, found in sorted(files.items()):
        parts = Path(file).parts
        rooms["/".join(parts[:2]) if len(parts) > 2 else parts[0]].append((Path(file).name, found["summary"]))
    rows: list[list[str]] = []
    for room, found in rooms.items():
        keys = ("covered_lines", "num_statements", "covered_branches", "num_branches")
        lines, of_lines, branches, of_branches = (sum(each.get(key, 0) for _, each in found) for key in keys)
        low = [f"`{name}` {each['percent_covered']:.0f}" for name, each in found if each["percent_covered"] < 95.0]
        shares = percent(lines, of_lines), percent(branches, of_branches)
        rows.append([f"`{room}`", str(len(found)), *shares, ", ".join(low)])
    return rows


def main(least: float = 95.0, write: bool = False) -> int:
    """Run both legs, print or write the table, and return 1 if too little is covered or a test failed."""
    run("erase")
    test = ("run", "-m", "pytest", "-p", "no:cacheprovider")
    failed = [leg for leg in LEGS if run(*test, *LEGS[leg], plain=leg == "plain")]
    result = ROOT / "coverage.json"
    run("combine", "--quiet")
    run("json", "--quiet", "-o", str(result))
    found = json.loads(result.read_text("utf-8"))
    result.unlink()
    total = found["totals"]
    lines = percent(total["covered_lines"], total["num_statements"])
    branches = percent(total["covered_branches"], total["num_branches"])
    text = table(["Room", "Files", "Lines, %", "Branches, %", "Files below 95 %"], by_room(found["files"]))
    both = total["percent_covered"]
    told = f"{text}\nAll lines: {lines} %; all branches: {branches} %; both together: {both:.1f} %.\n"
    put("coverage", told, write=write)
    return int(bool(failed) or both < least)


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
