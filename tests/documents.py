"""The code that documents show, run as a reader would run it."""

import re
from collections.abc import Iterable
from pathlib import Path

import nbformat

ROOT = Path(__file__).parents[1]
EXTENDING = ROOT / "docs" / "extending.md"
POLICIES = ROOT / "docs" / "policies.md"
DATA = ROOT / "docs" / "data.md"
OWN_CONTROLLER = ROOT / "notebooks" / "03_your_own_controller.ipynb"


def blocks_of(page: Path) -> list[str]:
    """Return the blocks of code of a page."""
    return re.findall(r"^```python\n(.*?)^```$", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)


def run_extending() -> None:
    """Run the page on extending."""
    run_program(blocks_of(EXTENDING), str(EXTENDING))


def run_policies() -> None:
    """Run the page on trained policies, in a folder with a policy ``policies/mine``."""
    run_program(blocks_of(POLICIES), str(POLICIES))


def run_own_controller() -> None:
    """Run the notebook on one's own controller, without its pictures in the page."""
    cells = [cell.source for cell in nbformat.read(OWN_CONTROLLER, as_version=4).cells if cell.cell_type == "code"]
    run_program((cell.replace("%matplotlib inline\n", "") for cell in cells), "<notebook>")


def run_program(blocks: Iterable[str], name: str) -> None:
    """Run blocks one after another, as one main program: then numba caches what their laws compile to."""
    names: dict[str, object] = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, name, "exec"), names)
