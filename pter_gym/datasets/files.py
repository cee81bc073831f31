"""Data sets as files that Minari reads, with a card. The same command writes the same bytes."""

import hashlib
import json
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any, cast

import gymnasium
import numpy as np

from pter_gym._version import __version__
from pter_gym.benchmark.statistics import bootstrap_interval, mean
from pter_gym.datasets.levels import LEVELS, actors_of, stages
from pter_gym.datasets.recording import Episode, environment_of
from pter_gym.errors import needs_extra
from pter_gym.internal.files import FilePath, find_path, write_files_atomic
from pter_gym.internal.terminal import make_folder

VERSION = 0
"""Version of the data sets; it is in their names."""

DATA, METADATA, CARD = "main_data.hdf5", "metadata.json", "README.md"
"""Files of a data set: Minari's two, in a folder ``data``, and the card beside it."""

ARRAYS = ("observations", "actions", "rewards", "terminations", "truncations")
"""What Minari keeps of an episode."""

LICENCE = "MIT"
AUTHOR = "pter_gym contributors"


def load_minari() -> ModuleType:
    """Return Minari, or raise a DependencyError that says how to install it."""
    try:
        import_module("h5py")  # what Minari stores with
        return import_module("minari")
    except ImportError as error:
        raise needs_extra("recording", "data") from error


def dataset_id(scenario: str, level: str) -> str:
    """Return what Minari knows a data set by."""
    return f"pter/{scenario}/{level}-v{VERSION}"


def default_folder() -> Path:
    """Return the folder in which Minari looks for data sets."""
    load_minari()
    from minari.storage.datasets_root_dir import get_dataset_path

    return get_dataset_path()


def write_dataset(
    scenario: str, level: str, episodes: Sequence[Episode], folder: FilePath, *, seed: int, command: str
) -> Path:
    """Write a data set and return its folder; Minari finds it there once its last file is written.

    Parameters
    ----------
    scenario, level, seed
        As in ``record_episodes``.
    episodes
        What it holds.
    folder
        The folder of all data sets; made if need be.
    command
        The command that makes it, for the card.

    Raises
    ------
    DependencyError
        If Minari is missing.
    StorageError
        If it cannot be written.
    """
    where = find_path("out", folder) / dataset_id(scenario, level)
    make_folder(where / "data")
    data = data_of(episodes)
    metadata = metadata_of(scenario, level, episodes, seed=seed, command=command, size=len(data))
    card = card_of(scenario, level, episodes, seed=seed, command=command, digest=hashlib.sha256(data).hexdigest())
    last = where / "data" / METADATA
    if last.exists() and last.read_bytes() != metadata:
        last.unlink()  # it is of other data
    write_files_atomic(where, {f"data/{DATA}": data, CARD: card.encode(), f"data/{METADATA}": metadata})
    return where


def data_of(episodes: Sequence[Episode]) -> bytes:
    """Return episodes as an HDF5 file in Minari's layout.

    Minari's own way is not taken, since it writes to a disk bit by bit, in chunks that are four times as large where
    episodes are short.
    """
    import h5py

    with h5py.File("memory", "w", driver="core", backing_store=False) as file:
        for number, episode in enumerate(episodes):
            group = file.create_group(f"episode_{number}")
            group.attrs.update({"id": number, "seed": episode.seed, "total_steps": len(episode)})
            for name in ARRAYS:
                group.create_dataset(name, data=getattr(episode, name))
        file.flush()
        return cast(Any, file.id).get_file_image()


def metadata_of(scenario: str, level: str, episodes: Sequence[Episode], *, seed: int, command: str, size: int) -> bytes:
    """Return what Minari is told of a data set, as it writes it; ``size`` is that of the data [B]."""
    minari = load_minari()
    from minari.dataset.minari_storage import MinariStorage

    name, arguments = environment_of(scenario, seed)
    env = gymnasium.make(name, **arguments)
    judged = gymnasium.make(name, **arguments, starts="rest")
    with TemporaryDirectory(prefix="pter-") as trial:
        storage = MinariStorage.new(trial, env.observation_space, env.action_space, env.spec, "hdf5")
        storage.update_metadata(
            {
                "dataset_id": dataset_id(scenario, level),
                "minari_version": minari.__version__,
                "eval_env_spec": judged.spec.to_json(),  # type: ignore[union-attr]
                "algorithm_name": ", ".join(actor.name for actor in actors_of(scenario, level)),
                "author": {AUTHOR},
                "description": f"{LEVELS[level]}; {command}",
                "requirements": [f"pter-gym=={__version__}"],
                "license": LICENCE,
                "total_episodes": len(episodes),
                "total_steps": sum(map(len, episodes)),
                "dataset_size": round(size / 1e6, 1),
            }
        )
        env.close()
        judged.close()
        return (Path(trial) / METADATA).read_bytes()


def summary_of(episodes: Sequence[Episode]) -> dict[str, Any]:
    """Return counts and scores of episodes; a score is a mean with its 95 % interval."""

    def score(values: Sequence[float]) -> tuple[float, float, float]:
        return tuple(bootstrap_interval(np.array(values), mean))  # type: ignore[return-value]

    return {
        "steps": sum(map(len, episodes)),
        "episodes": len(episodes),
        "mean_return": score([float(each.rewards.sum()) for each in episodes]),
        "arrived": score([float(each.arrived) for each in episodes]),
        "distance_m": score([each.distance for each in episodes]),
    }


def card_of(scenario: str, level: str, episodes: Sequence[Episode], *, seed: int, command: str, digest: str) -> str:
    """Return the card of a data set in Markdown; what is in front of it is for machines."""
    name, arguments = environment_of(scenario, seed)
    summary = summary_of(episodes)
    ident = dataset_id(scenario, level)
    front = {
        "license": LICENCE.lower(),
        "pretty_name": ident,
        "tags": ["minari", "reinforcement-learning", "offline-rl", "robotics", "pter-gym"],
        "task_categories": ["reinforcement-learning", "robotics"],
        "pter": {"summary": summary, "sha256": digest},
    }
    given = ", ".join(f"{key}={value!r}" for key, value in arguments.items())
    returns, arrived, distance = summary["mean_return"], summary["arrived"], summary["distance_m"]
    return "\n".join(
        [
            "---",
            *(f"{key}: {json.dumps(value)}" for key, value in front.items()),
            "---",
            "",
            f"# {ident}",
            "",
            f"{summary['steps']} control steps in {summary['episodes']} episodes: {LEVELS[level]}.",
            "",
            f"- Environment: `gymnasium.make({name!r}, {given})`",
            f"- Who acts: {_told(scenario, level)}",
            f"- Command: `{command}`, with pter-gym {__version__}",
            f"- Mean return: {_interval(returns, 1.0, 1)}",
            f"- Episodes that arrive: {_interval(arrived, 100.0, 1)} %",
            f"- Mean distance from the path: {_interval(distance, 1000.0, 2)} mm",
            f"- SHA-256 of `data/{DATA}`: `{digest}`",
            f"- Licence: {LICENCE}, as that of pter-gym",
            "",
            "Episodes are of training draws. Each begins with a reset by its stored seed; all levels of a scenario",
            "have the same machines, paths, hands and starts. Observations and actions are float32 as the environment",
            "gives and takes them, rewards float64. In brackets intervals of 95 %.",
            "",
        ]
    )


def _told(scenario: str, level: str) -> str:
    names = ", ".join(f"`{actor.name}`" for actor in actors_of(scenario, level))
    trained = level in ("medium", "replay")
    return f"{names}, stages of `{stages()['command']}`" if trained else names


def _interval(score: tuple[float, float, float], factor: float, digits: int) -> str:
    value, low, high = (f"{factor * each:.{digits}f}" for each in score)
    return f"{value} ({low} … {high})"
