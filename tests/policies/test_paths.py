"""Each kind of path is accepted where a path is; bad paths and machines are refused with the name of the argument."""

import json
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pter_gym
from pter_gym._commands.main import main
from pter_gym._engine.batch import Batch
from pter_gym._internal.files import find_path
from pter_gym._internal.terminal import make_folder
from pter_gym.benchmark import ResultsFolder, find_policy, run_scenario, run_standard_test, verify
from pter_gym.benchmark._identity import identity_of
from pter_gym.benchmark._run_files import read_run
from pter_gym.benchmark.episodes import load_episodes, scenarios, store_episodes
from pter_gym.benchmark.tuned import find_tuned, read_table
from pter_gym.controllers import Free, Impedance, bind
from pter_gym.envs._single import PathFollowingEnv
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.errors import DataError, ParameterError
from pter_gym.hands import read_forces
from pter_gym.params import BASELINE, DELRIN_THEORETICAL
from pter_gym.params._preset import load_preset
from pter_gym.paths import read_path
from pter_gym.policies import SHIPPED, exported_policies, read_policy, shipped_policies
from pter_gym.scenarios.randomisation import Randomisation
from pter_gym.tasks.path_following import PathFollowing, observation_layout

LAYOUT = observation_layout(BASELINE, "torque")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home, which is the present folder too, with the policy ``mine`` in the folder ``policies``."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "policies"
    folder.mkdir()
    copy("mine", folder)
    return tmp_path


def copy(name: str, folder: Path) -> None:
    """Copy a shipped policy under another name."""
    card = json.loads((SHIPPED / "residual.json").read_text("utf-8"))
    (folder / f"{name}.json").write_text(json.dumps({**card, "name": name}), "utf-8")
    (folder / f"{name}.safetensors").write_bytes((SHIPPED / "residual.safetensors").read_bytes())
    (folder / f"{name}.md").write_text("", "utf-8")


def content_of(policy: Any) -> str | None:
    return identity_of(policy, bind(policy, BASELINE, LAYOUT))


@pytest.mark.parametrize("kind", [str, Path])
@pytest.mark.parametrize(
    "path",
    [
        "policies/mine",
        "~/policies/mine",
        "{home}/policies/mine",
        "policies/mine.json",
        "policies/",
    ],
)
def test_an_exported_policy_is_found_by_each_kind_of_path(kind: Callable[[str], Any], path: str, home: Path) -> None:
    given = kind(path.format(home=home))
    expected = content_of(find_policy("residual"))
    for find in (read_policy, find_policy):
        assert content_of(find(given)) == expected


def test_a_policy_in_the_present_folder_is_found_by_its_name(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home / "policies")
    (home / "policies" / "residual.json").write_text("no card")
    expected = content_of(read_policy("residual"))
    assert content_of(find_policy("mine")) == content_of(read_policy("mine")) == expected
    assert (
        content_of(read_policy("mine", "~/policies")) == content_of(read_policy("mine", home / "policies")) == expected
    )
    assert shipped_policies("~/policies") == ("mine", "residual")
    assert exported_policies("../policies") == exported_policies() == ("mine",)


def test_what_is_not_there_is_told_with_what_is_near(home: Path) -> None:
    def refused(path: Any, match: str) -> None:
        for find in (read_policy, find_policy):
            with pytest.raises(ParameterError, match=match):
                find(path)

    refused("policies/mein", "no exported policy 'policies/mein': no policies/mein.json; did you mean 'policies/mine'")
    refused("~/policies/mein.json", "did you mean '.*/policies/mine'")
    refused("residul", "policies must be among .*, got 'residul'; did you mean 'residual'")
    copy("other", home / "policies")
    refused("policies", "the folder holds several, policies/mine, policies/other")
    refused(Path("nowhere"), r"no exported policy '(\./)?nowhere': no nowhere.json")
    (home / "run").mkdir()
    (home / "run" / "run.json").write_text("{}")
    refused("./run", "the folder of a training, of which `pter export run` makes a policy")
    with pytest.raises(ParameterError, match="policies must be among mine, other, got 'more'"):
        read_policy("more", "policies")


def test_results_are_found_by_each_kind_of_path(home: Path) -> None:
    runs = run_scenario("standard", [Path("policies/mine")], ["brisk"], episodes=1, results="~/results")
    (file,) = (home / "results" / "runs").iterdir()
    assert runs[0].conditions.policy == "policies/mine"
    for path in ("results", Path("~/results"), str(home / "results")):
        assert ResultsFolder(path).path in (Path("results"), home / "results")
        assert ResultsFolder(path).runs()[0].conditions == runs[0].conditions
    assert all(verdict.same for verdict in verify("~/results")[:-1])
    assert read_run(str(file)).conditions == read_run(f"~/results/runs/{file.name}").conditions == runs[0].conditions


def test_the_command_takes_paths_from_home_on(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No shell replaces the ``~`` behind ``=`` or a comma."""
    arguments = ["--scenario", "paper", "--policies", "free,~/policies", "--time-constants", "0.1", "--out=~/results"]
    assert main(["benchmark", *arguments]) == 0, capsys.readouterr().err
    content = json.loads((home / "results" / "benchmark.json").read_text("utf-8"))
    assert list(content["policies"]) == ["free", "~/policies"]
    assert main(["benchmark", "--policies", "policies/mein"]) == 2
    assert "did you mean 'policies/mine'" in capsys.readouterr().err


@pytest.mark.parametrize("kind", [str, Path])
def test_files_are_written_and_read_by_each_kind_of_path(kind: Callable[[str], Any], home: Path) -> None:
    (home / "path.csv").write_text("x,y\n-0.3,0.7\n0.3,0.7\n")
    (home / "forces.csv").write_text("time,along,across\n0,1,0\n1,1,0\n")
    preset = Path(pter_gym.__file__).parent / "presets" / "pter.toml"
    (home / "preset.toml").write_bytes(preset.read_bytes())
    assert read_path(kind("~/path.csv")) == read_path(kind("path.csv"))
    assert read_forces(kind("~/forces.csv")) == read_forces(kind("forces.csv"))
    assert load_preset(kind("~/preset.toml")) == load_preset(preset)
    store_episodes("standard", [BASELINE], [PathFollowing()], [0], ["all"], version=1, folder=kind("~/episodes"))
    assert scenarios(kind("episodes")) == ("standard",)
    assert len(load_episodes("standard", "slow", folder=kind("~/episodes"))) == 1
    assert read_table(kind("~/none.toml")) == {}
    make_folder(kind("~/new/folder"))
    assert (home / "new" / "folder").is_dir()


TAKERS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "find_path": ("field", lambda path: find_path("field", path)),
    "read_path": ("file", read_path),
    "read_forces": ("file", read_forces),
    "load_preset": ("path", load_preset),
    "ResultsFolder": ("path", ResultsFolder),
    "verify": ("path", verify),
    "read_run": ("path", read_run),
    "load_episodes": ("folder", lambda path: load_episodes("standard", "slow", folder=path)),
    "find_tuned": ("path", lambda path: find_tuned("impedance-tuned", path=path)),
    "shipped_policies": ("folder", shipped_policies),
    "read_policy": ("name", read_policy),
    "make_folder": ("out", make_folder),
}
if find_spec("pter_gym.tools.tuning"):
    from pter_gym.tools.tuning import add_gains

    TAKERS["add_gains"] = ("path", lambda path: add_gains(None, path))  # type: ignore[arg-type]


@pytest.mark.parametrize("taker", TAKERS)
def test_a_path_that_cannot_be_is_refused_with_its_argument(taker: str) -> None:
    field, take = TAKERS[taker]
    for given in (5, "a\0b", "~nobody-of-this-name/file"):
        with pytest.raises(ParameterError, match=rf"^{field} must be a path, as a string or a pathlib.Path, got "):
            take(given)


def test_what_is_no_file_of_its_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="it is not a regular file"):
        read_run(str(tmp_path))


@pytest.mark.parametrize("names", ["residual", b"residual", Path("residual"), 5, [], None, [5], [None]], ids=repr)
def test_names_come_in_a_list(names: Any) -> None:
    with pytest.raises(ParameterError, match=r"policies must (hold at least one name|be names or paths)"):
        run_scenario("standard", names, ["brisk"], episodes=1)
    if names not in ([5], [None]):
        with pytest.raises(ParameterError, match="paces must hold at least one name"):
            run_scenario("standard", ["free"], names, episodes=1)


MACHINE_TAKERS: dict[str, Callable[[Any], Any]] = {
    "single environment": lambda machine: PathFollowingEnv(machine=machine).machine,
    "vector environment": lambda machine: PathFollowingVectorEnv(2, machine=machine).batch.machine,
    "standard test": lambda machine: run_standard_test({"free": Free()}, machine=machine, time_constants=[0.1]).machine,
    "initial state": lambda machine: pter_gym.initial_state(machine, (1.0, 2.0), volts=(5.0,) * 4).torque_dynamic,
    "bind": lambda machine: bind(Impedance(), machine, LAYOUT).gains,  # type: ignore[attr-defined]
    "method bind": lambda machine: Impedance().bind(machine, LAYOUT).gains,
    "layout": lambda machine: observation_layout(machine, "torque"),
}


@pytest.mark.parametrize("taker", MACHINE_TAKERS)
def test_a_machine_is_given_by_itself_or_its_name_and_none_is_the_usual_one(taker: str) -> None:
    take = MACHINE_TAKERS[taker]
    for given, machine in ((None, BASELINE), ("delrin_theoretical", DELRIN_THEORETICAL)):
        found, expected = take(given), take(machine)
        same = np.array_equal(found, expected) if isinstance(found, np.ndarray) else found == expected
        assert same
    for wrong in (5, "baselin", {}):
        with pytest.raises(ParameterError, match=r"machine must be a Machine or one of baseline, .* got"):
            take(wrong)
    with pytest.raises(ParameterError, match="got 'baselin'; did you mean 'baseline'"):
        take("baselin")


def test_worlds_are_of_machines_and_tasks() -> None:
    for machines, tasks, field in ((None, PathFollowing(), "machines"), ([BASELINE, 5], PathFollowing(), "machines")):
        with pytest.raises(ParameterError, match=f"{field} must be a Machine or a sequence of them"):
            Batch(machines, tasks)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="tasks must be a PathFollowing or a sequence of them"):
        Batch(BASELINE, "line")  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="machine must be a Machine, or draw one, got None"):
        Randomisation(machine=None, task=PathFollowing()).pairs()  # type: ignore[arg-type]
