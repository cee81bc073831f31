"""Figures and tables of ``pter reproduce``: what each shows, and its files."""

import json
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from pter_gym.errors import unknown_name

if TYPE_CHECKING:
    from pter_gym.tools.paper.claims import Claim
    from pter_gym.tools.paper.study import Study


@dataclass(frozen=True, kw_only=True)
class Product:
    """One figure or table.

    Attributes
    ----------
    name
        Name for ``pter reproduce``, and of its files.
    place
        Where it is in the paper.
    title
        What it shows.
    remark
        What a reader should know about it.
    """

    name: str
    place: str
    title: str
    remark: str


PRODUCTS: dict[str, Product] = {
    entry["name"]: Product(**entry)
    for entry in tomllib.loads(Path(__file__).with_name("products.toml").read_text("utf-8"))["products"]
}
"""By name, in the order of the paper."""


def find_products(names: Iterable[str]) -> dict[str, Product]:
    """Return the products of given names, in the order of the paper; ``all`` means all of them.

    Raises
    ------
    ParameterError
        If there is no product with a given name.
    """
    wanted = set(names)
    unknown = sorted(wanted - PRODUCTS.keys() - {"all"})
    if unknown:
        raise unknown_name("figures", ", ".join(unknown), ("all", *PRODUCTS))
    return {name: product for name, product in PRODUCTS.items() if "all" in wanted or name in wanted}


def results(
    study: "Study",
    products: Iterable[str],
    *,
    pdf: bool = False,
    on_progress: Callable[[str], None] = lambda _: None,
) -> "tuple[dict[str, bytes], tuple[Claim, ...]]":
    """Return the content of all files by their names, and the claims about the products.

    Parameters
    ----------
    study
        The experiments.
    products
        Names in ``PRODUCTS``.
    pdf
        Whether each picture is a PDF file too.
    on_progress
        Called with a name when a product is done, and finally with ``claims``.
    """
    from pter_gym.tools import figures as style
    from pter_gym.tools.paper.claims import STATEMENTS, check
    from pter_gym.tools.paper.figures import PICTURES
    from pter_gym.tools.paper.tables import COLUMNS, csv_text, table1

    names = list(products)
    files: dict[str, bytes] = {}
    for name in names:
        for stem, draw in PICTURES.items():
            if stem.partition("_")[0] == name:
                figure = draw(study)
                files[f"{stem}.png"] = style.png(figure)
                if pdf:
                    files[f"{stem}.pdf"] = style.pdf(figure)
        files[f"{name}.csv"] = csv_text(COLUMNS[name](study)).encode()
        if name == "table1":
            files["table1.json"] = _json(table1(study))
        on_progress(name)
    claims = check(study, [statement for statement in STATEMENTS if statement.figure in names])
    files["claims.json"] = _json([claim.as_json() for claim in claims])
    on_progress("claims")
    return files, claims


def claims_table(claims: "Iterable[Claim]") -> Table:
    """Return the claims as a table for the terminal, with their counts."""
    told = list(claims)
    counts = Counter(claim.kind for claim in told)
    caption = ", ".join(f"{count} {kind}" for kind, count in counts.items())
    table = Table("", "the paper says", "measured", "needed", box=None, pad_edge=False, caption=caption)
    for claim in told:
        s = claim.statement
        unit = "" if s.unit == "1" else f" {s.unit}"
        table.add_row(claim.kind, f"{s.claim} ({s.section})", f"{claim.value:.4g}{unit}", s.condition)
    return table


def _json(content: object) -> bytes:
    return (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode()
