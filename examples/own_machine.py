"""Simulate a machine of your own: other links, another clutch material, other clutches."""

from dataclasses import replace

import gymnasium

import pter_gym
from pter_gym.params import BASELINE, Connection, with_friction

arm = replace(BASELINE.arm, length_a=0.6, length_b=0.5)  # m
cork = replace(with_friction(BASELINE.clutch, breakaway=0.9, dynamic=0.6), time_constant=0.04)  # s
# a clutch connects by its row (a, b) of W: its slip velocity is a·ωA + b·ωB
clutches = (
    Connection("brakes A", (1.0, 0.0)),
    Connection("brakes B", (0.0, 1.0)),
    Connection("couples A to B, 1:2", (1.0, -0.5)),
)
machine = replace(BASELINE, arm=arm, clutch=cork, clutches=clutches)

env = gymnasium.make("PTER/PathFollowing-v0", machine=machine)
policy = pter_gym.load_policy("velocity-ratio", env)  # control laws use the clutches that exist
observation, info = env.reset(seed=0)
policy.reset()
over = False
while not over:
    observation, reward, terminated, truncated, info = env.step(policy(observation))
    over = terminated or truncated
telemetry = env.unwrapped.telemetry_layout.as_dict(info["telemetry"])
print(
    f"after {telemetry['time']:.2f} s the tip is "
    f"{1000 * abs(telemetry['normal_error']):.0f} mm from the path"
)
