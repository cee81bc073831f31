# pyright: standard
"""Derivatives by a machine's parameters, from those by the kernels' constants."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from pter_gym._compiled.records import store
from pter_gym._internal.fields import require
from pter_gym._physics.model import model_of
from pter_gym._physics.open_loop import BODY, BODY_WIDTH
from pter_gym.errors import ParameterError
from pter_gym.gradients._branchless import Columns, Stage
from pter_gym.gradients._tracing import adjoint_of
from pter_gym.params import Machine, find_machine
from pter_gym.params._connection import BRAKE_A, BRAKE_B
from pter_gym.params._spread import map_numbers, numbers_of

MAX_SUBSTEPS = 10_000


def divided(machine: Machine | str | None, period: float) -> tuple[Machine, int]:
    """Return a machine whose substeps fill a control step of a period [s], and their number."""
    machine = find_machine(machine)
    require_derivatives(machine)
    if not 0.0 < period <= MAX_SUBSTEPS * machine.substep:
        raise ParameterError(
            f"period must be > 0 s and at most {MAX_SUBSTEPS * machine.substep:g} s, got {period!r}"
        )
    count = math.ceil(period / machine.substep * (1.0 - 1e-9))
    substep = period / count
    return machine if substep == machine.substep else replace(machine, substep=substep), count


def require_derivatives(*machines: Machine) -> None:
    """Raise a ParameterError if a machine's clutches fade, have hysteresis, or may creep."""
    for machine in machines:
        clutch, constant = machine.clutch, "0: at a constant voltage hysteresis has no derivatives"
        require(clutch.fade == 0.0, clutch, "fade", "0: heat has no derivatives")
        require(clutch.hysteresis == 0.0, clutch, "hysteresis", constant)
        refuse_creep(machine)


def refuse_creep(machine: Machine) -> None:
    """Raise a ParameterError if a machine's clutches may creep."""
    clutch = machine.clutch
    require(clutch.band == "vanishing", clutch, "band", '"vanishing": creep has no derivatives')


@np.errstate(divide="ignore", invalid="ignore")  # in the branch of a hand that has no damping
def by_machine(machine: Machine, bar: Any) -> dict[str, float]:
    """Return derivatives by a machine's parameters, from those by a body's (entries, 1)."""
    places = numbers_of(machine)
    rows = BODY_WIDTH + len(places)
    w, adjoints = np.zeros((rows, 1)), np.zeros((rows, 1))
    w[BODY_WIDTH:, 0] = [number.value for number in places.values()]
    adjoints[:BODY_WIDTH] = bar
    _adjoint(machine.clutch.lag, len(machine.clutches))(w, 0, adjoints)
    by = dict(zip(places, adjoints[BODY_WIDTH:, 0].tolist(), strict=True))
    del by["substep"]  # what a longer substep does is no change of the machine
    del by["clutch.hysteresis"]  # of which no state is left where it is 0
    if not machine.has_paper_clutches:  # dry friction is with the slot that slips as its axis does
        for name, brake in (("arm.dry_a", BRAKE_A), ("arm.dry_b", BRAKE_B)):
            if brake.row in machine.slot_rows:
                by[name] += float(bar[BODY.arrangement.dry[machine.slot_rows.index(brake.row)], 0])
    return by


@cache
def _adjoint(lag: str, clutches: int) -> Stage:
    """Return the adjoint of ``model_of``; which numbers there are depends on no others."""
    some = find_machine(None)
    some = replace(some, clutch=replace(some.clutch, lag=lag), clutches=some.clutches[:clutches])
    rows = {place: BODY_WIDTH + k for k, place in enumerate(numbers_of(some))}

    def stage(w: Columns, i: int) -> None:
        varying = with_any_numbers(some, lambda place, _: w[rows[place], i])
        store(w, BODY.machine, i, model_of(varying))

    return adjoint_of(stage)


def with_any_numbers(machine: Machine, number_at: Callable[[str, float], Any]) -> Any:
    """Return what ``model_of`` reads of a machine, with ``number_at(place, value)`` as numbers."""

    def make(owner: Any, **made: Any) -> SimpleNamespace:
        if owner is machine:
            count = len(machine.clutches)
            made["slot_scale"] = *made["clutch_scale"][:count], *machine.slot_scale[count:]
        return SimpleNamespace(**made)

    return map_numbers(machine, lambda place, number: number_at(place, number.value), make)
