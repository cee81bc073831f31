"""Proximal policy optimisation of Stable-Baselines3."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from torch import nn

from pter_agents.algorithms import Learner
from pter_agents.critic import TwoViewsPolicy
from pter_agents.settings import Settings, require_whole
from pter_agents.worlds import InterfaceVecEnv
from pter_gym.params import require, require_number


@dataclass(frozen=True, kw_only=True)
class PPOSettings(Settings):
    """Hyper-parameters of proximal policy optimisation, in addition to those of ``Settings``.

    Attributes
    ----------
    minibatch, epochs
        Samples of a gradient step, and how often each sample is used.
    learning_rate
        At the beginning; it falls linearly to ``learning_rate_end``.
    discount, trace
        γ and the λ of generalised advantage estimation, for one control step.
    clip, entropy, value_weight, max_gradient, target_kl
        As in Stable-Baselines3; a ``target_kl`` of 0 is none.
    """

    minibatch: int
    epochs: int
    learning_rate: float
    learning_rate_end: float
    discount: float
    trace: float
    clip: float
    entropy: float
    value_weight: float
    max_gradient: float
    target_kl: float

    def __post_init__(self) -> None:
        """Check each number by itself."""
        super().__post_init__()
        for name in ("minibatch", "epochs"):
            require_whole(self, name)
        for name in ("learning_rate", "max_gradient"):
            require_number(self, name, above=0.0)
        for name in ("discount", "trace"):
            require_number(self, name, at_least=0.0, at_most=1.0)
        for name in ("learning_rate_end", "entropy", "value_weight", "target_kl"):
            require_number(self, name, at_least=0.0)
        require_number(self, "clip", above=0.0, below=1.0)
        samples = self.worlds * self.steps
        require(
            samples % self.minibatch == 0,
            self,
            "minibatch",
            self.minibatch,
            f"a divisor of worlds × steps = {samples}",
        )


class CheckedPPO(PPO):
    """Proximal policy optimisation that stops when a number is no longer finite."""

    def train(self) -> None:
        """Update the networks from the rollout."""
        try:
            super().train()
        except ValueError as error:  # torch refuses a distribution with NaN
            raise FloatingPointError(str(error).splitlines()[0]) from error
        logged = self.logger.name_to_value
        losses = (logged[name] for name in ("train/loss", "train/value_loss", "train/policy_gradient_loss"))
        if not all(map(math.isfinite, losses)):
            raise FloatingPointError("the loss is not finite")
        if not all(bool(torch.isfinite(weight).all()) for weight in self.policy.parameters()):
            raise FloatingPointError("a weight is not finite after its gradient step")


@dataclass(frozen=True)
class Falling:
    """A learning rate that falls linearly over the training."""

    first: float
    last: float

    def __call__(self, remaining: float) -> float:
        """Return the rate where a share of the training remains; the last rollout may go beyond its end."""
        return self.last + (self.first - self.last) * max(remaining, 0.0)


def make_model(settings: PPOSettings, worlds: InterfaceVecEnv, seed: int) -> CheckedPPO:
    """Return an untrained model."""
    model = CheckedPPO(
        TwoViewsPolicy,
        worlds,
        learning_rate=Falling(settings.learning_rate, settings.learning_rate_end),
        n_steps=settings.steps,
        batch_size=settings.minibatch,
        n_epochs=settings.epochs,
        gamma=settings.discount,
        gae_lambda=settings.trace,
        clip_range=settings.clip,
        ent_coef=settings.entropy,
        vf_coef=settings.value_weight,
        max_grad_norm=settings.max_gradient,
        target_kl=settings.target_kl or None,
        policy_kwargs={
            "net_arch": {"pi": list(settings.hidden), "vf": list(settings.value_hidden)},
            "log_std_init": math.log(settings.deviation),
            "seen": worlds.interface.size,
        },
        seed=seed,
        device="cpu",
    )
    policy: Any = model.policy
    with torch.no_grad():
        policy.action_net.bias.fill_(settings.start)
    return model


def actor(model: OnPolicyAlgorithm) -> nn.Sequential:
    """Return the layers of a model's policy."""
    policy: Any = model.policy
    return nn.Sequential(*policy.mlp_extractor.policy_net, policy.action_net)


LEARNER = Learner(settings=PPOSettings, smoke={"minibatch": 512, "epochs": 2}, make_model=make_model, actor=actor)
