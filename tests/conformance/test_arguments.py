"""Arguments as users have them: NumPy's numbers, pathlib's paths and files that change later."""

import re
from collections.abc import Callable
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from pter_gym.benchmark import run_scenario
from pter_gym.controllers import Impedance
from pter_gym.envs import PathFollowingEnv
from pter_gym.envs._mixin import Arguments, find_worlds
from pter_gym.errors import ParameterError
from pter_gym.hands import MultiSineHand, RecordedForces, find_hand
from pter_gym.params import BASELINE, find_machine, save_machine
from pter_gym.paths import Polyline, Spline, find_path
from pter_gym.policies._view import find_view
from pter_gym.scenarios import find_scenario
from pter_gym.scenarios.distributions import Draws, Uniform, Vary
from pter_gym.scenarios.paces import find_pace
from pter_gym.tasks.path_following import PathFollowing, Sensing
from pter_gym.tasks.path_following._specification import Starts

POINTS = ((-0.3, 0.6), (0.0, 0.62), (0.3, 0.6))
ID = "PTER/Standard-v0"


def write_path(file: Path, points: Any = POINTS) -> Path:
    file.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in points))
    return file


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    return write_path(tmp_path / "mine.csv")


@pytest.fixture
def toml(tmp_path: Path) -> Path:
    save_machine(BASELINE, tmp_path / "m.toml", origin="chosen: a test")
    return tmp_path / "m.toml"


# --- NumPy's numbers ---


NUMBERS: list[dict[str, Any]] = [
    {"frame_skip": np.int64(2)},
    {"error_max": np.float32(0.05)},
    {"pace": np.float32(0.2)},
    {"pace": np.array(0.2)},
    {"contexts": np.uint8(8)},
    {"context_seed": np.int32(1)},
    {"observe_context": np.bool_(True)},
]


def made_by_jax(name: str, **arguments: Any) -> None:
    pytest.importorskip("jax")
    from pter_gym.envs.jax import make

    make(name, **arguments)


def made_by_sb3(name: str, **arguments: Any) -> None:
    pytest.importorskip("stable_baselines3")
    from pter_gym.envs.sb3 import make_sb3_vec_env

    make_sb3_vec_env(2, scenario="standard", **arguments)


DOORS: dict[str, Callable[..., Any]] = {
    "make": gymnasium.make,
    "make_vec": lambda name, **arguments: gymnasium.make_vec(name, np.int64(2), **arguments),
    "jax": made_by_jax,
    "Stable-Baselines3": made_by_sb3,
}


@pytest.mark.parametrize("arguments", NUMBERS, ids=str)
@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_numpys_numbers_are_numbers_at_every_door(door: Any, arguments: dict[str, Any]) -> None:
    env = door(ID, **arguments)
    if env is not None:
        plain: Any = EnvSpec.from_json(env.spec.to_json())
        (name,) = arguments
        assert plain.kwargs[name] == arguments[name]
        assert type(plain.kwargs[name]) in (bool, int, float)


@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_an_unknown_argument_is_told_with_the_nearest_at_every_door(door: Any) -> None:
    for name, meant in (("sensor", "sensors"), ("hands", "hand"), ("frameskip", "frame_skip")):
        with pytest.raises(ParameterError, match=f"{name} is not .* did you mean '{meant}'"):
            door(ID, **{name: 1})


def test_the_list_of_arguments_is_one() -> None:
    """Their types for editors, their defaults, and what the docstring describes."""
    given = Arguments.__annotations__
    listed = {**signature(find_worlds).parameters, **signature(find_view).parameters}
    assert given.keys() == listed.keys() - {"view", "whose_gains", "usual_skip", "voltage_max"}
    _, _, page = str(PathFollowingEnv.__doc__).partition("## Arguments")
    items = re.findall(r"^ *- (`\w+`(?:, `\w+`)*):", page.partition("##")[0], re.MULTILINE)
    told = [name for item in items for name in re.findall(r"\w+", item)]
    assert set(told) - {"render_mode", "width", "height"} == {*given}


def test_a_hand_is_an_argument_as_a_path_is() -> None:
    arm, push = find_hand("rough-posture"), MultiSineHand(push=40.0)
    for door in ("make", "make_vec", "jax", "Stable-Baselines3"):
        DOORS[door](ID, hand="rough-posture", contexts=2)
    for hand, found in ((push, push), ("rough-posture", arm)):
        alone: Any = gymnasium.make("PTER/PathFollowing-v0", hand=hand).unwrapped
        drawn: Any = gymnasium.make("PTER/Hands-v0", hand=hand, contexts=8).unwrapped
        assert {task.hand for _, task in alone.batch.pairs} == {found}
        assert {task.hand for _, task in drawn.batch.pairs} == {replace(found, random_phases=True)}
        assert len({task.pace for _, task in drawn.batch.pairs}) == 8
        assert alone.whose_gains == ("hands" if found is arm else "standard")
    held: Any = gymnasium.make(ID, hand="rough-posture", contexts=2).unwrapped
    assert (held.whose_gains, held.scenario.name) == ("hands", "standard-by-rough-posture")
    spec: Any = EnvSpec.from_json(gymnasium.make(ID, hand=push, contexts=2).spec.to_json())  # pyright: ignore[reportOptionalMemberAccess]
    again: Any = gymnasium.make(spec).unwrapped
    assert again.batch.pairs[0][1].hand == replace(push, random_phases=True)
    with pytest.raises(ParameterError, match="hand must be among"):
        gymnasium.make(ID, hand="rough-posturs")
    with pytest.raises(ParameterError, match="hand must not be given with a task"):
        gymnasium.make("PTER/PathFollowing-v0", hand=push, task=PathFollowing())


F = np.float32
FIELDS: list[Callable[[], Any]] = [
    lambda: PathFollowing(pace=F(0.2)),  # pyright: ignore[reportArgumentType]
    lambda: replace(BASELINE, substep=F(1e-3)),
    lambda: replace(BASELINE, clutch_scale=tuple(np.ones(4, F))),
    lambda: replace(BASELINE.arm, inertia_a=F(0.5)),
    lambda: replace(BASELINE.clutch, time_constant=F(0.1)),
    lambda: Sensing(delay=np.int64(1), encoder_velocity=np.bool_(True)),  # pyright: ignore[reportArgumentType]
    lambda: Starts(moving=F(0.5)),  # pyright: ignore[reportArgumentType]
    lambda: MultiSineHand(amplitudes=tuple(np.ones(5, F)), random_phases=np.bool_(True)),  # pyright: ignore[reportArgumentType]
    lambda: RecordedForces(times=tuple(np.arange(3.0)), along=(F(1.0),) * 3, across=(0.0,) * 3),  # pyright: ignore[reportArgumentType]
    lambda: Spline(points=tuple((F(x), F(y)) for x, y in POINTS), smooth=F(0.001)),  # pyright: ignore[reportArgumentType]
    lambda: Polyline(points=np.array(POINTS, F), radius=F(0.01)),  # pyright: ignore[reportArgumentType]
    lambda: Impedance(stiffness=F(500.0), tip_space=np.bool_(True)),  # pyright: ignore[reportArgumentType]
]


def builtins_in(value: Any) -> bool:
    parts = value if isinstance(value, tuple) else (value,)
    return not any(isinstance(part, np.generic) for part in parts) and all(
        builtins_in(part) for part in parts if isinstance(part, tuple)
    )


@pytest.mark.parametrize("make", FIELDS)
def test_fields_hold_pythons_numbers(make: Callable[[], Any]) -> None:
    assert all(map(builtins_in, vars(make()).values()))


@pytest.mark.parametrize("bad", [np.float32("nan"), np.float64("inf"), np.bool_(True), np.ones(2)])
def test_what_is_no_number_of_numpys_stays_refused(bad: Any) -> None:
    with pytest.raises(ParameterError, match=r"PathFollowing\.pace"):
        PathFollowing(pace=bad)
    with pytest.raises(ParameterError, match="pace"):
        find_pace(bad)


def test_paces_and_counts_of_a_benchmark_may_be_numpys() -> None:
    runs = run_scenario("standard", ["free"], F(0.5), episodes=np.int64(1))  # pyright: ignore[reportArgumentType]
    runs += run_scenario("standard", ["free"], np.array([0.5, 0.25]), episodes=1)  # pyright: ignore[reportArgumentType]
    assert [run.pace for run in runs] == ["brisk", "brisk", "medium"]


# --- files ---


def test_a_path_and_a_machine_may_be_pathlibs(csv: Path, toml: Path) -> None:
    assert find_path(csv) == Spline(points=POINTS)
    assert find_machine(toml) == BASELINE
    assert find_scenario("standard", toml, csv).name == "standard-on-mine"
    for door in ("make", "make_vec", "Stable-Baselines3"):
        DOORS[door](ID, path=csv, machine=toml)


@pytest.mark.parametrize(
    ("path", "machine"), [("MINE.CSV", "M.TOML"), ("mine.txt", "m.toml"), ("mine.Tsv", "m.toml")]
)
def test_files_are_known_by_their_endings_in_capitals_or_not(
    path: str, machine: str, csv: Path, toml: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(csv.parent)
    csv.rename(path)
    toml.rename(machine)
    assert find_path(path) == Spline(points=POINTS)
    assert find_machine(machine) == BASELINE
    DOORS["make"](ID, path=path, machine=machine)


@pytest.mark.parametrize("door", ["make", "make_vec"])
def test_a_spec_carries_what_files_held_when_they_were_read(
    door: str, csv: Path, toml: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    env: Any = DOORS[door](ID, path="mine.csv", machine="m.toml")
    text = env.spec.to_json()
    write_path(csv, ((-0.2, 0.5), (0.0, 0.55), (0.2, 0.5)))
    arm = replace(BASELINE.arm, inertia_a=1.1 * BASELINE.arm.inertia_a)
    save_machine(replace(BASELINE, arm=arm), toml, origin="chosen: a test")
    assert env.spec.to_json() == text
    for kept in (True, False):
        if not kept:
            csv.unlink()
            toml.unlink()
        spec: Any = EnvSpec.from_json(text)
        again: Any = gymnasium.make(spec) if door == "make" else gymnasium.make_vec(spec)
        machine, task = again.unwrapped.batch.pairs[0]
        assert (task.path, machine) == (Spline(points=POINTS), BASELINE)


def test_names_stay_names_in_a_spec() -> None:
    spec: Any = gymnasium.make(ID, path="circle", machine="delrin_theoretical").spec
    assert (spec.kwargs["path"], spec.kwargs["machine"]) == ("circle", "delrin_theoretical")


@pytest.mark.parametrize("door", ["make", "make_vec"])
def test_draws_of_ones_own_are_no_json(door: str) -> None:
    for task in (PathFollowing(), Vary(PathFollowing(), pace=Uniform(0.05, 0.1))):
        env: Any = DOORS[door]("PTER/PathFollowing-v0", scenario=Draws(task=task), contexts=3)
        with pytest.raises(ParameterError, match="scenario must be plain data"):
            env.spec.to_json()
        assert gymnasium.make(env.spec) if door == "make" else gymnasium.make_vec(env.spec)


def test_each_world_may_have_its_own_file_of_a_machine(toml: Path) -> None:
    env: Any = gymnasium.make_vec("PTER/PathFollowing-v0", 2, machine=[toml, "baseline"])
    toml.unlink()
    again: Any = EnvSpec.from_json(env.spec.to_json())
    assert [machine["type"] for machine in again.kwargs["machine"]] == ["Machine", "Machine"]


# --- paces ---


def test_the_slowest_pace_is_named_before_anything_is_run() -> None:
    with pytest.raises(ParameterError, match=r"pace must be at least 0\.0147 m/s on a path of"):
        run_scenario("standard", ["free"], 0.002)
    with pytest.raises(ParameterError, match=r"a speed ≥ 0\.001 m/s"):
        run_scenario("standard", ["free"], "1e-6")
    with pytest.raises(ParameterError, match="pace must be at least"):
        run_scenario(PathFollowing(pace=0.002), ["free"], episodes=1)
