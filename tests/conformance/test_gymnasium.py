"""The contract with Gymnasium, Stable-Baselines3 and Minari."""

import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from pter_gym._engine.world import ROW
from pter_gym.envs import PathFollowingEnv, PathFollowingVectorEnv
from pter_gym.hands import MultiSineHand
from pter_gym.params import DELRIN_EXPERIMENTAL
from pter_gym.paths import Line, Sine
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import PathFollowing, RewardWeights, Starts

ID = "PTER/PathFollowing-v0"
IDS = (ID, *(scenario.id for scenario in SCENARIOS.values()))
NEXT_STEP, SAME_STEP, DISABLED = (
    AutoresetMode.NEXT_STEP,
    AutoresetMode.SAME_STEP,
    AutoresetMode.DISABLED,
)
WORLDS, LIMIT, STEPS = 4, 25, 70
TASK = PathFollowing(
    path=Line(x=-0.1, y=0.54, length=0.2),
    start_offset=0.02,
    hand=MultiSineHand(push=50.0, amplitudes=(12.8,) * 5, random_phases=True),
)
"""A short path: some episodes end at its end and some at the limit, at different times."""

FIRST = np.arange(WORLDS) == 0
each_mode = pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)

# --- ids, specs, spaces ---


@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_checker_is_silent(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    options: dict[str, Any] = {} if name == ID else {"contexts": 8}
    env = gymnasium.make(name, observe_context=True, sensors="force", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=find_spec("pygame") is None)


def test_the_checker_of_stable_baselines3_is_silent() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(gymnasium.make("PTER/Standard-v0", contexts=8))


def test_ids_and_public_packages_need_no_import() -> None:
    code = (
        "import gymnasium\n"
        "assert gymnasium.make('pter_gym:PTER/Standard-v0', contexts=4).unwrapped.frame_skip == 3\n"
        "found = {name for name in gymnasium.registry if name.startswith('PTER/')}\n"
        f"assert found == {set(IDS)}\n"
        "import pter_gym\n"
        "pter_gym.params, pter_gym.benchmark, pter_gym.controllers, pter_gym.tasks, "
        "pter_gym.envs, pter_gym.scenarios"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("name", "keywords"),
    [
        (
            ID,
            {
                "task": PathFollowing(pace=0.3, path=Sine(), starts=Starts(moving=0.5)),
                "machine": DELRIN_EXPERIMENTAL,
            },
        ),
        (ID, {"machine": "delrin_experimental", "action_unit": "volt", "frame_skip": 2}),
        (ID, {"scenario": "paths", "contexts": np.int64(3), "pace": np.float32(0.25)}),
        (
            "PTER/Standard-v0",
            {"contexts": 4, "reward": RewardWeights(effort=1.0), "starts": Starts(moving=1.0)},
        ),
    ],
)
def test_a_spec_in_json_makes_the_same_environment(name: str, keywords: dict[str, Any]) -> None:
    env: Any = gymnasium.make(name, **keywords)
    again: Any = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.batch.pairs == env.unwrapped.batch.pairs
    assert (again.action_space, again.observation_space) == (
        env.action_space,
        env.observation_space,
    )
    assert again.unwrapped.frame_skip == env.unwrapped.frame_skip
    assert again.spec == env.spec


@pytest.mark.parametrize("name", [ID, "PTER/Standard-v0"])
def test_pictures_are_collected(name: str) -> None:
    env = gymnasium.make(name, render_mode="rgb_array_list", width=64, height=48)
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    assert [picture.shape for picture in env.render()] == [(48, 64, 3)] * 4  # type: ignore[union-attr]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have a display")
@pytest.mark.parametrize("name", [ID, "PTER/Standard-v0"])
def test_gymnasiums_own_check_passes_without_a_display(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pygame")
    for variable in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(variable, raising=False)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(gymnasium.make(name).unwrapped)
        env = gymnasium.make(name, render_mode="human")
        env.reset(seed=0)
        env.step(env.action_space.low)
        env.close()
    told = [str(warning.message) for warning in caught if "display" in str(warning.message)]
    assert len(told) == 2  # once for each window, not for each picture
    assert "SDL_VIDEODRIVER" not in os.environ


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_minus_one_is_no_limit_of_steps(make: Any) -> None:
    env = make(ID, max_episode_steps=-1)
    env.reset(seed=0)
    for _ in range(1100):
        locked = env.action_space.high
        *_, terminated, truncated, _ = env.step(locked)
        assert not np.any(terminated | truncated)


def test_ids_of_scenarios_are_arguments_of_both_environments() -> None:
    made: Any = gymnasium.make("PTER/Standard-v0", contexts=8)
    worlds: list[Any] = [
        gymnasium.make_vec("PTER/Standard-v0", 1, contexts=8),
        PathFollowingVectorEnv(1, scenario="standard", contexts=8),
        PathFollowingEnv(scenario="standard", contexts=8),
        made.unwrapped,
    ]
    action = np.full((1, 4), -0.5, np.float32)
    assert len({np.ravel(env.reset(seed=2)[0]).tobytes() for env in worlds}) == 1
    steps = [env.step(action.reshape(env.action_space.shape)) for env in worlds]
    assert (
        len({(np.ravel(obs).tobytes(), float(np.ravel(reward)[0])) for obs, reward, *_ in steps})
        == 1
    )
    assert made.unwrapped.batch.get_state()["worlds"][0, ROW.step, 0] == 3
    one, two = (
        gymnasium.make("PTER/Tremor-v0", contexts=16).unwrapped.batch.pairs for _ in range(2)
    )
    assert all(a[1] is b[1] for a, b in zip(one, two, strict=True)), "contexts are drawn once"


@pytest.mark.parametrize("sensors", ["encoders", "torque", "force"])
def test_observation_layout_names_every_entry(sensors: str) -> None:
    env: Any = gymnasium.make(ID, sensors=sensors)
    layout = env.unwrapped.observation_layout
    assert len(layout) == env.observation_space.shape[0]
    values = layout.as_dict(env.reset(seed=0)[0])
    assert values["pace"] == pytest.approx(0.5)
    assert values["progress"] == pytest.approx(0.0, abs=1e-7)
    assert values["cos_a"] ** 2 + values["sin_a"] ** 2 == pytest.approx(1.0, abs=1e-6)


def test_both_action_units_reach_the_same_voltages_and_rounding_is_clipped() -> None:
    volt, normalised = gymnasium.make(ID, action_unit="volt"), gymnasium.make(ID)
    volt.reset(seed=0), normalised.reset(seed=0)
    for k in range(20):
        action = np.array([1.0, 0.5 * (k % 5) - 1.0, 0.0, -1.0], np.float32)
        one, two = volt.step(24.0 * ((action + 1.0) / 2.0) ** 2), normalised.step(action)
        assert one[0].tobytes() == two[0].tobytes()
    ulp = float(np.spacing(np.float32(24.0)))
    obs = volt.unwrapped.step(np.array([24.0 + 4.0 * ulp, -4.0 * ulp, 0.0, 24.0]))[0]
    first = volt.unwrapped.observation_layout.index("volts_1")  # type: ignore[attr-defined]
    assert obs[first : first + 4].tolist() == [1.0, 0.0, 0.0, 1.0]


def test_reward_is_the_sum_of_its_terms() -> None:
    env: Any = gymnasium.make(ID, task=PathFollowing(reward=RewardWeights(effort=2.0)))
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.zeros(4, np.float32))  # 6 V
    row = env.unwrapped.telemetry_layout.as_dict(info["telemetry"])
    terms = [
        row[f"reward_{name}"] for name in ("tracking", "pace", "acceleration", "effort", "failure")
    ]
    assert reward == pytest.approx(sum(terms), rel=1e-15)
    assert terms[0] > 0.0
    assert all(term <= 0.0 for term in terms[1:])
    task = env.unwrapped.batch.task
    path_times = 0.01 * task.pace / task.path.length
    assert row["reward_effort"] == pytest.approx(-2.0 * (6.0 / 24.0) ** 2 * path_times, rel=1e-12)


# --- seeds ---


@pytest.mark.parametrize("name", [ID, "PTER/Standard-v0"])
def test_a_generator_seeds_an_environment_and_its_seed_repeats_the_episode(name: str) -> None:
    task: Any = {"task": PathFollowing(start_offset=0.02)} if name == ID else {"contexts": 8}
    starts = []
    for seed in (7, 7, 8):
        env: Any = gymnasium.make(name, **task)
        env.unwrapped.np_random = np.random.default_rng(seed)
        starts.append(env.reset()[0].tobytes())
        following = env.reset()[0].tobytes()
        assert env.reset(seed=env.unwrapped.np_random_seed)[0].tobytes() == starts[-1]
        assert env.reset()[0].tobytes() == following != starts[-1]
    assert starts[0] == starts[1] != starts[2]
    env = gymnasium.make(name, **task)
    start, _ = env.reset()
    assert env.reset(seed=env.unwrapped.np_random_seed)[0].tobytes() == start.tobytes()


@pytest.mark.parametrize("kind", [np.int64, np.uint8, np.array])
def test_a_seed_may_be_any_integer(kind: Any) -> None:
    env = gymnasium.make(ID, task=TASK)
    assert env.reset(seed=kind(3))[0].tobytes() == env.reset(seed=3)[0].tobytes()


def test_adjacent_seeds_share_no_stream() -> None:
    env = make(NEXT_STEP)
    starts = [env.reset(seed=0 if k == 0 else None)[0].copy() for k in range(12)]
    assert len({row.tobytes() for start in starts for row in start}) == 12 * WORLDS


# --- vector environments ---


def make(mode: AutoresetMode) -> Any:
    return PathFollowingVectorEnv(
        WORLDS, task=TASK, action_unit="volt", autoreset_mode=mode, max_episode_steps=LIMIT
    )


def actions(seed: int = 0) -> np.ndarray:
    """Random voltages."""
    return np.random.default_rng(seed).uniform(0.0, 9.0, (STEPS, WORLDS, 4)).astype(np.float32)


def play(env: Any, rows: Any, seed: Any = 0) -> Iterator[tuple[Any, ...]]:
    """Yield what a seeded reset and steps return, with the resets that DISABLED needs."""
    yield env.reset(seed=seed)
    for row in rows:
        returned = env.step(row)
        yield returned
        ended = returned[2] | returned[3]
        if env.metadata["autoreset_mode"] == DISABLED and ended.any():
            yield env.reset(options={"reset_mask": ended})


def leaves(value: Any) -> Iterator[np.ndarray]:
    """Yield the arrays within what was returned."""
    if isinstance(value, (tuple, dict)) or getattr(value, "dtype", None) == np.dtype(object):
        for part in value.values() if isinstance(value, dict) else value:
            yield from leaves(part)
    elif isinstance(value, np.ndarray):
        yield value


def bits(value: Any) -> list[bytes]:
    return [leaf.tobytes() for leaf in leaves(value)]


def world(returned: tuple[Any, ...], number: int) -> list[Any]:
    """What one world returned, infos left out."""
    return [part[number].tobytes() for part in returned[:-1]]


def told(infos: dict[str, Any]) -> dict[str, Any]:
    """What infos tell where their masks are set, and the masks."""
    out: dict[str, Any] = {}
    for key, value in infos.items():
        if key.startswith("_"):
            out[key] = value.tolist()
        elif isinstance(value, dict):
            out[key] = told(value)
        else:
            chosen = infos[f"_{key}"]
            part = np.stack(value[chosen]) if value.dtype == object else value[chosen]
            out[key] = (value.dtype, part.dtype, part.shape, part.tobytes())
    return out


@each_mode
def test_returns_are_those_of_gymnasiums_own_vector_environment(mode: AutoresetMode) -> None:
    options: dict[str, Any] = {"task": TASK, "action_unit": "volt", "max_episode_steps": LIMIT}
    ours = make(mode)
    theirs: Any = gymnasium.make_vec(ID, WORLDS, "sync", {"autoreset_mode": mode}, **options)
    for name in (
        "observation_space",
        "action_space",
        "single_observation_space",
        "single_action_space",
    ):
        assert getattr(ours, name) == getattr(theirs, name)
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    for one, two in zip(play(ours, actions(), 5), play(theirs, actions(), 5), strict=True):
        assert [(part.dtype, part.tobytes()) for part in one[:-1]] == [
            (p.dtype, p.tobytes()) for p in two[:-1]
        ]
        assert told(one[-1]) == told(two[-1])


def test_an_end_at_the_limit_is_both_terminated_and_truncated_as_with_time_limit() -> None:
    def first_end(env: Any, action: np.ndarray) -> list[Any]:
        env.reset(seed=0)
        for step in range(1, 1000):
            flags = [np.ravel(part)[0].item() for part in env.step(action)[2:4]]
            if any(flags):
                return [step, *flags]
        raise AssertionError("no end")

    free = -np.ones(4, np.float32)
    step, terminated, truncated = first_end(gymnasium.make(ID), free)
    assert (terminated, truncated) == (True, False)
    for limit, flags in (
        (step - 1, [False, True]),
        (step, [True, True]),
        (step + 1, [True, False]),
    ):
        alone = first_end(gymnasium.make(ID, max_episode_steps=limit), free)
        batch = first_end(gymnasium.make_vec(ID, num_envs=1, max_episode_steps=limit), free[None])
        assert batch == alone == [min(step, limit), *flags]


@each_mode
def test_returns_share_no_memory_and_neither_they_nor_actions_are_read_again(
    mode: AutoresetMode,
) -> None:
    clean = [(returned, bits(returned)) for returned in play(make(mode), actions())]
    for (one, _), (two, _) in pairwise(clean):
        assert not any(np.shares_memory(a, b) for a in leaves(one) for b in leaves(two))
    assert all(bits(returned) == before for returned, before in clean)

    def spoiled() -> Iterator[np.ndarray]:
        for row in actions():
            given = row.copy()
            yield given
            assert given.tobytes() == row.tobytes(), "step changed its actions"
            given[:] = 1.0

    for returned, (_, expected) in zip(play(make(mode), spoiled()), clean, strict=True):
        assert bits(returned) == expected
        for leaf in leaves(
            returned[:2] if len(returned) == 2 else (returned[0], returned[1], returned[4])
        ):
            leaf.fill(1)


def test_returns_of_one_world_keep_their_values() -> None:
    env: Any = PathFollowingEnv(task=TASK, action_unit="volt")
    kept = [
        (returned, bits(returned))
        for returned in (env.reset(seed=0), *map(env.step, actions()[:9, 0]))
    ]
    assert all(bits(returned) == before for returned, before in kept)


@pytest.mark.smoke
@each_mode
def test_a_partial_reset_restarts_the_chosen_worlds_alone(mode: AutoresetMode) -> None:
    env, plain = make(mode), make(mode)
    rows = actions()[: LIMIT - 8]
    for each in (env, plain):
        each.reset(seed=0)
        shown = each.step(rows[0])[0]
    start = make(mode).reset(seed=[1000, 1, 2, 3])[0]
    options = {"reset_mask": FIRST.copy()}
    obs, infos = env.reset(seed=[1000, 1001, 1002, 1003], options=options)
    assert (options["reset_mask"] == FIRST).all()
    np.testing.assert_array_equal(obs, [start[0], *shown[1:]])
    np.testing.assert_array_equal(infos["_telemetry"], FIRST)
    for row in rows[1:]:
        one, two = env.step(row), plain.step(row)
        assert [world(one, k) for k in range(1, WORLDS)] == [
            world(two, k) for k in range(1, WORLDS)
        ]
        if (one[2] | one[3] | two[2] | two[3]).any() and mode == DISABLED:
            break
