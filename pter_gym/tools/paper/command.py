"""``pter reproduce``: the paper's figures, its table and its claims, written to a folder."""

from pathlib import Path
from typing import Annotated

import tyro

from pter_gym._internal.terminal import make_folder, progress_bar, say, terminal


def reproduce(
    figures: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FIGURE")] = ("all",),
    out: Path = Path("pter-reproduce"),
) -> None:
    """Make the paper's figures and Table I, and check its claims.

    Writes a picture and a CSV file for each figure, and table1.json. With `all` it also writes claims.json, which has
    each claim of the paper with our measurement, and report.html, which shows everything.

    Example: pter reproduce fig3 table1

    Args:
        figures: Names of figures, or all.
        out: Folder for the results, created if necessary.
    """
    from pter_gym._internal.files import write_files_atomic
    from pter_gym.tools.paper.reproduce.chapters import find_products

    chosen = find_products(figures)
    make_folder(out)
    from pter_gym.tools.paper.experiments.study import Study
    from pter_gym.tools.paper.reproduce.results import results, summary, unmet_table

    with progress_bar() as progress:
        task = progress.add_task("reproducing", total=len(chosen) + 1)
        files, claims = results(Study(), chosen, on_progress=lambda _: progress.advance(task))
    try:
        write_files_atomic(out, files)
    finally:
        if not all(claim.holds for claim in claims):
            terminal().print(unmet_table(claims))
        say(summary(claims))
    for name in ("report.html", "claims.json", "table1.json") if "report.html" in files else files:
        say(f"wrote {out / name}")


def names() -> dict[str, list[str]]:
    """Return the names that arguments accept, for the help."""
    from pter_gym.tools.paper.reproduce.chapters import PRODUCTS

    return {"figures": list(PRODUCTS)}
