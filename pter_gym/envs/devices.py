"""The vector environment by the device that simulates it."""

from typing import Any, Literal

from pter_gym.envs.vector import PathFollowingVectorEnv
from pter_gym.errors import ParameterError, needs_extra

Device = Literal["cpu", "cuda"]


def make_vector_env(num_envs: int = 1, *, device: Device = "cpu", **keywords: Any) -> PathFollowingVectorEnv:
    """Return the vector environment on a device; the entry point of ``gymnasium.make_vec``.

    Parameters
    ----------
    num_envs
        N.
    device
        ``"cpu"`` or ``"cuda"``.
    **keywords
        Of ``PathFollowingVectorEnv``.

    Raises
    ------
    ParameterError
        If there is no such device.
    DependencyError
        If the CUDA device or what it needs is missing.
    """
    if device == "cpu":
        return PathFollowingVectorEnv(num_envs, **keywords)
    if device == "cuda":
        try:
            from pter_gym.envs.cuda import CudaPathFollowingVectorEnv
        except ImportError as error:
            raise needs_extra('device="cuda"', "gpu") from error
        return CudaPathFollowingVectorEnv(num_envs, **keywords)
    raise ParameterError(f"device must be cpu or cuda, got {device!r}")
