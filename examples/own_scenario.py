"""Train on a distribution of your own: episodes may draw any field of machine and task."""

import gymnasium
from gymnasium.vector import AutoresetMode

import pter_gym
from pter_gym.hands import HumanArm, MultiSineHand, find_hand
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL
from pter_gym.paths import Circle, Line
from pter_gym.scenarios.distributions import Draws, LogUniform, OneOf, Uniform, Vary
from pter_gym.tasks.path_following import STARTS, PathFollowing

clutch = OneOf(
    (BASELINE.clutch, Vary(DELRIN_EXPERIMENTAL.clutch, time_constant=LogUniform(0.02, 0.2)))
)
hand = OneOf(
    (MultiSineHand(), Vary(HumanArm(), eagerness=Uniform(1.3, 1.8)), find_hand("tremor-essential"))
)
scenario = Draws(
    machine=Vary(BASELINE, clutch=clutch),
    task=Vary(
        PathFollowing(starts=STARTS["path"]),
        path=OneOf((Line(), Circle())),
        hand=hand,
        pace=LogUniform(0.12, 0.5),
    ),
)
envs = gymnasium.make_vec(
    "PTER/PathFollowing-v0",
    num_envs=64,
    scenario=scenario,
    contexts=64,  # pairs of machine and task, one of which each episode has
    autoreset_mode=AutoresetMode.SAME_STEP,
)
policy = pter_gym.load_policy("torque-feedback-tuned", envs)
observations, infos = envs.reset(seed=0)
policy.reset()
ended = arrived = 0
for _ in range(300):
    observations, rewards, terminated, truncated, infos = envs.step(policy(observations))
    over = terminated | truncated
    policy.reset(over)  # these worlds have begun new episodes
    ended, arrived = ended + over.sum(), arrived + infos["is_success"].sum()
print(f"{arrived} of {ended} episodes arrived")
