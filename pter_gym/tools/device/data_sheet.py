"""A clutch or brake from the numbers of its data sheet; what is left out is PTER's."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple, cast

import numpy as np

from pter_gym._internal.checks import is_finite
from pter_gym._internal.files import expand_path
from pter_gym._internal.reading import read_toml, reading
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine, MachineSpread, TorqueCurve, find_machines
from pter_gym.params._files import is_machine_file


class Limits(NamedTuple):
    """Least and largest number of a data sheet, and its unit."""

    least: float
    most: float
    unit: str


SHEET = {
    "torque": Limits(0.0, 500.0, "N·m"),
    "at": Limits(0.0, 1000.0, "V (or A, for a current)"),
    "off": Limits(0.0, 500.0, "N·m"),
    "lag": Limits(5e-4, 2.0, "s"),
    "hysteresis": Limits(0.0, 0.4, "of the largest voltage"),
}
"""Torque at a voltage or current, torque without one, time constant, half the loop's width."""

KNEES = np.linspace(0.0, 0.95, 96)
"""Where a curve through a table may bend, over its last voltage."""

ASTRAY = 0.1
"""Largest distance of the curve from a table's torque, over the largest torque."""


def machine_of_sheet(**sheet: Any) -> Machine:
    """Return PTER with four clutches of a data sheet.

    Parameters
    ----------
    **sheet
        Numbers of ``SHEET``. ``torque`` and ``at`` are given together: one of each for a torque
        that is linear in the voltage, or lists of both, for the ``TorqueCurve`` that is nearest.

    Raises
    ------
    ParameterError
        If there is no such number, one is out of range, ``off`` is not below ``torque``, or no
        curve is near the table.
    """
    given = {name: value for name, value in sheet.items() if value is not None}
    if unknown := [name for name in given if name not in SHEET]:
        raise ParameterError(f"clutch must hold {', '.join(SHEET)}, got {unknown[0]!r}")
    own = BASELINE.clutch
    if ("at" in given) != ("torque" in given):
        raise ParameterError("torque and at must be given together: so many N·m at so many volts")
    dynamic, top = own.dynamic, own.voltage_max
    if "torque" in given:
        volts, torques = _table(given)
        dynamic, top = _nearest_curve(volts, torques), volts[-1]
    elif "off" in given:
        dynamic = replace(dynamic, off_state=_number("off", given["off"]))
        if dynamic.off_state >= own.largest.dynamic:
            raise ParameterError(f"off must be below PTER's torque, got {given['off']!r}")
    clutch = replace(
        own,
        dynamic=dynamic,
        breakaway=dynamic.scaled(own.breakaway.slope / own.dynamic.slope),
        voltage_max=top,
        time_constant=_number("lag", given.get("lag", own.time_constant)),
        hysteresis=top * _number("hysteresis", given.get("hysteresis", 0.0)),
    )
    return replace(BASELINE, clutch=clutch)


def _number(name: str, value: object) -> float:
    """Return a number of a sheet, or raise a ParameterError."""
    least, most, unit = SHEET[name]
    if not is_finite(value) or not least <= (number := float(cast("float", value))) <= most:
        doubt = f": is this in {unit}?" if is_finite(value) else ""
        raise ParameterError(
            f"{name} must be a number from {least:g} to {most:g} {unit}, got {value!r:.100}{doubt}"
        )
    return number


def _table(given: Mapping[str, Any]) -> tuple[list[float], list[float]]:
    """Return voltages, from 0 on, and torques of a sheet, or raise a ParameterError."""
    columns: list[list[float]] = []
    for name in ("at", "torque"):
        column: Sequence[object] = (
            given[name] if isinstance(given[name], list | tuple) else [given[name]]
        )
        columns.append([_number(name, each) for each in column])
    volts, torques = columns
    if len(volts) != len(torques):
        raise ParameterError(
            "torque and at must hold as many numbers: a table such as torque = [0.5, 5.0, 9.0] has "
            f"at = [0.0, 4.0, 8.0], got {given['torque']!r:.100} and {given['at']!r:.100}"
        )
    if not volts or volts[0] > 0.0:
        off = _number("off", given.get("off", BASELINE.clutch.dynamic.off_state))
        volts, torques = [0.0, *volts], [off, *torques]
    elif "off" in given:
        raise ParameterError("off must be left out with a table that begins at 0")
    if not all(a < b for column in (volts, torques) for a, b in pairwise(column)):
        raise ParameterError(
            "torque must rise with at, and be above off ≥ 0, got "
            + ", ".join(f"{t:g} N·m at {v:g}" for v, t in zip(volts, torques, strict=True))
        )
    return volts, torques


def _nearest_curve(volts: Sequence[float], torques: Sequence[float]) -> TorqueCurve:
    """Return the curve that is nearest to a table by squares, or raise a ParameterError."""
    top, v, wanted = volts[-1], np.array(volts), np.array(torques)
    if len(volts) == 2:
        slope = (torques[1] - torques[0]) / top
        return TorqueCurve(slope=slope, knee=top, curvature=0.0, off_state=torques[0])
    best, nearest = math.inf, None
    for knee in KNEES * top:
        columns = np.stack([v, np.maximum(v - knee, 0.0) ** 2], axis=1)
        least_squares = cast("Any", np.linalg.lstsq)
        solution = least_squares(columns, wanted - wanted[0], rcond=None)[0]
        slope, curvature = solution.tolist()
        error = float(np.abs(wanted[0] + columns @ solution - wanted).max())
        if error < best and slope > 0.0 and slope + 2.0 * curvature * (top - knee) > 0.0:
            best = error
            nearest = TorqueCurve(
                slope=slope, knee=float(knee), curvature=curvature, off_state=torques[0]
            )
    if nearest is None or best > ASTRAY * torques[-1]:
        raise ParameterError(
            "torque must be near a straight line that bends once, as TorqueCurve has it: the "
            f"nearest is {best:.2g} N·m off, of {torques[-1]:g}"
        )
    return nearest


def find_device(name: str) -> Machine | MachineSpread:
    """Return what a name or a file describes; a file may hold a ``[clutch]`` of a data sheet alone.

    Raises what ``find_machines`` and ``machine_of_sheet`` do.
    """
    path = expand_path("machine", name) if is_machine_file(name) else None
    if path and path.is_file():
        content = read_toml(path, "machine")
        sheet: Any = content.get("clutch")
        if content.keys() == {"clutch"} and not (isinstance(sheet, dict) and "type" in sheet):
            with reading(f"machine {name}"):
                if not isinstance(sheet, dict):
                    raise ParameterError(
                        f"clutch must be a table with {', '.join(SHEET)}, got {sheet!r:.100}"
                    )
                return machine_of_sheet(**cast("dict[str, Any]", sheet))
    return find_machines(name)
