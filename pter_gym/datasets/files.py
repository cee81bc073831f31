"""Data sets as files: Minari writes them, a card says what they are. The same command writes the same bytes."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

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

LICENCE = "MIT"
AUTHOR = "pter_gym contributors"


def load_minari() -> ModuleType:
    """Return Minari, or raise a DependencyError that says how to install it."""
    try:
        import h5py  # noqa: F401  (what Minari stores with)
        import minari
    except ImportError as error:
        raise needs_extra("recording", "data") from error
    return minari


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
        If it cannot be written; it says where its files are.
    """
    name = dataset_id(scenario, level)
    where = find_path("out", folder) / name
    make_folder(where / "data")
    with TemporaryDirectory(prefix="pter-") as trial:
        place = Path(trial)
        _store(place, scenario, level, episodes, seed, command)
        data, metadata = (place / DATA).read_bytes(), (place / METADATA).read_bytes()
    card = card_of(scenario, level, episodes, seed=seed, command=command, digest=hashlib.sha256(data).hexdigest())
    last = where / "data" / METADATA
    if last.exists() and last.read_bytes() != metadata:
        last.unlink()  # it is of other data
    write_files_atomic(where, {f"data/{DATA}": data, CARD: card.encode(), f"data/{METADATA}": metadata})
    return where


def _store(
    folder: Path, scenario: str, level: str, episodes: Sequence[Episode], seed: int, command: str
) -> None:
    """Let Minari write episodes to an empty folder."""
    minari = load_minari()
    from minari.data_collector.episode_buffer import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    name, arguments = environment_of(scenario, seed)
    env = gymnasium.make(name, **arguments)
    judged = gymnasium.make(name, **arguments, starts="rest")
    storage = MinariStorage.new(folder, env.observation_space, env.action_space, env.spec, "hdf5")
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
        }
    )
    storage.update_episodes(
        EpisodeBuffer(
            seed=each.seed,
            observations=each.observations,  # type: ignore[arg-type]
            actions=each.actions,  # type: ignore[arg-type]
            rewards=each.rewards,  # type: ignore[arg-type]
            terminations=each.terminations,  # type: ignore[arg-type]
            truncations=each.truncations,  # type: ignore[arg-type]
        )
        for each in episodes
    )
    env.close()
    judged.close()


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


def card_of(
    scenario: str, level: str, episodes: Sequence[Episode], *, seed: int, command: str, digest: str
) -> str:
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
            f"{summary['steps']} control steps in {summary['episodes']} episodes of "
            f"`gymnasium.make({name!r}, {given})`: {LEVELS[level]}.",
            "",
            f"- Who acts: {_told(scenario, level)}",
            f"- Command: `{command}`, with pter-gym {__version__}",
            f"- Mean return: {_interval(returns, 1.0, 1)}",
            f"- Episodes that arrive: {_interval(arrived, 100.0, 1)} %",
            f"- Mean distance from the path: {_interval(distance, 1000.0, 2)} mm",
            f"- SHA-256 of `data/{DATA}`: `{digest}`",
            f"- Licence: {LICENCE}, as that of pter-gym",
            "",
            "Episodes are of training draws. Episode k begins with a reset by its stored seed; all levels of a scenario "
            "have the same machines, paths, hands and starts. Observations and actions are float32 as the environment "
            "gives and takes them, rewards float64. Intervals are of 95 %.",
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
