"""Recurrent PPO of sb3-contrib, with one LSTM in the policy and one in the value network."""

import math
from dataclasses import dataclass
from typing import Any

from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from torch import nn

from pter_agents.algorithms import Learner, State
from pter_agents.networks import Actor
from pter_agents.stable import Stable, StableSettings, StableWorlds
from pter_agents.worlds import TrainingWorlds
from pter_gym.params import require, require_number, require_whole
from pter_gym.policies._cards import MOST_LSTM


@dataclass(frozen=True, kw_only=True)
class RecurrentSettings(StableSettings):
    """Hyper-parameters of proximal policy optimisation with an LSTM, in addition to those of ``StableSettings``.

    Attributes
    ----------
    lstm
        Units of the LSTM between the inputs and the hidden layers, of the policy and of the value.
    epochs
        How often each sample of a rollout is used.
    trace
        λ of generalised advantage estimation, for one control step.
    deviation
        Initial standard deviation of the exploration; it is learned.
    clip, value_weight, max_gradient
        Clip range of the likelihood ratio, weight of the value loss, and limit of the gradient norm.
    """

    lstm: int
    epochs: int
    trace: float
    deviation: float
    clip: float
    value_weight: float
    max_gradient: float

    def __post_init__(self) -> None:
        """Check each number by itself."""
        super().__post_init__()
        whole = type(self.lstm) is int and 1 <= self.lstm <= MOST_LSTM
        require(whole, self, "lstm", self.lstm, f"a whole number from 1 to {MOST_LSTM}")
        require_whole(self, "epochs")
        for name in ("deviation", "max_gradient"):
            require_number(self, name, above=0.0)
        require_number(self, "trace", at_least=0.0, at_most=1.0)
        require_number(self, "value_weight", at_least=0.0)
        require_number(self, "clip", above=0.0, below=1.0)
        samples = self.worlds * self.steps
        even = self.minibatch > 1 and samples % self.minibatch == 0
        require(even, self, "minibatch", self.minibatch, f"a divisor of worlds × steps = {samples}, above 1")


class Recurrent(Stable):
    """Proximal policy optimisation with an LSTM; parameters as in ``Learner``."""

    def __init__(self, settings: RecurrentSettings, worlds: TrainingWorlds, total: int, seed: int) -> None:  # noqa: ARG002
        algorithm: Any = RecurrentPPO(
            "MlpLstmPolicy",
            StableWorlds(worlds, seed * settings.worlds, settings.reward_scale),
            learning_rate=settings.learning_rate,
            n_steps=settings.steps,
            batch_size=settings.minibatch,
            n_epochs=settings.epochs,
            gamma=settings.discount,
            gae_lambda=settings.trace,
            clip_range=settings.clip,
            vf_coef=settings.value_weight,
            max_grad_norm=settings.max_gradient,
            policy_kwargs={
                "activation_fn": nn.Tanh,
                "net_arch": {"pi": list(settings.hidden), "vf": list(settings.value_hidden)},
                "lstm_hidden_size": settings.lstm,
                "log_std_init": math.log(settings.deviation),
            },
            seed=seed,
            device="cpu",
        )
        nn.init.constant_(algorithm.policy.action_net.bias, settings.start)
        super().__init__(algorithm, worlds, settings.worlds * settings.steps)

    def actor(self) -> Actor:
        """Return the policy's mean action."""
        policy = self.algorithm.policy
        return Actor(nn.Sequential(*policy.mlp_extractor.policy_net, policy.action_net), lstm=policy.lstm_actor)

    def get_state(self) -> State:
        """Return the complete training state."""
        return {**super().get_state(), "memory": tuple(self.algorithm._last_lstm_states)}

    def set_state(self, state: State) -> None:
        """Restore the state from ``get_state``."""
        super().set_state(state)
        self.algorithm._last_lstm_states = RNNStates(*state["memory"])


LEARNER = Learner(settings=RecurrentSettings, smoke={"minibatch": 512, "epochs": 1}, make_model=Recurrent)
