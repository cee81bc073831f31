"""All files of a reproduction: made in memory first, then written, each atomically."""

import json
from collections import Counter
from collections.abc import Callable, Iterable

from rich.table import Table

from pter_gym.tools.paper.experiments.claims import STATEMENTS, Claim, check
from pter_gym.tools.paper.experiments.study import Study
from pter_gym.tools.paper.reproduce.chapters import PRODUCTS
from pter_gym.tools.paper.reproduce.figures import files_of
from pter_gym.tools.paper.reproduce.report import SIGNS, report


def results(
    study: Study, products: Iterable[str], on_progress: Callable[[str], None] = lambda _: None
) -> tuple[dict[str, bytes], tuple[Claim, ...]]:
    """Return the content of all files by their names, and the claims about the products.

    Parameters
    ----------
    study
        The experiments.
    products
        Names in ``PRODUCTS``; if all of them, a report and a claims file are added.
    on_progress
        Called with a name when a product is done, and finally with ``claims``.
    """
    names = list(products)
    files: dict[str, bytes] = {}
    for name in names:
        files |= files_of(name, study)
        on_progress(name)
    claims = check(study, [statement for statement in STATEMENTS if statement.figure in names])
    if set(names) == PRODUCTS.keys():
        pictures = {name.removesuffix(".png"): content for name, content in files.items() if name.endswith(".png")}
        files["claims.json"] = claims_json(claims).encode()
        files["report.html"] = report(study.setup, claims, pictures).encode()
    on_progress("claims")
    return files, claims


def claims_json(claims: Iterable[Claim]) -> str:
    """Return the content of ``claims.json``: a list with one object per claim."""
    return json.dumps([claim.as_json() for claim in claims], indent=2, ensure_ascii=False) + "\n"


def unmet_table(claims: Iterable[Claim]) -> Table:
    """Return a table of the claims that do not hold; it fits a terminal of 80 columns."""
    table = Table("not met", "measured", "needed", box=None, pad_edge=False)
    for claim in claims:
        s = claim.statement
        if not claim.holds:
            unit = "" if s.unit == "1" else f" {s.unit}"
            table.add_row(f"{s.claim} ({s.section})", f"{claim.value:.4g}{unit}", s.condition)
    return table


def summary(claims: Iterable[Claim]) -> str:
    """Return how many claims hold, in one line."""
    counts = Counter(claim.kind for claim in claims)
    return "claims of the paper: " + ", ".join(f"{counts[kind]} {kind}" for kind in SIGNS)
