"""Episodes as tables: what a file holds is what was recorded, with names and units."""

import csv
from pathlib import Path

import numpy as np
import pytest

from pter_gym.benchmark.simulation import record_episode
from pter_gym.benchmark.trajectories import check_table, write_trajectories
from pter_gym.controllers import Free, Random
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

STEPS = 12


def episodes(seed: int = 3) -> dict[str, np.ndarray]:
    """Recorded ones, and one of numbers of any size."""
    bits = np.random.default_rng(seed).integers(2**64, size=(3, len(TELEMETRY)), dtype=np.uint64)
    return {"a, b": np.nan_to_num(bits.view(np.float64))} | {
        name: record_episode(policy, BASELINE, PathFollowing(), seed, STEPS).telemetry
        for name, policy in {"free": Free(), "random": Random(seed=seed)}.items()
    }


def test_an_episode_comes_back_from_both_kinds_of_file_bit_for_bit(tmp_path: Path) -> None:
    found = episodes()
    whole = np.concatenate(list(found.values()))
    names = [name for name, rows in found.items() for _ in rows]
    for name in ("x.csv", "x.npz"):
        write_trajectories(found, tmp_path / name)
    with (tmp_path / "x.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert head[:3] == ["policy", "time [s]", "theta_a [rad]"]
    assert {"normal_error [m]", "torque_4 [N·m]", "mode", "is_success"} <= set(head)
    assert len(set(head)) == len(head) == len(TELEMETRY) + 1
    assert [row[0] for row in rows] == names
    assert np.array([[float(x) for x in row[1:]] for row in rows]).tobytes() == whole.tobytes()
    with np.load(tmp_path / "x.npz", allow_pickle=False) as archive:
        assert archive["policy"].tolist() == names
        assert dict(zip(archive["names"].tolist(), archive["units"].tolist(), strict=True)) == {
            field.name: field.unit for field in TELEMETRY.fields
        }
        for k, column in enumerate(TELEMETRY.names):
            np.testing.assert_array_equal(archive[column], whole[:, k])


@pytest.mark.parametrize("ending", [".csv", ".npz", ".CSV"])
def test_the_same_seed_gives_the_same_file(tmp_path: Path, ending: str) -> None:
    for name, seed in (("one", 3), ("two", 3), ("other", 4)):
        write_trajectories(episodes(seed), tmp_path / f"{name}{ending}")
    one, two, other = ((tmp_path / f"{name}{ending}").read_bytes() for name in ("one", "two", "other"))
    assert one == two != other


def test_another_ending_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    for call in (check_table, lambda path: write_trajectories({"free": np.zeros((1, len(TELEMETRY)))}, path)):
        with pytest.raises(ParameterError, match=r"csv's ending must be among \.csv, \.npz"):
            call(tmp_path / "x.txt")
    assert not list(tmp_path.iterdir())
