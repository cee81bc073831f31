"""The machines that have names: the paper's three, and arrangements of clutches that were never built."""

from dataclasses import replace
from typing import cast

from pter_gym.errors import ParameterError, nearest
from pter_gym.params._actuators import read_actuators
from pter_gym.params._connection import BRAKE_A, BRAKE_B, COUPLED, INVERTED
from pter_gym.params._machine import Clutch, Machine
from pter_gym.params._preset import PRESET, Preset, is_preset, load_preset, machine_of

_MU_STATIC_PRESENT = 0.45
"""Static friction coefficient of the present clutches (paper section IV-B.2)."""

_MU_STATIC_DELRIN, _MU_DYNAMIC_DELRIN = 0.20, 0.35
"""Friction coefficients of Delrin 100 on steel from the literature (paper section IV-B.2)."""


def with_friction(clutch: Clutch, breakaway: float, dynamic: float) -> Clutch:
    """Return a clutch of another friction material, given factors on its breakaway and dynamic torque."""
    return replace(
        clutch, breakaway=clutch.breakaway.scaled(breakaway), dynamic=clutch.dynamic.scaled(dynamic)
    )


def paper_machines_of(preset: Preset) -> dict[str, Machine]:
    """Return the three machines of Table I by name: the present clutches, Delrin as measured and as published."""
    baseline, delrin = machine_of(preset), preset.delrin
    scale, mu_dynamic = delrin["dynamic_scale"], delrin["mu_dynamic_present"]
    factors = {
        "baseline": (1.0, 1.0),
        "delrin_experimental": (
            scale * delrin["breakaway_ratio"] / preset.clutch["breakaway_ratio"],
            scale,
        ),
        "delrin_theoretical": (
            _MU_STATIC_DELRIN / _MU_STATIC_PRESENT,
            _MU_DYNAMIC_DELRIN / mu_dynamic,
        ),
    }
    return {
        name: replace(baseline, clutch=with_friction(baseline.clutch, *each))
        for name, each in factors.items()
    }


PAPER_MACHINES = paper_machines_of(PRESET)

BASELINE = PAPER_MACHINES["baseline"]
"""PTER with its present clutches (paper section IV-B.1)."""

DELRIN_EXPERIMENTAL = PAPER_MACHINES["delrin_experimental"]
"""PTER with Delrin clutches as measured on the testbed (paper section IV-B.2)."""

DELRIN_THEORETICAL = PAPER_MACHINES["delrin_theoretical"]
"""PTER with Delrin clutches as in the literature: T_k > T_s (paper section IV-B.2)."""

ARRANGEMENTS = {
    "two-brakes": (BRAKE_A, BRAKE_B),
    "brakes-and-coupling": (BRAKE_A, BRAKE_B, COUPLED),
    "brakes-and-inverter": (BRAKE_A, BRAKE_B, INVERTED),
    "couplings-1-2": (
        BRAKE_A,
        BRAKE_B,
        replace(COUPLED, row=(1.0, -0.5)),
        replace(INVERTED, row=(1.0, 0.5)),
    ),
    "couplings-2-1": (
        BRAKE_A,
        BRAKE_B,
        replace(COUPLED, row=(1.0, -2.0)),
        replace(INVERTED, row=(1.0, 2.0)),
    ),
    "double-brakes": (
        BRAKE_A,
        BRAKE_B,
        replace(BRAKE_A, name="A to ground, 2"),
        replace(BRAKE_B, name="B to ground, 2"),
    ),
}
"""Clutches other than the paper's, by name. None of these machines was ever built: PTER has
``PAPER_CLUTCHES``.

In ``couplings-1-2`` axis B turns twice as fast as axis A while a coupling is stuck, in
``couplings-2-1`` half as fast. """

MACHINES = PAPER_MACHINES | {
    name: replace(BASELINE, clutches=clutches) for name, clutches in ARRANGEMENTS.items()
}
"""Machines that environments and commands know by name; another clutch material is one more entry.

The first three are the paper's; the others are ``BASELINE`` with ``ARRANGEMENTS``, which were never
built. """


ACTUATORS = read_actuators(
    {"pter-clutch": BASELINE.clutch, "delrin-clutch": DELRIN_EXPERIMENTAL.clutch}
)
"""Clutches and brakes by name, with what is known of them."""


def find_machine(machine: Machine | str | None) -> Machine:
    """Return a machine given as itself, by its name, or by the path of a preset; ``BASELINE`` for
    None.

    A name is one of ``MACHINES``, or of ``ACTUATORS`` for PTER with four of these in place of its
    clutches.

    Raises
    ------
    ParameterError
        If it is neither a machine nor a known name (the nearest names are suggested), or a preset
        cannot be read.
    DataError
        If a preset is damaged, incomplete or out of range.
    """
    given = cast("object", machine)
    if given is None:
        return BASELINE
    if isinstance(given, Machine):
        return given
    if isinstance(given, str) and given in MACHINES:
        return MACHINES[given]
    if isinstance(given, str) and given in ACTUATORS:
        return replace(BASELINE, clutch=ACTUATORS[given].clutch)
    if isinstance(given, str) and is_preset(given):
        return machine_of(load_preset(given))
    names = (*MACHINES, *ACTUATORS)
    raise ParameterError(
        f"machine must be a Machine or one of {', '.join(names)} or the path of a preset (.toml), "
        f"got {given!r:.200}{nearest(given, names)}"
    )
