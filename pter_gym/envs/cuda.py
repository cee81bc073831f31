"""The vector environment on a CUDA device: the scalar functions of ``pter_gym.engine.world``, a thread for each world.

Observations, rewards and flags stay on the device: PyTorch tensors where PyTorch sees the device, otherwise arrays with
``__cuda_array_interface__``. ``step`` waits for nothing. So a refused action cannot raise at once: its world stays
where it is, its reward is NaN, and ``check``, the next ``reset`` or ``close`` raises.

With ``NUMBA_ENABLE_CUDASIM=1`` and ``NUMBA_DISABLE_JIT=1`` the kernels run in plain Python, without a device.
"""

import importlib
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numba import cuda as numba_cuda
from numpy.typing import NDArray

from pter_gym.compiled.compiler import device
from pter_gym.engine.world import (
    ALIVE,
    BASIC_ROWS,
    CHANGING_ROWS,
    FLAGS,
    HIGH,
    LIMIT,
    LOW,
    PARAM,
    SCRATCH_ROWS,
    SLACK,
    SUBSTEP,
    SUBSTEPS,
    SUCCESS,
    TERMINATED,
    TRUNCATED,
    aim_torques,
    catch_crossing,
    end_step,
    find_velocity,
    given_volts,
    guide_tip,
    is_refused,
    judge_step,
    locate,
    move_arm,
    plan_hand,
    plans,
    push_tip,
    see,
    sense_torques,
    start_episode,
    take_command,
    take_context,
    take_reading,
    write_observation,
)
from pter_gym.envs.vector import PathFollowingVectorEnv
from pter_gym.errors import ActionError, DependencyError, ResetNeededError
from pter_gym.physics.model import VOLTAGE_DECAY, VOLTAGE_MAX
from pter_gym.tasks.path_following import SENSES_IDEALLY, TELEMETRY

cuda: Any = numba_cuda

MISSING = 'device="cuda" needs an NVIDIA GPU and its driver, and found none'

THREADS = 128
"""Threads in a block of the device."""

NONE_REFUSED = np.iinfo(np.int64).max

_ONE = np.uint64(1)


@device
def _move(w: Any, actions: Any, world: int, config: Any, guides: bool) -> None:
    """Move one world through a control step."""
    low, high, h, count = config[LOW], config[HIGH], config[SUBSTEP], int(config[SUBSTEPS])
    take_command(w, 0, given_volts(actions, world, low, w[PARAM + VOLTAGE_MAX, 0] / (high - low)))
    lags_voltage = w[PARAM + VOLTAGE_DECAY, 0] != 0.0
    for k in range(count):
        if lags_voltage | (k == 0):
            aim_torques(w, 0, h * count)
        push_tip(w, 0)
        if guides:
            guide_tip(w, 0, h)
        find_velocity(w, 0, h)
        catch_crossing(w, 0, h)
        move_arm(w, 0, h)
    sense_torques(w, 0, h)


@cuda.jit
def _advance(
    worlds: Any,
    words: Any,
    actions: Any,
    obs: Any,
    final_obs: Any,
    rewards: Any,
    flags: Any,
    telemetry: Any,
    config: Any,
    constants: Any,
    ended: int,
    refused: Any,
) -> None:
    world = cuda.grid(1)
    if world >= obs.shape[0]:
        return
    width = worlds.shape[2]
    b = world // width
    lane = world % width
    low, high, slack, period = config[LOW], config[HIGH], config[SLACK], config[SUBSTEP] * config[SUBSTEPS]
    if is_refused(worlds[b, ALIVE, lane], actions, low - slack, high + slack, ended, world):
        cuda.atomic.min(refused, 0, world)
        rewards[world] = np.nan
        return
    w = cuda.local.array((SCRATCH_ROWS, 1), np.float64)
    for row in range(CHANGING_ROWS):
        w[row, 0] = worlds[b, row, lane] if row < worlds.shape[1] else 0.0
    take_context(w, 0, constants)
    if w[ALIVE, 0] != 0.0:
        _move(w, actions, world, config, worlds.shape[1] > BASIC_ROWS)
    locate(w, 0, constants)
    judge_step(w, 0, period, config[LIMIT])
    if plans(w, 0):
        plan_hand(w, 0, constants, period, config[SUBSTEPS])
    if w[PARAM + SENSES_IDEALLY, 0] == 0.0:
        take_reading(w, 0, words[world, 0], words[world, 1])
    see(w, 0, config, constants)
    end_step(w, 0, world, words, obs, final_obs, rewards, flags, telemetry, 0, period, ended, config, constants)
    for row in range(worlds.shape[1]):
        worlds[b, row, lane] = w[row, 0]


@cuda.jit
def _reset(worlds: Any, words: Any, chosen: Any, seeded: Any, obs: Any, config: Any, constants: Any) -> None:
    world = cuda.grid(1)
    if world >= obs.shape[0]:
        return
    width = worlds.shape[2]
    b = world // width
    lane = world % width
    w = cuda.local.array((SCRATCH_ROWS, 1), np.float64)
    for row in range(CHANGING_ROWS):
        w[row, 0] = worlds[b, row, lane] if row < worlds.shape[1] else 0.0
    take_context(w, 0, constants)
    if chosen[world]:
        if not seeded[world]:
            words[world, 1] += _ONE
        count = config[SUBSTEPS]
        start_episode(w, 0, words[world, 0], words[world, 1], constants, config[SUBSTEP] * count, count)
        for row in range(worlds.shape[1]):
            worlds[b, row, lane] = w[row, 0]
    see(w, 0, config, constants)
    write_observation(w, 0, obs, world, config, constants)


class CudaPathFollowingVectorEnv(PathFollowingVectorEnv):
    """``PathFollowingVectorEnv`` on a CUDA device.

    It differs where the device does: returns are device arrays, ``final_obs`` is an array (N, entries) whose rows count
    where ``_final_obs`` says so, and refused actions are reported late, as the module says. Results agree with the
    CPU's to 1e-9, not to the bit, since the device contracts products and sums.
    """

    def __init__(self, num_envs: int = 1, **keywords: Any) -> None:
        if not cuda.is_available():
            raise DependencyError(MISSING)
        super().__init__(num_envs, **keywords)
        self._torch = _torch_with_cuda()
        self._grid = (-(-self.num_envs // THREADS), THREADS)
        self._begun = np.zeros(self.num_envs, np.bool_)
        self._upload()

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start new episodes; see ``PathFollowingVectorEnv.reset``. Raises what ``check`` raises."""
        self._check_open()
        chosen = self._mask(options)
        seeds = self._seeds(seed)
        self.check()
        to_device = cuda.to_device
        fresh = chosen & ~self._begun
        given = np.array([each is not None for each in seeds]) if seeds is not None else np.zeros_like(chosen)
        seeded = chosen & (given | fresh)
        if seeded.any():
            words = self._device["words"].copy_to_host()
            drawn = np.random.SeedSequence().generate_state(self.num_envs, np.uint64)
            for world in map(int, np.flatnonzero(seeded)):
                words[world] = seeds[world] if seeds is not None and given[world] else drawn[world], 0
            self._device["words"] = to_device(words)
        self._begun |= chosen
        obs = self._empty((self.num_envs, len(self.observation_layout)), np.float32)
        _reset[self._grid](
            self._device["worlds"],
            self._device["words"],
            to_device(chosen),
            to_device(seeded),
            self._view(obs),
            self._device["config"],
            self._device["constants"],
        )
        return obs, {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Advance all worlds by one control period, without waiting for the device.

        Parameters
        ----------
        actions
            Shape (N, 4), float32 or float64: a device array, or an array of the host, which is copied.

        Raises
        ------
        ActionError
            If the actions have a wrong shape or type.
        ResetNeededError
            If a world was never reset.
        """
        self._check_open()
        if not self._begun.all():
            raise ResetNeededError(f"world {self._begun.argmin()} needs a reset: it was never reset")
        n = self.num_envs
        same = self.autoreset_mode == AutoresetMode.SAME_STEP
        entries = len(self.observation_layout)
        obs = self._empty((n, entries), np.float32)
        final_obs = self._empty((n if same else 0, entries), np.float32)
        rewards = self._empty((n,), np.float64)
        flags = self._empty((FLAGS, n), np.bool_)
        telemetry = self._empty((self._records * (2 if same else 1), n, len(TELEMETRY)), np.float64)
        view = self._view
        _advance[self._grid](
            self._device["worlds"],
            self._device["words"],
            self._on_device(actions),
            view(obs),
            view(final_obs),
            view(rewards),
            view(flags),
            view(telemetry),
            self._device["config"],
            self._device["constants"],
            self._ended,
            self._device["refused"],
        )
        infos: dict[str, Any] = {"is_success": flags[SUCCESS]}
        if self._records:
            infos["telemetry"] = telemetry[0]
        if same:
            infos |= {"final_obs": final_obs, "_final_obs": self._either(flags)}
            if self._records:
                infos["final_info"] = {"telemetry": telemetry[1]}
        return obs, rewards, flags[TERMINATED], flags[TRUNCATED], infos

    def check(self) -> None:
        """Wait for the device and raise if a step was refused since the last look.

        Raises
        ------
        ActionError, ResetNeededError
            With the number of the first world whose step was refused.
        """
        world = int(self._device["refused"].copy_to_host()[0])
        if world == NONE_REFUSED:
            return
        self._device["refused"] = cuda.to_device(np.array([NONE_REFUSED]))
        width = self._device["worlds"].shape[2]
        alive = self._device["worlds"].copy_to_host()[world // width, ALIVE, world % width]
        if alive == 0.0:
            raise ResetNeededError(f"world {world} needs a reset: it was never reset or its episode has ended")
        raise ActionError(f"an action of world {world} was not finite or out of bounds")

    def close_extras(self) -> None:
        """Report what ``check`` reports."""
        self.check()

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Return copies on the host of all that changes; fits ``set_state`` of the CPU's environment too."""
        return {
            "worlds": self._device["worlds"].copy_to_host(),
            "words": self._device["words"].copy_to_host(),
            "seeded": self._begun.copy(),
        }

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Bring the worlds to a state from ``get_state``, of the CPU's environment too."""
        self.batch.set_state(state)
        self._upload()

    def _upload(self) -> None:
        host = self.batch.device_arrays()
        self._begun = host.pop("seeded").copy()
        to_device = cuda.to_device
        self._device = {name: to_device(array) for name, array in host.items()}
        self._device["refused"] = to_device(np.array([NONE_REFUSED]))

    def _empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """Return a new device array: PyTorch's where it sees the device, whose allocator is fast."""
        if self._torch is None:
            return cuda.device_array(shape, dtype)
        return self._torch.empty(shape, dtype=getattr(self._torch, np.dtype(dtype).name), device="cuda")

    def _either(self, flags: Any) -> Any:
        if self._torch is not None:
            return flags[TERMINATED] | flags[TRUNCATED]
        host = flags.copy_to_host()
        return cuda.to_device(host[TERMINATED] | host[TRUNCATED])

    def _on_device(self, actions: Any) -> Any:
        if not hasattr(actions, "__cuda_array_interface__"):
            actions = np.ascontiguousarray(actions)
        if tuple(actions.shape) != (self.num_envs, 4):
            raise ActionError(f"action must have the shape {(self.num_envs, 4)}, got {tuple(actions.shape)}")
        if "float" not in str(actions.dtype):
            raise ActionError(f"action must be float32 or float64, got {actions.dtype}")
        if isinstance(actions, np.ndarray):
            return cuda.to_device(actions)
        return self._view(actions.detach() if hasattr(actions, "detach") else actions)

    def _view(self, array: Any) -> Any:
        """Return numba's view of a device array; numba's own need none."""
        return array if self._torch is None else cuda.as_cuda_array(array)


def _torch_with_cuda() -> Any:
    """Return PyTorch if it is installed and sees a device."""
    try:
        torch: Any = importlib.import_module("torch")
    except ImportError:
        return None
    return torch if torch.cuda.is_available() else None
