"""The data behind each figure as columns of a CSV file; a column's name ends with its unit."""

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.benchmark._measures import column
from pter_gym.tools.paper.path_tests import PAPER_TABLE, Sweep
from pter_gym.tools.paper.study import Study
from pter_gym.units import to_inch_pounds, to_inches

Array = NDArray[np.float64]
Columns = dict[str, NDArray[Any]]


def csv_text(columns: Mapping[str, ArrayLike]) -> str:
    """Return columns of equal length as a CSV file with one line of names; NaN is an empty cell."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(map(_cell, np.asarray(values).tolist()) for values in columns.values()), strict=True))
    return buffer.getvalue()


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.9g}"
    return str(int(value)) if isinstance(value, bool) else str(value)


def stacked(parts: Iterable[Mapping[str, ArrayLike]]) -> Columns:
    """Return the rows of several parts stacked; a single value is repeated in each row of its part."""
    columns: dict[str, list[NDArray[Any]]] = {}
    for part in parts:
        for name, values in zip(part, np.broadcast_arrays(*part.values()), strict=True):
            columns.setdefault(name, []).append(values)
    return {name: np.concatenate(values) for name, values in columns.items()}


def length(name: str, metres: Array, per: str = "") -> Columns:
    """Return a length, or a quantity with ``per``, in SI and in the paper's unit."""
    return {f"{name}_m{per}": metres, f"{name}_in{per}": np.asarray(to_inches(1.0) * metres)}


def torque(name: str, newton_metres: Array) -> Columns:
    """Return a torque in SI and in the paper's unit."""
    return {f"{name}_nm": newton_metres, f"{name}_in_lbf": np.asarray(to_inch_pounds(1.0) * newton_metres)}


def single_dof_paths(study: Study) -> Columns:
    """Fig. 3: the tip in each test."""
    return stacked(
        {
            "clutch": test.clutch,
            "locked_clutch": test.locked,
            "time_s": test.trajectory.time,
            **length("tip_x", test.trajectory.tip_position[:, 0]),
            **length("tip_y", test.trajectory.tip_position[:, 1]),
            "deviation_from_line_m": test.deviation,
        }
        for test in study.single_dof
    )


def single_dof_torques(study: Study) -> Columns:
    """Fig. 4: the torques in each test."""
    return stacked(
        {
            "clutch": test.clutch,
            "locked_clutch": test.locked,
            "time_s": test.trajectory.time,
            **torque("input_torque", test.input_torque),
            **torque("clutch_torque", test.torque),
            **torque("locked_clutch_torque", np.abs(test.locked_torque)),
            "tip_speed_m_s": np.linalg.norm(test.trajectory.tip_velocity, axis=1),
        }
        for test in study.single_dof
    )


def clutch_step(study: Study) -> Columns:
    """The step response of each clutch."""
    step = study.step_response
    return stacked(
        {"clutch": k, "time_s": step.time, **torque("torque", values), "first_order_torque_nm": step.first_order}
        for k, values in enumerate(step.torque, 1)
    )


def torque_curves(study: Study) -> Columns:
    """Fig. 5: the curves, and the bench tests where there is one at the voltage."""

    def parts() -> Iterable[Columns]:
        for name, curves in study.torque_curves.items():
            volts = np.union1d(curves.volts, curves.bench_volts)
            measured = np.full((2, len(volts)), np.nan)
            measured[:, np.searchsorted(volts, curves.bench_volts)] = curves.bench_breakaway, curves.bench_dynamic
            yield {
                "model": np.array(name),
                "volts_v": volts,
                **torque("breakaway", np.interp(volts, curves.volts, curves.breakaway)),
                **torque("dynamic", np.interp(volts, curves.volts, curves.dynamic)),
                "bench_breakaway_nm": measured[0],
                "bench_dynamic_nm": measured[1],
            }

    return stacked(parts())


def sweeps(found: Mapping[str, Sweep], name: str) -> Columns:
    """Figs. 7 and 8, and the test of the control laws: all scores over the time constant."""
    return stacked(
        {
            name: key,
            "time_constant_s": sweep.time_constant,
            **length("position_error", sweep.position_error),
            **length("peak_acceleration", sweep.peak_acceleration, "_s2"),
            **length("mean_acceleration", sweep.tip_acceleration, "_s2"),
            **length("mean_speed", sweep.tip_speed, "_s"),
            **length("path_length", sweep.path_length),
            "completed": sweep.completed,
        }
        for key, sweep in found.items()
    )


def reversals(study: Study) -> Columns:
    """Fig. 9: torque and slip of clutch 1."""
    return stacked(
        {
            "model": name,
            "time_s": reversal.trajectory.time,
            **torque("torque", reversal.torque),
            "slip_velocity_rad_s": reversal.trajectory.slip_velocity[:, 0],
            "dynamic_torque_nm": reversal.dynamic,
        }
        for name, reversal in study.reversals.items()
    )


def gains(study: Study) -> Columns:
    """Fig. 10: position error and saturation over the gain."""
    sweep = study.gain_sweep
    return {
        "gain_v_per_in_lbf": sweep.gain,
        "gain_v_per_nm": np.asarray(to_inch_pounds(1.0) * sweep.gain),
        **length("position_error", sweep.position_error),
        "saturated_fraction_1": sweep.saturated,
        "completed": sweep.completed,
    }


def lines(study: Study) -> Columns:
    """Fig. 11: the tip with and without feedback."""
    test = study.line_following
    return stacked(
        {
            "gain_v_per_in_lbf": gain,
            "time_s": column(run.telemetry, "time"),
            **length("tip_x", column(run.telemetry, "tip_x")),
            **length("tip_y", column(run.telemetry, "tip_y")),
            **length("arc_length", column(run.telemetry, "arc_length")),
            **length("normal_error", column(run.telemetry, "normal_error")),
        }
        for gain, run in ((0.0, test.without), (test.gain, test.with_feedback))
    )


TABLE_KEYS = ("position_error_in", "tip_speed_in_s", "tip_acceleration_in_s2")
"""Entries of a row of Table I in ``table1.json``."""


def table1(study: Study) -> dict[str, dict[str, float]]:
    """Table I as ``table1.json`` holds it, in the paper's units."""
    return {name: dict(zip(TABLE_KEYS, row, strict=True)) for name, row in study.table1.items()}


def table1_columns(study: Study) -> Columns:
    """Table I beside the paper's."""
    columns: Columns = {"model": np.array(list(study.table1))}
    ours, papers = np.array(list(study.table1.values())), np.array([PAPER_TABLE[name] for name in study.table1])
    for k, key in enumerate(TABLE_KEYS):
        columns |= {key: ours[:, k], f"paper_{key}": papers[:, k]}
    return columns


COLUMNS: dict[str, Callable[[Study], Columns]] = {
    "fig3": single_dof_paths,
    "fig4": single_dof_torques,
    "step": clutch_step,
    "fig5": torque_curves,
    "fig7": lambda study: sweeps(study.sweeps, "model"),
    "fig8": lambda study: sweeps(study.sweeps, "model"),
    "table1": table1_columns,
    "fig9": reversals,
    "fig10": gains,
    "fig11": lines,
    "policies": lambda study: sweeps(study.policies, "policy"),
}
"""The data of each figure or table."""
