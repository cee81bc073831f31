"""Train Stable-Baselines3's PPO in two phases and rank it, in a few minutes (extra `agents`)."""

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from pter_gym.benchmark import from_sb3, print_boards, run_scenario
from pter_gym.envs.sb3 import PathErrorCallback, make_sb3_vec_env
from pter_gym.tasks.path_following import RewardWeights

SEED, FIRST, SECOND = 0, 1_250_000, 2_750_000


class Anneal(BaseCallback):
    """Lets the learning rate and the noise of the actions fall."""

    def _on_training_start(self):
        self.log_std = self.model.policy.log_std.data.clone()

    def _on_step(self):
        return True

    def _on_rollout_start(self):
        done = (self.num_timesteps - FIRST) / SECOND
        self.model.policy.log_std.data.copy_((1 - done) * self.log_std - 3 * done)
        self.model.lr_schedule = lambda _: 3e-4 * (1 - done)


def worlds(**weights):
    return make_sb3_vec_env(64, scenario="standard", reward=RewardWeights(**weights))


torch.set_num_threads(1)
model = PPO("MlpPolicy", worlds(), n_steps=64, batch_size=1024, gae_lambda=0.98, seed=SEED)
callback = PathErrorCallback(250_000)
model.learn(FIRST, callback, progress_bar=True)
model.set_env(worlds(tracking=50, precision=50, effort=0))  # pays for the last millimetres
model.set_random_seed(SEED)
model.learn(SECOND, [Anneal(), callback], reset_num_timesteps=False, progress_bar=True)
policies = {"mine": from_sb3(model), "tuned law": "torque-feedback-tuned"}
print_boards(run_scenario("standard", policies, seed=0))
