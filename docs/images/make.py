"""Make the README's picture: the paper's torque feedback two thirds of the way along the path."""

from pathlib import Path

import gymnasium
import pygame

from pter_gym.controllers import TorqueFeedback

TIME = 0.65

env = gymnasium.make("pter_gym:PTER/PathFollowing-v0", render_mode="rgb_array")
pter = env.unwrapped
policy = TorqueFeedback().bind(pter.machine, pter.observation_layout)
observation, info = env.reset(seed=0)
while info["telemetry"][pter.telemetry_layout.index("time")] < TIME - 1e-9:
    observation, _, _, _, info = env.step(policy(observation))
picture = env.render()
env.close()
pygame.image.save(pygame.surfarray.make_surface(picture.swapaxes(0, 1)), Path(__file__).with_name("pter.png"))
