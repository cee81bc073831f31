"""Episodes as tables: what a file holds is what was recorded, with names and units."""

import csv
from pathlib import Path

import numpy as np
import pytest

from pter_gym.benchmark._trajectories import check_table, write_trajectories
from pter_gym.benchmark.simulation import record_episode
from pter_gym.controllers import Random
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing


def test_an_episode_comes_back_from_both_kinds_of_file_bit_for_bit(tmp_path: Path) -> None:
    bits = np.random.default_rng(3).integers(2**64, size=(3, len(TELEMETRY)), dtype=np.uint64)
    recorded = record_episode(Random(seed=3), BASELINE, PathFollowing(), 3, 12).telemetry
    found = {"any numbers, of any size": np.nan_to_num(bits.view(np.float64)), "random": recorded}
    whole = np.concatenate(list(found.values()))
    names = [name for name, rows in found.items() for _ in rows]
    for name in ("x.csv", "y.CSV", "x.npz", "y.npz"):
        write_trajectories(found, tmp_path / name)
    for one, other in (("x.csv", "y.CSV"), ("x.npz", "y.npz")):
        assert (tmp_path / one).read_bytes() == (tmp_path / other).read_bytes()
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


def test_another_ending_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    for call in (check_table, lambda path: write_trajectories({"free": np.zeros((1, len(TELEMETRY)))}, path)):
        with pytest.raises(ParameterError, match=r"csv must end in \.csv, \.npz"):
            call(tmp_path / "x.txt")
    assert not list(tmp_path.iterdir())
