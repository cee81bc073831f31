"""Make the environment and step it: one world with random actions, then many at once."""

import gymnasium

import pter_gym  # noqa: F401, registers the environments

env = gymnasium.make("PTER/Standard-v0")
observation, info = env.reset(seed=0)
episode_return, over = 0.0, False
while not over:
    action = env.action_space.sample()  # four numbers in [-1, 1], one for each clutch
    observation, reward, terminated, truncated, info = env.step(action)
    episode_return += reward
    over = terminated or truncated
print(f"return {episode_return:.0f}, arrived: {info['is_success']}")

# observations and telemetry are arrays whose entries have names, units and scales
layout, telemetry = (
    env.unwrapped.observation_layout,
    env.unwrapped.telemetry_layout.as_dict(info["telemetry"]),
)
print(f"{len(layout)} observations: {', '.join(layout.names)}")
print(f"{telemetry['time']:.2f} s, {1000 * telemetry['normal_error']:.0f} mm from the path")
env.close()

# one compiled call steps all worlds; each has the same bits as it would have alone
envs = gymnasium.make_vec("PTER/Everything-v0", num_envs=256)
observations, infos = envs.reset(seed=0)
arrived = 0
for _ in range(100):
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
    arrived += infos["is_success"].sum()
print(f"{arrived} of the random episodes arrived")
envs.close()
