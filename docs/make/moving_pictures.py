"""Make the moving pictures: `python docs/make/moving_pictures.py [side-by-side] [paths] …`, all by default.

`side-by-side.webp` has a tuned law and a trained policy on the same episode, a scenario's name that scenario under one
trained policy, and `policies` a still picture of each policy at the end of one episode. Needs the extra `render`.
"""

import io
from collections.abc import Callable
from pathlib import Path

import tyro
from pages import IMAGES
from PIL import Image

from pter_gym.benchmark import find_policy
from pter_gym.benchmark.simulation import record_episode, time_limit
from pter_gym.controllers import CONTROLLERS
from pter_gym.internal.files import write_bytes_atomic
from pter_gym.params import Machine
from pter_gym.policies import shipped_policies
from pter_gym.render.film import Film, Shot
from pter_gym.render.picture import Subject
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.tasks.path_following import PathFollowing

MOVING = IMAGES / "moving"
POLICIES = IMAGES / "policies"
COMPARED = ("torque-feedback-tuned", "residual")
ALONE = "residual"
PACE = "medium"
DRAWS = 16
SEED = 2**31 + 15  # of no training
EPISODE = {"standard": 0, "paths": 13, "hands": 3, "materials": 1, "everything": 9, "tremor": 0}
"""The draw of each scenario that is shown: of those with other paths, the first sine with the paper's kind of hand."""

RATE = 12.5  # frames in a second, in real time


def drawn(scenario: str) -> tuple[Machine, PathFollowing]:
    """Return machine and task of the episode of a scenario that is shown."""
    draws = find_scenario(scenario).randomisation(PACE, contexts=DRAWS, seed=SEED)
    return list(draws.pairs())[EPISODE[scenario]]


def film(names: tuple[str, ...], scenario: str, size: tuple[int, int]) -> Film:
    """The same episode of policies, side by side."""
    machine, task = drawn(scenario)
    shots = [
        Shot(
            Subject(machine, task, name),
            record_episode(find_policy(name, scenario=scenario), machine, task, SEED, time_limit(task)).telemetry,
        )
        for name in names
    ]
    return Film(shots, RATE, size=size)


def write(content: io.BytesIO, path: Path) -> None:
    """Write a picture, and say how large it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomic(path, content.getvalue())
    print(f"wrote {path}: {len(content.getvalue()) / 1000:.0f} kB")


def write_moving(shown: Film, path: Path) -> None:
    """Write a film as an animated WebP, which repeats."""
    first, *others = (Image.fromarray(shown.pixels(frame)) for frame in range(len(shown)))
    content = io.BytesIO()
    duration = round(1000 / RATE)
    first.save(content, "WEBP", save_all=True, append_images=others, duration=duration, loop=0, quality=40, method=4)
    write(content, path)


def side_by_side() -> None:
    """A tuned law and a trained policy on the same episode of the paper's setting."""
    write_moving(film(COMPARED, "standard", (720, 405)), MOVING / "side-by-side.webp")


def alone(scenario: str) -> Callable[[], None]:
    """Return what draws an episode of a scenario under one trained policy."""

    def draw() -> None:
        write_moving(film((ALONE,), scenario, (600, 428)), MOVING / f"{scenario}.webp")

    return draw


def policies() -> None:
    """Each policy at the end of the same episode of the paper's setting."""
    for name in policy_names():
        shown = film((name,), "standard", (600, 428))
        content = io.BytesIO()
        Image.fromarray(shown.pixels(len(shown) - 1)).save(content, "WEBP", quality=80, method=4)
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
