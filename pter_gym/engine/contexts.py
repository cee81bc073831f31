"""The worlds of a batch before the first step: who shares which constants, and the blocks that hold them."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym.compiled.records import flat
from pter_gym.engine.world import LANES, ROW
from pter_gym.errors import ParameterError
from pter_gym.hands import Operator
from pter_gym.params import Machine
from pter_gym.paths import Path
from pter_gym.tasks.path_following.context import CONTEXT_WIDTH, context_of
from pter_gym.tasks.path_following.specification import IDEAL_SENSING, PathFollowing, check_machine

Array = NDArray[np.float64]
Pair = tuple[Machine, PathFollowing]


def number_drawing(num_worlds: int | None) -> int:
    """Return the number of worlds that draw, or raise a ParameterError."""
    if num_worlds is None or num_worlds < 1:
        raise ParameterError(f"num_worlds must be ≥ 1 where worlds draw their machines and tasks, got {num_worlds!r}")
    return num_worlds


def number_of_pairs(
    machines: Machine | Sequence[Machine], tasks: PathFollowing | Sequence[PathFollowing], num_worlds: int | None
) -> int:
    """Return the number of worlds that machines and tasks give, or raise a ParameterError where they disagree."""
    for field, items, kind in (("machines", machines, Machine), ("tasks", tasks, PathFollowing)):
        given = cast("Sequence[object]", items if isinstance(items, Sequence) else (items,))
        if not all(isinstance(item, kind) for item in given):
            raise ParameterError(f"{field} must be a {kind.__name__} or a sequence of them, got {items!r:.200}")
    lengths = {len(items) for items in (machines, tasks) if not isinstance(items, (Machine, PathFollowing))}
    if num_worlds is not None:
        lengths.add(num_worlds)
    lengths = lengths or {1}
    if len(lengths) > 1 or min(lengths) < 1:
        raise ParameterError(f"num_worlds must be ≥ 1 and the number of machines and of tasks, got {sorted(lengths)}")
    return lengths.pop()


def is_plain(task: PathFollowing) -> bool:
    """Tell whether a task does with the rows that every world stores."""
    return not task.hand.plans and task.sensing == IDEAL_SENSING


def distinct(machines: Sequence[Machine], tasks: Sequence[PathFollowing]) -> tuple[list[Pair], Array]:
    """Return the pairs of machine and task without repeats, and the number of each world's, (N,)."""
    numbers: dict[tuple[int, int], int] = {}
    pairs: list[Pair] = []
    index = np.empty(len(machines))
    for world, pair in enumerate(zip(machines, tasks, strict=True)):
        key = id(pair[0]), id(pair[1])
        if key not in numbers:
            numbers[key] = len(pairs)
            pairs.append(pair)
        index[world] = numbers[key]
    return pairs, index


def constants_of(pairs: Sequence[Pair]) -> Array:
    """Return the flat array of constants: a context for each pair, then the arcs of paths and recorded forces."""
    shared: list[Array] = []
    begins: dict[Path | Operator, tuple[int, int]] = {}
    end = CONTEXT_WIDTH * len(pairs)
    period = pairs[0][1].control_period
    for _, task in pairs:
        for item in (task.path, task.hand):
            if item in begins:
                continue
            table = item.arcs.table if isinstance(item, Path) else item.sampled(period)
            begins[item] = (end, len(table)) if len(table) else (0, 0)
            shared.append(table.ravel())
            end += table.size
    rows = [flat(context_of(task, machine, begins[task.path], begins[task.hand])) for machine, task in pairs]
    return np.concatenate([np.array(rows).ravel(), *shared])


def check_shared(pairs: Sequence[Pair]) -> None:
    """Check that machines and tasks fit together and share what the worlds of a batch must share."""
    first, goal = pairs[0]
    for machine, task in pairs:
        if (machine.substep, machine.clutch.voltage_max) != (first.substep, first.clutch.voltage_max):
            raise ParameterError("machines of one batch must share substep and clutch.voltage_max")
        if task.control_period != goal.control_period:
            raise ParameterError("tasks of one batch must share control_period")
        check_machine(task, machine)


def empty_blocks(contexts: Array, draws: int, rows: int) -> Array:
    """Return blocks of worlds (B, rows, lanes) that have not begun, whose constants begin at ``contexts`` (N,)."""
    n = len(contexts)
    width = min(LANES, -(-n // 8) * 8)
    blocks = -(-n // width)
    worlds: Any = np.zeros((blocks, rows, width))
    worlds[:, ROW.context_at] = np.concatenate([contexts, np.repeat(contexts[-1:], blocks * width - n)]).reshape(
        -1, width
    )
    worlds[:, ROW.draws_from] = worlds[:, ROW.context_at]
    worlds[:, ROW.draws] = draws
    return worlds
