"""Recorded episodes as a data set in Minari's format."""

import shutil
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium

from pter_gym._internal.files import FilePath, find_path
from pter_gym._version import __version__
from pter_gym.benchmark.intervals import mean_interval, rate_interval
from pter_gym.errors import StorageError, needs_extra
from pter_gym.tools.datasets.levels import LEVELS, actors_of
from pter_gym.tools.datasets.recording import Episode, environment_of

VERSION = 0
"""Version of the data sets, part of their names."""


def load_minari() -> Any:
    """Return Minari, or raise a DependencyError that says how to install it."""
    try:
        import_module("h5py")  # what Minari stores with
        return import_module("minari")
    except ImportError as error:
        raise needs_extra("recording", "data") from error


def dataset_id(scenario: str, level: str) -> str:
    """Return the name under which Minari finds a data set."""
    return f"pter/{scenario}/{level}-v{VERSION}"


def write_dataset(
    scenario: str, level: str, episodes: Sequence[Episode], folder: FilePath | None, *, seed: int, command: str
) -> Path:
    """Write a data set, replacing an earlier one of the same name, and return its folder.

    Parameters
    ----------
    scenario, level, seed
        As in ``record_episodes``.
    episodes
        The episodes.
    folder
        Folder of all data sets, created if necessary; None for the one where Minari looks for them.
    command
        The command that makes the data set, for its description.

    Raises
    ------
    DependencyError
        If Minari is missing.
    StorageError
        If the data set cannot be written; an earlier one is left unchanged.
    """
    minari = load_minari()
    from minari.dataset.minari_storage import MinariStorage
    from minari.storage.datasets_root_dir import get_dataset_path

    ident = dataset_id(scenario, level)
    target = (get_dataset_path() if folder is None else find_path("out", folder)) / ident
    name, arguments = environment_of(scenario, seed)
    env, judged = gymnasium.make(name, **arguments), gymnasium.make(name, **arguments, starts="rest")
    metadata = {
        "dataset_id": ident,
        "minari_version": minari.__version__,
        "eval_env_spec": judged.spec.to_json(),  # type: ignore[union-attr]
        "algorithm_name": ", ".join(actor.name for actor in actors_of(scenario, level)),
        "author": {"pter_gym contributors"},
        "description": f"{LEVELS[level]}; {command}",
        "requirements": [f"pter-gym=={__version__}"],
        "license": "MIT",
        "summary": summary_of(episodes),
    }
    work = target.with_name(f".{target.name}").absolute()  # Minari loses its files where a path is relative
    try:
        shutil.rmtree(work, ignore_errors=True)  # of a process that was killed
        (work / "new").mkdir(parents=True)
        storage = MinariStorage.new(work / "new" / "data", env.observation_space, env.action_space, env.spec)
        storage.update_metadata(metadata)
        fields = Episode._fields[:-2]  # Minari's, without what only the summary needs
        buffers = (dict(zip(fields, episode, strict=False)) for episode in episodes)
        storage.update_episodes(minari.data_collector.EpisodeBuffer(**each) for each in buffers)
        if target.exists():
            target.rename(work / "old")
        (work / "new").rename(target)
    except OSError as error:
        raise StorageError(f"data set {str(target)!r} cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)
        env.close()
        judged.close()
    return target


def summary_of(episodes: Sequence[Episode]) -> dict[str, Any]:
    """Return counts and scores of episodes; a score is a mean and the ends of its 95 % interval."""
    scores = {
        "mean_return": [float(episode.rewards.sum()) for episode in episodes],
        "arrived": [float(episode.arrived) for episode in episodes],
        "distance_m": [episode.distance for episode in episodes],
    }
    return {
        "steps": sum(len(episode.rewards) for episode in episodes),
        "episodes": len(episodes),
        **{name: list((rate_interval if name == "arrived" else mean_interval)(scores[name])) for name in scores},
    }
