"""What ``pter reproduce`` can make: pictures and data for each figure and table of the paper."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from matplotlib.figure import Figure

from pter_gym.errors import unknown_name
from pter_gym.paper import plots
from pter_gym.paper.experiments.study import Study
from pter_gym.paper.reproduce import tables
from pter_gym.plots.style import pdf, png

Draw = Callable[[Study], Figure]


@dataclass(frozen=True, kw_only=True)
class Product:
    """Files of one figure or table.

    Attributes
    ----------
    place
        Where it is in the paper.
    title
        What it shows.
    remark
        What a reader should know about it.
    pictures
        How to draw it, by the names of the files without their endings.
    columns
        Its data.
    """

    place: str
    title: str
    remark: str
    pictures: dict[str, Draw]
    columns: Callable[[Study], tables.Columns]


PRODUCTS: dict[str, Product] = {
    "fig3": Product(
        place="Fig. 3",
        title="Single degree of freedom, path of the tip",
        remark="One clutch is locked by a large voltage, which leaves the tip a single line to move on. The clutch "
        "under test has a small voltage, and a torque on one link rises until it gives way. The paper shows clutch 1 "
        "with clutch 2 locked; the other three tests are ours.",
        pictures={"fig3": lambda study: plots.single_dof_paths(study.single_dof)},
        columns=tables.single_dof_paths,
    ),
    "fig4": Product(
        place="Fig. 4",
        title="Single degree of freedom, clutch torques",
        remark="The clutch under test carries its share of the rising input torque up to 63.5 in·lbf, then falls back "
        "to the dynamic torque. For clutches 3 and 4 the locked clutch carries the other half. The torque of clutch "
        "2, where that one is locked, grows with the speed of link A through the velocity term and the coupled masses.",
        pictures={"fig4": lambda study: plots.single_dof_torques(study.single_dof)},
        columns=tables.single_dof_torques,
    ),
    "step": Product(
        place="Section III-B",
        title="Step response of a clutch",
        remark="A constant tip force keeps a clutch slipping while its voltage steps up. The torque that it generates "
        "is a first-order step response, since the lag is that of the normal force.",
        pictures={"step": lambda study: plots.clutch_step(study.step_response)},
        columns=tables.clutch_step,
    ),
    "fig5": Product(
        place="Fig. 5",
        title="Torque over voltage",
        remark="A linear and a quadratic segment for each torque. The marks are a bench test like the paper's, made on "
        "the simulated clutch: with T_k above T_s it first slips at T_k, since below that motion does not persist.",
        pictures={"fig5": lambda study: plots.torque_over_voltage(study.torque_curves)},
        columns=tables.torque_curves,
    ),
    "fig7": Product(
        place="Fig. 7",
        title="Average position error",
        remark="The same test at each time constant, for each material. The paper shows the present clutches.",
        pictures={"fig7": lambda study: plots.error_over_time_constant(study.sweeps)},
        columns=tables.errors,
    ),
    "fig8": Product(
        place="Fig. 8",
        title="Peak acceleration, path length and speed",
        remark="The largest acceleration of the tip, low-pass filtered and without the first 0.2 s, in which the push "
        "sets in. Path length and mean speed are in the paper's text.",
        pictures={
            "fig8": lambda study: plots.peak_acceleration_over_time_constant(study.sweeps),
            "fig8_way_and_speed": lambda study: plots.way_and_speed_over_time_constant(study.sweeps),
        },
        columns=tables.accelerations,
    ),
    "table1": Product(
        place="Table I",
        title="Comparison of the friction materials",
        remark="Averages over the runs at several time constants. A bar shows how far from the paper's number a value "
        "may lie to count as met.",
        pictures={"table1": lambda study: plots.table_comparison(study.table1)},
        columns=tables.table1_columns,
    ),
    "fig9": Product(
        place="Fig. 9",
        title="Torque while the motion turns back",
        remark="Link A moves against a constant voltage on clutch 1, and a step force turns it back. At zero slip the "
        "present clutches hold until T_s is exceeded, then fall to T_k: a jump. With T_k above T_s there is none. The "
        "jump lasts as long as the slip stays inside the stick band, which is a few steps of the simulation.",
        pictures={"fig9": lambda study: plots.reversal_torques(study.reversals)},
        columns=tables.reversals,
    ),
    "fig10": Product(
        place="Fig. 10",
        title="Position error over the feedback gain",
        remark="At the manufacturer's time constant of 0.105 s. V per in·lbf is our reading of the gain's unit; the "
        "paper prints none.",
        pictures={"fig10": lambda study: plots.error_over_gain(study.gain_sweep)},
        columns=tables.gains,
    ),
    "fig11": Product(
        place="Fig. 11",
        title="Line following with torque feedback",
        remark="The same test without and with feedback, seen along the line.",
        pictures={"fig11": lambda study: plots.followed_lines(study.line_following)},
        columns=tables.lines,
    ),
}
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
    files[f"{name}.csv"] = tables.csv_text(product.columns(study)).encode()
    if name == "table1":
        files["table1.json"] = (json.dumps(tables.table1(study), indent=2) + "\n").encode()
    return files
