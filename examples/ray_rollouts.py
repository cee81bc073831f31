"""Episodes on a Ray cluster: `python examples/ray_rollouts.py --workers 2`."""

import time

import gymnasium
import numpy as np
import ray
import tyro

import pter_gym


@ray.remote(num_cpus=1)
class Worker:
    def __init__(self, worlds: int, policy: str) -> None:
        options = {"frame_skip": 1, "telemetry": False, "num_threads": 1}
        self.envs = gymnasium.make_vec("pter_gym:PTER/Standard-v0", worlds, **options)
        self.policy = pter_gym.load_policy(policy, self.envs)
        obs, _ = self.envs.reset(seed=0)
        self.envs.step(self.policy(obs))  # compiles before anything is timed

    def episodes(self, seed: int) -> tuple[np.ndarray, float]:
        begin, steps, (obs, _) = time.perf_counter(), 0, self.envs.reset(seed=seed)
        self.policy.reset()
        returns, running = np.zeros(self.envs.num_envs), np.ones(self.envs.num_envs, bool)
        while running.any():
            obs, rewards, terminated, truncated, _ = self.envs.step(self.policy(obs))
            returns += running * rewards
            running &= ~(terminated | truncated)
            steps += self.envs.num_envs
        return returns, steps / (time.perf_counter() - begin)


def main(
    workers: int = 2, worlds: int = 256, policy: str = "residual", seed: int = 0
) -> np.ndarray:
    episodes = [
        Worker.remote(worlds, policy).episodes.remote(seed + k * worlds) for k in range(workers)
    ]
    for k, (returns, speed) in enumerate(shares := ray.get(episodes)):
        print(
            f"worker {k}: mean return {returns.mean():.1f} of {worlds} worlds, "
            f"{speed:,.0f} control steps/s"
        )
    return np.concatenate([returns for returns, _ in shares])


if __name__ == "__main__":
    tyro.cli(main)
