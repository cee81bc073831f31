"""The vector environment on a CUDA device: the scalar functions of ``pter_gym._engine.world``, a thread for each world.

Observations, rewards and flags stay on the device, as PyTorch tensors if PyTorch sees the device, otherwise as arrays
with ``__cuda_array_interface__``. ``step`` does not wait for the device, so it cannot raise for a bad action: that
world stays where it is, its reward is NaN, and ``check``, the next ``reset`` or ``close`` raises.

With ``NUMBA_ENABLE_CUDASIM=1`` and ``NUMBA_DISABLE_JIT=1`` the kernels run in plain Python, without a device.
"""

import importlib
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numba import cuda as numba_cuda
from numpy.typing import NDArray

from pter_gym._engine.cuda import THREADS, advance, reset
from pter_gym._engine.world import FLAG, FLAGS, ROW
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.errors import ActionError, DependencyError, ParameterError, ResetNeededError
from pter_gym.params import require_paper_clutches
from pter_gym.tasks.path_following._telemetry import COLUMNS

cuda: Any = numba_cuda

MISSING = 'device="cuda" needs an NVIDIA GPU and its driver, but there is none'

NONE_REFUSED = np.iinfo(np.int64).max


class CudaPathFollowingVectorEnv(PathFollowingVectorEnv):
    """``PathFollowingVectorEnv`` on a CUDA device.

    Returned arrays are on the device, ``final_obs`` is an array (N, entries) whose rows are valid where ``_final_obs``
    is true, and bad actions are reported late. Results agree with those of the CPU to 1e-9, not bit for bit, since the
    device fuses products and sums.
    """

    device = "cuda"

    def __init__(self, num_envs: int = 1, **keywords: Any) -> None:
        if keywords.get("render_mode") is not None:
            raise ParameterError('render_mode must be None with device="cuda": watch worlds of device="cpu"')
        if not cuda.is_available():
            raise DependencyError(MISSING)
        super().__init__(num_envs, **keywords)
        require_paper_clutches(self.batch.machine, "the kernels of a CUDA device are made for them")
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
        reset[self._grid](
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
        """Advance all worlds by ``frame_skip`` control periods, without waiting for the device.

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
        telemetry = self._empty((self._records * (2 if same else 1), n, COLUMNS), np.float64)
        view = self._view
        advance[self._grid](
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
        infos: dict[str, Any] = {"is_success": flags[FLAG.success]}
        if self._records:
            infos["telemetry"] = telemetry[0]
        if same:
            infos |= {"final_obs": final_obs, "_final_obs": self._either(flags)}
            if self._records:
                infos["final_info"] = {"telemetry": telemetry[1]}
        return obs, rewards, flags[FLAG.terminated], flags[FLAG.truncated], infos

    def check(self) -> None:
        """Wait for the device and raise if a step was refused since the last check.

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
        alive = self._device["worlds"].copy_to_host()[world // width, ROW.alive, world % width]
        if alive == 0.0:
            raise ResetNeededError(f"world {world} needs a reset: it was never reset or its episode has ended")
        raise ActionError(f"an action of world {world} was not finite or out of bounds")

    def close_extras(self) -> None:
        """Report what ``check`` reports."""
        self.check()

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Return copies on the host of all that changes; ``set_state`` of the CPU environment accepts them too."""
        return {
            "worlds": self._device["worlds"].copy_to_host(),
            "words": self._device["words"].copy_to_host(),
            "seeded": self._begun.copy(),
        }

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Set the worlds to a state from ``get_state``, also of the CPU environment."""
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
            return flags[FLAG.terminated] | flags[FLAG.truncated]
        host = flags.copy_to_host()
        return cuda.to_device(host[FLAG.terminated] | host[FLAG.truncated])

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
