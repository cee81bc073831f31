"""Another algorithm, as somebody would add one: its hyper-parameters, its model, and the layers of its policy."""

from dataclasses import dataclass
from typing import Any

from stable_baselines3 import A2C

from pter_agents.algorithms import Learner
from pter_agents.critic import TwoViewsPolicy
from pter_agents.ppo import actor
from pter_agents.settings import Settings
from pter_agents.worlds import InterfaceVecEnv
from pter_gym.params import require_number


@dataclass(frozen=True, kw_only=True)
class AdvantageSettings(Settings):
    """Hyper-parameters of advantage actor-critic."""

    rate: float

    def __post_init__(self) -> None:
        """Check each number by itself."""
        super().__post_init__()
        require_number(self, "rate", above=0.0)


def make_model(settings: AdvantageSettings, worlds: InterfaceVecEnv, seed: int) -> A2C:
    """Return an untrained model."""
    arch: Any = {"pi": list(settings.hidden), "vf": list(settings.value_hidden)}
    return A2C(
        TwoViewsPolicy,
        worlds,
        learning_rate=settings.rate,
        n_steps=settings.steps,
        policy_kwargs={"net_arch": arch, "seen": worlds.interface.size},
        seed=seed,
        device="cpu",
    )


LEARNER = Learner(settings=AdvantageSettings, smoke={}, make_model=make_model, actor=actor)
