"""Many worlds in one call. The single environment and the vector environments are doors to this."""

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.controllers import Policy
from pter_gym.controllers.laws import no_law
from pter_gym.engine.kernels import advance_kernel, reset_kernel
from pter_gym.engine.world import (
    ALIVE,
    BASIC_ROWS,
    CHANGING_ROWS,
    CONTEXT_AT,
    DRAWS,
    DRAWS_FROM,
    FLAGS,
    HAS_LAW,
    LANES,
    NEXT_STEP,
    REFUSE,
    SAME_STEP,
    SEGMENT,
    SKIP,
    STEP,
)
from pter_gym.errors import ActionError, ParameterError, ResetNeededError
from pter_gym.hands import HumanArm, RecordedForces
from pter_gym.params import Machine
from pter_gym.paths import Path
from pter_gym.tasks.path_following import (
    CONTEXT,
    CONTEXT_ROWS,
    ENTRIES,
    IDEAL_SENSING,
    PATH_COUNT,
    RECORD_COUNT,
    RECORD_FIRST,
    TELEMETRY,
    PathFollowing,
    Sensors,
    check_machine,
    context_rows,
    observation_layout,
    substeps,
)

Array = NDArray[np.float64]
Observations = NDArray[np.float32]
ActionUnit = Literal["volt", "normalised"]
Pair = tuple[Machine, PathFollowing]

NO_LIMIT = float("inf")

RECORDED = len(TELEMETRY)
"""Entries of a telemetry row."""

INLINE_BLOCKS = 16
"""Batches of fewer blocks are stepped by the caller's thread alone: waking another one costs more than it saves."""


class Returns(NamedTuple):
    """What a step returns: fresh arrays, but for ``final_obs``.

    Attributes
    ----------
    obs
        Observations, float32 (N, len(layout)).
    final_obs
        With ``SAME_STEP``, the last observations of the worlds that ended and were reset in this step, float32
        (N, len(layout)); other rows hold anything, and the next step changes all.
    rewards
        float64 (N,).
    flags
        bool (FLAGS, N): terminated, truncated, success.
    telemetry
        float64 (1, N, len(TELEMETRY)), or (0, …) without telemetry; with ``SAME_STEP`` a second layer holds the last
        ones of the worlds that ended.
    """

    obs: Observations
    final_obs: Observations
    rewards: Array
    flags: NDArray[np.bool_]
    telemetry: Array


class Batch:
    """N worlds, each with its own machine, task, seed and episode count.

    Parameters
    ----------
    machines, tasks
        One for all worlds, or a sequence with one for each. The machines share the substep and the largest voltage, the
        tasks the control period.
    num_worlds
        N; may be left out where ``machines`` or ``tasks`` is a sequence.
    draws
        Whether each world draws one of the given pairs of machine and task at each reset, by its seed and episode
        alone. Otherwise each world keeps its own.
    sensors
        What the observation holds; see ``observation_layout``.
    observe_context
        Whether the observation ends with what is told of machine and task.
    action_unit
        ``"volt"``: actions within [0, voltage_max]; ``"normalised"``: within [−1, 1] for the same voltages.
    max_steps
        Control steps after which an episode is truncated; none by default.
    telemetry
        Whether steps return telemetry.
    num_threads
        Threads that share the work of large batches; the result does not depend on it.

    Attributes
    ----------
    machine, task
        The first ones given.
    pairs
        The distinct pairs of machine and task; ``context`` holds their numbers.
    layout
        Layout of the observations.
    action_low, action_high
        Bounds of an action in its unit.

    Raises
    ------
    ParameterError
        If the worlds disagree on what they must share, or a machine cannot do its task.
    """

    def __init__(
        self,
        machines: Machine | Sequence[Machine],
        tasks: PathFollowing | Sequence[PathFollowing],
        num_worlds: int | None = None,
        *,
        draws: bool = False,
        sensors: Sensors = "torque",
        observe_context: bool = False,
        action_unit: ActionUnit = "volt",
        max_steps: int | None = None,
        telemetry: bool = True,
        num_threads: int = 1,
    ) -> None:
        if action_unit not in get_args(ActionUnit):
            raise ParameterError(f"action_unit must be one of {', '.join(get_args(ActionUnit))}, got {action_unit!r}")
        if num_threads < 1:
            raise ParameterError(f"num_threads must be ≥ 1, got {num_threads!r}")
        if max_steps is not None and max_steps < 1:
            raise ParameterError(f"max_steps must be ≥ 1 or None, got {max_steps!r}")
        given = _number_of_pairs(machines, tasks, None if draws else num_worlds)
        self.num_worlds = _number_drawing(num_worlds) if draws else given
        listed_machines = [machines] * given if isinstance(machines, Machine) else list(machines)
        listed_tasks = [tasks] * given if isinstance(tasks, PathFollowing) else list(tasks)
        self.machine = listed_machines[0]
        self.task = listed_tasks[0]
        self.layout = observation_layout(self.machine, sensors, observe_context)
        voltage_max = self.machine.clutch.voltage_max
        self.action_low, self.action_high = (0.0, voltage_max) if action_unit == "volt" else (-1.0, 1.0)
        plain = len(self.layout) - (len(CONTEXT) if observe_context else 0)
        self._config = np.array(
            [
                self.action_low,
                self.action_high,
                4.0 * float(np.spacing(np.float32(self.action_high))),
                self.machine.substep,
                substeps(self.task, self.machine),
                NO_LIMIT if max_steps is None else max_steps,
                0.0,
                plain,
                *(1.0 / self.layout.scales[:plain]),
                *np.zeros(ENTRIES - plain),
                *self.layout.scales,
            ]
        )
        self.pairs, numbers = _distinct(listed_machines, listed_tasks)
        _check_shared(self.pairs)
        self._constants = _constants(self.pairs)
        self._worlds = _blocks(
            np.zeros(self.num_worlds) if draws else float(CONTEXT_ROWS) * numbers,
            len(self.pairs) if draws else 1,
            BASIC_ROWS if all(_is_plain(task) for _, task in self.pairs) else CHANGING_ROWS,
        )
        self._words = np.zeros((self.num_worlds, 2), np.uint64)
        self._seeded = np.zeros(self.num_worlds, np.bool_)
        self._actions = np.empty((self.num_worlds, 4))
        self._records = int(telemetry)
        self._final_obs = np.empty((0, len(self.layout)), np.float32)
        self._shape = (self.num_worlds, len(self.layout))
        self._alone = np.empty(1), np.empty((FLAGS, 1), np.bool_)
        self._advance = advance_kernel(no_law)
        self._num_threads = num_threads
        self._pool: ThreadPoolExecutor | None = None
        self._pool_owner = -1

    def reset(
        self, seeds: Sequence[int | None] | None = None, chosen: NDArray[np.bool_] | None = None
    ) -> tuple[Observations, Array]:
        """Start new episodes.

        Parameters
        ----------
        seeds
            One seed ≥ 0 for each world, or None for an unseeded reset, which goes on to the next episode of the world's
            present seed (drawn from the operating system at first).
        chosen
            Which worlds to reset, shape (N,); all by default. The others stay as they are.

        Returns
        -------
        observations, telemetry
            Of all worlds: float32 (N, len(layout)) and float64 (N or 0, len(TELEMETRY)), fresh arrays. The telemetry
            holds the pose, and zero for what only a step tells.
        """
        chosen = np.ones(self.num_worlds, np.bool_) if chosen is None else chosen
        words = self._next_words(seeds, chosen)
        obs = np.empty((self.num_worlds, len(self.layout)), np.float32)
        telemetry = np.empty((self._records, self.num_worlds, len(TELEMETRY)))
        kernel = reset_kernel()
        self._words, self._seeded = words, self._seeded | chosen
        kernel(self._worlds, words, chosen, obs, telemetry, self._config, self._constants)
        return obs, telemetry.reshape(-1, len(TELEMETRY))

    def step(self, actions: ArrayLike, ended: int = REFUSE) -> Returns:
        """Advance all worlds by one control period.

        Parameters
        ----------
        actions
            Clutch voltages in the action unit, shape (N, 4). Up to four float32 ulp beyond a bound are clipped.
        ended
            What to do with a world whose episode has ended, from ``pter_gym.engine.world``: ``REFUSE`` to step,
            ``SKIP`` it (its rows are zero, and NaN in the telemetry), reset it in the ``NEXT_STEP``, ignoring that
            step's action, or in the ``SAME_STEP``.

        Raises
        ------
        ActionError
            If an action has a wrong shape or type, is not finite, or is out of bounds; no world has moved.
        ResetNeededError
            If a world was never reset, or its episode has ended with ``REFUSE`` or ``SAME_STEP``; no world has moved.
        """
        self._take(actions, self._actions.shape)
        n = self.num_worlds
        obs = np.empty((n, len(self.layout)), np.float32)
        rewards = np.empty(n)
        flags = np.empty((FLAGS, n), np.bool_)
        telemetry = np.empty((self._records * (2 if ended == SAME_STEP else 1), n, RECORDED))
        if ended == NEXT_STEP and not self._seeded.all():
            raise ResetNeededError(f"world {self._seeded.argmin()} needs a reset: it was never reset")
        if ended == SAME_STEP and not len(self._final_obs):
            self._final_obs = np.empty_like(obs)
        if ended == SKIP:
            obs.fill(0.0)
            rewards.fill(0.0)
            flags.fill(False)
            telemetry.fill(np.nan)
        refused = self._run(self._advance, self._actions, obs, rewards, flags, telemetry, self._config, ended, 1)
        if refused >= 0:
            self._refuse(refused)
        return Returns(obs, self._final_obs, rewards, flags, telemetry)

    def step_alone(self, action: ArrayLike) -> tuple[Observations, Array, float, bool, bool]:
        """Advance a batch of one world, as ``step`` with ``REFUSE`` does, with less around it.

        Parameters
        ----------
        action
            Shape (4,).

        Returns
        -------
        observation, telemetry
            Fresh arrays (len(layout),) and (len(TELEMETRY),).
        reward, terminated, success
            As Python has them.
        """
        self._take(action, (4,))
        obs = np.empty(self._shape, np.float32)
        telemetry = np.empty((1, 1, RECORDED))
        rewards, flags = self._alone
        refused = self._advance(
            self._worlds,
            self._words,
            self._actions,
            obs,
            self._final_obs,
            rewards,
            flags,
            telemetry,
            self._config,
            self._constants,
            REFUSE,
            1,
            0,
            1,
        )
        if refused >= 0:
            self._refuse(refused)
        (terminated,), _, (success,) = flags.tolist()
        return obs[0], telemetry[0, 0], rewards.item(), terminated, success

    def rollout(
        self, obs: Observations, law: Any, gains: Array, steps: int, memory: Array | None = None
    ) -> tuple[Observations, Array]:
        """Run a compiled control law in all worlds, from their present state, for at most ``steps`` control periods.

        Parameters
        ----------
        obs
            The latest observations, shape (N, len(layout)).
        law, gains
            A law as in ``pter_gym.controllers.laws`` and its gains, shape (G,).
        steps
            Number of control periods.
        memory
            What the law keeps, from ``empty_memory``; it is changed, so that a further rollout may go on with it. Empty
            by default.

        Returns
        -------
        observations, telemetry
            The last observations, and float64 (steps, N, len(TELEMETRY)); NaN after the end of an episode.
        """
        telemetry = np.full((steps, self.num_worlds, RECORDED), np.nan)
        obs, _ = self._follow(obs, law, gains, memory, telemetry, steps)
        return obs, telemetry

    def outcome(
        self, obs: Observations, law: Any, gains: Array, steps: int, memory: Array
    ) -> tuple[Observations, NDArray[np.bool_]]:
        """Run a compiled control law as ``rollout`` does, without telemetry, which takes a good part of the time.

        Parameters
        ----------
        obs, law, gains, steps, memory
            As in ``rollout``.

        Returns
        -------
        observations, flags
            The last observations, and bool (FLAGS, N): whether the episode ended in these steps, and how.
        """
        return self._follow(obs, law, gains, memory, np.empty((0, self.num_worlds, RECORDED)), steps)

    def _follow(
        self, obs: Observations, law: Any, gains: Array, memory: Array | None, telemetry: Array, steps: int
    ) -> tuple[Observations, NDArray[np.bool_]]:
        """Run a law and write the telemetry, if there is room for it; return the last observations and the flags."""
        obs = obs.copy()
        memory = self.empty_memory() if memory is None else memory
        config = np.concatenate([self._config, gains])
        config[HAS_LAW] = 1.0
        rewards = np.empty(self.num_worlds)
        flags = np.zeros((FLAGS, self.num_worlds), np.bool_)
        self._run(advance_kernel(law), memory, obs, rewards, flags, telemetry, config, SKIP, steps)
        return obs, flags

    def record_forces(self, forces: Array) -> None:
        """Replace the recorded forces of all hands.

        Parameters
        ----------
        forces
            Along and across the path at the control instants [N], shape (T, 2), as ``RecordedForces.sampled`` gives
            them.

        Raises
        ------
        ParameterError
            If the hands have no recording in common, or it has another number of instants.
        """
        recordings = {
            (int(context[RECORD_FIRST]), int(context[RECORD_COUNT]))
            for context in self._constants[: CONTEXT_ROWS * len(self.pairs)].reshape(-1, CONTEXT_ROWS)
        }
        first, count = recordings.pop()
        if recordings or count == 0 or forces.shape != (count, 2):
            raise ParameterError(
                f"forces must be those of the recording that all hands share, ({count}, 2), got {forces.shape}"
            )
        self._constants[first : first + 2 * count] = forces.ravel()

    def empty_memory(self) -> Array:
        """Return the memory of a law at the start of an episode, (N, MEMORY)."""
        return Policy.empty_memory(self.num_worlds)

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all that changes, with which ``set_state`` brings the worlds back bit for bit."""
        return {
            "worlds": self._worlds.copy(),
            "words": self._words.copy(),
            "seeded": self._seeded.copy(),
        }

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Bring the worlds to a state from ``get_state`` of a batch of the same size.

        Raises
        ------
        ParameterError
            If a part is missing, has another shape or type, or belongs to other machines or tasks; nothing has changed.
        """
        own = {"worlds": self._worlds, "words": self._words, "seeded": self._seeded}
        for name, mine in own.items():
            part = state.get(name)
            if not isinstance(part, np.ndarray) or part.shape != mine.shape or part.dtype != mine.dtype:
                raise ParameterError(f"state[{name!r}] must be an array of {mine.dtype} with the shape {mine.shape}")
        worlds = state["worlds"]
        if not self._fits(worlds):
            raise ParameterError("state['worlds'] must be of an environment with the same machines and tasks")
        self._worlds[:] = worlds
        self._words[:] = state["words"]
        self._seeded[:] = state["seeded"]

    def _fits(self, worlds: Array) -> bool:
        """Tell whether worlds from elsewhere point at constants, arcs and instants that there are."""
        if not ((worlds[:, STEP] >= 0.0) & (worlds[:, STEP] < 2.0**31)).all():
            return False
        same = np.array_equal(worlds[:, DRAWS_FROM : DRAWS + 1], self._worlds[:, DRAWS_FROM : DRAWS + 1])
        numbers = (worlds[:, CONTEXT_AT] - worlds[:, DRAWS_FROM]) / CONTEXT_ROWS
        if not same or not np.isin(numbers, np.arange(int(worlds[:, DRAWS].max()))).all():
            return False
        arcs = self._constants[worlds[:, CONTEXT_AT].astype(np.intp) + PATH_COUNT]
        return bool(np.isin(worlds[:, SEGMENT], np.arange(int(arcs.max()))).all() and (worlds[:, SEGMENT] < arcs).all())

    @property
    def context(self) -> list[int]:
        """The number of each world's present pair of machine and task in ``pairs``."""
        numbers = self._worlds[:, CONTEXT_AT].reshape(-1)[: self.num_worlds] / CONTEXT_ROWS
        return numbers.astype(np.intp).tolist()

    def truth(self) -> Array:
        """Return all that is true of each world, (N, entries): its state, then the numbers of its machine and task.

        In no particular units and order; for critics, which may know more than the policies that they judge.
        """
        worlds = self._worlds.transpose(0, 2, 1).reshape(-1, self._worlds.shape[1])[: self.num_worlds]
        context = worlds[:, CONTEXT_AT, None].astype(np.intp) + np.arange(CONTEXT_ROWS)
        return np.concatenate([worlds, self._constants[context]], axis=1)

    def device_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that a kernel on another device needs: worlds, words, config, constants, who has begun."""
        return {
            "worlds": self._worlds,
            "words": self._words,
            "config": self._config,
            "constants": self._constants,
            "seeded": self._seeded,
        }

    @property
    def nbytes(self) -> int:
        """Bytes that the worlds take between steps."""
        return (
            self._worlds.nbytes
            + self._constants.nbytes
            + self._words.nbytes
            + self._seeded.nbytes
            + self._actions.nbytes
            + self._final_obs.nbytes
        )

    def _run(
        self,
        kernel: Any,
        given: Array,
        obs: Observations,
        rewards: Array,
        flags: NDArray[np.bool_],
        telemetry: Array,
        config: Array,
        ended: int,
        steps: int,
    ) -> int:
        """Run the kernel over all blocks, in this thread or in several; return the first refused world or −1."""
        outputs = (obs, self._final_obs, rewards, flags, telemetry)
        arguments = (self._worlds, self._words, given, *outputs, config, self._constants, ended)
        blocks = len(self._worlds)
        if self._num_threads == 1 or blocks < INLINE_BLOCKS:
            return kernel(*arguments, steps, 0, blocks)
        refused = kernel(*arguments, 0, 0, 0)
        if refused < 0:
            share = -(-blocks // self._num_threads)
            shares = [(first, min(first + share, blocks)) for first in range(0, blocks, share)]
            self._share_out(partial(kernel, *arguments, steps), shares)
        return refused

    def _share_out(self, call: Callable[[int, int], Any], shares: list[tuple[int, int]]) -> None:
        """Call a compiled function for all shares, in all threads at once. An interrupt (Ctrl-C) waits for all."""
        left = iter(shares)
        done: list[tuple[int, int]] = []

        def work() -> None:
            for share in left:
                try:
                    call(*share)
                finally:
                    done.append(share)

        threads = self._threads()
        try:
            jobs = [threads.submit(work) for _ in range(self._num_threads - 1)]
            work()
            for job in jobs:
                job.result()
        except BaseException:
            work()
            while len(done) < len(shares):
                time.sleep(1e-4)
            raise

    def _threads(self) -> ThreadPoolExecutor:
        """Return the pool of threads, made at first need and again in a forked child."""
        if self._pool is None or self._pool_owner != os.getpid():
            self._pool = ThreadPoolExecutor(self._num_threads - 1, thread_name_prefix="pter")
            self._pool_owner = os.getpid()
        return self._pool

    def close(self) -> None:
        """Stop the threads, if there are any."""
        if self._pool is not None and self._pool_owner == os.getpid():
            self._pool.shutdown(wait=False)
        self._pool = None

    def _next_words(self, seeds: Sequence[int | None] | None, chosen: NDArray[np.bool_]) -> NDArray[np.uint64]:
        """Return seed and episode count of each world after a reset of the chosen ones, (N, 2)."""
        words = self._words.copy()
        given = np.zeros(self.num_worlds, np.bool_)
        if seeds is not None:
            if len(seeds) != self.num_worlds:
                raise ParameterError(f"seeds must hold {self.num_worlds} entries, got {len(seeds)}")
            for seed in seeds:
                if seed is not None and not 0 <= seed < 2**64:
                    raise ParameterError(f"seeds must lie within [0, 2⁶⁴), got {seed!r}")
            given = chosen & np.array([seed is not None for seed in seeds])
            words[given, 0] = np.array([0 if seed is None else seed for seed in seeds], np.uint64)[given]
            words[given, 1] = 0
        words[chosen & ~given & self._seeded, 1] += np.uint64(1)
        fresh = chosen & ~given & ~self._seeded
        words[fresh, 0] = np.frombuffer(os.urandom(8 * int(fresh.sum())), np.uint64)
        return words

    def _take(self, actions: ArrayLike, shape: tuple[int, ...]) -> None:
        """Copy actions of a shape to where the kernel reads them."""
        try:
            array = np.asarray(actions)
        except (ValueError, TypeError, RuntimeError) as error:  # ragged, or a tensor that is not plain CPU memory
            raise ActionError(f"action must be an array of numbers: {error}") from None
        if array.shape != shape:
            raise ActionError(f"action must have the shape {shape}, got {array.shape}")
        if array.dtype.kind not in "fiu":
            raise ActionError(f"action must hold real numbers, got dtype {array.dtype}")
        self._actions[...] = array

    def _refuse(self, world: int) -> None:
        width = self._worlds.shape[2]
        if self._worlds[world // width, ALIVE, world % width] == 0.0:
            raise ResetNeededError(f"world {world} needs a reset: it was never reset or its episode has ended")
        raise ActionError(
            f"action of world {world} must be finite and within [{self.action_low:g}, {self.action_high:g}], "
            f"got {self._actions[world].tolist()}"
        )


def _number_drawing(num_worlds: int | None) -> int:
    if num_worlds is None or num_worlds < 1:
        raise ParameterError(f"num_worlds must be ≥ 1 where worlds draw their machines and tasks, got {num_worlds!r}")
    return num_worlds


def _number_of_pairs(
    machines: Machine | Sequence[Machine], tasks: PathFollowing | Sequence[PathFollowing], num_worlds: int | None
) -> int:
    lengths = {len(items) for items in (machines, tasks) if not isinstance(items, (Machine, PathFollowing))}
    if num_worlds is not None:
        lengths.add(num_worlds)
    lengths = lengths or {1}
    if len(lengths) > 1 or min(lengths) < 1:
        raise ParameterError(f"num_worlds must be ≥ 1 and the number of machines and of tasks, got {sorted(lengths)}")
    return lengths.pop()


def _is_plain(task: PathFollowing) -> bool:
    """Tell whether a task does with the rows that every world stores."""
    return not isinstance(task.hand, (HumanArm, RecordedForces)) and task.sensing == IDEAL_SENSING


def _distinct(machines: Sequence[Machine], tasks: Sequence[PathFollowing]) -> tuple[list[Pair], Array]:
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


def _constants(pairs: Sequence[Pair]) -> Array:
    """Return the flat array of constants: a context for each pair, then the arcs of paths and recorded forces."""
    shared: list[Array] = []
    begins: dict[Path | RecordedForces, tuple[int, int]] = {}
    end = CONTEXT_ROWS * len(pairs)
    period = pairs[0][1].control_period
    for _, task in pairs:
        for item in (task.path, task.hand):
            if item in begins or not isinstance(item, (Path, RecordedForces)):
                continue
            table = item.arcs.table if isinstance(item, Path) else item.sampled(period)
            begins[item] = end, len(table)
            shared.append(table.ravel())
            end += table.size
    rows = [
        context_rows(
            task,
            machine,
            begins[task.path],
            begins[task.hand] if isinstance(task.hand, RecordedForces) else (0, 0),
        )
        for machine, task in pairs
    ]
    return np.concatenate([np.array(rows).ravel(), *shared])


def _check_shared(pairs: Sequence[Pair]) -> None:
    """Check that machines and tasks fit together and share what the worlds of a batch must share."""
    first, goal = pairs[0]
    for machine, task in pairs:
        if (machine.substep, machine.clutch.voltage_max) != (first.substep, first.clutch.voltage_max):
            raise ParameterError("machines of one batch must share substep and clutch.voltage_max")
        if task.control_period != goal.control_period:
            raise ParameterError("tasks of one batch must share control_period")
        check_machine(task, machine)


def _blocks(contexts: Array, draws: int, rows: int) -> Array:
    """Return blocks of worlds (B, rows, lanes) that have not begun, whose constants begin at ``contexts`` (N,)."""
    n = len(contexts)
    width = min(LANES, -(-n // 8) * 8)
    blocks = -(-n // width)
    worlds = np.zeros((blocks, rows, width))
    worlds[:, CONTEXT_AT] = np.concatenate([contexts, np.repeat(contexts[-1:], blocks * width - n)]).reshape(-1, width)
    worlds[:, DRAWS_FROM] = worlds[:, CONTEXT_AT]
    worlds[:, DRAWS] = draws
    return worlds
