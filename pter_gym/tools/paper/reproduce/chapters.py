"""The products of ``pter reproduce``, chapter by chapter; nothing here draws."""

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pter_gym.errors import unknown_name

if TYPE_CHECKING:
    from pter_gym.tools.paper.reproduce.figures import Draw


@dataclass(frozen=True, kw_only=True)
class Product:
    """One figure or table.

    Attributes
    ----------
    name
        Name for ``pter reproduce``, and of its CSV file.
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

    @property
    def pictures(self) -> "dict[str, Draw]":
        """Functions that draw it, by file name without extension."""
        from pter_gym.tools.paper.reproduce.figures import PICTURES

        return PICTURES[self.name]


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """A chapter of the report: its title, its introduction, and its products."""

    title: str
    text: str
    products: tuple[Product, ...]


def _read() -> tuple[Chapter, ...]:
    table = tomllib.loads(Path(__file__).with_name("chapters.toml").read_text("utf-8"))
    return tuple(
        Chapter(
            title=chapter["title"],
            text=chapter["text"],
            products=tuple(Product(**product) for product in chapter["products"]),
        )
        for chapter in table["chapters"]
    )


CHAPTERS = _read()
"""The chapters of the report, in the order of the paper; ``chapters.toml`` has their texts."""

PRODUCTS: dict[str, Product] = {product.name: product for chapter in CHAPTERS for product in chapter.products}
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
