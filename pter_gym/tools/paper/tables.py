"""The data behind each figure as columns of a CSV file; a column's name ends with its unit."""

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.benchmark.measures import column
from pter_gym.tools.paper.experiments import Experiments
from pter_gym.tools.paper.path_tests import PAPER_TABLE
from pter_gym.units import INCH, INCH_POUND

Columns = Mapping[str, ArrayLike]

UNITS = {
    "time_constant": "time_constant_s",
    "position_error": "position_error_m",
    "tip_speed": "mean_speed_m_s",
    "tip_acceleration": "mean_acceleration_m_s2",
    "peak_acceleration": "peak_acceleration_m_s2",
    "path_length": "path_length_m",
    "gain": "gain_v_per_in_lbf",
    "saturated": "saturated_fraction_1",
    "volts": "volts_v",
    "breakaway": "breakaway_nm",
    "dynamic": "dynamic_nm",
    "bench_breakaway": "bench_breakaway_nm",
    "bench_dynamic": "bench_dynamic_nm",
}
"""Columns of the fields of results; others keep their names."""

PAPER_UNITS = {
    "_m": ("_in", INCH),
    "_m_s": ("_in_s", INCH),
    "_m_s2": ("_in_s2", INCH),
    "_nm": ("_in_lbf", INCH_POUND),
}
"""Ending of a column in SI, its ending in the paper's unit, and the size of that unit."""

TABLE_KEYS = ("position_error_in", "tip_speed_in_s", "tip_acceleration_in_s2")
"""Entries of a row of Table I in ``table1.json``."""


def csv_text(columns: Columns) -> str:
    """Return columns of equal length as a CSV file with one line of names; NaN is an empty cell."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(
        zip(*(map(_cell, np.asarray(values).tolist()) for values in columns.values()), strict=True)
    )
    return buffer.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.9g}"
    return int(value) if isinstance(value, bool) else value


def stacked(parts: Iterable[Columns]) -> Columns:
    """Return the rows of several parts stacked, lengths and torques in the paper's units too.

    A single value is repeated in each row of its part.
    """
    columns: dict[str, list[NDArray[Any]]] = {}
    for part in parts:
        for name, values in zip(part, np.broadcast_arrays(*part.values()), strict=True):
            columns.setdefault(name, []).append(values)
            for ending, (paper, unit) in PAPER_UNITS.items():
                if name.endswith(ending):
                    columns.setdefault(name.removesuffix(ending) + paper, []).append(values / unit)
    return {name: np.concatenate(values) for name, values in columns.items()}


def by_model(results: Mapping[str, object]) -> Columns:
    """Return the fields of results stacked, with a column of the machines' names."""
    return stacked({"model": name, **result_columns(result)} for name, result in results.items())


def result_columns(result: object) -> Columns:
    """Return the fields of a result, arrays of equal length."""
    return {UNITS.get(name, name): values for name, values in vars(result).items()}


def single_dof_columns(experiments: Experiments) -> Columns:
    """Figs. 3 and 4: tip and torques in each test."""
    return stacked(
        {
            "clutch": test.clutch,
            "locked_clutch": test.locked,
            "time_s": test.trajectory.time,
            "tip_x_m": test.trajectory.tip_position[:, 0],
            "tip_y_m": test.trajectory.tip_position[:, 1],
            "deviation_from_line_m": test.deviation,
            "input_torque_nm": test.input_torque,
            "clutch_torque_nm": test.torque,
            "locked_clutch_torque_nm": np.abs(test.locked_torque),
            "tip_speed_m_s": np.linalg.norm(test.trajectory.tip_velocity, axis=1),
        }
        for test in experiments.single_dof
    )


def clutch_step_columns(experiments: Experiments) -> Columns:
    """The step response of each clutch."""
    step = experiments.step_response
    return stacked(
        {
            "clutch": k,
            "time_s": step.time,
            "torque_nm": torque,
            "first_order_torque_nm": step.first_order,
        }
        for k, torque in enumerate(step.torque, 1)
    )


def reversal_columns(experiments: Experiments) -> Columns:
    """Fig. 9: torque and slip of clutch 1."""
    return stacked(
        {
            "model": name,
            "time_s": reversal.trajectory.time,
            "torque_nm": reversal.torque,
            "slip_velocity_rad_s": reversal.trajectory.slip_velocity[:, 0],
            "dynamic_torque_nm": reversal.dynamic,
        }
        for name, reversal in experiments.reversals.items()
    )


def lines(experiments: Experiments) -> Columns:
    """Fig. 11: the tip with and without feedback."""
    names = "time_s", "tip_x_m", "tip_y_m", "arc_length_m", "normal_error_m"
    return stacked(
        {"gain_v_per_in_lbf": float(gain)}
        | {name: column(run.telemetry, name.rpartition("_")[0]) for name in names}
        for gain, (run,) in experiments.line_following.runs.items()
    )


def table1_entries(experiments: Experiments) -> dict[str, dict[str, float]]:
    """Table I as ``table1.json`` holds it, in the paper's units."""
    return {
        name: dict(zip(TABLE_KEYS, row, strict=True)) for name, row in experiments.table1.items()
    }


def table1_columns(experiments: Experiments) -> Columns:
    """Table I next to the paper's."""
    table = experiments.table1
    columns: dict[str, ArrayLike] = {"model": list(table)}
    for k, key in enumerate(TABLE_KEYS):
        columns[key] = [row[k] for row in table.values()]
        columns[f"paper_{key}"] = [PAPER_TABLE[name][k] for name in table]
    return columns


COLUMNS: dict[str, Callable[[Experiments], Columns]] = {
    "fig3": single_dof_columns,
    "fig4": single_dof_columns,
    "step": clutch_step_columns,
    "fig5": lambda experiments: by_model(experiments.torque_curves),
    "fig7": lambda experiments: by_model(experiments.sweeps),
    "fig8": lambda experiments: by_model(experiments.sweeps),
    "table1": table1_columns,
    "fig9": reversal_columns,
    "fig10": lambda experiments: stacked([result_columns(experiments.gain_sweep)]),
    "fig11": lines,
}
"""The data of each figure or table."""
