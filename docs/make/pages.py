"""What the scripts here share: blocks of pages between two comments, and cells and tables in Markdown."""

import re
from collections.abc import Iterable
from pathlib import Path

from pter_gym._internal.files import write_text_atomic

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
IMAGES = DOCS / "images"
BELOW = "†"
"""Marks a score without a rank."""


def _block(name: str) -> "re.Pattern[str]":
    return re.compile(rf"<!-- {re.escape(name)} -->\n(.*?)<!-- /{re.escape(name)} -->\n", re.DOTALL)


def read_block(page: Path, name: str) -> str:
    """Return what is between `<!-- name -->` and `<!-- /name -->`, which must be in the page once."""
    found = _block(name).findall(page.read_text("utf-8"))
    if len(found) != 1:
        raise ValueError(f"{page} must have one block {name!r}, but has {len(found)}")
    return found[0]


def write_block(page: Path, name: str, content: str) -> None:
    """Replace what ``read_block`` returns."""
    read_block(page, name)
    filled = f"<!-- {name} -->\n{content}<!-- /{name} -->\n"
    write_text_atomic(page, _block(name).sub(lambda _: filled, page.read_text("utf-8")))


def put_block(page: str, name: str, content: str, *, write: bool) -> None:
    """Write a block of a page, named from the root of the checkout, or print it."""
    if write:
        write_block(ROOT / page, name, content)
    else:
        print(content)


def table(header: Iterable[str], rows: Iterable[Iterable[str]], align: str = "---:") -> str:
    """Return a table whose first column is text; the others are aligned to the right, or as ``align`` says."""
    head = list(header)
    line = f"|---|{f'{align}|' * (len(head) - 1)}\n"
    return f"| {' | '.join(head)} |\n{line}" + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def text_table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of text, whose cells may contain vertical lines."""
    return table(header, ([cell.replace("|", r"\|") for cell in row] for row in rows), "---")


def joined(text: str) -> str:
    """Return the text with spaces at which no line breaks."""
    return text.replace(" ", "\u00a0")


def signed(text: str) -> str:
    """Return the text with typographic minus signs."""
    return text.replace("-", "−")
