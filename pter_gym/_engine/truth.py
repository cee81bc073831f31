"""What no sensor shows of worlds: state, machine, hand and task, as named numbers."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import compile_kernel
from pter_gym._compiled.layout import Field, Layout
from pter_gym._compiled.records import Records, layout_of, record_fields
from pter_gym._engine.world import ADDRESSES, ROW, Addresses, WorldState
from pter_gym.params import Machine
from pter_gym.tasks.path_following._context import CONTEXT, CONTEXT_WIDTH, Context
from pter_gym.tasks.path_following._observation import (
    FORCE_SCALE,
    OMEGA_SCALE,
    SPEED_SCALE,
    TORQUE_SCALE,
    observation_layout,
)

_UNIT_SCALES = {
    "rad/s": OMEGA_SCALE,
    "m/s": SPEED_SCALE,
    "N": FORCE_SCALE,
    "N·m": TORQUE_SCALE,
    "N/m": 300.0,
    "N·s/m": 20.0,
    "J": 10.0,
}
"""Usual sizes of what is true of a world and neither observed nor has a scale of its own."""


def _build_tell(digest: str) -> Any:
    def tell(worlds: Records, constants: Records, entries: Records, truth: Records) -> None:
        _ = digest
        rows, width = worlds.shape[1], worlds.shape[2]
        for world in range(truth.shape[0]):
            block, lane = world // width, world % width
            context = int(worlds[block, ROW.context_at, lane]) - rows
            for k in range(truth.shape[1]):
                entry = entries[k]
                own = entry < rows
                truth[world, k] = worlds[block, entry, lane] if own else constants[context + entry]

    return tell


@cache
def tell_kernel() -> Any:
    """Return the compiled ``tell(worlds, constants, entries, truth)``.

    It writes some rows of the worlds, (B, rows, lanes), and numbers of their contexts, which follow
    these rows, to ``truth``, (N, len(entries)).
    """
    return compile_kernel(_build_tell)


def all_entries(rows: int) -> NDArray[np.intp]:
    """Return all that is true of worlds with so many rows but the limit of the energy.

    That one follows from the rest.
    """
    return np.delete(np.arange(rows + CONTEXT_WIDTH), rows + int(CONTEXT.task.energy_max))


def told_entries(rows: int) -> NDArray[np.intp]:
    """Return those that say something of a world: no addresses, nor ``alive``."""
    places = rows + int(CONTEXT.hand.record_first), rows + int(CONTEXT.task.path.first)
    silent = [*range(ADDRESSES.end), int(ROW.alive), *places]
    entries = all_entries(rows)
    return entries[~np.isin(entries, silent)]


def told_layout(rows: int, machine: Machine) -> Layout:
    """Return names, units and scales of ``told_entries``."""
    observed = observation_layout(machine, "force").fields
    scales = _UNIT_SCALES | {"V": machine.clutch.voltage_max}
    scales |= {field.name: field.scale for field in observed}

    def scaled(field: Field) -> Field:
        usual = scales.get(field.name, scales.get(field.unit, 1.0))
        return replace(field, scale=usual if field.scale == 1.0 else field.scale)

    state = map(scaled, layout_of(WorldState).fields[: rows - ADDRESSES.end])
    context = (
        replace(field, name=f"{name}_{field.name}")
        for name, _, kind in record_fields(Context)
        for field in map(scaled, layout_of(kind).fields)
    )
    fields: list[Field] = [*layout_of(Addresses).fields, *state, *context]
    return Layout(tuple(fields[int(entry)] for entry in told_entries(rows)))
