"""Many worlds in one call. The single environment is a batch of one."""

import os
from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pter_gym.controllers.laws import EXTERNAL, MEMORY
from pter_gym.envs.kernels import ALIVE, WORLD_ROWS, advance_kernel, reset_kernel
from pter_gym.errors import ActionError, ParameterError, ResetNeededError
from pter_gym.params import Machine
from pter_gym.physics.model import model_of
from pter_gym.tasks.path_following import (
    TELEMETRY,
    PathFollowing,
    Sensors,
    check_machine,
    observation_layout,
    substeps,
    task_model,
)

Array = NDArray[np.float64]
Observations = NDArray[np.float32]

ActionUnit = Literal["volt", "normalised"]

_EXTERNAL = np.array([EXTERNAL])


class Batch:
    """N worlds of one task, each with its own machine, seed and episode count.

    Parameters
    ----------
    machines
        One machine for all worlds, or one for each. They share the substep and the largest voltage.
    task
        The task.
    num_worlds
        N; may be left out where ``machines`` is a sequence.
    sensors
        What the observation holds; see ``observation_layout``.
    action_unit
        ``"volt"``: actions within [0, voltage_max]; ``"normalised"``: within [−1, 1] for the same voltages.

    Attributes
    ----------
    task, machine, num_worlds
        As given; ``machine`` is the first one.
    layout
        Layout of the observations.
    action_low, action_high
        Bounds of an action in its unit.

    Raises
    ------
    ParameterError
        If the machines disagree on what they must share, or one of them cannot do the task.
    """

    def __init__(
        self,
        machines: Machine | Sequence[Machine],
        task: PathFollowing,
        num_worlds: int | None = None,
        *,
        sensors: Sensors = "torque",
        action_unit: ActionUnit = "volt",
    ) -> None:
        if action_unit not in get_args(ActionUnit):
            raise ParameterError(f"action_unit must be one of {', '.join(get_args(ActionUnit))}, got {action_unit!r}")
        listed = (
            [machines] * (1 if num_worlds is None else num_worlds) if isinstance(machines, Machine) else list(machines)
        )
        if not listed or (num_worlds is not None and len(listed) != num_worlds):
            raise ParameterError(
                f"num_worlds must be ≥ 1 and the number of machines, got {num_worlds!r}, {len(listed)}"
            )
        first = listed[0]
        columns: dict[int, tuple[float, ...]] = {}
        for machine in listed:
            if id(machine) in columns:
                continue
            if (machine.substep, machine.clutch.voltage_max) != (first.substep, first.clutch.voltage_max):
                raise ParameterError("machines of one batch must share substep and clutch.voltage_max")
            check_machine(task, machine)
            columns[id(machine)] = (*model_of(machine), *task_model(task, machine))
        self.task = task
        self.machine = first
        self.num_worlds = len(listed)
        self.layout = observation_layout(first, sensors)
        voltage_max = first.clutch.voltage_max
        self.action_low, self.action_high = (0.0, voltage_max) if action_unit == "volt" else (-1.0, 1.0)
        self._slack = 4.0 * float(np.spacing(np.float32(self.action_high)))
        self._substep = first.substep
        self._count = substeps(task, first)
        self._params = np.array([columns[id(machine)] for machine in listed]).T.copy()
        self._state = np.zeros((WORLD_ROWS, self.num_worlds))
        self._words = np.zeros((self.num_worlds, 2), np.uint64)
        self._seeded = np.zeros(self.num_worlds, np.bool_)
        self._scales = np.array([self.layout.scales, 1.0 / self.layout.scales])
        self._memory = np.zeros((self.num_worlds, MEMORY))
        self._advance = advance_kernel()

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
            Which worlds to reset, shape (N,); all by default. Rows of other worlds are zero in what is returned.

        Returns
        -------
        observations, telemetry
            float32 (N, len(layout)) and float64 (N, len(TELEMETRY)), fresh arrays.
        """
        chosen = np.ones(self.num_worlds, np.bool_) if chosen is None else chosen
        given = [None] * self.num_worlds if seeds is None else list(seeds)
        if len(given) != self.num_worlds:
            raise ParameterError(f"seeds must hold {self.num_worlds} entries, got {len(given)}")
        for seed in given:
            if seed is not None and not 0 <= seed < 2**64:
                raise ParameterError(f"seeds must lie within [0, 2⁶⁴), got {seed!r}")
        for world in map(int, np.flatnonzero(chosen)):
            seed = given[world]
            if seed is None and self._seeded[world]:
                self._words[world, 1] += np.uint64(1)
            else:
                drawn = int.from_bytes(os.urandom(8)) if seed is None else seed
                self._words[world] = drawn, 0
                self._seeded[world] = True
        obs = np.zeros((self.num_worlds, len(self.layout)), np.float32)
        telemetry = np.zeros((self.num_worlds, len(TELEMETRY)))
        reset_kernel()(self._params, self._state, self._words, chosen, self._scales, obs, telemetry)
        return obs, telemetry

    def step(self, actions: ArrayLike, *, skip_ended: bool = False) -> tuple[Observations, Array]:
        """Advance all worlds by one control period.

        Parameters
        ----------
        actions
            Clutch voltages in the action unit, shape (N, 4). Up to four float32 ulp beyond a bound are clipped.
        skip_ended
            Leave out worlds whose episode has ended, with zeros and NaN in their rows, instead of refusing to step.

        Returns
        -------
        observations, telemetry
            float32 (N, len(layout)) and float64 (N, len(TELEMETRY)), fresh arrays.

        Raises
        ------
        ActionError
            If an action has a wrong shape or type, is not finite, or is out of bounds; no world has moved.
        ResetNeededError
            If a world was never reset or its episode has ended; no world has moved.
        """
        numbers = self._numbers(actions)
        shape = (self.num_worlds, len(self.layout))
        obs = np.zeros(shape, np.float32) if skip_ended else np.empty(shape, np.float32)
        telemetry = np.empty((1, self.num_worlds, len(TELEMETRY)))
        if skip_ended:
            telemetry.fill(np.nan)
        refused = self._advance(
            self._params,
            self._state,
            numbers,
            _EXTERNAL,
            self._memory,
            self._scales,
            obs,
            telemetry,
            self.action_low,
            self.action_high,
            self._slack,
            skip_ended,
            self._substep,
            self._count,
            0,
            self.num_worlds,
        )
        if refused >= 0:
            self._refuse(refused, numbers[refused])
        return obs, telemetry[0]

    def rollout(self, obs: Observations, law: Any, gains: Array, steps: int) -> tuple[Observations, Array]:
        """Run a compiled control law in all worlds, from their present state, for at most ``steps`` control periods.

        Parameters
        ----------
        obs
            The latest observations, shape (N, len(layout)).
        law, gains
            A law as in ``pter_gym.controllers.laws`` and its gains, shape (G,).
        steps
            Number of control periods.

        Returns
        -------
        observations, telemetry
            The last observations, and float64 (steps, N, len(TELEMETRY)); NaN after the end of an episode.
        """
        obs = obs.copy()
        telemetry = np.full((steps, self.num_worlds, len(TELEMETRY)), np.nan)
        memory = np.zeros((self.num_worlds, MEMORY))
        memory[:, -1] = np.arange(self.num_worlds)
        advance_kernel(law)(
            self._params,
            self._state,
            np.empty((0, 4)),
            gains,
            memory,
            self._scales,
            obs,
            telemetry,
            self.action_low,
            self.action_high,
            self._slack,
            True,
            self._substep,
            self._count,
            0,
            self.num_worlds,
        )
        return obs, telemetry

    def snapshot(self) -> tuple[Array, NDArray[np.uint64]]:
        """Return copies of all that changes: the state array, and seed and episode of each world."""
        return self._state.copy(), self._words.copy()

    def _numbers(self, actions: ArrayLike) -> Array:
        try:
            array = np.asarray(actions)
        except ValueError:
            raise ActionError("action must be an array of numbers") from None
        if array.shape != (self.num_worlds, 4):
            raise ActionError(f"action must have the shape {(self.num_worlds, 4)}, got {array.shape}")
        if array.dtype.kind not in "fiu":
            raise ActionError(f"action must hold real numbers, got dtype {array.dtype}")
        return np.ascontiguousarray(array, np.float64)

    def _refuse(self, world: int, action: Array) -> None:
        if self._state[ALIVE, world] == 0.0:
            raise ResetNeededError(f"world {world} needs a reset: it was never reset or its episode has ended")
        raise ActionError(
            f"action of world {world} must be finite and within [{self.action_low:g}, {self.action_high:g}], "
            f"got {action.tolist()}"
        )
