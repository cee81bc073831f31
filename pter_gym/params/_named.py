"""The machines with names: the paper's three, and arrangements that were never built."""

from dataclasses import replace

from pter_gym.errors import ParameterError
from pter_gym.params._actuators import read_actuators
from pter_gym.params._connection import BRAKE_A, BRAKE_B, COUPLED, INVERTED
from pter_gym.params._machine import Clutch, Machine, TorqueCurve

_BREAKAWAY_RATIO = 1.12
"""T_s/T_k of the present clutches; fitted: at least 1.12 for the jump of Fig. 9."""

_DELRIN_SCALE = 0.8008
"""T_k of Delrin as measured, relative to the present clutches; fitted."""

_DELRIN_RATIO = 1.24
"""T_s/T_k of Delrin as measured; fitted: at least 1.12 for the jump of Fig. 9."""

_MU_DYNAMIC_PRESENT = 0.40178571428571425
"""Dynamic friction coefficient of the present clutches; derived: the static one over T_s/T_k."""

_MU_STATIC_PRESENT = 0.45
"""Static friction coefficient of the present clutches (paper section IV-B.2)."""

_MU_STATIC_DELRIN, _MU_DYNAMIC_DELRIN = 0.20, 0.35
"""Friction coefficients of Delrin 100 on steel from the literature (paper section IV-B.2)."""


def with_friction(clutch: Clutch, breakaway: float, dynamic: float) -> Clutch:
    """Return a clutch of another friction material: factors on breakaway and dynamic torque."""
    return replace(
        clutch, breakaway=clutch.breakaway.scaled(breakaway), dynamic=clutch.dynamic.scaled(dynamic)
    )


def paper_machines(
    baseline: Machine,
    *,
    breakaway_ratio: float = _BREAKAWAY_RATIO,
    delrin_scale: float = _DELRIN_SCALE,
    delrin_ratio: float = _DELRIN_RATIO,
    mu_dynamic: float = _MU_DYNAMIC_PRESENT,
) -> dict[str, Machine]:
    """Return the machines of Table I by name: the present clutches, and Delrin's two.

    Parameters
    ----------
    baseline
        The machine with the present clutches.
    breakaway_ratio, mu_dynamic
        Their T_s/T_k, and their dynamic friction coefficient.
    delrin_scale, delrin_ratio
        T_k of Delrin as measured, over that of the present clutches, and its T_s/T_k.
    """
    factors = {
        "baseline": (1.0, 1.0),
        "delrin_experimental": (delrin_scale * delrin_ratio / breakaway_ratio, delrin_scale),
        "delrin_theoretical": (
            _MU_STATIC_DELRIN / _MU_STATIC_PRESENT,
            _MU_DYNAMIC_DELRIN / mu_dynamic,
        ),
    }
    return {
        name: replace(baseline, clutch=with_friction(baseline.clutch, *pair))
        for name, pair in factors.items()
    }


_CURVE = TorqueCurve(slope=0.8869, knee=19.4, curvature=1.557)

PAPER_MACHINES = paper_machines(
    Machine(clutch=Clutch(breakaway=_CURVE.scaled(_BREAKAWAY_RATIO), dynamic=_CURVE))
)

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


def nominal_machine(machines: set[Machine]) -> Machine:
    """Return the only machine, or the paper's with clutches and largest voltage of several."""
    first, *others = machines
    if not others:
        return first
    if any(machine.clutches != first.clutches for machine in others):
        raise ParameterError(
            "Machine.clutches of all worlds must be the same for a policy bound to a machine"
        )
    clutch = replace(BASELINE.clutch, voltage_max=first.clutch.voltage_max)
    return replace(BASELINE, clutches=first.clutches, clutch=clutch)
