"""Stable-Baselines3's ``VecEnv`` over the batch: contract, wrappers, algorithms, same episodes.

And the callback that assesses a model.
"""

import csv
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import pter_gym
from pter_gym.benchmark import Assessment, examine, from_sb3
from pter_gym.errors import ActionError, ParameterError
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.paths import Line
from pter_gym.policies import read_policy
from pter_gym.tasks.path_following import STARTS, PathFollowing
from rollouts import Acting

pytestmark = pytest.mark.agents

algorithms = pytest.importorskip("stable_baselines3")
vec_env = pytest.importorskip("stable_baselines3.common.vec_env")

ID = "PTER/PathFollowing-v0"
COUNT = 6
LIMIT = 19
TASK = PathFollowing(
    path=Line(length=0.55), start_offset=0.02, hand=MultiSineHand(random_phases=True)
)


def make(count: int = COUNT, **options: Any) -> Any:
    from pter_gym.envs.sb3 import make_sb3_vec_env

    return make_sb3_vec_env(count, **{"task": TASK, "max_episode_steps": LIMIT, **options})


def actions(steps: int = 250, count: int = COUNT) -> np.ndarray:
    """Random normalised actions, half of them without voltage, so episodes end in both ways."""
    rng = np.random.default_rng(11)
    drawn = 2.0 * np.sqrt(rng.uniform(0.0, 1.0, (steps, count, 4))) - 1.0
    return np.where(rng.random((steps, count, 1)) < 0.5, -1.0, drawn).astype(np.float32)


def test_same_episodes_as_stable_baselines_own_vec_env_of_single_environments() -> None:
    ours = make()
    theirs = vec_env.DummyVecEnv(
        [
            lambda: algorithms.common.monitor.Monitor(
                gymnasium.make(ID, task=TASK, max_episode_steps=LIMIT)
            )
        ]
        * COUNT
    )
    ours.seed(40)
    theirs.seed(40)
    assert ours.reset().tobytes() == theirs.reset().tobytes()
    returns = np.zeros((2, COUNT))
    ends = {"terminated": 0, "truncated": 0}
    for row in actions():
        obs, rewards, dones, infos = ours.step(row)
        their_obs, their_rewards, their_dones, their_infos = theirs.step(row)
        for mine, other in ((obs, their_obs), (rewards, their_rewards), (dones, their_dones)):
            assert (mine.dtype, mine.tobytes()) == (other.dtype, other.tobytes())
        returns += [rewards, their_rewards]
        for info, their_info, done in zip(infos, their_infos, dones, strict=True):
            assert info["TimeLimit.truncated"] is their_info["TimeLimit.truncated"]
            assert (
                ("terminal_observation" in info) == ("terminal_observation" in their_info) == done
            )
            if done:
                assert (
                    info["terminal_observation"].tobytes()
                    == their_info["terminal_observation"].tobytes()
                )
                assert info["is_success"] is their_info["is_success"]
                mine, other = info["episode"], their_info["episode"]
                assert (mine.keys(), mine["r"], mine["l"]) == (other.keys(), other["r"], other["l"])
                ends["truncated" if info["TimeLimit.truncated"] else "terminated"] += 1
    assert returns[0].tobytes() == returns[1].tobytes()
    assert min(ends.values()) > 3, ends


def test_seed_holds_for_one_reset() -> None:
    env = make()
    assert env.seed(7) == list(range(7, 7 + COUNT))
    first = env.reset()
    second = env.reset()
    assert first.tobytes() != second.tobytes()
    env.seed(7)
    assert env.reset().tobytes() == first.tobytes()
    assert env.reset().tobytes() == second.tobytes()


def test_reset_infos_options_and_attributes() -> None:
    env = make()
    env.reset()
    assert env.reset_infos == [{}] * COUNT
    assert len({id(info) for info in env.reset_infos}) == COUNT
    assert env.get_attr("num_envs", [0, 2]) == [COUNT, COUNT]
    assert env.get_attr("render_mode") == [None] * COUNT
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False] * COUNT
    assert env.env_is_wrapped(algorithms.common.monitor.Monitor) == [True] * COUNT
    assert env.has_attr("autoreset_mode")
    assert not env.has_attr("gravity")
    with pytest.raises(ParameterError, match="num_envs"):
        env.set_attr("num_envs", 3)
    wrong: list[Any] = [{"speed": 1.0}, 5]
    for options in wrong:
        env.set_options(options)
        with pytest.raises(ParameterError, match="options"):
            env.reset()
        env.reset()  # what was refused is forgotten
    env.seed(-5)
    with pytest.raises(ParameterError, match="seed"):
        env.reset()
    env.reset()


def test_worlds_are_drawn_as_one_picture() -> None:
    pytest.importorskip("pygame")
    env = make(3, render_mode="rgb_array", width=64, height=48)
    env.reset()
    assert env.get_attr("render_mode") == ["rgb_array"] * 3
    assert [image.shape for image in env.get_images()] == [(48, 64, 3)] * 3
    picture = env.render()
    assert picture is not None
    assert picture.shape == (96, 128, 3)


def test_bad_actions_and_a_closed_environment_raise() -> None:
    env = make()
    env.reset()
    with pytest.raises(ActionError, match="shape"):
        env.step(np.zeros((COUNT + 1, 4), np.float32))
    env.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        env.step(np.zeros((COUNT, 4), np.float32))


@pytest.mark.slow
def test_sac_learns() -> None:
    pytest.importorskip("torch").set_num_threads(1)
    model = algorithms.SAC(
        "MlpPolicy",
        make(),
        learning_starts=60,
        batch_size=32,
        train_freq=4,
        policy_kwargs={"net_arch": [16, 16]},
        seed=0,
        device="cpu",
    )
    model.learn(total_timesteps=600)
    assert model.num_timesteps == 600
    assert len(model.ep_info_buffer) > 3
    buffer = model.replay_buffer
    # an episode's last transition leads to its last observation, not to the start of the next
    assert buffer.dones[: buffer.pos].any()
    following = buffer.next_observations[: buffer.pos - 1] == buffer.observations[1 : buffer.pos]
    ended = buffer.dones[: buffer.pos - 1].astype(bool) | (buffer.timeouts[: buffer.pos - 1] > 0)
    assert following.all(axis=-1)[~ended].all()
    assert not following.all(axis=-1)[ended].any()


def test_missing_stable_baselines_says_what_to_install() -> None:
    program = (
        "import sys; sys.modules['stable_baselines3'] = None\n"
        "try: import pter_gym.envs.sb3\n"
        "except ImportError as error: print(error)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert "'.[agents]'" in result.stdout


def test_a_trained_policy_acts_in_it_and_is_reset_by_its_user() -> None:
    from pter_gym.envs.sb3 import make_sb3_vec_env

    env = make_sb3_vec_env(
        3, task=replace(TASK, start_offset=0.0, truncation_error=0.02, starts=STARTS["path"])
    )
    watched = vec_env.VecCheckNan(env)
    policy = pter_gym.load_policy("residual", watched)
    bound = read_policy("residual").bind(BASELINE, env.env.observation_layout)
    alone = [Acting(bound) for _ in range(3)]
    watched.seed(0)
    observations, began = watched.reset(), 0
    for _ in range(100):
        chosen = policy(observations)
        volts = [act(row) for act, row in zip(alone, observations, strict=True)]
        np.testing.assert_allclose(24.0 * ((chosen + 1.0) / 2.0) ** 2, volts, atol=1e-3)
        observations, _, done, _ = watched.step(chosen)
        began += 0 < done.sum() < 3
        policy.reset(done)
        for world in np.flatnonzero(done):
            alone[world].reset()
    assert began >= 2
    with pytest.raises(ParameterError, match="VecNormalize"):
        pter_gym.load_policy("residual", vec_env.VecNormalize(env))


@pytest.mark.smoke
@pytest.mark.parametrize("kind", ["batch", "dummy"])
def test_models_of_stable_baselines_bring_that_of_their_environment(kind: str) -> None:
    from stable_baselines3.common.env_util import make_vec_env

    from pter_gym.envs.sb3 import make_sb3_vec_env

    keywords: dict[str, Any] = {"frame_skip": 4}
    made = {
        "batch": lambda: make_sb3_vec_env(2, **keywords),
        "dummy": lambda: make_vec_env("PTER/Standard-v0", 2, env_kwargs=keywords),
    }[kind]()
    model = algorithms.PPO("MlpPolicy", made, n_steps=8, batch_size=8, device="cpu")
    assert from_sb3(model).frame_skip == 4
    assert from_sb3(model, frame_skip=2).frame_skip == 2
    with pytest.raises(ParameterError, match="frame_skip"):
        from_sb3(model, frame_skip=0)
    with pytest.raises(ParameterError, match="frame_skip"):
        pter_gym.load_policy(from_sb3(model), gymnasium.make("PTER/PathFollowing-v0"))


KINDS: dict[str, dict[str, Any]] = {
    "PPO": {"n_steps": 16, "batch_size": 16},
    "SAC": {"learning_starts": 8, "batch_size": 8},
}


def small(kind: str, env: Any) -> Any:
    """A model with a small network."""
    options = {"policy_kwargs": {"net_arch": [8]}, "device": "cpu", "seed": 0, **KINDS[kind]}
    return getattr(algorithms, kind)("MlpPolicy", env, **options)


ASSESSED: dict[str, dict[str, Any]] = {
    "PPO": {"scenario": "standard", "machine": "pter-clutch", "starts": "path", "error_max": 0.1},
    "SAC": {"scenario": "standard", "base": "single-dof-tuned", "pace": "brisk"},
}


def parameters(model: Any) -> dict[str, Any]:
    return {name: each.clone() for name, each in model.policy.state_dict().items()}


@pytest.mark.parametrize("kind", ["PPO", "SAC"])
def test_a_callback_assesses_as_the_benchmark_does(kind: str, tmp_path: Path) -> None:
    from pter_gym.envs.sb3 import PathErrorCallback, make_sb3_vec_env

    given, trained = ASSESSED[kind], list[Any]()
    callback = PathErrorCallback(40, tmp_path / "best", episodes=2, verbose=0)
    for callbacks in (None, callback):
        venv = vec_env.VecNormalize(make_sb3_vec_env(2, **given), clip_obs=3.0)
        model = small(kind, venv)
        model.set_logger(algorithms.common.logger.configure(str(tmp_path), ["csv", "tensorboard"]))
        trained.append(parameters(model.learn(96, callbacks)))
        model.logger.close()
    for name, values in trained[0].items():
        assert values.equal(trained[1][name]), name
    latest = callback.assessments[-1]
    steps = [each.steps for each in callback.assessments]
    assert steps == ([0, 64, 96] if kind == "PPO" else [0, 40, 80, 96])
    paces = ("slow", "medium", "brisk") if kind == "PPO" else ("brisk",)
    assert tuple(latest.paces) == paces
    with (tmp_path / "progress.csv").open() as text:
        (*_, logged) = csv.DictReader(text)
    for pace, found in latest.paces.items():
        draws = {"scenario": "standard", "pace": pace, "machine": given.get("machine")}
        assert found == examine({"mine": from_sb3(model, venv)}, **draws, episodes=2)["mine"]
        assert float(logged[f"path_error_mm/{pace}"]) == 1000 * found.path_error_m
        assert float(logged[f"completed/{pace}"]) == found.completed
        assert float(logged[f"ranked/{pace}"]) == found.ranked
    assert float(logged["path_error_mm/mean"]) == 1000 * latest.path_error_m
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    read = events.EventAccumulator(str(tmp_path)).Reload()
    points = read.Scalars(f"path_error_mm/{paces[0]}")
    assert [point.step for point in points] == steps
    again = vec_env.VecNormalize.load(
        str(tmp_path / "best" / "vecnormalize.pkl"), make_sb3_vec_env(2, **given)
    )
    best = type(model).load(tmp_path / "best" / "best_model", again)
    error = examine({"mine": from_sb3(best)}, **draws, episodes=2)["mine"]
    assert error == callback.best.paces[pace]


def test_the_best_model_is_kept_and_not_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ranked models come first, then the smallest error."""
    from pter_gym.envs import sb3

    model = small("PPO", sb3.make_sb3_vec_env(2, scenario="standard"))
    results = iter([(5, 0.3), (40, 0.0), (20, 0.0), (30, 0.0), (1, 0.16)])
    known: list[dict[str, Any]] = []

    def given(*_: object) -> Assessment:
        known.append(parameters(model))
        error, uneven = next(results)
        return Assessment(1e-3 * error, 1.0, 0.0, uneven)

    monkeypatch.setattr(sb3, "assess", given)
    callback = sb3.PathErrorCallback(1, tmp_path, paces=0.3)
    model.learn(4 * 32, callback)
    assert callback.best is callback.assessments[2]
    assert next(results, None) is None
    assert [path.name for path in tmp_path.iterdir()] == ["best_model.zip"]
    kept = parameters(algorithms.PPO.load(tmp_path / "best_model"))
    assert all(kept[name].equal(values) for name, values in known[2].items())
    assert not all(kept[name].equal(values) for name, values in known[3].items())
    printed = capsys.readouterr().out.splitlines()
    assert printed[1] == "        32 steps   0.3  40.0 mm"
    assert printed[-1].endswith("0.3   1.0 mm (unranked)")


def test_a_task_is_assessed_from_rest_to_its_end() -> None:
    env = make(task=replace(TASK, starts=STARTS["path"], truncation_error=0.03, pace=0.3))
    (scenario, *_), (paces, *_) = env.get_attr("scenario"), env.get_attr("paces")
    assert scenario.draws.varied_task.template == replace(TASK, pace=0.3)
    assert paces == ("0.3",)


def test_what_cannot_be_assessed_is_refused_before_training(tmp_path: Path) -> None:
    from pter_gym.envs.sb3 import PathErrorCallback, make_sb3_vec_env

    wrong: dict[str, Any] = {
        "eval_freq": 0,
        "episodes": 2.5,
        "paces": ("slow", "fast"),
        "best_model_save_path": "",
    }
    for name, value in wrong.items():
        with pytest.raises(ParameterError, match=name):
            PathErrorCallback(**{name: value})
    (tmp_path / "file").touch()
    names = ("standard", "paths")
    kinds: list[Any] = [
        lambda name=name: gymnasium.make("PTER/Standard-v0", scenario=name) for name in names
    ]
    refused = {
        "best_model_save_path": (
            make_sb3_vec_env(2, scenario="standard"),
            {"best_model_save_path": tmp_path / "file"},
        ),
        "one for all worlds": (make(2, task=[TASK, TASK]), {}),
        "one scenario": (vec_env.DummyVecEnv(kinds), {}),
        "VecFrameStack": (vec_env.VecFrameStack(make_sb3_vec_env(2), 2), {}),
    }
    for message, (env, given) in refused.items():
        model = small("PPO", env)
        with pytest.raises(ParameterError, match=message):
            model.learn(32, PathErrorCallback(**given))
        assert model.num_timesteps == 0
