"""A page's information about the kernels and its choices, as JSON, all from the package's
declarations.

Numbers in the module's memory are found by places: ``places(ROW)`` is the record of a world with
row numbers in place of values. What a page chooses from (machines, hands, paths, laws, networks)
are values in the same records.
"""

from dataclasses import asdict, replace
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import width
from pter_gym._engine.batch import Batch
from pter_gym._engine.law import Memory
from pter_gym._engine.step import INSTANT
from pter_gym._engine.world import CONFIG, ROW, ROWS
from pter_gym._internal.palette import clutch_name
from pter_gym._physics.friction import ClutchMode
from pter_gym.benchmark.measures import PRICE, SEGMENTS
from pter_gym.benchmark.policies import find_policy
from pter_gym.benchmark.tuned import TUNED
from pter_gym.controllers import CONTROLLERS
from pter_gym.hands import MultiSineHand, Operator, RecordedForces
from pter_gym.params import BASELINE, MACHINES, Machine, require
from pter_gym.paths import PATHS, Path, find_path
from pter_gym.paths._arcs import SEGMENT
from pter_gym.paths._projection import SEGMENT_WIDTH
from pter_gym.policies import read_policy, shipped_policies
from pter_gym.scenarios import PACES, find_pace, name_of_pace
from pter_gym.scenarios._variations import WIDTH
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing, check_machine
from pter_gym.tasks.path_following._context import CONTEXT, CONTEXT_WIDTH, context_of
from pter_gym.tasks.path_following._rules import ALLOWANCE, START
from pter_gym.tasks.path_following._specification import MAX_CURVATURE_RATIO, largest_error_max
from pter_gym.tools.web.kernels import MAX_ARCS

VOLTAGE_MAX = BASELINE.clutch.voltage_max
"""The largest voltage of a page [V]: of its sliders, and of its policies."""


POINTER = RecordedForces(times=(0.0,), along=(0.0,), across=(0.0,))
"""A hand whose recording a page goes on writing while the world moves."""

HANDS: MappingProxyType[str, Operator] = MappingProxyType(
    {"paper": MultiSineHand(), "pointer": POINTER}
)
"""Hands by name."""


OWN = "own"
"""Name of a machine, a path and a pace of a person's own."""


def tables(
    own: Machine | None = None, path: Path | str | None = None, pace: float | str | None = None
) -> dict[str, Any]:
    """Return all tables; those of a user start the page.

    Parameters
    ----------
    own
        A machine, which becomes one of the machines, and which controllers are bound to.
    path, pace
        A path and a commanded pace, as ``find_path`` and ``find_pace`` take them.

    Raises
    ------
    ParameterError
        If the machine cannot follow the paths of a page, its largest voltage is not that of a page,
        or there is no such path or pace.
    """
    found = {**declarations(), **choices(own)}
    if path is not None:
        found["begin"] = {"path": path if path in PATHS else OWN}
        found["paths"][found["begin"]["path"]] = path_table(
            find_path(path), BASELINE if own is None else own
        )
    if pace is not None:
        called = name_of_pace(pace)
        found["begin"] = {**found.get("begin", {}), "pace": called if called in PACES else OWN}
        found["paces"][found["begin"]["pace"]] = find_pace(pace)
    return found


def declarations() -> dict[str, Any]:
    """Return the layout of the module's memory, and its meaning."""
    batch = pages_batch()
    return {
        "observation": fields(batch.layout),
        "telemetry": fields(TELEMETRY),
        "modes": [mode.name for mode in ClutchMode],
        "places": {
            "world": places(ROW),
            "config": places(CONFIG),
            "context": places(CONTEXT),
            "arc": places(SEGMENT),
        },
        "widths": {
            "world": ROWS,
            "telemetry": len(TELEMETRY),
            "context": CONTEXT_WIDTH,
            "arc": SEGMENT_WIDTH,
            "instant": INSTANT,
            "memory": width(Memory),
            "arcs": MAX_ARCS,
        },
    }


def choices(own: Machine | None = None) -> dict[str, Any]:
    """Return what a page may choose from."""
    batch = pages_batch()
    nominal = BASELINE if own is None else own
    top = nominal.clutch.voltage_max
    require(
        top == VOLTAGE_MAX,
        nominal.clutch,
        "voltage_max",
        f"{VOLTAGE_MAX:g} V, as the page has it",
        got=top,
    )
    rows = rows_of(nominal)
    machines = {name: machine for name, machine in MACHINES.items() if rows_of(machine) == rows}
    machines = machines if own is None else {OWN: own, **machines}
    config = batch.device_arrays()["config"]
    return {
        "config": [value if np.isfinite(value) else None for value in config.tolist()],
        "error_max": WIDTH,
        "sharpest": MAX_CURVATURE_RATIO,
        "control_period": batch.task.control_period,
        "paces": dict(PACES),
        "scoring": {"segments": SEGMENTS, "price": PRICE, "allowance": ALLOWANCE, "start": START},
        "machines": {
            name: part(machine=machine, record="machine") for name, machine in machines.items()
        },
        "told": {name: part(machine=machine, record="told") for name, machine in machines.items()},
        "hands": {name: part(hand=hand, record="hand") for name, hand in HANDS.items()},
        "task": part(record="task"),
        "arrangements": {
            name: part(machine=machine, record="arrangement") for name, machine in machines.items()
        },
        "clutches": [
            {"name": clutch.name, "line": rows.index(clutch.row), "colour": clutch_name(clutch.row)}
            for clutch in nominal.clutches
        ],
        "declared": not nominal.has_paper_clutches,
        "paths": {name: path_table(path, nominal) for name, path in PATHS.items()},
        "laws": {name: laws(name, nominal, batch.layout) for name in (*CONTROLLERS, *TUNED)},
        "policies": {name: network(name, nominal, batch.layout) for name in policies_for(rows)},
    }


def rows_of(machine: Machine) -> tuple[tuple[float, float], ...]:
    """Return the rows of W of a machine's clutches."""
    return tuple(clutch.row for clutch in machine.clutches)


def policies_for(rows: tuple[tuple[float, float], ...]) -> list[str]:
    """Return the names of the trained policies for clutches with these rows of W."""
    return [name for name in shipped_policies() if read_policy(name).interface.clutches == rows]


def pages_batch() -> Batch:
    """Return a world for a page: with all sensors, voltages as actions and no time limit."""
    return Batch(BASELINE, PathFollowing(), 1, sensors="force")


def fields(layout: Layout) -> list[dict[str, Any]]:
    """Return names, units, meanings and scales."""
    return [asdict(field) for field in layout.fields]


def places(record: Any) -> Any:
    """Return a record as nested objects, by the names of its entries."""
    if not isinstance(record, tuple):
        return record
    return {name: places(value) for name, value in cast(Any, record)._asdict().items()}


def part(record: str, machine: Machine = BASELINE, hand: Operator = POINTER) -> Any:
    """Return a part of the context of a machine and a hand, whose recording has one instant if it is one."""
    task = PathFollowing(hand=hand)
    return places(getattr(context_of(task, machine, (0, 0), (0, 1)), record))


def path_table(path: Path, machine: Machine) -> dict[str, Any]:
    """Return the arcs of a path that a machine can follow, and how wide the workspace about it is [m]."""
    task = PathFollowing(path=path)
    if path.max_curvature > 0.0:
        task = replace(task, error_max=min(WIDTH, largest_error_max(path)))
    check_machine(task, machine)
    return {"arcs": path.arcs.table.tolist(), "length": path.length, "error_max": task.error_max}


def laws(name: str, nominal: Machine, layout: Layout) -> dict[str, list[float]]:
    """Return the gains of a law for each of the scenarios whose gains a page uses."""
    return {
        scenario: gains(find_policy(name, scenario=scenario), nominal, layout)
        for scenario in ("standard", "paths")
    }


def gains(controller: Any, nominal: Machine, layout: Layout) -> list[float]:
    """Return the gains of a controller bound to a machine, as its compiled law reads them."""
    return controller.bind(nominal, layout).law.gains.tolist()


def network(name: str, nominal: Machine, layout: Layout) -> dict[str, Any]:
    """Return all but the weights of a trained policy: its gains before them, and what it keeps of a world."""
    policy = read_policy(name)
    bound: Any = policy.bind(nominal, layout)
    weights = sum(weight.size + bias.size for weight, bias in policy.layers)
    return {
        "frame_skip": policy.interface.frame_skip,
        "gains": bound.law.gains[:-weights].tolist(),
        "layers": [f"layer_{k}" for k in range(len(policy.layers))],
        "memory": bound.start(1).shape[1],
    }
