"""Learning libraries: each script runs, and learns within a minute; tensors of torch share the arrays' memory."""

import importlib
import importlib.util
import re
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from documents import load_script
from pter_gym.benchmark import examine, from_actions
from pter_gym.errors import ParameterError

pytestmark = [
    pytest.mark.agents,
    # the libraries' own: packages that they find deprecated, and what they do with their arguments
    pytest.mark.filterwarnings("ignore"),
]
torch = pytest.importorskip("torch")

ID = "PTER/Standard-v0"
FOLDER = Path(__file__).parents[2] / "agents" / "libraries"
PAGE = Path(__file__).parents[2] / "docs" / "learning-libraries.md"
NEEDS = {
    "rsl_rl_ppo": "rsl_rl",
    "sb3": "sb3_contrib",
    "skrl_ppo": "skrl",
    "torchrl_ppo": "torchrl",
    "zoo": "huggingface_sb3",  # which comes with the zoo; to import that would change Gymnasium's TimeLimit
}
TINY: dict[str, dict[str, Any]] = {name: {"steps": 512, "worlds": 8, "horizon": 32} for name in NEEDS}
TINY |= {"sb3": {"steps": 512, "worlds": 2}, "zoo": {"steps": 64}}
LEARNERS: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (f"{name}_ppo", {}) for name in ("rsl_rl", "skrl", "torchrl")},
    **{name: ("sb3", {"algorithm": name}) for name in ("ppo", "sac")},  # a minute is too short for TQC
}
SEEDS = 3


def train(script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **options: Any) -> Any:
    pytest.importorskip(NEEDS[script])
    if script == "zoo":
        options["out"] = tmp_path
    monkeypatch.chdir(tmp_path)
    return load_script(FOLDER / f"{script}.py").train(**options)


@pytest.mark.slow
@pytest.mark.parametrize("script", NEEDS)
def test_a_script_trains(script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    policy = train(script, tmp_path, monkeypatch, **TINY[script], seed=3)
    assert examine({script: policy}, episodes=2).keys() == {script, "free", "locked", "random"}


@pytest.mark.long
@pytest.mark.parametrize("name", LEARNERS)
def test_a_minute_teaches_most_seeds(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script, options = LEARNERS[name]
    trained = {f"{name} {seed}": train(script, tmp_path, monkeypatch, **options, seed=seed) for seed in range(SEEDS)}
    verdicts = examine(trained)
    known = min(verdicts[other].path_error_m for other in ("free", "random"))
    assert np.median([verdicts[each].path_error_m for each in trained]) < 0.5 * known, verdicts
    assert np.median([verdicts[each].completed for each in trained]) > 0.9, verdicts


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ["ppo", "sac", "tqc"])
def test_all_interfaces_of_stable_baselines_train_alike(
    algorithm: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"algorithm": algorithm, "steps": 8192}
    trained = {door: train("sb3", tmp_path, monkeypatch, **options, door=door) for door in ("native", "make_vec_env")}
    trained["zoo"] = train("zoo", tmp_path, monkeypatch, **options)
    verdicts = examine(trained, episodes=8)
    assert verdicts["native"] == verdicts["make_vec_env"] == verdicts["zoo"]
    assert verdicts["native"] not in [verdicts[other] for other in ("free", "locked", "random")]


def test_tensors_share_the_memory_of_the_arrays_and_keep_what_they_hold() -> None:
    envs = gymnasium.make_vec(ID, 4, action_unit="normalised", autoreset_mode="SAME_STEP", telemetry=False)
    obs, _ = envs.reset(seed=0)
    kept: list[tuple[Any, Any]] = []
    actions = torch.zeros(4, 4)
    for _ in range(3):
        for array in (obs, *envs.step(actions.numpy())[:4]):
            for tensor in (torch.from_dlpack(array), torch.as_tensor(array)):
                assert tensor.data_ptr() == array.ctypes.data
                kept.append((tensor, array.copy()))
        obs = envs.step(actions)[0]  # a tensor of torch is taken, too
    for tensor, then in kept:
        np.testing.assert_array_equal(tensor.numpy(), then)
    addresses = {tensor.data_ptr() for tensor, _ in kept}
    assert len(addresses) == len(kept) // 2


def rsl_rl(worlds: int = 4, mode: str = "SAME_STEP", **options: Any) -> Any:
    pytest.importorskip("rsl_rl")
    door = importlib.import_module("pter_gym.envs.rsl_rl")
    envs = gymnasium.make_vec(ID, worlds, action_unit="normalised", autoreset_mode=mode, telemetry=False, **options)
    return door.RslRlVecEnv(envs, seed=7)


def test_rsl_rl_sees_the_episodes_of_the_vector_environment() -> None:
    ours = rsl_rl(max_episode_steps=20)
    theirs = gymnasium.make_vec(
        ID, 4, action_unit="normalised", autoreset_mode="SAME_STEP", telemetry=False, max_episode_steps=20
    )
    obs, _ = theirs.reset(seed=7)
    np.testing.assert_array_equal(ours.get_observations()["policy"], obs)
    drawn, steps, ends = np.random.default_rng(1), np.zeros(4), 0
    for _ in range(60):
        actions = drawn.normal(size=(4, 4)).astype(np.float32)
        obs, rewards, terminated, truncated, _ = theirs.step(actions.clip(-1.0, 1.0))
        seen, pay, done, extras = ours.step(torch.as_tensor(actions))
        steps = np.where(terminated | truncated, 0, steps + 1)
        np.testing.assert_array_equal(seen["policy"], obs)
        np.testing.assert_array_equal(pay, rewards.astype(np.float32))
        np.testing.assert_array_equal(done, terminated | truncated)
        np.testing.assert_array_equal(extras["time_outs"], truncated & ~terminated)
        np.testing.assert_array_equal(ours.episode_length_buf, steps)
        ends += int(done.sum())
    assert ends >= 8
    assert ours.max_episode_length == 20


def test_rsl_rl_is_told_what_it_cannot_have() -> None:
    with pytest.raises(ParameterError, match="autoreset_mode must be SAME_STEP, got NEXT_STEP"):
        rsl_rl(mode="NEXT_STEP")
    with pytest.raises(ParameterError, match="init_at_random_ep_len must be False"):
        rsl_rl().episode_length_buf = torch.zeros(4)


def test_torchrl_sees_the_last_observation_of_an_episode() -> None:
    pytest.importorskip("torchrl")
    wrapper = importlib.import_module("torchrl.envs").GymWrapper
    drawn = {}
    for mode in ("DISABLED", "SAME_STEP"):
        envs = gymnasium.make_vec(
            ID, 4, action_unit="normalised", autoreset_mode=mode, telemetry=False, max_episode_steps=20
        )
        torch.manual_seed(0)
        world = wrapper(envs)
        world.set_seed(5)
        drawn[mode] = world.rollout(50, break_when_any_done=False)
    for data in drawn.values():
        ends = data["next", "done"][:, :-1, 0]
        assert int(ends.sum()) >= 8
        after, now = data["next", "observation"][:, :-1], data["observation"][:, 1:]
        assert torch.equal(after[~ends], now[~ends])
        assert (after[ends] != now[ends]).any(dim=1).all()


@pytest.mark.parametrize("unit", ["volt", "normalised"])
def test_actions_of_any_library_become_volts(unit: Any) -> None:
    envs = gymnasium.make_vec(ID, 2, action_unit=unit, telemetry=False)
    low, high = (torch.as_tensor(bound[:1]) for bound in (envs.action_space.low, envs.action_space.high))
    released = from_actions(lambda obs: low.expand(len(obs), 4), envs)
    held = from_actions(lambda obs: high.expand(len(obs), 4).requires_grad_() + 9.0, envs)
    verdicts = examine({"released": released, "held": held}, episodes=2)
    assert verdicts["released"] == verdicts["free"]
    assert verdicts["held"] == verdicts["locked"]


@pytest.mark.slow
def test_the_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    for library in ("stable_baselines3", "rsl_rl", "torchrl"):
        pytest.importorskip(library)
    exec("\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)), {})
    assert re.search(r"untrained  [\d.]+ mm", capsys.readouterr().out)
