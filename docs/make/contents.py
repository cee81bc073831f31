"""The order of the site's pages: the side bar shows the chapters, and below a page the pages that belong to it."""

import re

from sphinx.application import Sphinx

from pter_gym.scenarios import SCENARIOS

CHAPTERS = {
    "Start": ("first-steps", "push-it-yourself", "watching", "commands"),
    "Tutorials": ("tutorials", "your-algorithm", "extending", "identify", "deploy"),
    "The environment": ("path-following", "scenarios/index"),
    "Policies and scores": ("policies", "controllers", "agents", "scoring"),
    "The robot and its paper": ("model", "paper-figures"),
    "Reference": ("api", "architecture", "verification", "contributing", "changelog"),
}
"""What ``index`` shows."""

BELOW = {
    "push-it-yourself": ("browser",),
    "watching": ("gallery",),
    "tutorials": (
        "notebooks/01_the_paper",
        "notebooks/02_your_own_clutch",
        "notebooks/03_your_own_controller",
        "notebooks/04_train_an_agent",
        "notebooks/05_read_the_benchmark",
        "notebooks/06_which_machine_to_build",
    ),
    "your-algorithm": ("stock-algorithms", "learning-libraries", "at-scale"),
    "path-following": ("environment", "task", "reward"),
    "scenarios/index": tuple(f"scenarios/{name}" for name in SCENARIOS),
    "policies": ("data",),
    "controllers": ("classical-control", "which-clutches"),
    "scoring": ("bound",),
    "model": ("hands", "gradients"),
    "paper-figures": ("reproduction", "calibration"),
    "verification": ("robustness",),
    "contributing": ("listing",),
}
"""Pages by the page that they belong to."""


def add_contents(app: Sphinx, page: str, source: list[str]) -> None:
    """Append to a page the pages below it; in its file they would look like code."""
    source[0] = re.sub(r"\]\((\.\./)+notebooks/", "](/notebooks/", source[0])  # of which the site has a copy
    source[0] = source[0].replace("](../docs/", "](/")
    if page == "index":
        source[0] += "".join(toctree(pages, caption) for caption, pages in CHAPTERS.items())
    elif page == "commands":
        source[0] += toctree(sorted(name for name in app.env.found_docs if name.startswith("commands/")))
    elif page in BELOW:
        source[0] += toctree(BELOW[page])


def toctree(pages: "list[str] | tuple[str, ...]", caption: str = "") -> str:
    """Return a hidden table of contents in MyST."""
    told = f":caption: {caption}\n" if caption else ""
    return "\n```{toctree}\n:hidden:\n" + told + "\n" + "\n".join(f"/{page}" for page in pages) + "\n```\n"
