"""Pictures and data of ``pter reproduce`` for each figure and table of the paper."""

import json
from collections.abc import Callable

from matplotlib.figure import Figure

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


def files_of(name: str, study: Study) -> dict[str, bytes]:
    """Return the content of a product's files by their names."""
    files: dict[str, bytes] = {}
    for stem, draw in PICTURES[name].items():
        figure = draw(study)
        files |= {f"{stem}.png": png(figure), f"{stem}.pdf": pdf(figure)}
    files[f"{name}.csv"] = tables.csv_text(tables.COLUMNS[name](study)).encode()
    if name == "table1":
        files["table1.json"] = (json.dumps(tables.table1(study), indent=2) + "\n").encode()
    return files
