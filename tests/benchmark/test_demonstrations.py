"""Recorded episodes: complete, checked when they are read, and from training draws."""

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pter_gym.benchmark import find_policy
from pter_gym.benchmark.demonstrations import Demonstrations, read_demonstrations, record, write_demonstrations
from pter_gym.benchmark.metrics import SCORES
from pter_gym.commands import main as cli
from pter_gym.engine.batch import Batch
from pter_gym.errors import DataError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.scenarios import find_scenario

SHIPPED = Path(__file__).parents[2] / "agents" / "pter_agents" / "demonstrations"


@pytest.fixture(scope="module")
def found() -> Demonstrations:
    return record(["impedance-tuned", "free"], ["standard", "everything"], ["brisk"], episodes=2, seed=3)


def test_episodes_are_complete(found: Demonstrations) -> None:
    assert len(found) == 8
    assert found.policies == ("impedance-tuned", "impedance-tuned", "free", "free") * 2
    assert found.scenarios == ("standard",) * 4 + ("everything",) * 4
    assert found.draws.tolist() == [0, 1] * 4
    assert set(found.scores) == set(SCORES)
    lengths = found.ends - found.starts
    np.testing.assert_allclose(lengths, 100.0 * found.scores["duration_s"])
    assert found.info["command"] == (
        "pter record --policies impedance-tuned,free --scenarios standard,everything --paces brisk "
        "--episodes 2 --seed 3"
    )


def test_the_volts_are_what_the_policy_answers_to_the_observation(found: Demonstrations) -> None:
    rows = slice(found.starts[5], found.ends[5])
    _, (machine, task) = find_scenario("everything").randomisation("brisk", contexts=2, seed=3).pairs()
    layout = Batch(machine, task, 1).layout
    policy = find_policy("impedance-tuned", scenario="everything").bind(BASELINE, layout)  # type: ignore[union-attr]
    for obs, volts in zip(found.obs[rows], found.volts[rows], strict=True):
        np.testing.assert_array_equal(policy(obs[None, : len(layout)])[0], volts)


def test_a_file_brings_all_of_it_back(found: Demonstrations, tmp_path: Path) -> None:
    path = tmp_path / "some.npz"
    write_demonstrations(found, path)
    again = read_demonstrations(path)
    for name in ("obs", "volts", "starts", "ends", "draws"):
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
    assert (again.policies, again.scenarios, again.paces) == (found.policies, found.scenarios, found.paces)
    assert again.info == found.info
    assert all(again.scores[name].tolist() == found.scores[name].tolist() for name in SCORES)
    first = path.read_bytes()
    write_demonstrations(found, path)
    assert path.read_bytes() == first


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"obs": np.zeros((3, 24))}, "obs must be finite numbers of float32"),
        ({"starts": np.zeros(8, np.int64)}, "episodes must follow each other"),
        ({"draws": np.zeros(3, np.int64)}, "draws must be int64"),
        ({"policies": ("free",)}, "8 names of each kind"),
        ({"info": {}}, "info must name the entries"),
    ],
)
def test_wrong_contents_are_refused(
    change: dict[str, object], message: str, found: Demonstrations, tmp_path: Path
) -> None:
    write_demonstrations(replace(found, **change), tmp_path / "wrong.npz")  # type: ignore[arg-type]
    with pytest.raises(DataError, match=message):
        read_demonstrations(tmp_path / "wrong.npz")


def test_not_a_number_is_refused(found: Demonstrations, tmp_path: Path) -> None:
    volts = found.volts.copy()
    volts[5, 2] = np.nan
    write_demonstrations(replace(found, volts=volts), tmp_path / "wrong.npz")
    with pytest.raises(DataError, match="volts must be finite"):
        read_demonstrations(tmp_path / "wrong.npz")


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="are refused"):
        read_demonstrations(tmp_path / "missing.npz")
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(DataError, match="are refused"):
        read_demonstrations(tmp_path / "text.npz")
    with zipfile.ZipFile(tmp_path / "other.npz", "w") as archive:
        archive.writestr("obs.npy", b"")
    with pytest.raises(DataError, match="it must hold draws, "):
        read_demonstrations(tmp_path / "other.npz")


def test_a_large_content_is_refused_before_it_is_unpacked(
    found: Demonstrations, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_demonstrations(found, tmp_path / "large.npz")
    monkeypatch.setattr("pter_gym.benchmark.demonstrations.MOST_UNPACKED", 1000)
    monkeypatch.setattr(np, "load", lambda *_, **__: pytest.fail("it was unpacked"))
    with pytest.raises(DataError, match="its content must have at most 1000 B"):
        read_demonstrations(tmp_path / "large.npz")


def test_bad_arguments_are_named() -> None:
    with pytest.raises(ParameterError, match="policies must hold at least one name"):
        record([], ["standard"], ["brisk"], episodes=1)
    with pytest.raises(ParameterError, match="episodes must be"):
        record(["free"], ["standard"], ["brisk"], episodes=0)
    with pytest.raises(ParameterError, match="seed must be"):
        record(["free"], ["standard"], ["brisk"], episodes=1, seed=-1)
    with pytest.raises(ParameterError, match="did you mean 'standard'"):
        record(["free"], ["standart"], ["brisk"], episodes=1)


def test_the_command_writes_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "few.npz"
    arguments = ["--policies", "free", "--scenarios", "standard", "--paces", "brisk", "--episodes", "1"]
    assert cli.main(["record", *arguments, "--out", str(out)]) == 0
    assert "1 episodes" in capsys.readouterr().out
    assert read_demonstrations(out).policies == ("free",)
    assert cli.main(["record", *arguments, "--out", str(tmp_path / "none" / "few.npz")]) == 2
    assert "out must be a file in a folder that exists" in capsys.readouterr().err


def test_what_ships_is_whole_and_small() -> None:
    paths = list(SHIPPED.glob("*.npz"))
    assert paths
    assert sum(path.stat().st_size for path in paths) <= 3_000_000
    for path in paths:
        found = read_demonstrations(path)
        assert {"predictive", "single-dof-tuned"} <= set(found.policies)
        assert set(found.scenarios) == {"standard", "everything"}
        assert set(found.paces) == {"slow", "medium", "brisk"}
