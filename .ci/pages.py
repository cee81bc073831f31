"""Text between markers in the documents, for the scripts beside this one that measure something."""

import re
from pathlib import Path

from pter_gym.files import write_text_atomic

ROOT = Path(__file__).parents[1]


def put(page: Path, name: str, text: str) -> None:
    """Put text between `<!-- name -->` and `<!-- /name -->`, which must stand in the page once."""
    block = re.compile(rf"<!-- {name} -->\n.*?<!-- /{name} -->\n", re.DOTALL)
    changed, count = block.subn(lambda _: f"<!-- {name} -->\n{text}<!-- /{name} -->\n", page.read_text("utf-8"))
    if count != 1:
        raise SystemExit(f"{page} must hold <!-- {name} --> … <!-- /{name} --> once, found {count}")
    write_text_atomic(page, changed)
    print(f"wrote {page}")
