"""Checkpoints of a run: all that a training's future depends on, as arrays without code.

They are written whole or not at all, and the newest two are kept.
"""

import io
import re
import zipfile
from pathlib import Path

import numpy as np

from pter_agents.algorithms import Model, State
from pter_gym.errors import DataError
from pter_gym.internal.files import FilePath, find_path, write_bytes_atomic

KEPT = 2
"""Newest checkpoints that are kept."""

NAME = re.compile(r"checkpoint-(\d+)\.npz")


def checkpoints(folder: FilePath) -> list[Path]:
    """Return the checkpoints in a run's folder, the newest last."""
    found = [
        (int(match[1]), path) for path in find_path("folder", folder).iterdir() if (match := NAME.fullmatch(path.name))
    ]
    return [path for _, path in sorted(found)]


def save_checkpoint(model: Model, folder: FilePath) -> Path:
    """Write the checkpoint of a model between two rollouts, and let all but the newest go."""
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **model.get_state())  # type: ignore[arg-type]
    path = find_path("folder", folder) / f"checkpoint-{model.steps}.npz"
    write_bytes_atomic(path, content.getvalue())
    for old in checkpoints(folder)[:-KEPT]:
        old.unlink(missing_ok=True)
    return path


def load_checkpoint(model: Model, path: FilePath, *, weights_only: bool = False) -> None:
    """Bring a new model to where a checkpoint was written, or its networks alone.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    path = find_path("path", path)
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
            state: State = dict(archive)
        (model.set_weights if weights_only else model.set_state)(state)
    except (OSError, ValueError, KeyError, RuntimeError, EOFError, zipfile.BadZipFile) as error:
        raise DataError(f"checkpoint {path} cannot be read: {error}") from None
