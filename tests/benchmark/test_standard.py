"""The standard test, its file and its command."""

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from pter_gym._commands import main as cli
from pter_gym.benchmark import Result, run_standard_test
from pter_gym.benchmark._measures import column
from pter_gym.benchmark.metrics import SCORES
from pter_gym.controllers import CONTROLLERS, Free, Impedance, Random, TorqueFeedback
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL
from pter_gym.tasks.path_following import COLUMN


@pytest.fixture(scope="module")
def result() -> Result:
    """All built-in controllers at three time constants."""
    return run_standard_test({name: kind() for name, kind in CONTROLLERS.items()}, time_constants=(0.01, 0.105, 0.2))


def test_file_and_its_hash_of_the_configuration(result: Result) -> None:
    content = json.loads(json.dumps(result.as_json(), allow_nan=False))
    assert (content["scenario"], list(content["policies"])) == ("standard", list(CONTROLLERS))
    for runs in content["policies"].values():
        assert [run["time_constant_s"] for run in runs] == [0.01, 0.105, 0.2]
        assert all(set(run) == {"time_constant_s", *SCORES} for run in runs)
    free = {"free": Free()}
    hashes = [
        run_standard_test(free, machine=machine, time_constants=taus).as_json()["config_hash"]
        for machine, taus in ((None, (0.01, 0.105, 0.2)), (None, (0.01,)), (DELRIN_EXPERIMENTAL, (0.01,)))
    ]
    assert hashes[0] == content["config_hash"]
    assert len(set(hashes)) == 3


def test_controllers_arrive_and_feedback_helps(result: Result) -> None:
    impedance, feedback = (result.runs[name] for name in ("impedance", "torque-feedback"))
    assert all(run.score.completed for run in (*impedance, *feedback))
    assert feedback[1].score.path_error_m < impedance[1].score.path_error_m


def test_locked_never_arrives_and_free_feels_no_clutch(result: Result) -> None:
    assert not any(run.score.completed for run in result.runs["locked"])
    free = result.runs["free"]
    assert all(run.score.dissipated_j == 0.0 for run in free)
    moves = [run.telemetry[:, : COLUMN.told.time_constant] for run in free]  # what is told of the clutches differs
    assert moves[0].tobytes() == moves[2].tobytes()


def test_the_energy_ledger_of_the_standard_test(result: Result) -> None:
    """What it leaves between work and dissipation, both with the velocities after kicks, halves with the substep.

    The loss is ½h∫ω̇ᵀMω̇ over the motion, 0.2% of the hand's work for each millisecond of h at the manufacturer's time
    constant; the turning of the mass matrix leaves a thousandth of that.
    """
    half = replace(BASELINE, substep=0.5 * BASELINE.substep)
    laws = {"impedance": Impedance(), "torque-feedback": TorqueFeedback()}
    finer = run_standard_test(laws, machine=half, time_constants=(0.105,))
    terms = ("hand_work", "dissipated", "numerical_loss", "residual")
    for name in laws:
        telemetry = result.runs[name][1].telemetry, finer.runs[name][0].telemetry
        ledgers = [[column(rows, term).sum() for term in terms] for rows in telemetry]
        (work, _, loss, _), (half_work, _, half_loss, _) = ledgers
        assert 0.0 < loss <= 2.0 * BASELINE.substep * work
        assert half_loss / half_work == pytest.approx(0.5 * loss / work, rel=0.01)
        for rows, (work, dissipated, loss, residual) in zip(telemetry, ledgers, strict=True):
            assert abs(residual) <= 2e-3 * loss
            assert work - dissipated - loss + residual == pytest.approx(column(rows, "kinetic_energy")[-1], rel=1e-11)


def test_the_seed_decides_the_random_policy() -> None:
    one, two, other = (
        run_standard_test({"random": Random(seed=seed)}, seed=seed, time_constants=(0.1,)).runs["random"][0].telemetry
        for seed in (1, 1, 2)
    )
    assert one.tobytes() == two.tobytes() != other.tobytes()


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
        run_standard_test(**{"policies": {"free": Free()}, **keywords})


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "folder"
    arguments = ["--policies", "free, torque-feedback", "--time-constants", "0.1,0.2", "--out", str(out)]
    arguments = ["benchmark", "--scenario", "paper", *arguments]
    assert cli.main(arguments) == 0
    shown = capsys.readouterr().out
    assert "torque-feedback" in shown
    names = ("tip_paths", "error_against_time") if find_spec("pter_gym.tools.pictures") else ()
    pictures = {f"{name}.{kind}" for name in names for kind in ("png", "pdf")}
    assert {path.name for path in out.iterdir()} == {"benchmark.json", *pictures}
    content = json.loads((out / "benchmark.json").read_text())
    assert list(content["policies"]) == ["free", "torque-feedback"]
    for picture in out.glob("*.png"):
        assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
