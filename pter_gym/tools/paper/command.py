"""``pter reproduce``: the paper's figures, its table and its claims."""

from collections import Counter
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from pter_gym._commands.terminal import conclude, progress_bar, terminal
from pter_gym._internal.files import make_folder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from pter_gym.tools.paper.claims import Claim


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
    terminal().print(verdicts(claims))
    conclude([f"{len(files)} files to {out}"], "pter benchmark")


def verdicts(claims: "Sequence[Claim]") -> "Table":
    """Return what became of the claims of each sentence of the paper, and how many of each kind."""
    from rich.table import Table

    counts = ", ".join(
        f"{count} {kind}" for kind, count in Counter(claim.kind for claim in claims).items()
    )
    table = Table.grid(padding=(0, 2))
    for (paper, section), group in groupby(
        claims, key=lambda claim: (claim.statement.paper, claim.statement.section)
    ):
        for claim in group:
            s = claim.statement
            measured = f"Measured {s.with_unit(f'{claim.value:.4g}')}, needed {s.condition}."
            table.add_row(claim.kind, f"{s.claim} {measured}")
        table.add_row("", f"“{paper}” ({section})")
    table.add_row("in all", counts)
    return table


def names() -> dict[str, list[str]]:
    """Return the names that arguments accept, for the help."""
    from pter_gym.tools.paper.outputs import OUTPUTS

    return {"figures": list(OUTPUTS)}
