"""Data sets as Minari reads them: complete, the same bytes each time, and never half."""

import hashlib
import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from documents import DATA, blocks_of, run_program
from pter_gym._commands.main import main
from pter_gym.errors import StorageError
from pter_gym.tools.datasets.recording import (
    REFERENCE_EPISODES,
    RecordedEpisode,
    record_transitions,
)
from pter_gym.tools.datasets.writing import write_dataset

minari = pytest.importorskip("minari")
pytest.importorskip("h5py")

NAME = "pter/standard/random-v0"
COMMAND = [
    "record",
    "--scenario",
    "standard",
    "--level",
    "random",
    "--steps",
    "400",
    "--seed",
    "2",
    "--out",
]


def digests(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data")
    assert main([*COMMAND, str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def episodes() -> list[RecordedEpisode]:
    """What the command records."""
    return record_transitions("standard", "random", 400, seed=2)


@pytest.fixture
def dataset(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    return minari.load_dataset(NAME)


def test_minari_reads_what_was_recorded(dataset: Any, episodes: list[RecordedEpisode]) -> None:
    assert list(minari.list_local_datasets()) == [NAME]
    assert dataset.total_episodes == len(episodes)
    assert dataset.total_steps == sum(len(each.rewards) for each in episodes)
    metadata = dataset.storage.metadata
    scores = minari.get_normalized_score(
        dataset, np.array([metadata["ref_min_score"], metadata["ref_max_score"]])
    )
    assert scores.tolist() == [0.0, 1.0]
    assert metadata["num_episodes_average_score"] == REFERENCE_EPISODES
    summary = dataset.storage.metadata["summary"]
    assert summary["arrived"][0] == pytest.approx(np.mean([each.arrived for each in episodes]))
    assert dataset.storage.metadata["description"].endswith(
        "pter record --scenario standard --level random --steps 400 --seed 2"
    )
    for read, made in zip(dataset.iterate_episodes(), episodes, strict=True):
        for name in ("observations", "actions", "rewards", "terminations", "truncations"):
            found, expected = getattr(read, name), getattr(made, name)
            assert found.dtype == expected.dtype
            assert found.tobytes() == expected.tobytes()


def test_the_environment_comes_back_and_pays_the_same_bit_for_bit(dataset: Any) -> None:
    env = dataset.recover_environment()
    assert env.action_space == dataset.action_space
    assert env.observation_space == dataset.observation_space
    for number, seed in enumerate(
        each["seed"] for each in dataset.storage.get_episode_metadata(range(3))
    ):
        episode = dataset[number]
        obs, _ = env.reset(seed=seed)
        assert obs.tobytes() == episode.observations[0].tobytes()
        assert [env.step(action)[1] for action in episode.actions] == episode.rewards.tolist()
    judged = dataset.recover_environment(eval_env=True)
    assert judged.spec.kwargs["starts"] == "rest"


def test_the_same_command_writes_the_same_bytes_over_what_is_there(
    folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    (data,) = tmp_path.rglob("*.hdf5")
    data.write_bytes(b"earlier")
    assert main([*COMMAND, str(tmp_path)]) == 0
    assert digests(tmp_path) == digests(folder)


def test_data_sets_go_to_minaris_folder_by_default(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    assert main(["record", "--scenario", "standard", "--level", "random", "--steps", "1"]) == 0
    assert minari.load_dataset("pter/standard/random-v0").total_episodes == 1


def test_the_page_loads_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    assert main(["record", "--scenario", "standard", "--level", "expert", "--steps", "1"]) == 0
    blocks = blocks_of(DATA)
    if find_spec("d3rlpy") is None:
        blocks = [block for block in blocks if "d3rlpy" not in block]
    run_program(blocks, str(DATA))


def test_a_full_disk_keeps_the_earlier_data(
    folder: Path, episodes: list[RecordedEpisode], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    # of a process that was killed
    (tmp_path / "pter" / "standard" / ".random-v0" / "new").mkdir(parents=True)

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("minari.dataset.minari_storage.MinariStorage.update_metadata", fail)
    with pytest.raises(StorageError):
        write_dataset("standard", "random", episodes[:1], tmp_path, seed=2, command="")
    assert digests(tmp_path) == digests(folder)
    assert not (tmp_path / "pter" / "standard" / ".random-v0").exists()
