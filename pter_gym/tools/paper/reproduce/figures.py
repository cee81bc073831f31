"""What ``pter reproduce`` can make: pictures and data for each figure and table of the paper."""

import json
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from pter_gym.errors import unknown_name
from pter_gym.tools.figures import pdf, png
from pter_gym.tools.paper import plots
from pter_gym.tools.paper.experiments.study import Study
from pter_gym.tools.paper.reproduce import tables

Draw = Callable[[Study], Figure]

PICTURES: dict[str, dict[str, Draw]] = {
    "fig3": {"fig3": lambda study: plots.single_dof_paths(study.single_dof)},
    "fig4": {"fig4": lambda study: plots.single_dof_torques(study.single_dof)},
    "step": {"step": lambda study: plots.clutch_step(study.step_response)},
    "fig5": {"fig5": lambda study: plots.torque_over_voltage(study.torque_curves)},
    "fig7": {"fig7": lambda study: plots.error_over_time_constant(study.sweeps)},
    "fig8": {
        "fig8": lambda study: plots.peak_acceleration_over_time_constant(study.sweeps),
        "fig8_way_and_speed": lambda study: plots.way_and_speed_over_time_constant(study.sweeps),
    },
    "table1": {"table1": lambda study: plots.table_comparison(study.table1)},
    "fig9": {"fig9": lambda study: plots.reversal_torques(study.reversals)},
    "fig10": {"fig10": lambda study: plots.error_over_gain(study.gain_sweep)},
    "fig11": {"fig11": lambda study: plots.followed_lines(study.line_following)},
}
"""How each figure or table is drawn, by the names of the files without their endings."""


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
    def pictures(self) -> dict[str, Draw]:
        """How to draw it, by the names of the files without their endings."""
        return PICTURES[self.name]


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """A chapter of the report: its title, what it is about, and the products that it shows."""

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
        If there is no product of a name.
    """
    wanted = set(names)
    unknown = sorted(wanted - PRODUCTS.keys() - {"all"})
    if unknown:
        raise unknown_name("figures", ", ".join(unknown), ("all", *PRODUCTS))
    return {name: product for name, product in PRODUCTS.items() if "all" in wanted or name in wanted}


def files_of(name: str, study: Study) -> dict[str, bytes]:
    """Return the content of a product's files by their names."""
    product = PRODUCTS[name]
    files: dict[str, bytes] = {}
    for stem, draw in product.pictures.items():
        figure = draw(study)
        files |= {f"{stem}.png": png(figure), f"{stem}.pdf": pdf(figure)}
    files[f"{name}.csv"] = tables.csv_text(tables.COLUMNS[name](study)).encode()
    if name == "table1":
        files["table1.json"] = (json.dumps(tables.table1(study), indent=2) + "\n").encode()
    return files
