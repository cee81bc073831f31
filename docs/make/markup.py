"""Tables, cells and numbers in Markdown."""

from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
IMAGES = DOCS / "images"


def table(header: Iterable[str], rows: Iterable[Iterable[str]], align: str = "---") -> str:
    """Return a table whose first column is aligned to the left and the others as ``align`` says."""
    head = list(header)
    lines = (" | ".join(cell.replace("|", r"\|") for cell in row) for row in (head, *rows))
    first, *others = (f"| {line} |\n" for line in lines)
    return f"{first}|---|{f'{align}|' * (len(head) - 1)}\n{''.join(others)}"


def code(text: str) -> str:
    """Return the text as code."""
    return f"`{text}`"


def joined(text: str) -> str:
    """Return the text with spaces at which no line breaks."""
    return text.replace(" ", "\u00a0")


def number(value: float) -> str:
    """Return a number with four digits and a typographic minus sign."""
    return f"{value:.4g}".replace("-", "−")
