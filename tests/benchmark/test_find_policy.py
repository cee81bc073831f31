"""Policies as users write them, and how little is loaded for one that acts."""

import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import pter_gym
from pter_gym._commands.main import main
from pter_gym.benchmark import ResultsFolder, examine, find_policy, run_scenario
from pter_gym.controllers import CONTROLLERS, Free, Impedance, Locked, PaceSchedule
from pter_gym.errors import ParameterError
from pter_gym.policies.find import Kind, kind_of
from pter_gym.policies.tuned import damping_table
from pter_gym.scenarios import PACES, SCENARIOS


@pytest.mark.parametrize(
    ("scenario", "nearest"), [("tremor", "hands"), ("corridor", "standard"), ("wall", "standard")]
)
def test_gains_for_the_nearest_scenario_serve_where_there_are_none(
    scenario: str, nearest: str
) -> None:
    law = find_policy("single-dof-tuned", scenario)
    assert law == find_policy("single-dof-tuned", nearest)
    assert law != find_policy("single-dof-tuned", "everything")
    assert find_policy("impedance", scenario) != find_policy("impedance", nearest)  # has dampers


def zero(obs: Any) -> Any:
    return np.zeros((len(obs), 4))


def test_gains_are_those_of_the_scenario_and_the_papers_change_in_the_damper_alone() -> None:
    assert find_policy("impedance", scenario=None) == Impedance()
    assert find_policy("single-dof-tuned", scenario="hands") != find_policy(
        "single-dof-tuned", scenario="paths"
    )
    assert set(damping_table()) == set(SCENARIOS)
    for scenario, controllers in damping_table().items():
        for name, dampers in controllers.items():
            found = find_policy(name, scenario=scenario)
            assert isinstance(found, PaceSchedule)
            for pace, speed in PACES.items():
                law: Any = CONTROLLERS[name]()
                assert found.at(speed) == replace(law, damping_tangential=dampers[pace])
            with pytest.raises(ParameterError, match="pace"):
                found.at(0.3)


def test_a_name_means_the_same_wherever_one_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text("from pter_gym.controllers import SingleDof as Law\n")
    Path("gains.toml").write_text("[standard.single-dof.slow]\ngains = {grip = 3.0}\n")
    Path("impedance.safetensors").touch()  # a law's name stays a law's
    Path("net.safetensors").touch()
    kinds: dict[str, Kind] = {
        "impedance": "law",
        "single-dof-scaled": "tuned law",
        "residual": "network",
        "net": "network",
        "./impedance": "network",
        "gains.toml": "gains",
        "mine.py:Law": "code",
        "os.path:join": "code",
        "net+detector": "fault-tolerant",
    }
    assert {name: kind_of(name) for name in kinds} == kinds
    for base in ("mine.py:Law", "gains.toml"):
        env: Any = gymnasium.make("PTER/Standard-v0", base=base)
        assert env.unwrapped.base == find_policy(base)
    with pytest.raises(ParameterError, match=r"base must be among impedance.*'residual'"):
        gymnasium.make("PTER/Standard-v0", base="residual")


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("impedanze", "impedance"),
        ("", "policies"),
        ("some/where.json", "some/where"),
        ("nowhere.at_all:thing", "nowhere"),
        ("os:nothing", "os:nothing"),
        ("os:", "os:"),
        ("my.py", "my.py:policy"),
        ("./my.py", "my.py:policy"),
        ("my.py:law", "my.py"),
        ("functools:partial", "functools:partial"),
        (3, "policies"),
    ],
)
def test_unknown_policies_are_named_as_written(name: Any, match: str) -> None:
    with pytest.raises(ParameterError, match=match):
        find_policy(name)


def test_code_is_found_in_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "code_of_mine.py").write_text(
        "class Law:\n    def __call__(self, obs): return 0.0\nlaw = Law()"
    )
    law: Any = find_policy("code_of_mine:law")
    assert type(find_policy("code_of_mine:Law")) is type(law)


@pytest.mark.parametrize("name", ["code.py", "code.PY"])
def test_code_is_found_in_a_file(name: str, tmp_path: Path) -> None:
    file = tmp_path / name  # a module of the standard library has this name
    file.write_text("class Law:\n    def __call__(self, obs): return 0.0\nlaw = Law()")
    law: Any = find_policy(f"{file}:law")
    assert type(find_policy(f"{file}:Law")) is type(law)
    broken = tmp_path / "broken.py"
    broken.write_text("import pter_gym\nlaw = 1 / 0")
    for name in (f"{file}:lwa", f"{file}:", f"{broken}:law"):
        with pytest.raises(ParameterError, match="policies"):
            find_policy(name)


@pytest.mark.parametrize("wrong", ["def broken(:", "nothing + 1", "import numpy; numpy.zeros(-1)"])
@pytest.mark.parametrize("name", ["{folder}/laws.py:law", "laws_of_mine:law"])
def test_the_file_that_does_not_run_is_named(
    wrong: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not always the one that the user has named."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    gains = f"gains_{abs(hash((wrong, name)))}"
    for file in ("laws.py", "laws_of_mine.py"):
        (tmp_path / file).write_text(f"\n\n\nimport {gains}\nlaw = 1\n")
    (tmp_path / f"{gains}.py").write_text(f"\n{wrong}\n")
    with pytest.raises(ParameterError, match=rf"{gains}\.py, line 2"):
        find_policy(name.format(folder=tmp_path))


def test_a_file_that_has_changed_is_read_again(tmp_path: Path) -> None:
    """Also a law, whose compiled code must not outlive its text."""
    file = tmp_path / "mine.py"
    law = """
from pter_gym.controllers import Policy, PerClutch, compiled

VOLTS = {volts}

@compiled
def law(obs, scales, gains, memory):
    return PerClutch(VOLTS, 0.0, 0.0, 0.0)

class Law:
    def bind(self, machine, layout):
        return Policy.from_law(law, [], machine, layout)
"""
    efforts = []
    for volts in (1.0, 24.0, 24.0):
        file.write_text(law.format(volts=volts))
        (run,) = run_scenario("standard", {"mine": f"{file}:Law"}, "brisk", episodes=1)
        efforts.append(run.scores["effort"][0])
    assert efforts[0] < efforts[1] == efforts[2]
    assert find_policy(f"{file}:Law").__class__ is find_policy(f"{file}:Law").__class__


def test_names_stand_for_policies_and_paces_wherever_their_meaning_is_clear() -> None:
    ways: list[Any] = [
        "free",
        ["free"],
        {"free"},
        {"free": "free"},
        {"free": Free()},
        {"free": ["free"]},
    ]
    for policies in ways:
        (found,) = run_scenario("standard", policies, "brisk", episodes=1)
        assert (found.policy, found.pace) == ("free", "brisk")
    for paces in (0.5, [0.5], ("brisk", "brisk")):
        (found,) = run_scenario("standard", "free", paces, episodes=1)
        assert found.pace == "brisk"
    assert "mine" in examine({"mine": [Free(), Locked()]}, episodes=1)


BAD: list[tuple[str, Any]] = [
    *(
        ("policies", bad)
        for bad in ({}, [], "", "fre", {" free": Free()}, {"a\n": Free()}, {"a": 3}, {"": Free()})
    ),
    *(
        ("policies", bad)
        for bad in (zero, Free(), [zero], [Free()], {"a": Free}, {"a": [Free]}, {"a": []})
    ),
    *(("paces", bad) for bad in ("fast", 0.0, [-0.3], "nan", [], [["brisk"]], "")),
    *(("scenario", bad) for bad in ("standart", None, ["standard"])),
    *(("episodes", bad) for bad in (0, 1.0, "1", True, 10**6)),
    *(("seed", bad) for bad in (-1, 2**64, 1.5, "7")),
    *(("num_threads", bad) for bad in (0, "a", None)),
]


@pytest.mark.parametrize(("field", "value"), BAD)
def test_bad_arguments_of_run_scenario_are_named(field: str, value: Any) -> None:
    given: dict[str, Any] = {
        "scenario": "standard",
        "policies": "free",
        "paces": "brisk",
        "episodes": 1,
    }
    with pytest.raises(ParameterError, match=field):
        run_scenario(**{**given, field: value})


@pytest.mark.parametrize("bad", [3, (), {"a": Free()}, [3], 2 * [Free()]])
def test_training_seeds_are_different_policies(bad: Any) -> None:
    with pytest.raises(ParameterError, match="policies"):
        run_scenario("standard", {"mine": bad}, "brisk", episodes=1)


def one_row(obs: Any) -> Any:
    return np.array([obs[0], 0.0, 0.0, 24.0])


def columns(obs: Any) -> Any:
    return np.zeros((4, len(obs)))


def named(obs: Any) -> Any:
    return np.full((len(obs), 4), obs["theta_a"])


@pytest.mark.parametrize(
    ("law", "match"),
    [
        (one_row, r"one_row failed for observations \(2, 24\)"),
        (columns, r"columns returned shape \(4, 2\).*\(2, 24\): return one row of 4 volts"),
        (named, r"named failed .*IndexError"),
    ],
)
def test_a_function_that_cannot_act_in_many_worlds_is_told_before_any_run(
    law: Any, match: str, tmp_path: Path
) -> None:
    with pytest.raises(ParameterError, match=match):
        run_scenario("standard", {"free": "free", "law": law}, "brisk", results=tmp_path)
    assert not list((tmp_path / "runs").iterdir())


def test_a_function_beyond_the_range_is_clipped_as_a_drive_does() -> None:
    def high(obs: Any) -> Any:
        return np.full((len(obs), 4), 30.0)

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        runs = run_scenario("standard", {"high": high, "locked": "locked"}, "brisk", episodes=2)
    assert len([each for each in caught if "high gives" in str(each.message)]) == 1
    np.testing.assert_array_equal(runs[0].scores["path_error_m"], runs[1].scores["path_error_m"])


def test_a_policy_acts_without_what_scores_need() -> None:
    program = """
import sys, gymnasium, pter_gym
env = gymnasium.make("PTER/Standard-v0", frame_skip=1)
before = set(sys.modules)
pter_gym.load_policy("residual", env)
print(*sorted(set(sys.modules) - before))
"""
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not [name for name in found if name.startswith("pter_gym.benchmark")]
    assert not {"scipy", "rich"} & set(found)


PLAIN = "import numpy as np\n\ndef law(obs):\n    return np.full((len(obs), 4), {volts})\n"


@pytest.mark.parametrize("door", ["find_policy", "load_policy", "benchmark"])
def test_a_file_that_has_changed_is_run_again_at_every_door(
    door: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twice within a second, and of the same length, which Python's bytecode cannot tell apart."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "mine.py"
    name = f"{file}:law"
    env: Any = gymnasium.make("PTER/PathFollowing-v0")
    observation, _ = env.reset(seed=0)
    found = []
    for volts in ("1.0", "2.0", "2.0"):
        file.write_text(PLAIN.format(volts=volts))
        if door == "load_policy":
            found.append(pter_gym.load_policy(name, env)(observation)[0])
        elif door == "benchmark":
            out = ["--out", str(tmp_path), "--no-film", "--paces", "brisk", "--episodes", "1"]
            assert main(["benchmark", "--policies", name, *out]) == 0
            (run,) = ResultsFolder(tmp_path).runs()
            found.append(24.0 * run.scores["effort"][0])
        else:
            act: Any = find_policy(name)
            found.append(act(observation[None])[0, 0])
    assert found[1] == found[2] != found[0]
