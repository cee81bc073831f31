"""A machine as a preset file, which commands accept in place of a machine."""

import math
from dataclasses import fields, replace
from types import MappingProxyType

from pter_gym._internal.files import FilePath, find_path, write_text_atomic
from pter_gym.errors import ParameterError
from pter_gym.params._fields import require
from pter_gym.params._machine import Machine, is_preset, machine_of
from pter_gym.params._preset import CLUTCHES, PRESET, Preset, format_preset, parse_preset


def preset_of(machine: Machine, base: Preset = PRESET, *, origin: str | None = None) -> Preset:
    """Return a preset for ``machine_of``, without a hand and with breakaway torque a multiple of dynamic torque.

    Parameters
    ----------
    machine
        Its arm, its clutches, and what these connect.
    base
        All other numbers.
    origin
        Provenance of the numbers that differ from ``base``, in the form used in preset files.
    """
    curve, count = machine.clutch.dynamic, len(machine.clutches)
    clutch = replace(
        base.clutch,
        slope=curve.slope,
        knee=curve.knee,
        curvature=curve.curvature,
        breakaway_ratio=machine.clutch.breakaway.slope / curve.slope,
        time_constant=machine.clutch.time_constant,
        voltage_max=machine.clutch.voltage_max,
        scale=machine.clutch_scale[:count],
    )
    arm = replace(base.arm, **{item.name: getattr(machine.arm, item.name) for item in fields(base.arm)})
    provenance = dict(base.provenance)
    if origin is not None:
        parts = (("arm", arm, base.arm), ("clutch", clutch, base.clutch))
        changed = [
            f"{name}.{k}" for name, now, was in parts for k, value in vars(now).items() if value != getattr(was, k)
        ]
        if machine.clutches != base.clutches:
            changed += [f"{CLUTCHES}.{each.name}" for each in machine.clutches]
        provenance |= dict.fromkeys(changed, origin)
    return replace(base, arm=arm, clutch=clutch, clutches=machine.clutches, provenance=MappingProxyType(provenance))


def save_preset(machine: Machine, path: FilePath, *, origin: str, title: str = "") -> None:
    """Write a machine as a preset; commands and ``find_machine`` accept its path in place of a machine.

    Parameters
    ----------
    machine
        What to write. A preset cannot hold a hand, or non-default ``slip_threshold``, ``substep`` or ``lag``.
    path
        The file, whose name ends in ``.toml``.
    origin
        Provenance of the numbers that differ from the package's own preset: one line that begins with ``published:``,
        ``derived:``, ``fitted:``, ``identified:`` or ``chosen:``.
    title
        Heading of the file.

    Raises
    ------
    ParameterError
        If a preset cannot hold the machine, or ``origin`` or ``path`` is not of this form.
    StorageError
        If the file cannot be written.
    """
    file = find_path("path", path)
    if not is_preset(str(file)):
        raise ParameterError(f"path must end in .toml, got {str(file)!r}")
    text = format_preset(preset_of(machine, origin=origin), title)
    read = machine_of(parse_preset(text))  # which checks it
    for owner, name, usual in (
        *((machine, name, getattr(read, name)) for name in ("hand", "slip_threshold", "substep")),
        (machine.clutch, "lag", read.clutch.lag),
    ):
        require(getattr(owner, name) == usual, owner, name, getattr(owner, name), f"{usual!r} in a preset")
    breakaway, multiple = vars(machine.clutch.breakaway), vars(read.clutch.breakaway)
    alike = all(math.isclose(value, multiple[name], rel_tol=1e-9) for name, value in breakaway.items())
    require(alike, machine.clutch, "breakaway", machine.clutch.breakaway, "a multiple of dynamic in a preset")
    write_text_atomic(file, text)
