"""Make pictures of README and the documents: `python docs/make/images.py [NAME …]`, all by default.

`error-against-pace.png` is made with the leaderboards, by `docs/make/scenario_pages.py`.
"""

from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
import pygame
import tyro
from figures.pages import clutches_over_time
from pages import IMAGES

from pter_gym.benchmark import find_policy
from pter_gym.benchmark.measures import column, four
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.commands.main import main as pter_command
from pter_gym.controllers import TorqueFeedback
from pter_gym.engine.batch import Batch
from pter_gym.physics.friction import ClutchMode
from pter_gym.plots import save
from pter_gym.scenarios import find_pace, find_scenario

TIME = 0.65

SCENARIO, PACE = "standard", "medium"
COMPARED = ("torque-feedback", "ppo-standard")
DRAWS = 16
SEED = 2**31 + 3  # of no training
SETTLED = 0.5  # s: the start is over


def pter(path: Path) -> None:
    """The paper's torque feedback two thirds of the way along the path."""
    env = gymnasium.make("pter_gym:PTER/PathFollowing-v0", render_mode="rgb_array")
    world = env.unwrapped
    policy = TorqueFeedback().bind(world.machine, world.observation_layout)
    observation, info = env.reset(seed=0)
    while info["telemetry"][world.telemetry_layout.index("time")] < TIME - 1e-9:
        observation, _, _, _, info = env.step(policy(observation))
    picture = env.render()
    env.close()
    pygame.image.save(pygame.surfarray.make_surface(picture.swapaxes(0, 1)), path)


def clutches(path: Path) -> None:
    """The first of some drawn episodes under the paper's torque feedback and under a trained policy."""
    machines, tasks = zip(*find_scenario(SCENARIO).randomisation(PACE, contexts=DRAWS, seed=SEED).pairs(), strict=True)
    batch = Batch(machines, tasks)
    episodes: dict[str, np.ndarray] = {}
    for name in COMPARED:
        policy = find_policy(name, scenario=SCENARIO)
        telemetry = simulate(batch, policy, range(SEED, SEED + DRAWS), max(map(time_limit, tasks)))
        first = telemetry[:, 0]
        episodes[name] = first[np.isfinite(column(first, "time"))]
        print_start(name, telemetry)
        print_modes(name, telemetry)
    title = f"One drawn episode of {SCENARIO} at {find_pace(PACE):g} m/s"
    save(clutches_over_time(episodes, machines[0].clutch.voltage_max, title), path)


def print_start(name: str, telemetry: np.ndarray) -> None:
    """Print how far from the path the tip is soon after the start, and what the clutches got until then."""
    for when in (0.2, SETTLED):
        row = round(when / 0.01)
        errors = 1000.0 * np.abs(column(telemetry[row], "normal_error"))
        volts = four(telemetry[1 : row + 1], "volts").mean(axis=(0, 1))
        quartiles = ", ".join(f"{each:.0f}" for each in np.percentile(errors, (0, 25, 50, 75, 100)))
        print(f"{name}, after {when:g} s: {quartiles} mm (extremes, quartiles); voltages so far {volts.round(1)}")


def print_modes(name: str, telemetry: np.ndarray) -> None:
    """Print the share of the time in each mode, before and after the start is over."""
    time, mode = column(telemetry, "time"), column(telemetry, "mode")
    for when, counted in (("until", (time > 0.0) & (time <= SETTLED)), ("after", time > SETTLED)):
        shares = (f"{each.name} {100 * (mode[counted] == each).mean():.0f} %" for each in ClutchMode)
        print(f"{name}, {when} {SETTLED:g} s: {', '.join(shares)}")


def watch(path: Path) -> None:
    """Torque feedback and a trained policy on the same episode."""
    if status := pter_command(["watch", "torque-feedback,residual", "--size", "640x360", "--out", str(path)]):
        raise SystemExit(status)


PICTURES: dict[str, Callable[[Path], None]] = {"pter.png": pter, "clutches.png": clutches, "watch.gif": watch}


def main(names: tyro.conf.Positional[tuple[str, ...]] = tuple(PICTURES)) -> None:
    """Make pictures of README and the documents: pter.png, clutches.png, watch.gif; all by default."""
    for name in names:
        PICTURES[name](IMAGES / name)
        print(f"wrote {IMAGES / name}")


if __name__ == "__main__":
    tyro.cli(main)
