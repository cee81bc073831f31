"""Checkpoints of a run: Stable-Baselines3's own files, with the state of worlds and random numbers added to them.

They are written whole or not at all, and the newest two are kept. They are local files of whoever trains: of what is in
them only arrays and tensors are read.
"""

import io
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file

from pter_agents.worlds import InterfaceVecEnv
from pter_gym.errors import DataError
from pter_gym.internal.files import write_bytes_atomic

State = dict[str, NDArray[Any]]

KEPT = 2
"""Newest checkpoints that are kept."""

EXTRA = "pter_state.npz"
"""Name of the added part."""

NAME = re.compile(r"checkpoint-(\d+)\.zip")


def checkpoints(folder: Path) -> list[Path]:
    """Return the checkpoints in a run's folder, the newest last."""
    found = [(int(match[1]), path) for path in folder.iterdir() if (match := NAME.fullmatch(path.name))]
    return [path for _, path in sorted(found)]


def save_checkpoint(model: OnPolicyAlgorithm, worlds: InterfaceVecEnv, folder: Path) -> Path:
    """Write the checkpoint of a model at a rollout's boundary, and let all but the newest go."""
    content = io.BytesIO()
    model.save(content)
    with zipfile.ZipFile(content, "a") as archive:
        archive.writestr(EXTRA, _packed(_state(model, worlds)))
    path = folder / f"checkpoint-{model.num_timesteps}.zip"
    write_bytes_atomic(path, content.getvalue())
    for old in checkpoints(folder)[:-KEPT]:
        old.unlink(missing_ok=True)
    return path


def load_weights(model: OnPolicyAlgorithm, path: Path) -> None:
    """Bring networks and optimiser of a model to those of a checkpoint.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    try:
        _, parameters, _ = load_from_zip_file(io.BytesIO(path.read_bytes()), load_data=False, device="cpu")
        model.set_parameters(parameters, exact_match=True, device="cpu")
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise DataError(f"checkpoint {path} cannot be read: {error}") from None


def resume_from(model: OnPolicyAlgorithm, worlds: InterfaceVecEnv, path: Path) -> None:
    """Bring a new model and its worlds to where a checkpoint was written.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    load_weights(model, path)
    try:
        with zipfile.ZipFile(path) as archive:
            state = dict(np.load(io.BytesIO(archive.read(EXTRA)), allow_pickle=False))
        worlds.set_state(state)
        _set_state(model, state)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise DataError(f"checkpoint {path} cannot be read: {error}") from None


def _state(model: OnPolicyAlgorithm, worlds: InterfaceVecEnv) -> State:
    """Return all that a run's future depends on, apart from networks and optimiser."""
    drawn: Any = np.random.get_state(legacy=True)  # noqa: NPY002 (Stable-Baselines3 draws from it)
    _, keys, position, has_gauss, gauss = drawn
    own: Any = model
    return {
        **worlds.get_state(),
        "last_obs": own._last_obs,
        "starts": own._last_episode_starts,
        "counts": np.array([model.num_timesteps, own._n_updates, position, has_gauss]),
        "numpy_keys": keys,
        "numpy_gauss": np.array(gauss),
        "torch": torch.get_rng_state().numpy(),
    }


def _set_state(model: OnPolicyAlgorithm, state: State) -> None:
    timesteps, updates, position, has_gauss = state["counts"].tolist()
    own: Any = model
    own.num_timesteps = timesteps
    own._n_updates = updates
    own._last_obs = state["last_obs"]
    own._last_episode_starts = state["starts"]
    np.random.set_state(("MT19937", state["numpy_keys"], position, has_gauss, float(state["numpy_gauss"])))  # noqa: NPY002
    torch.set_rng_state(torch.from_numpy(state["torch"]))


def _packed(state: State) -> bytes:
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **state)  # type: ignore[call-overload]
    return content.getvalue()
