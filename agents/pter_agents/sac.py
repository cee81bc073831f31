"""Soft actor-critic (Haarnoja et al., arXiv:1812.05905) of Stable-Baselines3: many worlds, few gradient steps."""

import math
from dataclasses import dataclass
from typing import Any

from stable_baselines3 import SAC
from torch import nn

from pter_agents.algorithms import Learner, State
from pter_agents.networks import Actor
from pter_agents.stable import Stable, StableSettings, StableWorlds
from pter_agents.worlds import TrainingWorlds
from pter_gym.params import require, require_number, require_whole

KEPT = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of a replay buffer, a row for each control step."""


@dataclass(frozen=True, kw_only=True)
class SACSettings(StableSettings):
    """Hyper-parameters of soft actor-critic, in addition to those of ``StableSettings``.

    Attributes
    ----------
    buffer
        Size of the replay buffer: the newest control steps of all worlds together.
    updates
        Gradient steps after each rollout.
    soft_update
        Share of the networks that their targets take over at each gradient step (τ).
    entropy
        Initial entropy coefficient; it is learned.
    """

    buffer: int
    updates: int
    soft_update: float
    entropy: float

    def __post_init__(self) -> None:
        """Check each number by itself."""
        super().__post_init__()
        for name in ("buffer", "updates"):
            require_whole(self, name)
        require_number(self, "soft_update", above=0.0, at_most=1.0)
        require_number(self, "entropy", above=0.0)
        require_number(self, "start", above=-1.0, below=1.0)
        rollout = self.worlds * self.steps
        require(self.buffer >= rollout, self, "buffer", self.buffer, f"at least worlds × steps = {rollout}")


class OffPolicy(Stable):
    """Soft actor-critic, or another algorithm with the same actor, entropy coefficient and replay buffer.

    Parameters
    ----------
    settings
        Hyper-parameters.
    worlds
        Worlds to learn in.
    seed
        Seed of weights, worlds and noise.
    kind
        Class of the algorithm.
    **options
        Further arguments of that class.
    """

    def __init__(
        self, settings: SACSettings, worlds: TrainingWorlds, seed: int, kind: type[Any], **options: Any
    ) -> None:
        algorithm = kind(
            "MlpPolicy",
            StableWorlds(worlds, seed * settings.worlds, settings.reward_scale),
            learning_rate=settings.learning_rate,
            buffer_size=settings.buffer,
            learning_starts=0,
            batch_size=settings.minibatch,
            tau=settings.soft_update,
            gamma=settings.discount,
            train_freq=settings.steps,
            gradient_steps=settings.updates,
            ent_coef=f"auto_{settings.entropy!r}",
            policy_kwargs={
                "activation_fn": nn.Tanh,
                "net_arch": {"pi": list(settings.hidden), "qf": list(settings.value_hidden)},
            },
            seed=seed,
            device="cpu",
            **options,
        )
        nn.init.constant_(algorithm.actor.mu.bias, math.atanh(settings.start))
        super().__init__(algorithm, worlds, settings.worlds * settings.steps)

    def actor(self) -> Actor:
        """Return the policy's mean action."""
        actor = self.algorithm.actor
        return Actor(nn.Sequential(*actor.latent_pi, actor.mu), squashed=True)

    def get_state(self) -> State:
        """Return the complete training state."""
        buffer = self.algorithm.replay_buffer
        kept = {name: getattr(buffer, name)[: buffer.size()] for name in KEPT}
        entropy = self.algorithm.log_ent_coef.detach()
        return {**super().get_state(), "kept": kept, "next": buffer.pos, "entropy": entropy}

    def set_state(self, state: State) -> None:
        """Restore the state from ``get_state``."""
        super().set_state(state)
        buffer, rows = self.algorithm.replay_buffer, len(state["kept"]["rewards"])
        for name in KEPT:
            getattr(buffer, name)[:rows] = state["kept"][name]
        buffer.pos, buffer.full = state["next"], rows == buffer.buffer_size
        self.algorithm.log_ent_coef.data.copy_(state["entropy"])


def make_sac(settings: SACSettings, worlds: TrainingWorlds, total: int, seed: int) -> OffPolicy:  # noqa: ARG001
    """Return an untrained model, see ``Learner``."""
    return OffPolicy(settings, worlds, seed, SAC)


LEARNER = Learner(settings=SACSettings, smoke={"buffer": 8192, "updates": 8}, make_model=make_sac)
