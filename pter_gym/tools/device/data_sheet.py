"""A clutch or brake from the numbers of its data sheet; what is left out is PTER's."""

from dataclasses import replace

from pter_gym._internal.files import expand_path
from pter_gym._internal.reading import read_toml, reading
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Machine, MachineSpread, TorqueCurve, find_machines
from pter_gym.params._files import is_machine_file

SHEET = ("torque", "at", "off", "lag")
"""Torque [N·m] at a voltage [V], torque [N·m] without one, time constant [s]."""


def machine_of_sheet(**sheet: float | None) -> Machine:
    """Return PTER with four clutches of a data sheet, whose torque is linear in the voltage.

    Parameters
    ----------
    **sheet
        Numbers of ``SHEET``; ``torque`` and ``at`` are given together.

    Raises
    ------
    ParameterError
        If there is no such number, one is out of range, or ``off`` is not below ``torque``.
    """
    given = {name: value for name, value in sheet.items() if value is not None}
    if unknown := [name for name in given if name not in SHEET]:
        raise ParameterError(f"clutch must hold {', '.join(SHEET)}, got {unknown[0]!r}")
    own = BASELINE.clutch
    at = given.get("at", own.voltage_max)
    torque = given.get("torque", own.dynamic.torque(own.voltage_max))
    off = given.get("off", own.dynamic.off_state)
    if ("at" in given) != ("torque" in given):
        raise ParameterError("torque and at must be given together: so many N·m at so many volts")
    if not 0.0 <= off < torque or not at > 0.0:
        raise ParameterError(
            f"torque must be above off ≥ 0 and at above 0, got {torque:g} N·m at {at:g} V and "
            f"{off:g} N·m without voltage"
        )
    dynamic, ratio = own.dynamic, own.breakaway.slope / own.dynamic.slope
    if "torque" in given:
        dynamic = TorqueCurve(slope=(torque - off) / at, knee=at, curvature=0.0, off_state=off)
    elif "off" in given:
        dynamic = replace(dynamic, off_state=off)
    clutch = replace(
        own,
        dynamic=dynamic,
        breakaway=dynamic.scaled(ratio),
        voltage_max=at,
        time_constant=given.get("lag", own.time_constant),
    )
    return replace(BASELINE, clutch=clutch)


def find_device(name: str) -> Machine | MachineSpread:
    """Return what a name or a file describes; a file may hold a ``[clutch]`` of a data sheet alone.

    Raises what ``find_machines`` and ``machine_of_sheet`` do.
    """
    path = expand_path("machine", name) if is_machine_file(name) else None
    if path and path.is_file():
        content = read_toml(path, "machine")
        if content.keys() == {"clutch"} and "type" not in content["clutch"]:
            with reading(f"machine {name}"):
                return machine_of_sheet(**content["clutch"])
    return find_machines(name)
