"""Recorded episodes as a data set in Minari's format."""

import shutil
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium

from pter_gym._internal.files import FilePath, expand_path, make_folder
from pter_gym._internal.locks import lock_beside, locked
from pter_gym._version import __version__
from pter_gym.benchmark.intervals import mean_interval
from pter_gym.errors import StorageError, needs_extra
from pter_gym.tools.datasets.recording import (
    LEVELS,
    REFERENCE_EPISODES,
    RecordedEpisode,
    environment_of,
    name_of_actor,
    reference_score,
)

__all__ = ["write_dataset"]


def load_minari() -> Any:
    """Return Minari, or raise a DependencyError that says how to install it."""
    try:
        import_module("h5py")  # what Minari stores with
        return import_module("minari")
    except ImportError as error:
        raise needs_extra("recording", "data") from error


def write_dataset(
    scenario: str,
    level: str,
    episodes: Sequence[RecordedEpisode],
    folder: FilePath | None,
    *,
    seed: int,
    command: str,
) -> Path:
    """Write the data set ``pter/SCENARIO/LEVEL-v0`` in place of an earlier one; return its folder.

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

    ident = f"pter/{scenario}/{level}-v0"
    target = (get_dataset_path() if folder is None else expand_path("out", folder)) / ident
    name, arguments = environment_of(scenario, seed)
    env = gymnasium.make(name, **arguments)
    judged = gymnasium.make(name, **arguments, starts="rest")
    metadata = {
        "dataset_id": ident,
        "minari_version": minari.__version__,
        "eval_env_spec": judged.spec.to_json(),  # type: ignore[union-attr]
        "algorithm_name": name_of_actor(scenario, level),
        "author": {"pter_gym contributors"},
        "description": f"{LEVELS[level]}; {command}",
        "requirements": [f"pter-gym=={__version__}"],
        "license": "MIT",
        "ref_min_score": reference_score(scenario, "random", seed),
        "ref_max_score": reference_score(scenario, "expert", seed),
        "num_episodes_average_score": REFERENCE_EPISODES,
        "summary": {
            "steps": sum(len(episode.rewards) for episode in episodes),
            "episodes": len(episodes),
            # means, and the ends of their 95 % intervals
            "mean_return": list(mean_interval([float(each.rewards.sum()) for each in episodes])),
            "arrived": list(mean_interval([float(each.arrived) for each in episodes])),
            "distance_m": list(mean_interval([each.distance for each in episodes])),
        },
    }
    target = target.absolute()  # Minari loses its files where a path is relative
    fields = RecordedEpisode._fields[:-2]  # Minari's, without what only the summary needs
    make_folder(target.parent)
    with locked(lock_beside(target)), replacing(target) as new:
        storage = MinariStorage.new(new / "data", env.observation_space, env.action_space, env.spec)
        storage.update_metadata(metadata)
        buffers = (dict(zip(fields, episode, strict=False)) for episode in episodes)
        storage.update_episodes(minari.data_collector.EpisodeBuffer(**each) for each in buffers)
    return target


@contextmanager
def replacing(folder: Path) -> Generator[Path]:
    """Lend a new folder that takes a folder's place when it is whole; one process at a time.

    Raises a StorageError if it cannot be written; the old one is left unchanged. If the process is
    killed while they change places, the old one is there again at the next call.
    """
    work = folder.with_name(f".{folder.name}")
    old, new = work / "old", work / "new"

    def tidy() -> None:
        if old.exists() and not folder.exists():
            old.rename(folder)
        shutil.rmtree(work, ignore_errors=True)

    try:
        tidy()  # after a process that was killed
        new.mkdir(parents=True)
        yield new
        if folder.exists():
            folder.rename(old)
        new.rename(folder)
    except OSError as error:
        raise StorageError(
            f"data set {str(folder)!r} cannot be written: {error.strerror or error}"
        ) from error
    finally:
        tidy()
