"""The CUDA kernels: equal to the CPU's, in numba's simulator here and on a device where there is one."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

import pter_gym  # noqa: F401  (registers the environment)
from pter_gym.errors import DependencyError, ParameterError

pytest.importorskip("numba_cuda")

SIMULATED = os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"


def has_device() -> bool:
    """Whether a CUDA device, or the simulator, is there."""
    from numba import cuda

    return bool(cuda.is_available())


def on_host(array: Any) -> NDArray[Any]:
    """Copy a device array to the host."""
    return array.copy_to_host() if hasattr(array, "copy_to_host") else array.cpu().numpy()


def worst_difference(mode: AutoresetMode, steps: int, worlds: int, limit: int, skip: int = 1) -> float:
    """Step the same worlds on both devices and return the largest difference of observations and rewards.

    Each step begins from equal states, so differences do not grow through stick-slip.
    """
    from pter_gym.scenarios import SCENARIOS

    keywords = {
        "num_envs": worlds,
        "randomisation": SCENARIOS["everything"].randomisation(contexts=6),
        "observe_context": True,
        "autoreset_mode": mode,
        "max_episode_steps": limit,
        "frame_skip": skip,
    }
    gpu: Any = gymnasium.make_vec("PTER/PathFollowing-v0", device="cuda", **keywords)
    cpu: Any = gymnasium.make_vec("PTER/PathFollowing-v0", **keywords)
    worst = np.abs(on_host(gpu.reset(seed=3)[0]) - cpu.reset(seed=3)[0]).max()
    rng = np.random.default_rng(0)
    for _ in range(steps):
        actions = rng.uniform(0.0, 5.0, (worlds, 4)).astype(np.float32)
        gpu.set_state(cpu.get_state())
        mine, theirs = gpu.step(actions), cpu.step(actions)
        worst = max(worst, np.abs(on_host(mine[0]) - theirs[0]).max())
        worst = max(worst, np.abs((on_host(mine[1]) - theirs[1]) / np.maximum(1.0, np.abs(theirs[1]))).max())
        np.testing.assert_array_equal(on_host(mine[2]), theirs[2])
        np.testing.assert_array_equal(on_host(mine[3]), theirs[3])
        ended = theirs[2] | theirs[3]
        if mode == AutoresetMode.SAME_STEP and ended.any():
            np.testing.assert_array_equal(on_host(mine[4]["_final_obs"]), ended)
            final = np.stack(list(theirs[4]["final_obs"][ended]))
            worst = max(worst, np.abs(on_host(mine[4]["final_obs"])[ended] - final).max())
        if mode == AutoresetMode.DISABLED and ended.any():
            options = {"reset_mask": ended}
            worst = max(worst, np.abs(on_host(gpu.reset(options=options)[0]) - cpu.reset(options=options)[0]).max())
    return float(worst)


def refused_action() -> str:
    """Give one world a NaN and return what the late report says."""
    from pter_gym.errors import ActionError

    env: Any = gymnasium.make_vec("PTER/PathFollowing-v0", num_envs=4, device="cuda")
    env.reset(seed=0)
    before = env.get_state()["worlds"]
    actions = np.zeros((4, 4), np.float32)
    actions[2, 1] = np.nan
    rewards = on_host(env.step(actions)[1])
    after = env.get_state()["worlds"]
    assert np.isnan(rewards[2])
    assert np.isfinite(rewards[[0, 1, 3]]).all()
    assert before[:, :, 2].tobytes() == after[:, :, 2].tobytes()
    try:
        env.reset()
    except ActionError as error:
        return str(error)
    return ""


def in_any_mode() -> dict[str, float]:
    """Return the worst difference of a few worlds in each mode, for so long that all end at the limit and go on."""
    once = {mode.name: worst_difference(mode, steps=8, worlds=3, limit=6) for mode in AutoresetMode}
    held = {f"{mode.name} held": worst_difference(mode, steps=4, worlds=3, limit=2, skip=3) for mode in AutoresetMode}
    return once | held


@pytest.fixture(scope="module")
def simulated() -> dict[str, Any]:
    """What ``in_any_mode`` and ``refused_action`` return in a process with numba's simulator."""
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import json, test_cuda as t\n"
        "print(json.dumps({**t.in_any_mode(), 'refused': t.refused_action()}))"
    )
    settings = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    found = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], env=settings, capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    return json.loads(found.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.name)
@pytest.mark.parametrize("held", ["", " held"])
def test_simulated_kernels_have_the_bits_of_the_cpu(mode: AutoresetMode, held: str, simulated: dict[str, Any]) -> None:
    assert simulated[mode.name + held] == 0.0


@pytest.mark.slow
def test_a_refused_action_moves_nothing_and_is_reported_late(simulated: dict[str, Any]) -> None:
    assert "world 2" in simulated["refused"]


@pytest.mark.gpu
@pytest.mark.skipif(not has_device(), reason="no CUDA device")
@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.name)
def test_the_device_agrees_with_the_cpu(mode: AutoresetMode) -> None:
    """float32 observations may differ by one ulp of 1 where the underlying float64 differ by 1e-9."""
    assert worst_difference(mode, steps=100, worlds=1000, limit=25) <= 2.0**-23 + 1e-9
    assert worst_difference(mode, steps=50, worlds=1000, limit=12, skip=2) <= 2.0**-23 + 1e-9


@pytest.mark.skipif(has_device(), reason="there is a CUDA device")
def test_without_a_device_one_error_says_what_is_needed() -> None:
    with pytest.raises(DependencyError, match="NVIDIA GPU"):
        gymnasium.make_vec("PTER/PathFollowing-v0", num_envs=2, device="cuda")


def test_an_unknown_device_is_refused() -> None:
    with pytest.raises(ParameterError, match="cpu or cuda"):
        gymnasium.make_vec("PTER/PathFollowing-v0", num_envs=2, device="tpu")
