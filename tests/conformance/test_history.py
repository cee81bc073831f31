"""What was observed earlier and what no sensor shows, at the doors of Gymnasium and of
Stable-Baselines3; JAX's are compared with Gymnasium's elsewhere."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from pter_gym.envs import PathFollowingEnv, PathFollowingVectorEnv
from pter_gym.errors import ActionError, ParameterError
from pter_gym.tasks.path_following import COLUMN

WORLDS, STEPS, LIMIT = 5, 60, 14
HISTORY = (1, 3, 10)
SHORT: dict[str, Any] = {"scenario": "everything", "contexts": 8, "starts": "path"}

KINDS: dict[str, dict[str, Any]] = {
    "encoders with delay": {"sensors": "encoders"},
    "volts, with the context": {"action_unit": "volt", "observe_context": True},
    "a base": {"base": "single-dof-tuned"},
}


def actions(env: PathFollowingVectorEnv) -> np.ndarray:
    space, rng = env.single_action_space, np.random.default_rng(0)
    low, high = space.low[0], space.low[0] + 0.6 * (space.high[0] - space.low[0])
    return rng.uniform(low, high, (STEPS, WORLDS, 4)).astype(np.float32)


def expected(seen: list[np.ndarray]) -> np.ndarray:
    """What is seen after the observations of an episode at each control step."""
    return np.concatenate([seen[max(len(seen) - 1 - ago, 0)] for ago in (0, *HISTORY)])


@pytest.mark.parametrize("skip", [1, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_a_history_is_what_was_observed_so_many_control_steps_ago(kind: str, skip: int) -> None:
    """Alone as in a batch, whatever the hold, and never of an earlier episode."""
    keywords = {**SHORT, **KINDS[kind]}
    worlds = PathFollowingVectorEnv(
        WORLDS,
        autoreset_mode="SAME_STEP",
        frame_skip=skip,
        history=HISTORY,
        max_episode_steps=LIMIT,
        **keywords,
    )
    alone = PathFollowingEnv(frame_skip=skip, history=HISTORY, **keywords)
    plain = PathFollowingEnv(frame_skip=1, **keywords)
    obs, _ = worlds.reset(seed=3)
    one, _ = alone.reset(seed=3 + WORLDS - 1)
    seen = [plain.reset(seed=3 + WORLDS - 1)[0]]
    begun, ends = 0, 0
    for t, given in enumerate(actions(worlds)):
        for found in (obs[-1], one):
            assert found.tobytes() == expected(seen).tobytes()
        obs, rewards, terminated, truncated, infos = worlds.step(given)
        one, reward, *flags, _ = alone.step(given[-1])
        earned = 0.0
        for _ in range(skip):
            now, part, *over, _ = plain.step(given[-1])
            seen.append(now)
            earned += part
            if any(over):
                break
        assert rewards[-1] == reward == earned
        assert flags == over
        assert terminated[-1] == over[0]
        if terminated[-1] or truncated[-1]:
            assert t + 1 - begun == LIMIT or over[0]
            for found in (infos["final_obs"][-1], one):
                assert found.tobytes() == expected(seen).tobytes()
            one, seen = alone.reset()[0], [plain.reset()[0]]
            begun, ends = t + 1, ends + 1
    assert ends > 2
    names = alone.observation_layout.names
    assert names[: len(names) // 4] == plain.observation_layout.names
    assert alone.observation_layout.index("normal_error[-10]") == 3 * len(names) // 4 + names.index(
        "normal_error"
    )


def test_states_go_on_alike_and_specs_recover_the_history() -> None:
    env = gymnasium.make("PTER/Standard-v0", contexts=8, history=HISTORY)
    spec: Any = env.spec
    again: Any = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(spec.to_json()))
    assert again.unwrapped.history == HISTORY
    np.testing.assert_array_equal(env.reset(seed=1)[0], again.reset(seed=1)[0])
    worlds = PathFollowingVectorEnv(WORLDS, history=HISTORY, **SHORT)
    worlds.reset(seed=0)
    first, later = np.split(actions(worlds), 2)
    for given in first:
        worlds.step(given)
    state = worlds.get_state()
    rows = [worlds.step(given)[0] for given in later]
    worlds.set_state(state)
    np.testing.assert_array_equal(rows, [worlds.step(given)[0] for given in later])
    told = gymnasium.make("PTER/Hands-v0", contexts=8, history=(1,), privileged=True)
    check_env(told.unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    "history", [(0,), (-1, 2), (3, 3), (3, 1), (1.0,), (True,), 3, "13", (201,), range(1, 202)]
)
def test_what_is_no_history_is_refused(history: Any) -> None:
    for kind in (PathFollowingEnv, PathFollowingVectorEnv):
        with pytest.raises(ParameterError, match="history must be rising whole numbers from 1 to"):
            kind(history=history)


def test_wrong_actions_move_nothing() -> None:
    env = PathFollowingVectorEnv(2, history=(1,), action_unit="volt")
    env.reset(seed=0)
    before = env.get_state()
    for wrong in (np.full((2, 4), 24.1), np.full((2, 4), np.nan), np.zeros((2, 3))):
        with pytest.raises(ActionError):
            env.step(wrong)
    for name, part in env.get_state().items():
        np.testing.assert_array_equal(part, before[name])


def agrees(layout: Any, truth: np.ndarray, telemetry: np.ndarray) -> None:
    """What the telemetry records is what the truth says."""
    for name, column in {
        "theta_a": COLUMN.theta.a,
        "theta_b": COLUMN.theta.b,
        "reached": COLUMN.reached,
        "torque_2": COLUMN.torque[1],
        "told_time_constant": COLUMN.told.time_constant,
        "told_hand_push": COLUMN.told.hand_push,
        "hand_push": COLUMN.told.hand_push,
    }.items():
        np.testing.assert_array_equal(truth[..., layout.index(name)], telemetry[..., column], name)


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
@pytest.mark.parametrize("more", [{}, {"base": "impedance", "history": (2,)}], ids=["", "a base"])
def test_what_no_sensor_shows_is_the_truth_before_a_reset_too(
    mode: str, more: dict[str, Any]
) -> None:
    keywords = {**SHORT, **more, "privileged": True}
    worlds = PathFollowingVectorEnv(
        WORLDS, autoreset_mode=mode, max_episode_steps=LIMIT, **keywords
    )
    alone = PathFollowingEnv(**keywords)
    layout = worlds.privileged_layout
    _, infos = worlds.reset(seed=3)
    _, info = alone.reset(seed=3 + WORLDS - 1)
    ends = 0
    waits = False
    for given in actions(worlds):
        truth = infos["privileged"]
        assert truth.shape == (WORLDS, len(layout))
        np.testing.assert_array_equal(truth, worlds.batch.privileged())
        agrees(layout, truth, infos["telemetry"])
        np.testing.assert_array_equal(truth[-1], info["privileged"])
        _, _, terminated, truncated, infos = worlds.step(given)
        if waits:
            _, info = alone.reset()
            waits = False
            continue
        *_, info = alone.step(given[-1])
        ended = terminated | truncated
        if ended.any() and mode == "SAME_STEP":
            final = infos["final_info"]
            agrees(layout, final["privileged"][ended], final["telemetry"][ended])
            np.testing.assert_array_equal(final["_privileged"], ended)
            assert not final["privileged"][~ended].any()
        if ended[-1]:
            ends += 1
            if mode == "SAME_STEP":
                np.testing.assert_array_equal(final["privileged"][-1], info["privileged"])
                _, info = alone.reset()
            waits = mode == "NEXT_STEP"
    assert ends > 2


def test_the_truth_has_names_scales_and_no_addresses() -> None:
    env = PathFollowingVectorEnv(64, privileged=True, **SHORT)
    layout = env.privileged_layout
    _, infos = env.reset(seed=0)
    assert np.abs(infos["privileged"] / layout.scales).max() < 100.0
    told = np.isin(env.batch.truth_entries, env.batch.privileged_entries)
    np.testing.assert_array_equal(infos["privileged"], env.batch.truth()[:, told])
    assert all(field.unit and field.meaning for field in layout.fields)
    plain, _ = PathFollowingVectorEnv(64, **SHORT).reset(seed=0)
    np.testing.assert_array_equal(env.reset(seed=0)[0], plain)


@pytest.mark.agents
def test_stable_baselines_has_the_same_rows() -> None:
    pytest.importorskip("stable_baselines3")
    from pter_gym.envs.sb3 import make_sb3_vec_env

    own: dict[str, Any] = {
        **SHORT,
        "history": HISTORY,
        "privileged": True,
        "max_episode_steps": LIMIT,
    }
    venv = make_sb3_vec_env(WORLDS, **own)
    worlds = PathFollowingVectorEnv(WORLDS, autoreset_mode="SAME_STEP", **own)
    venv.seed(3)
    obs, infos = worlds.reset(seed=3)
    assert venv.reset().tobytes() == obs.tobytes()
    for world, told in enumerate(venv.reset_infos):
        np.testing.assert_array_equal(told["privileged"], infos["privileged"][world])
    for given in actions(worlds):
        theirs, _, dones, listed = venv.step(given)
        obs, *_, infos = worlds.step(given)
        assert theirs.tobytes() == obs.tobytes()
        for world, told in enumerate(listed):
            truth = infos["privileged"][world]
            if dones[world]:
                np.testing.assert_array_equal(
                    told["terminal_observation"], infos["final_obs"][world]
                )
                np.testing.assert_array_equal(venv.reset_infos[world]["privileged"], truth)
                truth = infos["final_info"]["privileged"][world]
            np.testing.assert_array_equal(told["privileged"], truth)
