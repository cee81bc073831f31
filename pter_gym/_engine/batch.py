"""Many worlds in one call: the base of the single and the vector environments."""

from collections.abc import Sequence
from functools import partial
from typing import Any, Literal, NamedTuple, NoReturn, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym._compiled.addresses import table_of
from pter_gym._compiled.compiler import COMPILES
from pter_gym._compiled.records import flat, read
from pter_gym._engine.kernels import advance_address, advance_kernel, alone_kernel, reset_kernel
from pter_gym._engine.storage import Array, Mask, Storage, listed
from pter_gym._engine.threads import Threads
from pter_gym._engine.world import FLAGS, NEXT_STEP, REFUSE, ROW, SAME_STEP, SKIP, Config
from pter_gym._internal.checks import whole_number
from pter_gym._physics.arm import kinetic_energy, tip_velocity
from pter_gym.errors import ActionError, ParameterError, ResetNeededError
from pter_gym.params import SLOTS, Machine
from pter_gym.tasks.path_following._context import CONTEXT, OBSERVED_CONTEXT
from pter_gym.tasks.path_following._ending import ending
from pter_gym.tasks.path_following._observation import ENTRIES, OBS, Sensors, observation_layout
from pter_gym.tasks.path_following._position import path_state
from pter_gym.tasks.path_following._specification import PathFollowing, held_machine, substeps
from pter_gym.tasks.path_following._telemetry import COLUMNS, first_reason

Observations = NDArray[np.float32]
ActionUnit = Literal["volt", "normalised"]

NO_LIMIT = float("inf")


class Returns(NamedTuple):
    """What a step returns, in the kernel's order: fresh arrays, except ``final_obs``.

    Attributes
    ----------
    obs
        Observations, float32 (N, len(layout)).
    final_obs
        With ``SAME_STEP``, the last observations of the worlds that ended and were reset in this
        step, float32 (N, len(layout)); other rows hold anything, and the next step changes all.
    rewards
        float64 (N,).
    flags
        bool (FLAGS, N): terminated, truncated, success.
    telemetry
        float64 (1, N, len(TELEMETRY)), or (0, …) without telemetry; with ``SAME_STEP`` a second
        layer holds the last ones of the worlds that ended.
    """

    obs: Observations
    final_obs: Observations
    rewards: Array
    flags: Mask
    telemetry: Array


class Batch(Storage):
    """N worlds, each with its own machine, task, seed and episode count.

    Parameters
    ----------
    machines, tasks
        One for all worlds, or a sequence with one for each. The machines share the substep and the
        largest voltage, the tasks the control period.
    num_worlds
        N; may be left out where ``machines`` or ``tasks`` is a sequence.
    draws
        Whether each world draws one of the given pairs of machine and task at each reset, by its
        seed and episode alone. Otherwise each world keeps its own.
    sensors
        What the observation holds; see ``observation_layout``.
    observe_context
        Whether the observation ends with the context of machine and task.
    action_unit
        ``"volt"``: actions within [0, voltage_max]; ``"normalised"``: a within [−1, 1] for
        voltage_max·((a + 1)/2)².
    frame_skip
        Control steps for which an action is held. Rewards and their terms add up, and what else a
        step returns is of the last of them; an episode that ends earlier ends its world's step.
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
    num_actions
        Entries of an action: one for each clutch.
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
        frame_skip: int = 1,
        max_steps: int | None = None,
        telemetry: bool = True,
        num_threads: int = 1,
    ) -> None:
        if action_unit not in get_args(ActionUnit):
            raise ParameterError(
                f"action_unit must be one of {', '.join(get_args(ActionUnit))}, got {action_unit!r}"
            )
        self._threads = Threads(whole_number("num_threads", num_threads))
        all_machines, all_tasks = listed(machines, tasks, None if draws else num_worlds)
        drawing = whole_number("num_worlds", num_worlds) if draws else None
        self.machine, self.task = all_machines[0], all_tasks[0]
        self.layout = observation_layout(
            self.machine, sensors, OBSERVED_CONTEXT if observe_context else None
        )
        self.action_low, self.action_high = -1.0, 1.0
        if action_unit == "volt":
            self.action_low, self.action_high = 0.0, self.machine.clutch.voltage_max
        self.frame_skip = whole_number("frame_skip", frame_skip)
        self._entries = len(self.layout)
        shared = self._shared(observe_context, max_steps)
        self._config = np.array([*flat(shared), *self.layout.scales])
        super().__init__(all_machines, all_tasks, drawing)
        self.num_actions = len(self.machine.clutches)
        # a slot without a clutch keeps this action
        self._slots = np.full((self.num_worlds, SLOTS), self.action_low)
        self._declared = not self.machine.has_paper_clutches
        self._records = int(telemetry)
        self._final_obs = np.empty((0, self._entries), np.float32)
        self._alone_returns = self._empty_returns(1, 1)
        self._alone: Any = None

    def only(self, chosen: Mask) -> Self:
        """Return a batch that continues with the chosen worlds, (N,), from their present states."""
        part = super().only(chosen)
        part._slots = self._slots[chosen]
        return part

    def _shared(self, observe_context: bool, max_steps: int | None) -> Config:
        """Return what all worlds share."""
        entries = len(self.layout) - (len(OBSERVED_CONTEXT) if observe_context else 0)
        inverse = np.zeros(ENTRIES)
        inverse[:entries] = 1.0 / self.layout.scales[:entries]
        return Config(
            low=self.action_low,
            high=self.action_high,
            slack=4.0 * float(np.spacing(np.float32(self.action_high))),
            substep=held_machine(self.task, self.machine).machine.substep,
            substeps=substeps(self.task, self.machine),
            max_steps=NO_LIMIT if max_steps is None else whole_number("max_steps", max_steps),
            frame_skip=self.frame_skip,
            entries=entries,
            inverse_scale=read(inverse, OBS, 0),
        )

    def reset(
        self,
        seeds: Sequence[int | None] | None = None,
        chosen: Mask | None = None,
        *,
        all_seen: bool = True,
    ) -> tuple[Observations, Array]:
        """Start new episodes.

        Parameters
        ----------
        seeds
            One seed ≥ 0 for each world, or None for an unseeded reset, which goes on to the next
            episode of the world's present seed (drawn from the operating system at first).
        chosen
            Which worlds to reset, shape (N,); all by default. The others don't change.
        all_seen
            Whether to return the rows of the others too, which are otherwise undefined.

        Returns
        -------
        observations, telemetry
            Of all worlds: float32 (N, len(layout)) and float64 (N or 0, len(TELEMETRY)), fresh
            arrays. The telemetry holds the pose, and zero for entries that only a step computes.
        """
        chosen = np.ones(self.num_worlds, np.bool_) if chosen is None else chosen
        words = self.next_words(seeds, chosen)
        obs = np.empty((self.num_worlds, self._entries), np.float32)
        telemetry = np.empty((self._records, self.num_worlds, COLUMNS))
        kernel = reset_kernel()
        self._words[:], self._seeded[:] = words, self._seeded | chosen
        shared = self._config, self._constants
        kernel(self._worlds, self._words, chosen, all_seen, obs, telemetry, *shared)
        return obs, telemetry.reshape(-1, COLUMNS)

    def step(self, actions: ArrayLike, ended: int = REFUSE) -> Returns:
        """Advance all worlds by ``frame_skip`` control periods.

        Parameters
        ----------
        actions
            Clutch voltages in the action unit, shape (N, num_actions). Up to four float32 ulp
            beyond a bound are clipped.
        ended
            What to do with a world whose episode has ended, from ``pter_gym._engine.world``:
            ``REFUSE`` to step, ``SKIP`` it (its rows are zero, and NaN in the telemetry), reset it
            in the ``NEXT_STEP``, ignoring that step's action, or in the ``SAME_STEP``.

        Raises
        ------
        ActionError
            If an action has a wrong shape or type, is not finite, or is out of bounds; no world has
            moved.
        ResetNeededError
            If a world was never reset, or its episode has ended with ``REFUSE`` or ``SAME_STEP``;
            no world has moved.
        """
        n = self.num_worlds
        self._slots[:, : self.num_actions] = checked_actions(actions, (n, self.num_actions))
        if ended == NEXT_STEP:
            self._check_seeded()
        if ended == SAME_STEP and not len(self._final_obs):
            self._final_obs = np.empty((n, self._entries), np.float32)
        returns = self._empty_returns(n, self._records * (2 if ended == SAME_STEP else 1))
        if ended == SKIP:
            for part in (returns.obs, returns.rewards, returns.flags):
                part.fill(0)
            returns.telemetry.fill(np.nan)
        refused = self._run(returns, ended)
        if refused >= 0:
            self.raise_refusal(refused)
        return returns

    def step_alone(self, action: ArrayLike) -> tuple[Observations, Array, float, bool, bool, bool]:
        """Advance a batch of one world, as ``step`` with ``REFUSE`` does, with less around it.

        Parameters
        ----------
        action
            Shape (num_actions,).

        Returns
        -------
        observation, telemetry
            Fresh arrays (len(layout),) and (len(TELEMETRY),).
        reward, terminated, truncated, success
            As Python has them.
        """
        self._slots[0, : self.num_actions] = checked_actions(action, (self.num_actions,))
        refused = self._step_alone()
        if refused >= 0:
            self.raise_refusal(refused)
        obs, _, rewards, flags, telemetry = self._alone_returns
        (terminated,), (truncated,), (success,) = flags.tolist()
        return obs[0].copy(), telemetry[0, 0].copy(), rewards.item(), terminated, truncated, success

    @property
    def address(self) -> int:
        """Where the kernel is that advances these worlds."""
        return advance_address(self._declared)

    def kernel_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by name that kernels get, and which worlds have begun; no copies."""
        rest = {"slots": self._slots, "config": self._config, "constants": self._constants}
        return {**self._changing, **rest}

    def _empty_returns(self, worlds: int, layers: int) -> Returns:
        """Return what a step of so many worlds fills, with so many layers of telemetry."""
        return Returns(
            np.empty((worlds, self._entries), np.float32),
            self._final_obs,
            np.empty(worlds),
            np.empty((FLAGS, worlds), np.bool_),
            np.empty((layers, worlds, COLUMNS)),
        )

    def _arrays(self, returns: Returns) -> tuple[NDArray[Any], ...]:
        """Return the arrays that the step kernel gets, in its order."""
        return self._worlds, self._words, self._slots, *returns, self._config, self._constants

    def _run(self, returns: Returns, ended: int) -> int:
        """Run the kernel over all blocks, on one thread or several.

        Return the first world whose step is refused, or −1.
        """
        kernel, arrays = advance_kernel(self._declared), self._arrays(returns)
        shares = self._threads.shares(len(self._worlds))
        if len(shares) == 1:
            return kernel(*arrays, ended, *shares[0])
        refused = kernel(*arrays, ended, 0, 0)
        if refused < 0:
            self._threads.run_parallel(partial(kernel, *arrays, ended), shares)
        return refused

    def close(self) -> None:
        """Stop the threads, if there are any."""
        self._threads.close()

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy keeps: its arrays will be elsewhere."""
        return {**self.__dict__, "_alone": None}

    def _step_alone(self) -> int:
        """Run the kernel for the only world; return 0 if its step is refused, or −1."""
        if not COMPILES:
            return self._run(self._alone_returns, REFUSE)
        if self._alone is None:
            arrays = self._arrays(self._alone_returns)
            table = table_of(arrays)
            self._alone = table.ctypes.data, table, arrays
        return alone_kernel(self._declared)(self._alone[0])

    def raise_refusal(self, world: int) -> NoReturn:
        """Raise what ``step`` raises for a world whose step is refused."""
        if self._rows[world, int(ROW.alive)] == 0.0:
            ended = f"its episode has ended ({self._why_ended(world)})"
            why = ended if self._seeded[world] else "it was never reset"
            raise ResetNeededError(f"world {world} needs a reset: {why}")
        bounds = f"[{self.action_low:g}, {self.action_high:g}]"
        raise ActionError(
            f"action of world {world} must be finite and within {bounds}, "
            f"got {self._slots[world, : self.num_actions].tolist()}"
        )

    def _why_ended(self, world: int) -> str:
        """Return why the episode of a world that has ended is over."""
        row: Any = self._rows[world]
        context = int(row[ROW.context_at])
        task = read(self._constants, CONTEXT.task, context)
        arm = read(self._constants, CONTEXT.machine.arm, context)
        q, foot = read(row, ROW.motion, 0), read(row, ROW.foot, 0)
        at = path_state(foot, *tip_velocity(arm, q), task.free)
        return first_reason(ending(at, q, kinetic_energy(arm, q), task)) or "truncated"


def checked_actions(actions: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return actions as an array of real numbers of a shape, or raise an ActionError."""
    try:
        array = np.asarray(actions)
    except (ValueError, TypeError, RuntimeError) as error:  # ragged, or a tensor not on the CPU
        raise ActionError(f"action must be an array of numbers: {error}") from None
    if array.shape != shape:
        raise ActionError(f"action must have the shape {shape}, got {array.shape}")
    if array.dtype.kind not in "fiu":
        raise ActionError(f"action must hold real numbers, got dtype {array.dtype}")
    return array
