"""A base under the action: bits, contracts, storage and errors at all doors."""

import copy
import pickle
import warnings
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

import pter_gym
from pter_gym.benchmark import from_actions
from pter_gym.controllers import PerClutch, Policy, compiled
from pter_gym.envs import PathFollowingEnv, PathFollowingVectorEnv
from pter_gym.errors import ActionError, ParameterError, ResetNeededError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import COLUMN

ID, BASE, WORLDS = "PTER/Standard-v0", "single-dof-tuned", 5
SHORT: dict[str, Any] = {"scenario": "standard", "contexts": 8, "max_episode_steps": 30}


def actions(steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, WORLDS, 4)).astype(np.float32)


@pytest.mark.parametrize("skip", [1, 3])
@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
def test_a_row_of_a_batch_is_a_single_environment(mode: str, skip: int) -> None:
    batch = PathFollowingVectorEnv(
        WORLDS, autoreset_mode=mode, frame_skip=skip, base=BASE, num_threads=2, **SHORT
    )
    single = gymnasium.make(ID, contexts=8, max_episode_steps=30, frame_skip=skip, base=BASE)
    rows, _ = batch.reset(seed=3)
    obs, _ = single.reset(seed=3 + WORLDS - 1)
    ended = False
    for given in actions(70):
        np.testing.assert_array_equal(rows[-1], obs)
        rows, rewards, terminated, truncated, infos = batch.step(given)
        if ended and mode == "NEXT_STEP":
            obs, _ = single.reset()
            ended = False
            continue
        obs, reward, over, late, info = single.step(given[-1])
        assert (rewards[-1], terminated[-1], truncated[-1]) == (reward, over, late)
        ended = over or late
        if ended and mode == "SAME_STEP":
            np.testing.assert_array_equal(infos["final_obs"][-1], obs)
            np.testing.assert_array_equal(infos["final_info"]["telemetry"][-1], info["telemetry"])
            obs, _ = single.reset()


@pytest.mark.parametrize("skip", [1, 3])
def test_no_correction_leaves_the_law(skip: int) -> None:
    corrected = PathFollowingEnv(scenario="standard", frame_skip=skip, base=BASE)
    plain = PathFollowingEnv(scenario="standard", frame_skip=1, action_unit="volt")
    law = pter_gym.load_policy(BASE, plain)
    seen, _ = corrected.reset(seed=5)
    obs, _ = plain.reset(seed=5)
    law.reset()
    over = False
    while not over:
        assert seen[:-4].tobytes() == obs.tobytes()
        seen, reward, terminated, truncated, info = corrected.step(np.zeros(4, np.float32))
        earned, paid = 0.0, 0.0
        for _ in range(skip):
            if not over:
                obs, part, done, late, told = plain.step(law(obs))
                earned, over = earned + part, done or late
                paid = paid + told["telemetry"][[*COLUMN.terms]]
        assert (reward, terminated or truncated) == (earned, over)
        assert info["telemetry"][COLUMN.reward] == earned
        np.testing.assert_array_equal(info["telemetry"][[*COLUMN.terms]], paid)


def test_an_action_adds_its_share_of_the_reach() -> None:
    env = PathFollowingEnv(scenario="standard", base=BASE, reach=32, sensors="torque")
    obs, _ = env.reset(seed=5)
    layout = env.observation_layout
    before, given = layout.index("base_1"), np.array([0.1, -0.2, 0.0, 1.0], np.float32)
    base = obs[before:] * layout.scales[before:]
    at = layout.index("volts_1")
    obs, *_ = env.step(given)
    found = obs[at : at + 4] * layout.scales[at : at + 4]
    np.testing.assert_allclose(found, np.clip(base + 32 * given, 0.0, 24.0), atol=1e-5)
    weaker = replace(BASELINE, clutch=replace(BASELINE.clutch, voltage_max=12.0))
    reaches = [PathFollowingEnv(machine=each, base=BASE).reach for each in (BASELINE, weaker)]
    assert reaches == [8.0, 4.0]


def test_the_reach_is_a_fraction_of_the_machines_largest_voltage() -> None:
    half = replace(BASELINE, clutch=replace(BASELINE.clutch, voltage_max=12.0))
    usual, low = (
        PathFollowingEnv(scenario="standard", base=BASE, machine=machine)
        for machine in (BASELINE, half)
    )
    assert low.reach == 0.5 * usual.reach == 4.0


def test_a_copy_of_the_state_goes_on_alike() -> None:
    env = PathFollowingVectorEnv(WORLDS, base=BASE, **SHORT)
    env.reset(seed=0)
    for given in actions(10):
        env.step(given)
    state, later = env.get_state(), actions(40, 1)
    first = [env.step(given)[0] for given in later]
    env.set_state(state)
    np.testing.assert_array_equal(first, [env.step(given)[0] for given in later])


def test_a_world_that_begins_again_leaves_the_law_of_the_others() -> None:
    """Of the two that begin with one seed, the second after 10 steps."""
    env = PathFollowingVectorEnv(WORLDS, base=BASE, **SHORT)
    seeds, chosen = list(range(WORLDS)), np.arange(WORLDS) == 1
    rows: list[Any] = []
    for again in (False, True):
        first, _ = env.reset(seed=seeds)
        runs = [[first]]
        for step, given in enumerate(np.repeat(actions(1), 20, axis=0)):
            if again and step == 10:
                runs.append([env.batch.reset(seeds, chosen)[0]])
            runs[-1].append(env.step(given)[0])
        rows.append(runs)
    others = np.array(rows[0][0])[:, ~chosen]
    found = np.concatenate([rows[1][0], rows[1][1][1:]])[:, ~chosen]
    np.testing.assert_array_equal(found, others)
    np.testing.assert_array_equal(np.array(rows[1][1])[:, chosen], np.array(rows[1][0])[:, chosen])


COPIES = (copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each)))


@pytest.mark.parametrize("again", COPIES, ids=["deepcopy", "pickle"])
def test_copies_of_the_worlds_go_on_alike(again: Any) -> None:
    env = PathFollowingVectorEnv(WORLDS, base=BASE, **SHORT)
    env.reset(seed=0)
    for given in actions(3):
        env.step(given)
    other = again(env)
    for given in actions(3, 1):
        np.testing.assert_array_equal(env.step(given)[0], other.step(given)[0])


def volts_of_rows(obs: np.ndarray) -> np.ndarray:
    return np.abs(obs[:, :4])


def no_correction(obs: np.ndarray) -> np.ndarray:
    return np.zeros((len(obs), 4), np.float32)


POLICIES: dict[str, Any] = {
    "a network": lambda: "residual",
    "a law": lambda: BASE,
    "random": lambda: "random",
    "a function": lambda: volts_of_rows,
    "a model": lambda: from_actions(no_correction, PathFollowingEnv(frame_skip=1)),
    "with a base": lambda: from_actions(no_correction, PathFollowingEnv(base=BASE)),
}


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("again", COPIES, ids=["deepcopy", "pickle"])
def test_copies_of_a_loaded_policy_act_alike(policy: str, again: Any) -> None:
    env = PathFollowingEnv(scenario="standard", contexts=8, frame_skip=1)
    obs, _ = env.reset(seed=0)
    law = pter_gym.load_policy(POLICIES[policy](), env)
    law(obs)
    other = again(law)
    for _ in range(2):
        np.testing.assert_array_equal(law(obs), other(obs))


def test_checkers_are_silent() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(ID, contexts=8, base=BASE).unwrapped, skip_render_check=True)
        checker.check_env(gymnasium.make(ID, contexts=8, base=BASE))


def test_a_spec_recovers_the_environment() -> None:
    env = gymnasium.make(ID, contexts=8, base=BASE)
    assert env.spec is not None
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    np.testing.assert_array_equal(env.reset(seed=1)[0], again.reset(seed=1)[0])
    assert again.unwrapped.observation_layout.names[-4:] == ("base_1", "base_2", "base_3", "base_4")


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"base": "single-dof-tund"}, "did you mean 'single-dof-tuned'"),
        ({"base": lambda obs: obs}, "base must be a control law"),
        ({"base": BASE, "action_unit": "volt"}, "action_unit must be 'normalised'"),
        ({"base": BASE, "reach": 0.0}, "reach must be"),
        ({"base": BASE, "reach": float("nan")}, "reach must be"),
        ({"reach": 8.0}, "reach must not be given without"),
    ],
)
def test_what_is_no_base_is_refused(keywords: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        PathFollowingEnv(scenario="standard", contexts=8, **keywords)


def test_wrong_steps_move_nothing() -> None:
    env = PathFollowingEnv(scenario="standard", contexts=8, base=BASE)
    with pytest.raises(ResetNeededError):
        env.step(np.zeros(4))
    env.reset(seed=0)
    before = env.batch.get_state()
    for wrong in (np.full(4, 1.1), np.full(4, np.nan), np.zeros(3)):
        with pytest.raises(ActionError):
            env.step(wrong)
    for name, part in env.batch.get_state().items():
        np.testing.assert_array_equal(part, before[name])
    with pytest.raises(ParameterError, match="env must have no base"):
        pter_gym.load_policy(BASE, env)


@compiled
def fading(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """3 V, and NaN from a number of control steps on."""
    memory[0] += 1.0
    volts = np.nan if memory[0] > gains[0] else 3.0
    return PerClutch(volts, 3.0, 0.0, 0.0)


@dataclass(frozen=True)
class Fading:
    """The law above."""

    steps: float

    def bind(self, machine: Any, layout: Any) -> Policy:
        return Policy.from_law(fading, [self.steps], machine, layout)


def unchanged(env: PathFollowingVectorEnv, state: dict[str, np.ndarray]) -> bool:
    now = env.get_state()
    return all(now[name].tobytes() == part.tobytes() for name, part in state.items())


def test_a_base_that_fails_within_an_action_is_named_and_nothing_moves() -> None:
    env = PathFollowingVectorEnv(WORLDS, base=Fading(5.0), frame_skip=3, **SHORT)
    env.reset(seed=0)
    env.step(np.zeros((WORLDS, 4)))
    state = env.get_state()
    with pytest.raises(ParameterError, match=r"base must give finite voltages, got \[nan, 3.0"):
        env.step(np.zeros((WORLDS, 4)))
    assert unchanged(env, state)


@pytest.mark.parametrize("own", [{"base": BASE}, {"history": (1, 4)}], ids=["base", "history"])
def test_an_interrupt_within_an_action_moves_nothing(
    own: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = PathFollowingVectorEnv(WORLDS, frame_skip=3, **SHORT, **own)
    env.reset(seed=0)
    state, view, looks = env.get_state(), env.batch.view, [1]

    def interrupted(*arguments: Any) -> Any:
        if not looks:
            raise KeyboardInterrupt
        looks.pop()
        return type(view).after(view, *arguments)

    monkeypatch.setattr(view, "after", interrupted)
    with pytest.raises(KeyboardInterrupt):
        env.step(actions(1)[0])
    monkeypatch.undo()
    assert unchanged(env, state)
    env.step(actions(1)[0])
    assert not unchanged(env, state)


def test_a_state_of_another_base_or_without_numbers_is_refused() -> None:
    env = PathFollowingVectorEnv(WORLDS, base=BASE, **SHORT)
    other = PathFollowingVectorEnv(WORLDS, base="single-dof-scaled", **SHORT)
    for each in (env, other):
        each.reset(seed=0)
    state = env.get_state()
    with pytest.raises(ParameterError, match="with the same base"):
        env.set_state(other.get_state())
    for name in ("law", "base", "latest"):
        broken = env.get_state()
        broken[name][0] = np.nan
        with pytest.raises(ParameterError, match=name):
            env.set_state(broken)
    assert unchanged(env, state)
