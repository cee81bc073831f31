"""Episodes as tables: what a file holds is what was recorded, with names and units."""

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pter_gym.benchmark.simulation import record_episode
from pter_gym.benchmark.trajectories import POLICY, check_table, headings, write_trajectories
from pter_gym.controllers import Free, Random
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing

STEPS = 12

tables = arrays.arrays(
    np.float64,
    st.tuples(st.integers(1, 4), st.just(len(TELEMETRY))),
    elements=st.floats(allow_nan=False, allow_infinity=False),
)


def episodes(seed: int = 3) -> dict[str, np.ndarray]:
    policies = {"free": Free(), "a, b": Random(seed=seed)}
    return {
        name: record_episode(policy, BASELINE, PathFollowing(), seed, STEPS).telemetry
        for name, policy in policies.items()
    }


def read_csv(path: Path) -> tuple[list[str], list[str], np.ndarray]:
    """Headings, policies and numbers of a file."""
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    return head, [row[0] for row in rows], np.array([[float(x) for x in row[1:]] for row in rows])


def test_headings_are_the_declared_names_and_units():
    head = headings()
    assert head[:4] == ["policy", "time [s]", "theta_a [rad]", "theta_b [rad]"]
    assert {"normal_error [m]", "torque_4 [N·m]", "mode", "is_success"} <= set(head)
    assert len(head) == len(set(head)) == len(TELEMETRY) + 1
    assert not {POLICY, "names", "units"} & set(TELEMETRY.names)


def test_an_episode_comes_back_from_both_kinds_of_file(tmp_path: Path):
    found = episodes()
    whole = np.concatenate(list(found.values()))
    for name in ("x.csv", "x.npz"):
        write_trajectories(found, tmp_path / name)
    head, policies, numbers = read_csv(tmp_path / "x.csv")
    assert head == headings()
    assert policies == ["free"] * (STEPS + 1) + ["a, b"] * (STEPS + 1)
    np.testing.assert_array_equal(numbers, whole)
    assert numbers[0, 0] == numbers[STEPS + 1, 0] == 0.0
    with np.load(tmp_path / "x.npz", allow_pickle=False) as archive:
        assert archive["policy"].tolist() == policies
        assert dict(zip(archive["names"].tolist(), archive["units"].tolist(), strict=True)) == {
            field.name: field.unit for field in TELEMETRY.fields
        }
        for k, column in enumerate(TELEMETRY.names):
            np.testing.assert_array_equal(archive[column], whole[:, k])


@pytest.mark.parametrize("ending", [".csv", ".npz", ".CSV"])
def test_the_same_seed_gives_the_same_file(tmp_path: Path, ending: str):
    for name, seed in (("one", 3), ("two", 3), ("other", 4)):
        write_trajectories(episodes(seed), tmp_path / f"{name}{ending}")
    one, two, other = ((tmp_path / f"{name}{ending}").read_bytes() for name in ("one", "two", "other"))
    assert one == two != other


@settings(max_examples=30, deadline=None)
@given(tables)
def test_any_number_keeps_its_bits(tmp_path_factory: pytest.TempPathFactory, telemetry: np.ndarray):
    path = tmp_path_factory.mktemp("table") / "x.csv"
    write_trajectories({"mine": telemetry}, path)
    assert read_csv(path)[2].tobytes() == telemetry.tobytes()


def test_pandas_reads_both(tmp_path: Path):
    pandas = pytest.importorskip("pandas")
    write_trajectories(episodes(), tmp_path / "x.csv")
    table = pandas.read_csv(tmp_path / "x.csv")
    assert list(table.columns) == headings()
    assert table.groupby("policy")["time [s]"].min().tolist() == [0.0, 0.0]


@pytest.mark.parametrize("name", ["x.txt", "x", "x.npy"])
def test_another_ending_is_refused_before_anything_is_written(tmp_path: Path, name: str):
    with pytest.raises(ParameterError, match=r"csv's ending must be among \.csv, \.npz"):
        check_table(tmp_path / name)
    with pytest.raises(ParameterError, match="csv's ending"):
        write_trajectories({"free": np.zeros((1, len(TELEMETRY)))}, tmp_path / name)
    assert not list(tmp_path.iterdir())
