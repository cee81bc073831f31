"""Follow a path of your own: a smooth curve as complex points and derivatives."""

import cmath
from dataclasses import dataclass
from math import tau

import gymnasium
import numpy as np

import pter_gym
from pter_gym.paths import Arcs, Path, fit_arcs
from pter_gym.tasks.path_following import PathFollowing


@dataclass(frozen=True)
class Spiral(Path):
    turns: float = 0.75
    growth: float = 0.05  # m in each turn

    def make_arcs(self) -> Arcs:
        def curve(angle: float) -> tuple[complex, complex]:
            radius, direction = 0.15 + self.growth * angle / tau, cmath.exp(1j * angle)
            return 0.6j + radius * direction, (self.growth / tau + 1j * radius) * direction

        return fit_arcs(curve, np.linspace(0.0, tau * self.turns, 7).tolist())


task = PathFollowing(path=Spiral(), pace=0.25, error_max=0.1)
env = gymnasium.make("PTER/PathFollowing-v0", task=task)
policy = pter_gym.load_policy("single-dof-tuned", env)
observation, info = env.reset(seed=0)
policy.reset()
over = False
while not over:
    observation, reward, terminated, truncated, info = env.step(policy(observation))
    over = terminated or truncated
telemetry = env.unwrapped.telemetry_layout.as_dict(info["telemetry"])
print(
    f"{telemetry['reached']:.2f} of {task.path.length:.2f} m of the spiral, "
    f"arrived: {info['is_success']}"
)
