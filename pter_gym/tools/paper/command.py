"""``pter reproduce``: the paper's figures, its table and its claims; ``pter fit``: what the paper does not print."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import tyro

from pter_gym._commands.arguments import check_file
from pter_gym._internal.terminal import make_folder, progress_bar, say, terminal


def reproduce(
    figures: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FIGURE")] = (
        "all",
    ),
    pdf: bool = False,
    out: Path = Path("pter-reproduce"),
) -> None:
    """Make the paper's figures and Table I, and check its claims.

    Writes a picture and a CSV file for each figure, table1.json, and claims.json, which has each
    claim of the paper about these figures with our measurement. It prints the claims.

    Example: pter reproduce fig3 table1

    Args:
        figures: Names of figures, or all.
        pdf: Write each picture as PDF too.
        out: Folder for the results, created if necessary.
    """
    from rich.table import Table

    from pter_gym._internal.files import write_files_atomic
    from pter_gym.tools.paper.products import find_products, results

    chosen = find_products(figures)
    make_folder(out)
    from pter_gym.tools.paper.study import Study

    with progress_bar() as progress:
        task = progress.add_task("reproducing", total=len(chosen) + 1)
        files, claims = results(
            Study(), chosen, pdf=pdf, on_progress=lambda _: progress.advance(task)
        )
    write_files_atomic(out, files)
    counts = ", ".join(
        f"{count} {kind}" for kind, count in Counter(claim.kind for claim in claims).items()
    )
    table = Table(
        "", "the paper says", "measured", "needed", box=None, pad_edge=False, caption=counts
    )
    for claim in claims:
        s = claim.statement
        table.add_row(
            claim.kind, f"{s.claim} ({s.section})", s.with_unit(f"{claim.value:.4g}"), s.condition
        )
    terminal().print(table)
    say(f"wrote {len(files)} files to {out}")


def fit(
    seed: int = 0, budget: int = 6000, trends: float = 0.3, out: Path = Path("pter-preset.toml")
) -> None:
    """Search for values that the paper does not print.

    The search fits its Table I and its trends, and writes the result as a preset.

    Example: pter fit --budget 3000 --out preset.toml

    Args:
        seed: Seed of the search, at least 0; the same seed and budget give the same result.
        budget: Evaluated candidates, at least 1,000.
        trends: Weight of the trends over the time constant relative to Table I, at least 0.
        out: File for the preset, in TOML; its folder must exist.
    """
    check_file(out, ".toml")
    import numpy as np

    from pter_gym._internal.files import write_text_atomic
    from pter_gym.params._preset import format_preset
    from pter_gym.tools.paper.calibration import TARGET, search

    with progress_bar() as progress:
        bar = progress.add_task("fit", total=budget)
        result = search(seed, budget, trends, lambda n: progress.advance(bar, n))
    title = f"Found by pter fit --seed {seed} --budget {budget} --trends {trends:g}."
    write_text_atomic(out, format_preset(result.preset, title))
    found, worst = (
        result.quality,
        f"{100.0 * np.abs(result.quality.table[0] / TARGET - 1.0).max():.1f}%",
    )
    say(
        f"misfit {result.misfit:.4f}; Table I in the paper's units: {found.table[0].round(3).tolist()}"
    )
    say(
        f"worst entry {worst} off; trends of error, path length, speed, peak: {found.trends[0].round(2).tolist()}"
    )
    say(f"wrote {out}")


def names() -> dict[str, list[str]]:
    """Return the names that arguments accept, for the help."""
    from pter_gym.tools.paper.products import PRODUCTS

    return {"figures": list(PRODUCTS)}
