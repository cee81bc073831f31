"""Storage of N worlds: the constants that they share, and their state."""

import os
from collections.abc import Sequence
from copy import copy
from functools import cached_property, lru_cache
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym._compiled.records import flat, leaves, read
from pter_gym._engine.truth import all_entries, tell_kernel, told_entries, told_layout
from pter_gym._engine.world import BASIC_ROWS, LANES, ROW, STATE, STORED_ROWS, WorldState
from pter_gym._physics.arm import Motion, kinetic_energy
from pter_gym.errors import ParameterError, ResetNeededError
from pter_gym.hands import Operator
from pter_gym.params import Machine
from pter_gym.paths import Path
from pter_gym.tasks.path_following._context import CONTEXT, CONTEXT_WIDTH, context_of
from pter_gym.tasks.path_following._specification import (
    IDEAL_SENSING,
    PathFollowing,
    check_machine,
    sensing_of,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Pair = tuple[Machine, PathFollowing]

_STATE_NAMES = [leaf.name for leaf in leaves(type(STATE))]


def listed(
    machines: Machine | Sequence[Machine],
    tasks: PathFollowing | Sequence[PathFollowing],
    num_worlds: int | None,
) -> tuple[list[Machine], list[PathFollowing]]:
    """Return machines and tasks as lists of one length, or raise a ParameterError."""
    for field, items, kind in (("machines", machines, Machine), ("tasks", tasks, PathFollowing)):
        several = cast("Sequence[object]", items if isinstance(items, Sequence) else (items,))
        if not all(isinstance(item, kind) for item in several):
            raise ParameterError(
                f"{field} must be a {kind.__name__} or a sequence of them, got {items!r:.200}"
            )
    lengths = {len(items) for items in (machines, tasks) if isinstance(items, Sequence)}
    lengths = lengths if num_worlds is None else {*lengths, num_worlds}
    lengths = lengths or {1}
    if len(lengths) > 1 or min(lengths) < 1:
        raise ParameterError(
            f"num_worlds must be ≥ 1 and the number of machines and of tasks, got {sorted(lengths)}"
        )
    count = lengths.pop()
    return (
        list(machines) if isinstance(machines, Sequence) else [machines] * count,
        list(tasks) if isinstance(tasks, Sequence) else [tasks] * count,
    )


def distinct(
    machines: Sequence[Machine], tasks: Sequence[PathFollowing]
) -> tuple[list[Pair], Array]:
    """Return the pairs of machine and task without repeats, and the number of each one's, (N,)."""
    pairs: dict[tuple[int, int], tuple[int, Pair]] = {}
    index = [
        pairs.setdefault((id(pair[0]), id(pair[1])), (len(pairs), pair))[0]
        for pair in zip(machines, tasks, strict=True)
    ]
    return [pair for _, pair in pairs.values()], np.array(index, np.float64)


def constants_of(pairs: Sequence[Pair]) -> Array:
    """Return the constants: a context for each pair, then arcs of paths and recorded forces."""
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
    rows = [
        flat(context_of(task, machine, begins[task.path], begins[task.hand]))
        for machine, task in pairs
    ]
    return np.concatenate([np.array(rows).ravel(), *shared])


def check_shared(pairs: Sequence[Pair]) -> None:
    """Check that machines and tasks fit together and share what a batch's worlds must share."""
    first, goal = pairs[0]
    limits = first.substep, first.clutch.voltage_max
    for machine, task in pairs:
        if (machine.substep, machine.clutch.voltage_max) != limits:
            raise ParameterError("machines of one batch must share substep and clutch.voltage_max")
        if machine.has_paper_clutches != first.has_paper_clutches:
            raise ParameterError("Machine.clutches of one batch must all be the paper's, or none")
        if len(machine.clutches) != len(first.clutches):
            raise ParameterError(
                "Machine.clutches of one batch must be equally many: an action has an entry each"
            )
        if task.control_period != goal.control_period:
            raise ParameterError("tasks of one batch must share control_period")
        check_machine(task, machine)


@lru_cache(maxsize=16)
def checked_constants(pairs: tuple[Pair, ...]) -> Array:
    """Return the constants of pairs that fit together; batches that draw from them share these."""
    check_shared(pairs)
    return constants_of(pairs)


def empty_blocks(contexts: Array, draws: int, rows: int) -> Array:
    """Return blocks (B, rows, lanes) of worlds that have not begun.

    Their constants begin at ``contexts``, (N,).
    """
    n = len(contexts)
    width = min(LANES, -(-n // 8) * 8)
    blocks = -(-n // width)
    worlds: Any = np.zeros((blocks, rows, width))
    worlds[:, ROW.context_at] = np.concatenate(
        [contexts, np.repeat(contexts[-1:], blocks * width - n)]
    ).reshape(-1, width)
    worlds[:, ROW.draws_from] = worlds[:, ROW.context_at]
    worlds[:, ROW.draws] = draws
    return worlds


def needs_extras(machine: Machine, task: PathFollowing) -> bool:
    """Return whether a world keeps ``Extras``: a hand that plans, real sensors, or heat."""
    is_ideal = sensing_of(task, machine) == IDEAL_SENSING
    return task.hand.plans or not is_ideal or machine.clutch.fade > 0.0


class Storage:
    """The state of N worlds and their constants, without the kernels that move them.

    ``machines`` and ``tasks`` hold one for each world, or one for each pair of which ``drawing``
    worlds draw.
    """

    def __init__(
        self,
        machines: Sequence[Machine],
        tasks: Sequence[PathFollowing],
        drawing: int | None = None,
    ) -> None:
        self.num_worlds = len(machines) if drawing is None else drawing
        self.draws = drawing is not None
        self.pairs, numbers = distinct(machines, tasks)
        checked = checked_constants.__wrapped__ if drawing is None else checked_constants
        self._constants: Any = checked(tuple(self.pairs))
        extras = any(needs_extras(machine, task) for machine, task in self.pairs)
        self._worlds: Any = empty_blocks(
            float(CONTEXT_WIDTH) * numbers if drawing is None else np.zeros(drawing),
            1 if drawing is None else len(self.pairs),
            STORED_ROWS if extras else BASIC_ROWS,
        )
        self._words = np.zeros((self.num_worlds, 2), np.uint64)
        self._seeded = np.zeros(self.num_worlds, np.bool_)

    def next_words(self, seeds: Sequence[int | None] | None, chosen: Mask) -> NDArray[np.uint64]:
        """Return seed and episode count of each world after a reset of the chosen ones, (N, 2)."""
        words = self._words.copy()
        seeded_now = np.zeros(self.num_worlds, np.bool_)
        if seeds is not None:
            if len(seeds) != self.num_worlds:
                raise ParameterError(f"seeds must hold {self.num_worlds} entries, got {len(seeds)}")
            for seed in seeds:
                if seed is not None and not 0 <= seed < 2**64:
                    raise ParameterError(f"seeds must lie within [0, 2⁶⁴), got {seed!r}")
            seeded_now = chosen & np.array([seed is not None for seed in seeds])
            words[seeded_now, 0] = np.array([seed or 0 for seed in seeds], np.uint64)[seeded_now]
            words[seeded_now, 1] = 0
        others = chosen & ~seeded_now
        words[others & self._seeded, 1] += np.uint64(1)
        fresh = others & ~self._seeded
        words[fresh, 0] = np.frombuffer(os.urandom(8 * int(fresh.sum())), np.uint64)
        return words

    def only(self, chosen: Mask) -> Self:
        """Return a batch that continues with the chosen worlds, (N,), from their present states."""
        part, rows = copy(self), self._rows[chosen]
        part.num_worlds = len(rows)
        part._worlds = empty_blocks(rows[:, int(ROW.context_at)], 1, rows.shape[1])
        block, lane = np.divmod(np.arange(len(rows)), part._worlds.shape[2])
        part._worlds[block, :, lane] = rows
        part._words, part._seeded = self._words[chosen], self._seeded[chosen]
        return part

    @property
    def _changing(self) -> dict[str, NDArray[Any]]:
        """The arrays that resets and steps change."""
        return {"worlds": self._worlds, "words": self._words, "seeded": self._seeded}

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all that changes; ``set_state`` restores them bit for bit."""
        return {name: part.copy() for name, part in self._changing.items()}

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore a state from ``get_state`` of a batch of the same size.

        Raises
        ------
        ParameterError
            If a part is missing, has another shape or type, belongs to other machines or tasks, or
            holds numbers that are not finite or an arm faster than the integrator can hold; nothing
            has changed.
        """
        for name, mine in self._changing.items():
            part = state.get(name)
            expected = mine.shape, mine.dtype
            if not isinstance(part, np.ndarray) or (part.shape, part.dtype) != expected:
                raise ParameterError(
                    f"state[{name!r}] must be an array of {mine.dtype} with the shape {mine.shape}"
                )
        if not np.isfinite(state["worlds"]).all():
            raise ParameterError("state['worlds'] must hold finite numbers only")
        if not self._fits(state["worlds"]):
            raise ParameterError(
                "state['worlds'] must be of an environment with the same machines and tasks, "
                "and no faster than its integrator can hold"
            )
        for name, mine in self._changing.items():
            mine[:] = state[name]

    def get_worlds(self) -> WorldState:
        """Return a copy of each world's state, whose numbers are float64 (N,)."""
        columns = np.zeros((STORED_ROWS, self.num_worlds))
        columns[: self._worlds.shape[1]] = self._rows.T
        return read(columns, STATE, 0)

    def set_worlds(self, state: WorldState) -> None:
        """Set the states of all worlds, which must have been reset; machines, tasks and seeds stay.

        A world that continues from a state gives the same bits as the world that the state came
        from, if machine, task, seed and episode are the same. To use measurements, replace the
        measured numbers of another state::

            state = batch.get_worlds()
            batch.set_worlds(state._replace(command=state.command._make(volts)))

        With the angles of the links also set their cosines and sines, and with an arc length on a
        path of several arcs the number of the arc, ``foot.segment``.

        Parameters
        ----------
        state
            Numbers of each world (N,), or one for all of them. Worlds without ``Extras`` ignore
            these.

        Raises
        ------
        ParameterError
            If a number has another shape or is not finite, or the state does not fit machine and
            task; nothing has changed.
        ResetNeededError
            If a world was never reset.
        """
        self._check_seeded()
        worlds = self._worlds.copy()
        block, lane = np.divmod(np.arange(self.num_worlds), worlds.shape[2])
        for name, row, value in zip(_STATE_NAMES, flat(STATE), flat(state), strict=True):
            number: Any = np.asarray(value, np.float64)
            if number.shape not in ((), (1,), (self.num_worlds,)) or not np.isfinite(number).all():
                raise ParameterError(
                    f"{name} must be a finite number, or ({self.num_worlds},) of them, "
                    f"got {value!r:.200}"
                )
            if row < worlds.shape[1]:
                worlds[block, row, lane] = number
        if not self._fits(worlds):
            raise ParameterError(
                "state must be on an arc of the path, and no faster than the integrator can hold"
            )
        self._worlds[:] = worlds

    def _check_seeded(self) -> None:
        """Raise a ResetNeededError if a world was never reset."""
        if not self._seeded.all():
            raise ResetNeededError(
                f"world {self._seeded.argmin()} needs a reset: it was never reset"
            )

    def _fits(self, worlds: Any) -> bool:
        """Return whether rows from elsewhere point at what exists here, in motion that is held."""
        of_draws = [int(ROW.draws_from), int(ROW.draws)]
        at, step = worlds[:, ROW.context_at], worlds[:, ROW.step]
        numbers = (at - worlds[:, ROW.draws_from]) / CONTEXT_WIDTH
        if not (
            np.array_equal(worlds[:, of_draws], self._worlds[:, of_draws])
            and np.isin(numbers, np.arange(int(worlds[:, ROW.draws].max()))).all()
            and ((step >= 0.0) & (step < 2.0**31)).all()
        ):
            return False
        places, segments = at.astype(np.intp), worlds[:, ROW.foot.segment]
        arm: Any = read(self._constants, CONTEXT.machine.arm, places)
        energy = kinetic_energy(arm, Motion(*(worlds[:, row] for row in ROW.motion)))
        is_held = energy <= self._constants[places + CONTEXT.task.energy_max]
        is_on_path = (segments >= 0.0) & (
            segments < self._constants[places + CONTEXT.task.path.arcs]
        )
        return bool(
            (is_held | (worlds[:, ROW.alive] == 0.0)).all()
            and (is_on_path & (segments == segments.round())).all()
        )

    @property
    def _rows(self) -> Array:
        """What is stored of each world, (N, rows)."""
        stored = self._worlds.shape[1]
        return self._worlds.transpose(0, 2, 1).reshape(-1, stored)[: self.num_worlds]

    @property
    def context(self) -> list[int]:
        """The number of each world's present pair of machine and task in ``pairs``."""
        numbers = self._rows[:, int(ROW.context_at)] / CONTEXT_WIDTH
        return numbers.astype(np.intp).tolist()

    def truth(self) -> Array:
        """Return each world's state, then the numbers of its machine and task, (N, entries).

        In no particular units and order, and without the limit of the energy, which follows from
        the rest; for critics, which may know more than the policies that they judge.
        """
        return self._tell(self.truth_entries)

    @cached_property
    def truth_entries(self) -> NDArray[np.intp]:
        """Rows of ``truth`` among those of a world and, after them, of its context."""
        return all_entries(self._worlds.shape[1])

    @cached_property
    def privileged_entries(self) -> NDArray[np.intp]:
        """Rows of ``privileged``, numbered alike."""
        return told_entries(self._worlds.shape[1])

    @property
    def privileged_layout(self) -> Layout:
        """Names, units and scales of what ``privileged`` returns, which is in their units."""
        return told_layout(self._worlds.shape[1], self.pairs[0][0])

    def privileged(self) -> Array:
        """Return what ``privileged_layout`` describes, (N, entries)."""
        return self._tell(self.privileged_entries)

    def _tell(self, entries: NDArray[np.intp]) -> Array:
        truth = np.empty((self.num_worlds, len(entries)))
        tell_kernel()(self._worlds, self._constants, entries, truth)
        return truth
