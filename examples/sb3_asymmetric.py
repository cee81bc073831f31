"""Train Stable-Baselines3's PPO with a critic that sees what no sensor shows (extra `agents`)."""

import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnvWrapper

from pter_gym.benchmark import from_actions, print_boards, run_scenario
from pter_gym.envs.sb3 import make_sb3_vec_env

torch.set_num_threads(1)
worlds = make_sb3_vec_env(64, scenario="standard", privileged=True)
SEEN, TRUTH = worlds.observation_space.shape[0], worlds.env.privileged_layout


class WithTruth(VecEnvWrapper):
    """Observations that end with what no sensor shows."""

    def reset(self):
        return self.joined(self.venv.reset(), self.venv.reset_infos)

    def step_wait(self):
        obs, rewards, dones, infos = self.venv.step_wait()
        for info in (infos[k] for k in np.flatnonzero(dones)):
            info["terminal_observation"] = self.joined([info["terminal_observation"]], [info])[0]
        now = np.where(dones, self.venv.reset_infos, infos)
        return self.joined(obs, now), rewards, dones, infos

    def joined(self, obs, infos):
        truth = np.array([info["privileged"] for info in infos]) / TRUTH.scales
        return np.hstack([obs, truth.clip(-25, 25)]).astype(np.float32)


class Asymmetric(ActorCriticPolicy):  # the actor gets the first entries alone
    def _build_mlp_extractor(self):
        super()._build_mlp_extractor()
        self.mlp_extractor.policy_net[0] = torch.nn.Linear(SEEN, 64)
        self.mlp_extractor.policy_net.register_forward_pre_hook(lambda _, given: given[0][:, :SEEN])


envs = WithTruth(worlds, Box(-25, 25, (SEEN + len(TRUTH),)))
model = PPO(Asymmetric, envs, n_steps=64, batch_size=1024, gae_lambda=0.98, seed=0)
model.learn(600_000)
blind = ((0, 0), (0, len(TRUTH)))  # the actor does not look at these zeros
policy = from_actions(lambda obs: model.predict(np.pad(obs, blind), deterministic=True)[0], worlds)
policies = {"mine": policy, "tuned law": "torque-feedback-tuned"}
print_boards(run_scenario("standard", policies, seed=0))
