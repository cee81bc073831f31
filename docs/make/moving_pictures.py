"""Make the moving pictures: `python docs/make/moving_pictures.py [side-by-side] [paths] …`, all by default.

`side-by-side.webp` has a tuned law and a trained policy on the same episode, a scenario's name that scenario under one
trained policy, and `policies` a still picture of each policy at the end of one episode. Needs the extra `render`.
"""

import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from pages import IMAGES
from PIL import Image, ImageDraw, ImageFont

from pter_gym.benchmark import find_policy
from pter_gym.benchmark.simulation import time_limit
from pter_gym.controllers import CONTROLLERS, bind
from pter_gym.envs.single import PathFollowingEnv
from pter_gym.internal.files import write_bytes_atomic
from pter_gym.params import BASELINE, Machine
from pter_gym.policies import shipped_policies
from pter_gym.render import style
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.tasks.path_following import PathFollowing

Frame = NDArray[np.uint8]

MOVING = IMAGES / "moving"
POLICIES = IMAGES / "policies"
COMPARED = ("single-dof-tuned", "residual")
ALONE = "residual"
PACE = "medium"
DRAWS = 16
SEED = 2**31 + 15  # of no training
EPISODE = {"standard": 0, "paths": 13, "hands": 3, "materials": 1, "everything": 9}
"""The draw of each scenario that is shown: of those with other paths, the first sine with the paper's kind of hand."""

STRIDE = 7  # control steps of 10 ms from frame to frame: 14 frames in a second, in real time
REST = 1500  # ms that the last frame stays
SCENE = style.WIDTH - style.PANEL_WIDTH


def drawn(scenario: str) -> tuple[Machine, PathFollowing]:
    """Return machine and task of the episode of a scenario that is shown."""
    draws = find_scenario(scenario).randomisation(PACE, contexts=DRAWS, seed=SEED)
    return list(draws.pairs())[EPISODE[scenario]]


def frames(name: str, scenario: str, machine: Machine, task: PathFollowing) -> Iterator[Frame]:
    """Yield pictures (height, width, 3) of an episode of a policy."""
    env = PathFollowingEnv(machine, task, render_mode="rgb_array")
    policy = bind(find_policy(name, scenario=scenario), BASELINE, env.observation_layout)
    observation, _ = env.reset(seed=SEED)
    policy.reset()
    ended = False
    for step in range(time_limit(task)):
        if step % STRIDE == 0:
            yield picture(env)
        observation, _, terminated, truncated, _ = env.step(policy.act(observation[None])[0])
        if ended := terminated or truncated:
            break
    yield picture(env)
    env.close()
    print(f"{scenario}: {name} {'has ended' if ended else 'runs out of time'} after {(step + 1) / 100:g} s")


def picture(env: PathFollowingEnv) -> Frame:
    """The environment's picture."""
    shown: Any = env.render()
    return shown


def scene(frame: Frame) -> Frame:
    """The arm on its path, without the panel of the clutches and the legend above."""
    return frame[48:, :SCENE]


def named(frame: Frame, name: str) -> Frame:
    """The scene of a frame below the name of its policy."""
    head = Image.new("RGB", (SCENE, 40), style.BACKGROUND)
    font = ImageFont.load_default(22)
    ImageDraw.Draw(head).text((SCENE / 2, 22), name, style.INK, font, anchor="mm")
    return np.concatenate([np.asarray(head), scene(frame)])


def abreast(episodes: Sequence[Sequence[Frame]]) -> list[Frame]:
    """Frames of several episodes beside each other; who is done first waits."""
    longest = max(map(len, episodes))
    return [np.concatenate([each[min(k, len(each) - 1)] for each in episodes], axis=1) for k in range(longest)]


def write(content: io.BytesIO, path: Path) -> None:
    """Write a picture, and say how large it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomic(path, content.getvalue())
    print(f"wrote {path}: {len(content.getvalue()) / 1000:.0f} kB")


def write_moving(shown: Sequence[Frame], path: Path, width: int) -> None:
    """Write frames as an animated WebP of so many pixels across, which repeats."""
    height = round(width * shown[0].shape[0] / shown[0].shape[1])
    images = [Image.fromarray(frame).resize((width, height), Image.Resampling.LANCZOS) for frame in shown]
    times = [10 * STRIDE] * (len(images) - 1) + [REST]
    content = io.BytesIO()
    images[0].save(
        content, "WEBP", save_all=True, append_images=images[1:], duration=times, loop=0, quality=50, method=4
    )
    write(content, path)


def side_by_side() -> None:
    """A tuned law and a trained policy on the same episode of everything."""
    machine, task = drawn("everything")
    episodes = [[named(frame, name) for frame in frames(name, "everything", machine, task)] for name in COMPARED]
    write_moving(abreast(episodes), MOVING / "side-by-side.webp", 840)


def alone(scenario: str) -> Callable[[], None]:
    """Return what draws an episode of a scenario under one trained policy."""

    def draw() -> None:
        shown = [*frames(ALONE, scenario, *drawn(scenario))]
        write_moving(shown, MOVING / f"{scenario}.webp", 600)

    return draw


def policies() -> None:
    """Each policy at the end of the same episode of the paper's setting."""
    machine, task = drawn("standard")
    for name in policy_names():
        *_, last = frames(name, "standard", machine, task)
        content = io.BytesIO()
        Image.fromarray(last).resize((630, 450), Image.Resampling.LANCZOS).save(content, "WEBP", quality=80, method=4)
        write(content, POLICIES / f"{name}.webp")


def policy_names() -> list[str]:
    """The policies of the leaderboards: those of the paper with and without tuning, trained ones, ends of the scale."""
    guided = [name for name in CONTROLLERS if name not in ("free", "locked", "random")]
    tuned = [f"{name}-tuned" for name in guided]
    return [*sorted(shipped_policies()), *tuned, "impedance", "torque-feedback", "free", "locked", "random"]


PICTURES: dict[str, Callable[[], None]] = {
    "side-by-side": side_by_side,
    **{name: alone(name) for name in SCENARIOS},
    "policies": policies,
}


def main(names: tyro.conf.Positional[tuple[str, ...]] = tuple(PICTURES)) -> None:
    """Make the moving pictures: side-by-side, the name of a scenario, policies; all by default."""
    for name in names:
        PICTURES[name]()


if __name__ == "__main__":
    tyro.cli(main)
