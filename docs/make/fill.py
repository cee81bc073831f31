"""Fill the generated blocks of README.md and docs.

    python docs/make/fill.py                    # blocks `<!-- made: … -->`, from the code
    python docs/make/fill.py --results FOLDER   # blocks `<!-- board: … -->` too, from its runs
    python docs/make/fill.py --results FOLDER --score-first   # after scoring all policies

A block asks for a function of `made` or `boards` by name, with arguments, and ends with
`<!-- /made: … -->`.
"""

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import boards
import made
import tyro
from markup import DOCS, README, ROOT, with_marks

from pter_gym._internal.files import write_text_atomic
from pter_gym.plugins import COMMANDS, registered

BLOCK = re.compile(
    r"^<!-- (made|board): (.+?) -->\n(.*?)^<!-- /\1: \2 -->$", re.MULTILINE | re.DOTALL
)

SEED = 2026
"""Of the test episodes on which all boards are scored."""


class Block(NamedTuple):
    """A generated block: its page, what makes it, the name and arguments, and its content."""

    page: Path
    source: str
    asked: str
    content: str

    def make(self, results: Path | None = None) -> str:
        """Return what the block should contain."""
        name, *arguments = self.asked.split()
        if self.source == "board":
            return with_marks(f"{boards.BOARDS[name](results, *arguments).strip()}\n")
        up = "../" * len(self.page.relative_to(DOCS).parts[1:]) if self.page != README else "docs/"
        return f"{made.MADE[name](*arguments).strip().replace('](/', f']({up}')}\n"


def blocks() -> Iterator[Block]:
    """Yield all generated blocks."""
    for page in (README, *sorted(DOCS.rglob("*.md"))):
        for found in BLOCK.finditer(page.read_text("utf-8")):
            yield Block(page, *found.groups())


def write(block: Block, content: str) -> None:
    """Replace the content of a block in its page."""
    text = block.page.read_text("utf-8")
    first, last = (f"<!-- {slash}{block.source}: {block.asked} -->" for slash in ("", "/"))
    write_text_atomic(
        block.page, text.replace(f"{first}\n{block.content}{last}", f"{first}\n{content}{last}")
    )


def score(results: Path) -> None:
    """Run all policies on test episodes of all scenarios, and search worst hands for some."""
    from pter_gym._commands.main import main as pter
    from pter_gym.policies import shipped_policies
    from pter_gym.policies.tuned import tuned_policies
    from pter_gym.scenarios import SCENARIOS

    everyone = (
        *boards.LEFT_OUT,
        *("impedance", "torque-feedback"),
        *tuned_policies(),
        *shipped_policies(),
    )
    usual = ["benchmark", "--seed", str(SEED), "--no-film", "--out", str(results)]
    commands = [["--faults", "--policies", *boards.FAILING]]
    for scenario in SCENARIOS:
        readme = boards.README if scenario == "standard" else ()
        searched = {*boards.SEARCHED, *readme}
        others = [name for name in everyone if name not in searched]
        commands += [["--scenario", scenario, "--policies", *others]]
        commands += [["--scenario", scenario, "--worst", "--policies", *sorted(searched)]]
    for options in commands:
        if status := pter([*usual, *options]):
            raise SystemExit(status)
    failures = ROOT / "benchmarks" / "failures.py"
    subprocess.run([sys.executable, failures, "score", results], check=True)


def check_commands() -> None:
    """End unless the commands of this checkout are those that are installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    ours = {entry for entry in registered(COMMANDS).values() if entry.value.startswith("pter_")}
    if {each.name: each.value for each in ours} != project["entry-points"][COMMANDS]:
        raise SystemExit("other commands are installed; install again: pip install -e .")


def main(results: Path | None = None, score_first: bool = False) -> None:
    """Fill what the code declares and, with a folder of results, the leaderboards."""
    check_commands()
    if results is not None and score_first:
        score(results)
    for block in blocks():
        if block.source == "made" or results is not None:
            write(block, block.make(results))


if __name__ == "__main__":
    tyro.cli(main)
