"""Layout of the kernels' arrays and choices of the page, as JSON from the package's declarations.

A page finds numbers in the module's memory by places: ``places(ROW)`` is the record of a world with
row numbers in place of values. Its choices (machines, hands, paths, laws, networks) are values in
the same records.
"""

from dataclasses import asdict, replace
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import width
from pter_gym._engine.batch import Batch
from pter_gym._engine.hand import INSTANT
from pter_gym._engine.world import CONFIG, ROW, ROWS
from pter_gym._physics.friction import ClutchMode
from pter_gym.benchmark.measures import PRICE, SEGMENTS
from pter_gym.benchmark.policies import find_policy
from pter_gym.controllers import CONTROLLERS, Policy
from pter_gym.controllers._gains import Memory
from pter_gym.hands import MultiSineHand, Operator, RecordedForces
from pter_gym.haptics import torque_limits
from pter_gym.params import BASELINE, MACHINES, Machine
from pter_gym.paths import PATHS, Path
from pter_gym.policies import read_policy, shipped_policies
from pter_gym.policies.tuned import tuned_policies
from pter_gym.scenarios import PACES
from pter_gym.scenarios.variations import CURVED_WIDTH
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing
from pter_gym.tasks.path_following._context import CONTEXT, CONTEXT_WIDTH, context_of
from pter_gym.tasks.path_following._pace import ALLOWANCE, START
from pter_gym.tasks.path_following._specification import largest_error_max
from pter_gym.tools.palette import clutch_name
from pter_gym.tools.web.kernels import LAWS

POINTER = RecordedForces(times=(0.0,), along=(0.0,), across=(0.0,))
"""A hand whose recording, here of one instant, a page writes while the world moves."""

HANDS: MappingProxyType[str, Operator] = MappingProxyType(
    {"paper": MultiSineHand(), "pointer": POINTER}
)
"""Hands by name."""


def tables() -> dict[str, Any]:
    """Return all tables."""
    return {**declarations(), **choices()}


def declarations() -> dict[str, Any]:
    """Return the layout of the module's memory, and its meaning."""
    batch = pages_batch()
    return {
        "observation": fields(batch.layout),
        "telemetry": fields(TELEMETRY),
        "modes": [mode.name for mode in ClutchMode],
        "places": {"world": nested(ROW), "config": nested(CONFIG), "context": nested(CONTEXT)},
        "widths": {
            "world": ROWS,
            "telemetry": len(TELEMETRY),
            "context": CONTEXT_WIDTH,
            "instant": INSTANT,
            "memory": width(Memory),
        },
    }


def choices() -> dict[str, Any]:
    """Return a page's choices: machines with the paper's clutches, and the policies for them."""
    batch = pages_batch()
    machines = {name: machine for name, machine in MACHINES.items() if machine.has_paper_clutches}
    config = batch.kernel_arrays()["config"]
    return {
        "config": [value if np.isfinite(value) else None for value in config.tolist()],
        "control_period": batch.task.control_period,
        "paces": dict(PACES),
        "scoring": {"segments": SEGMENTS, "price": PRICE, "allowance": ALLOWANCE, "start": START},
        "machines": {
            name: context_part(machine=machine, record="machine")
            for name, machine in machines.items()
        },
        "told": {
            name: context_part(machine=machine, record="told") for name, machine in machines.items()
        },
        "torque_max": {
            name: float(torque_limits(machine, 0.0)[1].max()) for name, machine in machines.items()
        },
        "hands": {name: context_part(hand=hand, record="hand") for name, hand in HANDS.items()},
        "task": context_part(record="task"),
        "arrangement": context_part(record="arrangement"),
        "clutches": [
            {"name": clutch.name, "colour": clutch_name(clutch.row)} for clutch in BASELINE.clutches
        ],
        "paths": {name: arcs_of(path) for name, path in PATHS.items()},
        "laws": {name: laws(name, batch.layout) for name in (*CONTROLLERS, *tuned_policies())},
        "policies": {name: network_gains(name, batch.layout) for name in policies_of_the_paper()},
    }


def policies_of_the_paper() -> list[str]:
    """Return the names of the trained policies for the paper's clutches."""
    rows = tuple(clutch.row for clutch in BASELINE.clutches)
    return [name for name in shipped_policies() if read_policy(name).interface.clutches == rows]


def pages_batch() -> Batch:
    """Return a world for a page: with all sensors, voltages as actions and no time limit."""
    return Batch(BASELINE, PathFollowing(), 1, sensors="force")


def fields(layout: Layout) -> list[dict[str, Any]]:
    """Return names, units, meanings and scales."""
    return [asdict(field) for field in layout.fields]


def nested(record: Any) -> Any:
    """Return a record as nested objects, by the names of its entries."""
    if not isinstance(record, tuple):
        return record
    return {name: nested(value) for name, value in cast(Any, record)._asdict().items()}


def context_part(record: str, machine: Machine = BASELINE, hand: Operator = POINTER) -> Any:
    """Return a record of the context of a machine and a hand."""
    task = PathFollowing(hand=hand)
    return nested(getattr(context_of(task, machine, (0, 0), (0, 1)), record))


def arcs_of(path: Path) -> dict[str, Any]:
    """Return the arcs of a path, and the half-width of the workspace about it [m]."""
    task = PathFollowing(path=path)
    if path.max_curvature > 0.0:
        task = replace(task, error_max=min(CURVED_WIDTH, largest_error_max(path)))
    return {"arcs": path.arcs.table.tolist(), "length": path.length, "error_max": task.error_max}


def numbered_gains(policy: Policy) -> list[float]:
    """Return the number of a compiled law in the module, and its gains."""
    law: Any = policy.law
    return [LAWS.index(law.function), *law.gains.tolist()]


def laws(name: str, layout: Layout) -> dict[str, list[float]]:
    """Return the gains of a law for each of the scenarios whose gains a page uses."""
    controllers: dict[str, Any] = {
        scenario: find_policy(name, scenario=scenario) for scenario in ("standard", "paths")
    }
    return {
        scenario: numbered_gains(controller.bind(BASELINE, layout))
        for scenario, controller in controllers.items()
    }


def network_gains(name: str, layout: Layout) -> dict[str, Any]:
    """Return the gains of a trained policy other than its weights, and the size of its memory."""
    policy = read_policy(name)
    bound: Any = policy.bind(BASELINE, layout)
    weights = sum(weight.size + bias.size for weight, bias in policy.layers)
    return {
        "frame_skip": policy.interface.frame_skip,
        "gains": numbered_gains(bound)[:-weights],
        "layers": [f"layer_{k}" for k in range(len(policy.layers))],
        "memory": bound.start(1).shape[1],
    }
