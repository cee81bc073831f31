"""Checkpoints of a run: all that a training's future depends on, as arrays without code.

They are written whole or not at all, and the newest two are kept.
"""

import io
import re
from pathlib import Path

import numpy as np

from pter_agents.algorithms import Model, State
from pter_gym.internal.archives import read_arrays
from pter_gym.internal.computer import available_memory
from pter_gym.internal.files import FilePath, find_path, write_bytes_atomic
from pter_gym.internal.reading import read_bytes, reading

KEPT = 2
"""Newest checkpoints that are kept."""

WEIGHT = "weight_"
"""Begins the names of what the networks have learnt."""

NAME = re.compile(r"checkpoint-(\d+)\.npz")


def checkpoints(folder: FilePath) -> list[Path]:
    """Return the checkpoints in a run's folder, the newest last."""
    found = [
        (int(match[1]), path) for path in find_path("folder", folder).iterdir() if (match := NAME.fullmatch(path.name))
    ]
    return [path for _, path in sorted(found)]


def save_checkpoint(model: Model, folder: FilePath) -> Path:
    """Write the checkpoint of a model between two rollouts, and let all but the newest go.

    Raises
    ------
    StorageError
        If it cannot be written; the earlier ones stay.
    """
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
    with reading(f"checkpoint {path} cannot be read"):
        data = read_bytes(path, available_memory())
        state = read_arrays(data, len(data))  # as numpy.savez stores them, so they are no larger than the file
        own = model.get_state()
        _check(state, {name: own[name] for name in own if not weights_only or name.startswith(WEIGHT)}, path)
        try:
            (model.set_weights if weights_only else model.set_state)(state)
        except RuntimeError as error:  # torch's
            raise ValueError(str(error)) from None
        if not weights_only and (other := state.keys() ^ model.get_state().keys()):
            raise ValueError(f"it differs from what this model keeps in {', '.join(sorted(other)):.200}")


def _check(state: State, own: State, path: Path) -> None:
    """Raise a ValueError unless a state has all that a new model has, in the same shapes and types, and its own steps.

    Of what a new model has no rows of yet, it may have any number; a text may have any length.
    """
    for name, mine in own.items():
        found = state[name]
        same = found.dtype == mine.dtype or found.dtype.kind == mine.dtype.kind == "U"
        rows = mine.ndim > 0 and len(mine) == 0
        if not same or found.ndim != mine.ndim or found.shape[rows:] != mine.shape[rows:]:
            raise ValueError(f"{name} must be {mine.dtype} {mine.shape}, it is {found.dtype} {found.shape}")
    if path.name != f"checkpoint-{state['steps']}.npz":
        raise ValueError(f"it is of {state['steps']} control steps")
