"""``pter reproduce``: the paper's figures, its table and its claims."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import tyro

from pter_gym._commands.terminal import conclude, progress_bar, terminal
from pter_gym._internal.files import make_folder


def reproduce(
    figures: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FIGURE")] = (
        "all",
    ),
    pdf: bool = False,
    out: Path = Path("pter-reproduce"),
) -> None:
    """Make the paper's figures and Table I, and check its claims.

    Writes a picture and a CSV file for each figure, table1.json, and claims.json, which has each
    claim of the paper about these figures with our measurement. Also prints the claims.

    Example: pter reproduce fig3 table1

    Args:
        figures: Names of figures, or all.
        pdf: Also write each picture as PDF.
        out: Folder for the results, created if necessary.
    """
    from rich.table import Table

    from pter_gym._internal.files import write_files_atomic
    from pter_gym.tools.paper.outputs import find_outputs, make_outputs

    names = find_outputs(figures)
    make_folder(out)
    from pter_gym.tools.paper.experiments import Experiments

    with progress_bar() as progress:
        task = progress.add_task("reproducing", total=len(names) + 1)
        files, claims = make_outputs(
            Experiments(), names, pdf=pdf, on_progress=lambda _: progress.advance(task)
        )
    write_files_atomic(out, files)
    counts = ", ".join(
        f"{count} {kind}" for kind, count in Counter(claim.kind for claim in claims).items()
    )
    columns = ("", "the paper says", "read as", "measured", "needed")
    table = Table(*columns, box=None, pad_edge=False, caption=counts)
    for claim in claims:
        s = claim.statement
        table.add_row(
            claim.kind,
            f"“{s.paper}” ({s.section})",
            s.claim,
            s.with_unit(f"{claim.value:.4g}"),
            s.condition,
        )
    terminal().print(table)
    conclude([f"{len(files)} files to {out}"], "pter benchmark")


def names() -> dict[str, list[str]]:
    """Return the names that arguments accept, for the help."""
    from pter_gym.tools.paper.outputs import OUTPUTS

    return {"figures": list(OUTPUTS)}
