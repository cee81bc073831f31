"""Checkpoints of a run: the complete training state, as tensors and numbers without code.

A file is a SHA-256 followed by the output of ``torch.save``. It is written atomically, and the newest two are kept.
"""

import io
import pickle
import re
from hashlib import sha256
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch

from pter_agents.algorithms import Model
from pter_gym._internal.computer import available_memory
from pter_gym._internal.files import FilePath, find_path, write_bytes_atomic
from pter_gym._internal.reading import read_bytes, reading

KEPT = 2
"""Newest checkpoints that are kept."""

NAME = re.compile(r"checkpoint-(\d+)\.ckpt")


def checkpoints(folder: FilePath) -> list[Path]:
    """Return the checkpoints in a run's folder, the newest last."""
    found = [
        (int(match[1]), path) for path in find_path("folder", folder).iterdir() if (match := NAME.fullmatch(path.name))
    ]
    return [path for _, path in sorted(found)]


def save_checkpoint(model: Model, folder: FilePath) -> Path:
    """Write the checkpoint of a model between two rollouts, and delete all but the newest.

    Raises
    ------
    StorageError
        If it cannot be written; earlier ones are kept.
    """
    content = io.BytesIO()
    torch.save(_as_tensors(model.get_state()), content)
    path = find_path("folder", folder) / f"checkpoint-{model.steps}.ckpt"
    write_bytes_atomic(path, sha256(content.getvalue()).digest() + content.getvalue())
    for old in checkpoints(folder)[:-KEPT]:
        old.unlink(missing_ok=True)
    return path


def read_checkpoint(path: FilePath) -> dict[str, Any]:
    """Return the state of a model in a checkpoint, its arrays as tensors.

    Raises
    ------
    DataError
        If it cannot be read; no code in it is executed.
    """
    path = find_path("path", path)
    with reading(f"checkpoint {path} cannot be read"):
        data = read_bytes(path, available_memory())
        digest, content = data[: sha256().digest_size], data[sha256().digest_size :]
        if sha256(content).digest() != digest:
            raise ValueError("it is damaged")
        try:
            found = torch.load(io.BytesIO(content), weights_only=True)
        except (RuntimeError, pickle.UnpicklingError) as error:
            raise ValueError(str(error)) from None
        if found["steps"] != steps_of(path):
            raise ValueError(f"it is of {found['steps']} control steps")
        return found


def load_checkpoint(model: Model, path: FilePath, *, weights_only: bool = False) -> None:
    """Restore a new model, or only its networks, from a checkpoint.

    Raises
    ------
    DataError
        If it cannot be read, or is from another model.
    """
    state = read_checkpoint(path)
    with reading(f"checkpoint {path} cannot be read"):
        try:
            (model.set_weights if weights_only else model.set_state)(state)
        except RuntimeError as error:  # torch's
            raise ValueError(str(error)) from None


def steps_of(path: FilePath) -> int:
    """Return the control steps before a checkpoint."""
    return int(find_path("path", path).stem.rpartition("-")[2])


def _as_tensors(value: Any) -> Any:
    """Return a state with its arrays as tensors that share their memory."""
    if isinstance(value, dict):
        return {name: _as_tensors(part) for name, part in cast("dict[Any, Any]", value).items()}
    if isinstance(value, (list, tuple)):
        parts = [_as_tensors(part) for part in cast("list[Any]", value)]
        return parts if isinstance(value, list) else tuple(parts)
    return torch.from_numpy(value) if isinstance(value, np.ndarray) else value
