"""Branch coverage of the package and the agents, by file.

    python tests/campaigns/covered.py

Runs the tests twice. Without the compiler, chosen tests run the code of the kernels as plain Python, which takes
hundreds of times as long; only this can tell which branches of a kernel are reached. With it, all tests of the
gate run, for everything else. A branch counts if one of both reached it. Fails below ``--least`` per cent.
"""

import argparse
import json
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]

# The checkers count warnings, and NumPy warns when unsigned integers wrap around, as the random numbers want. Lanes
# that pad a block hold any numbers, of which it warns too.
PLAIN = [
    *("-n0", "-m", "not agents and not gpu and not long and not slow", "-k", "not checker"),
    *("-W", "ignore::RuntimeWarning"),
]
PLAIN_TESTS = [
    *(f"tests/benchmark/test_{name}.py" for name in ("leaderboard", "metrics", "statistics")),
    *(f"tests/conformance/test_{name}.py" for name in ("contract", "one_world", "philox", "traces")),
    *(f"tests/verification/test_{name}.py" for name in ("arcs", "controllers", "friction", "substep", "task")),
    "tests/properties",
]
COMPILED = ["-m", "not gpu and not long"]


def run_leg(name: str, arguments: list[str]) -> int:
    """Run pytest under coverage in one of both ways."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1" if name == "plain" else "0"}
    command = [sys.executable, "-m", "coverage", "run", "-m", "pytest", "-p", "no:cacheprovider", *arguments]
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode


def tool(*arguments: str) -> None:
    """Run coverage.py."""
    subprocess.run([sys.executable, "-m", "coverage", *arguments], cwd=ROOT, check=True)


def percent(covered: int, there: int) -> str:
    """A share in %; of nothing, all is covered."""
    return f"{100 * covered / there if there else 100:.1f}"


def by_room(files: dict[str, dict]) -> list[list[str]]:
    """A row for each room: files, lines and branches in %, and its files below 95 %."""
    rooms = defaultdict(list)
    for file, found in sorted(files.items()):
        parts = Path(file).parts
        rooms["/".join(parts[:2]) if len(parts) > 2 else parts[0]].append((file, found["summary"]))
    rows = []
    for room, found in rooms.items():
        summaries = [summary for _, summary in found]
        lines, of_lines, branches, of_branches = (
            sum(summary.get(key, 0) for summary in summaries)
            for key in ("covered_lines", "num_statements", "covered_branches", "num_branches")
        )
        low = [f"`{Path(file).name}` {summary['percent_covered']:.0f}" for file, summary in found]
        low = [text for text, summary in zip(low, summaries, strict=True) if summary["percent_covered"] < 95.0]
        shares = [percent(lines, of_lines), percent(branches, of_branches)]
        rows.append([f"`{room}`", str(len(found)), *shares, ", ".join(low)])
    return rows


def main() -> int:
    """Run both ways, print each file, tell whether enough is covered and all tests passed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--legs", nargs="+", default=["plain", "compiled"], choices=["plain", "compiled"])
    parser.add_argument("--tests", nargs="+", help="test files of both ways; else those that are chosen, and all")
    parser.add_argument("--processes", default="auto", help="of the compiled way")
    parser.add_argument("--least", type=float, default=95.0, help="per cent that must be covered")
    parser.add_argument("--write", action="store_true", help="put the table into docs/robustness.md")
    given = parser.parse_args()

    legs = {
        "plain": [*PLAIN, *(given.tests or PLAIN_TESTS)],
        "compiled": [*COMPILED, "-n", given.processes, *(given.tests or [])],
    }
    tool("erase")
    failed = [name for name in given.legs if run_leg(name, legs[name])]
    tool("combine", "--quiet")
    tool("report", "--skip-covered")
    tool("json", "--quiet", "-o", "coverage.json")
    result = ROOT / "coverage.json"
    found = json.loads(result.read_text("utf-8"))
    result.unlink()

    sys.path.insert(0, str(ROOT / "docs" / "make"))
    from pages import put_block, table

    totals = found["totals"]
    total = totals["percent_covered"]
    lines = percent(totals["covered_lines"], totals["num_statements"])
    branches = percent(totals["covered_branches"], totals["num_branches"])
    text = table(["Room", "Files", "Lines, %", "Branches, %", "Files below 95 %"], by_room(found["files"]))
    put_block(
        ROOT / "docs" / "robustness.md",
        "coverage",
        f"{text}\nAll lines: {lines} %; all branches: {branches} %; both together: {total:.1f} %.\n",
        write=given.write,
    )
    if failed:
        sys.stderr.write(f"tests failed: {', '.join(failed)}\n")
    return int(bool(failed) or total < given.least)


if __name__ == "__main__":
    sys.exit(main())
