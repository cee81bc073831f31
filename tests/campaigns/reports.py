"""What campaigns share: the page that their figures go to."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "docs" / "make"))

from pages import put_block, table  # noqa: E402

PAGE = "docs/robustness.md"

__all__ = ["PAGE", "ROOT", "put", "table"]


def put(name: str, content: str, *, write: bool) -> None:
    """Write figures between the markers of a campaign, or print them."""
    put_block(PAGE, name, content, write=write)
