"""Tables, cells and numbers in Markdown, and marks of the policies that a page shows."""

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

from pter_gym.policies import shipped_policies
from pter_gym.policies._files import ENDING, SHIPPED

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
IMAGES = DOCS / "images"
RECORD = IMAGES / "policies.json"
"""The shipped policies that each picture shows, with the digests of their files."""

MARK = re.compile(r"<!-- of: ([a-z0-9-]+) ([0-9a-f]{8}) -->")
"""Above what a page prints of a shipped policy: its name, and the digest of its file."""


def digests(text: str) -> dict[str, str]:
    """Return the digests of the files of the shipped policies that a text names."""
    return {
        name: hashlib.sha256((SHIPPED / f"{name}{ENDING}").read_bytes()).hexdigest()[:8]
        for name in shipped_policies()
        if re.search(rf"\b{name}\b", text)
    }


def with_marks(text: str) -> str:
    """Return a block below the marks of the shipped policies that it names."""
    marks = (f"<!-- of: {name} {digest} -->\n" for name, digest in digests(text).items())
    return "".join(marks) + text


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
