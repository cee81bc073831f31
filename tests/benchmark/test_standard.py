"""The standard test, its file and its command."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from standard_table import NAME, PAGE, standard_table

from pter_gym.benchmark import Result, find_policy, run_standard_test
from pter_gym.commands import main as cli
from pter_gym.controllers import CONTROLLERS
from pter_gym.errors import ParameterError

FIELDS = {
    "time_constant_s",
    "path_error_m",
    "mean_error_m",
    "mean_speed_m_s",
    "mean_acceleration_m_s2",
    "peak_acceleration_m_s2",
    "path_length_m",
    "completed",
    "duration_s",
    "dissipated_j",
}


@pytest.fixture(scope="module")
def result() -> Result:
    """All built-in controllers at three time constants."""
    return run_standard_test(
        {name: find_policy(name, scenario=None) for name in CONTROLLERS}, time_constants=(0.01, 0.105, 0.2)
    )


def test_file(result: Result) -> None:
    content = json.loads(json.dumps(result.as_json(), allow_nan=False))
    assert set(content) == {"scenario", "seed", "version", "config_hash", "policies"}
    assert content["scenario"] == "standard"
    assert list(content["policies"]) == list(CONTROLLERS)
    for runs in content["policies"].values():
        assert [run["time_constant_s"] for run in runs] == [0.01, 0.105, 0.2]
        for run in runs:
            assert set(run) >= FIELDS
            assert isinstance(run["completed"], bool)


def test_controllers_arrive_and_feedback_helps(result: Result) -> None:
    impedance, feedback = (result.runs[name] for name in ("impedance", "torque-feedback"))
    assert all(run.score.completed for run in (*impedance, *feedback))
    assert feedback[1].score.path_error_m < impedance[1].score.path_error_m


def test_locked_never_arrives_and_free_feels_no_clutch(result: Result) -> None:
    from pter_gym.tasks.path_following import COLUMN

    assert not any(run.score.completed for run in result.runs["locked"])
    free = result.runs["free"]
    assert all(run.score.dissipated_j == 0.0 for run in free)
    moves = [run.telemetry[:, : COLUMN.told.time_constant] for run in free]  # what is told of the clutches differs
    assert moves[0].tobytes() == moves[2].tobytes()


def test_integrator_error_on_the_standard_test(result: Result) -> None:
    """|N − R| ≤ 0.2% of the hand's work (DESIGN section 1), at the manufacturer's time constant."""
    for name in ("impedance", "torque-feedback"):
        run = result.runs[name][1]
        energy = {
            term: run.telemetry[:, result_index(term)].sum()
            for term in ("hand_work", "dissipated", "numerical_loss", "residual")
        }
        assert abs(energy["numerical_loss"] - energy["residual"]) <= 0.002 * energy["hand_work"]
        balance = energy["hand_work"] - energy["dissipated"] - energy["numerical_loss"] + energy["residual"]
        change = run.telemetry[-1, result_index("kinetic_energy")]
        assert balance == pytest.approx(change, rel=1e-11)


def result_index(name: str) -> int:
    from pter_gym.tasks.path_following import TELEMETRY

    return TELEMETRY.index(name)


def test_any_callable_is_a_policy(result: Result) -> None:
    seen: list[tuple[int, ...]] = []

    def release(obs: NDArray[np.float32]) -> NDArray[np.float32]:
        seen.append(obs.shape)
        return np.zeros((len(obs), 4), np.float32)

    found = run_standard_test({"mine": release}, time_constants=(0.01, 0.105, 0.2))
    assert {shape[0] for shape in seen} == {3}
    for mine, free in zip(found.runs["mine"], result.runs["free"], strict=True):
        assert mine.telemetry.tobytes() == free.telemetry.tobytes()


def test_the_seed_decides_the_random_policy() -> None:
    runs = [
        run_standard_test({"random": find_policy("random", seed)}, seed=seed, time_constants=(0.1,))
        for seed in (1, 1, 2)
    ]
    one, two, other = (run.runs["random"][0].telemetry.tobytes() for run in runs)
    assert one == two
    assert one != other


def test_the_hash_knows_the_configuration(result: Result) -> None:
    from pter_gym.params import DELRIN_EXPERIMENTAL

    free = {"free": find_policy("free", scenario=None)}
    hashes = {
        run_standard_test(free, time_constants=(0.01, 0.105, 0.2)).as_json()["config_hash"],
        run_standard_test(free, time_constants=(0.01,)).as_json()["config_hash"],
        run_standard_test(free, machine=DELRIN_EXPERIMENTAL, time_constants=(0.01,)).as_json()["config_hash"],
    }
    assert len(hashes) == 3
    assert result.as_json()["config_hash"] in hashes


@pytest.mark.parametrize(
    ("field", "keywords"),
    [
        ("policies", {"policies": {}}),
        ("time_constants", {"time_constants": ()}),
        ("time_constant", {"time_constants": (0.1, -1.0)}),
        ("seed", {"seed": -1}),
    ],
)
def test_bad_arguments_are_named(field: str, keywords: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match=field):
        run_standard_test(**{"policies": {"free": find_policy("free", scenario=None)}, **keywords})


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "folder"
    arguments = ["benchmark", "--policies", "free, torque-feedback", "--time-constants", "0.1,0.2", "--out", str(out)]
    assert cli.main(arguments) == 0
    shown = capsys.readouterr().out
    assert "torque-feedback" in shown
    assert "path" in shown
    pictures = {f"{name}.{kind}" for name in ("tip_paths", "error_against_time") for kind in ("png", "pdf")}
    assert {path.name for path in out.iterdir()} == {"benchmark.json", *pictures}
    content = json.loads((out / "benchmark.json").read_text())
    assert list(content["policies"]) == ["free", "torque-feedback"]
    for picture in out.glob("*.png"):
        assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize("arguments", [["--help"], ["benchmark", "--help"]])
def test_help_explains(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(arguments) == 0
    assert "benchmark" in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    from pter_gym import __version__

    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == f"pter {__version__}"


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
@pytest.mark.parametrize("files", [0, 1, 2])
def test_ctrl_c_leaves_whole_files(files: int, tmp_path: Path) -> None:
    """The signal comes when the command begins, or as soon as so many of its files are written."""
    out = tmp_path / "out"
    # Python itself exits with 1 if it is interrupted while it starts, so the signal waits until the command begins.
    code = "import sys; from pter_gym.commands.main import main; print('begun', flush=True); sys.exit(main())"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "benchmark", "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"begun\n"
    deadline = time.monotonic() + 60.0
    while len(list(out.glob("[!.]*"))) < files and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode in (0, cli.INTERRUPTED, -signal.SIGINT)
    assert len(list(out.glob("[!.]*"))) >= files
    for path in out.glob("*") if out.exists() else ():
        if path.suffix == ".json":
            json.loads(path.read_text())
        else:
            end = {".png": b"IEND\xaeB`\x82", ".pdf": b"%%EOF\n"}[path.suffix]
            assert path.read_bytes().endswith(end)


def test_the_readme_shows_this_test() -> None:
    assert f"<!-- {NAME} -->\n{standard_table()}<!-- /{NAME} -->\n" in PAGE.read_text("utf-8")
