"""The order of the site's pages: chapters in the side bar, and the pages linked from a page."""

import re

from sphinx.application import Sphinx

from pter_gym.scenarios import SCENARIOS

CHAPTERS: dict[str, tuple[str, ...]] = {
    "Start": (
        "push-it-yourself",
        "environment",
        "notebooks/01_the_paper",
        "notebooks/02_your_own_clutch",
        "notebooks/03_your_own_controller",
        "notebooks/04_train_an_agent",
        "notebooks/05_read_the_benchmark",
        "notebooks/06_which_machine_to_build",
        "notebooks/07_measure_a_hand",
        "in-class",
    ),
    "How to": (
        "your-algorithm",
        "agents",
        "papers-table",
        "extending",
        "watching",
        "data",
        "gradients",
        "cluster",
        "devices",
        "identify",
        "measure-a-hand",
        "deploy",
        "fmu",
        "troubleshooting",
    ),
    "How it works": (
        "model",
        "hands",
        "reward",
        "scoring",
        "worst-hand",
        "failures",
        "controllers",
        "stock-algorithms",
        "which-clutches",
        "reproduction",
        "verdict",
        "proven",
    ),
    "Reference": (
        "scenarios/index",
        "tables",
        "api",
        "stability",
        "systems",
        "glossary",
        "development/index",
    ),
}
"""What the side bar shows."""

BELOW = {
    "scenarios/index": tuple(f"scenarios/{name}" for name in SCENARIOS),
    "development/index": tuple(
        f"development/{name}"
        for name in (
            "architecture",
            "verification",
            "robustness",
            "bounds",
            "seeds",
            "worst-hands",
            "any-device",
            "rewards",
            "calibration",
            "hysteresis",
            "stock-algorithms",
            "control-laws",
            "gradients",
            "exported-c",
            "contributing",
            "listing",
            "changelog",
        )
    ),
}
"""Pages by the page that links to them."""


def add_contents(app: Sphinx, page: str, source: list[str]) -> None:
    """Append to a page the pages below it; in its file they would look like code."""
    # the site has a copy of the notebooks
    source[0] = re.sub(r"\]\((\.\./)+notebooks/", "](/notebooks/", source[0])
    source[0] = source[0].replace("](../docs/", "](/")
    if page == "index":
        source[0] += "".join(toctree(pages, caption) for caption, pages in CHAPTERS.items())
    elif page == "api":
        names = (name for name in app.env.found_docs if name.startswith("commands/"))
        source[0] += toctree(sorted(names))
    elif page in BELOW:
        source[0] += toctree(BELOW[page])


def toctree(pages: "list[str] | tuple[str, ...]", caption: str = "") -> str:
    """Return a hidden table of contents in MyST."""
    title = f":caption: {caption}\n" if caption else ""
    lines = "\n".join(f"/{page}" for page in pages)
    return f"\n```{{toctree}}\n:hidden:\n{title}\n{lines}\n```\n"
