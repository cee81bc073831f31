"""Change the reward: other weights of its terms, or a term of your own in a wrapper."""

from typing import Any

import gymnasium
import numpy as np

import pter_gym  # noqa: F401
from pter_gym.tasks.path_following import RewardWeights


class SmoothActions(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Subtract a cost for changes of the action from the reward."""

    def __init__(self, env: gymnasium.Env[Any, Any], price: float = 0.05) -> None:
        super().__init__(env)
        self.price = price

    def reset(self, **options: Any) -> Any:
        self.last = np.zeros(4)
        return super().reset(**options)

    def step(self, action: Any) -> Any:
        observation, reward, terminated, truncated, info = super().step(action)
        change = float(np.square(action - self.last).sum())
        self.last = np.array(action)
        return observation, float(reward) - self.price * change, terminated, truncated, info


# half of the weight on being within 6 mm of the path, and a cost of the tip's acceleration
weights = RewardWeights(tracking=50.0, precision=50.0, acceleration=0.01)
env = SmoothActions(gymnasium.make("PTER/Standard-v0", reward=weights))
env.reset(seed=0)
rewards = [env.step(env.action_space.sample())[1] for _ in range(5)]
print(f"rewards with a price on changes: {', '.join(f'{float(each):.2f}' for each in rewards)}")
