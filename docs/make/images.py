"""Make pictures of README and the documents: `python docs/make/images.py [NAME.png …]`, all by default.

`error-against-pace.png` is made with the leaderboards, by `docs/make/scenario_pages.py`.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import pygame
import tyro
from figures.classical import arm_and_deviation, clutches_along_path
from figures.hands import force_and_spectrum
from figures.pages import clutches_over_time
from pages import IMAGES
from studies.bounds import drawn_task
from studies.clutch_use import episodes as one_episode

from pter_gym.benchmark import find_policy
from pter_gym.benchmark.measures import column, four
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.controllers import TorqueFeedback
from pter_gym.engine.batch import Batch
from pter_gym.hands import MEASURED_TREMORS, find_hand
from pter_gym.params import BASELINE
from pter_gym.physics.friction import ClutchMode
from pter_gym.plots import save
from pter_gym.scenarios import find_scenario

TIME = 0.65

SCENARIO, PACE = "standard", "medium"
COMPARED = ("torque-feedback", "ppo-standard")
CLASSICAL = ("impedance", "impedance-tuned", "velocity-ratio-tuned", "single-dof-tuned")
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
    save(clutches_over_time(episodes, machines[0].clutch.voltage_max), path)


def classical_trajectories(path: Path) -> None:
    """Where four laws take the tip in one drawn episode."""
    save(arm_and_deviation(classical_episodes(), BASELINE.arm, drawn_task(PACE).path), path)


def classical_clutches(path: Path) -> None:
    """What four laws do with the clutches in that episode."""
    save(clutches_along_path(classical_episodes(), drawn_task(PACE).path, BASELINE.clutch.voltage_max), path)


def tremors(path: Path) -> None:
    """Force and spectrum of the measured tremors."""
    save(force_and_spectrum({name: find_hand(name) for name in MEASURED_TREMORS}, MEASURED_TREMORS), path)


def identified(path: Path) -> None:
    """Torque curves that are identified from the log of the machine in docs/identify.md."""
    from pter_gym.identification import Recorder, identify, record_log
    from pter_gym.identification.pictures import curves

    arm = replace(BASELINE.arm, inertia_a=0.7, inertia_b=0.6, coupling=0.1)
    machine = replace(BASELINE, arm=arm, clutch_scale=(0.9, 1.1, 1.05, 0.95))
    save(curves(identify(record_log(machine, recorder=Recorder(delay=0.012)))), path)


@cache
def classical_episodes() -> dict[str, np.ndarray]:
    """Telemetry of one drawn episode under each of four laws."""
    drawn = {name: one_episode(name, PACE, draws=1)[:, 0] for name in CLASSICAL}
    return {name: rows[np.isfinite(rows[:, 0])] for name, rows in drawn.items()}


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


PICTURES: dict[str, Callable[[Path], None]] = {
    "pter.png": pter,
    "clutches.png": clutches,
    "classical-trajectories.png": classical_trajectories,
    "classical-clutches.png": classical_clutches,
    "tremors.png": tremors,
    "identified.png": identified,
}


def main(names: tyro.conf.Positional[tuple[str, ...]] = tuple(PICTURES)) -> None:
    """Make pictures of README and the documents: pter.png, clutches.png and so on; all by default."""
    for name in names:
        PICTURES[name](IMAGES / name)
        print(f"wrote {IMAGES / name}")


if __name__ == "__main__":
    tyro.cli(main)
