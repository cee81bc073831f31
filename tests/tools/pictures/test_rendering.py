"""Rendering through Gymnasium: one world and many, wrappers that record, and refusals."""

import pickle
import subprocess
import sys
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RecordVideo, vector as wrappers

import pter_gym  # noqa: F401  (registers the environments)
from pter_gym.errors import ParameterError

ID = "PTER/PathFollowing-v0"
SMALL: dict[str, Any] = {"render_mode": "rgb_array", "width": 240, "height": 180}
SHAPE = (180, 240, 3)


def make_vec(count: int, name: str = ID, **keywords: Any) -> Any:
    return gymnasium.make_vec(name, num_envs=count, **{**SMALL, **keywords})


def braking(count: int) -> np.ndarray:
    """Return actions that brake with 3 V."""
    return np.full((count, 4), 2.0 * (3.0 / 24.0) ** 0.5 - 1.0, np.float32)


@pytest.mark.parametrize(("width", "height"), [(32, 64), (1920, 1080)])
def test_a_picture_has_the_size_that_was_asked_for(width: int, height: int):
    env = gymnasium.make(ID, render_mode="rgb_array", width=width, height=height)
    env.reset(seed=0)
    picture: Any = env.render()
    assert picture.shape == (height, width, 3)
    assert picture.dtype == np.uint8


@pytest.mark.parametrize(
    ("field", "bad"), [("width", 0), ("height", 2.5), ("height", "wide"), ("width", 10**5)]
)
def test_a_bad_size_is_refused(field: str, bad: Any):
    with pytest.raises(ParameterError, match=field):
        gymnasium.make(ID, **{**SMALL, field: bad})
    with pytest.raises(ParameterError, match=field):
        make_vec(2, **{field: bad})


def test_many_worlds_give_a_picture_each():
    env = make_vec(3)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.render()
    env.reset(seed=5)
    env.step(braking(3))
    frames = env.render()
    assert isinstance(frames, tuple)
    assert [frame.shape for frame in frames] == [SHAPE] * 3
    assert all(frame.dtype == np.uint8 and frame.flags.writeable for frame in frames)
    assert env.metadata["render_modes"] == ["rgb_array"]
    assert env.metadata["render_fps"] == 100


@pytest.mark.parametrize(("name", "drawn"), [(ID, {}), ("PTER/Everything-v0", {"contexts": 3})])
def test_a_world_is_drawn_the_same_among_many(name: str, drawn: dict[str, Any]):
    """With its own machine, task and trail, in each episode."""
    many = make_vec(2, name, max_episode_steps=4, **drawn)
    alone: Any = gymnasium.make(name, **SMALL, max_episode_steps=4, **drawn)
    many.reset(seed=[7, 9])
    alone.reset(seed=9)
    for _ in range(2):
        for _ in range(4):
            np.testing.assert_array_equal(many.render()[1], alone.render())
            many.step(braking(2))
            _, _, _, truncated, _ = alone.step(braking(1)[0])
        np.testing.assert_array_equal(many.render()[1], alone.render())
        assert truncated
        many.step(braking(2))
        alone.reset()


@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_trail_begins_with_its_episode(mode: AutoresetMode):
    env = make_vec(2, autoreset_mode=mode, max_episode_steps=3)
    env.reset(seed=0)
    first = env.render()
    for _ in range(3):
        env.step(braking(2))
    if mode == AutoresetMode.NEXT_STEP:
        env.step(braking(2))
    if mode == AutoresetMode.DISABLED:
        before = env.render()
        env.reset(options={"reset_mask": np.array([True, False])})
        np.testing.assert_array_equal(env.render()[1], before[1])
        np.testing.assert_array_equal(env.render()[0], first[0])
        return
    for now, then in zip(env.render(), first, strict=True):
        np.testing.assert_array_equal(now, then)


def test_rendering_changes_nothing_else():
    """Neither what comes out nor, without telemetry, what the infos hold."""
    drawn, plain = make_vec(3, telemetry=False), make_vec(3, telemetry=False, render_mode=None)
    for (obs, infos), (same_obs, same_infos) in [(drawn.reset(seed=1), plain.reset(seed=1))]:
        np.testing.assert_array_equal(obs, same_obs)
        assert infos.keys() == same_infos.keys()
    for _ in range(5):
        got, expected = drawn.step(braking(3)), plain.step(braking(3))
        drawn.render()
        for one, other in zip(got[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(one, other)
        assert got[4].keys() == expected[4].keys()


@pytest.mark.parametrize(
    "copied", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["deepcopy", "pickle"]
)
@pytest.mark.parametrize(
    "make", [lambda: gymnasium.make(ID, **SMALL), lambda: make_vec(2)], ids=["one", "many"]
)
def test_rendered_environments_can_be_copied(make: Callable[[], Any], copied: Callable[[Any], Any]):
    env = make()
    env.reset(seed=1)
    env.step(env.action_space.sample())
    before, other = env.render(), copied(env)
    np.testing.assert_array_equal(before, other.render())
    other.step(other.action_space.sample())
    other.render()
    np.testing.assert_array_equal(before, env.render())


def test_without_a_render_mode_nothing_is_rendered():
    env = gymnasium.make_vec(ID, num_envs=2)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="nothing is rendered"):
        assert env.render() is None


def test_another_render_mode_of_many_worlds_is_refused():
    with pytest.raises(ParameterError, match="render_mode"):
        make_vec(2, render_mode="human")


def test_without_a_render_mode_no_drawing_code_is_loaded():
    code = (
        "import sys, gymnasium, pter_gym\n"
        "env = gymnasium.make('PTER/PathFollowing-v0'); env.reset(seed=0)\n"
        "env.step(env.action_space.sample())\n"
        "gymnasium.make_vec('PTER/PathFollowing-v0', 2)\n"
        "print([name for name in sys.modules if name.startswith('pter_gym.tools.pictures')])"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        == "[]\n"
    )


def frames_in(path: Path) -> int:
    import imageio_ffmpeg

    return imageio_ffmpeg.count_frames_and_secs(str(path))[0]


def test_gymnasium_records_one_world_and_many(tmp_path: Path):
    pytest.importorskip("moviepy")
    if not hasattr(wrappers, "RecordVideo"):
        pytest.skip("this Gymnasium records no vector environments")
    one = RecordVideo(
        gymnasium.make(ID, **SMALL), str(tmp_path / "one"), episode_trigger=lambda _: True
    )
    four = wrappers.RecordVideo(make_vec(4), str(tmp_path / "four"), episode_trigger=lambda _: True)
    for name, env, actions in (("one", one, braking(1)[0]), ("four", four, braking(4))):
        env.reset(seed=0)
        for _ in range(9):
            env.step(actions)
        env.close()
        (video,) = (tmp_path / name).iterdir()
        assert frames_in(video) == 10
