"""The code that documents show, run as a reader would run it."""

import importlib.util
import re
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

import nbformat

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
DOCS = ROOT / "docs"
DATA = DOCS / "data.md"
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def blocks_of(page: Path) -> list[str]:
    """Return the blocks of Python of a page."""
    return re.findall(r"^```python\n(.*?)^```$", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)


def cells_of(notebook: Path) -> list[str]:
    """Return the cells of Python of a notebook."""
    cells = nbformat.read(notebook, as_version=4).cells
    code = (cell.source for cell in cells if cell.cell_type == "code")
    return [re.sub(r"^( *)%.*$", r"\1pass", source, flags=re.MULTILINE) for source in code]


def readme(name: str) -> str:
    """Return the block of code below a comment of the README."""
    (block,) = re.findall(
        rf"^<!-- {name} -->\n```\w+\n(.*?)^```$",
        README.read_text("utf-8"),
        re.MULTILINE | re.DOTALL,
    )
    return block


def run_extending() -> None:
    """Run the page on extending."""
    run_program(blocks_of(DOCS / "extending.md"), "extending.md")


def load_script(script: Path) -> ModuleType:
    """Import a script by its file."""
    spec = importlib.util.spec_from_file_location(script.stem, script)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run_program(blocks: Iterable[str], name: str, **known: object) -> dict[str, object]:
    """Run blocks one after another, as one main program, so numba caches compiled laws.

    They know names that earlier ones have made.
    """
    names: dict[str, object] = {"__name__": "__main__", **known}
    for block in blocks:
        exec(compile(block, name, "exec"), names)
    return names
