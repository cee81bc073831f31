"""Another algorithm, as somebody would add one: its hyper-parameters and its model, a plain policy gradient."""

from dataclasses import dataclass

import numpy as np
import torch

from pter_agents.algorithms import Learner, State
from pter_agents.networks import Actor, ActorCritic
from pter_agents.settings import TrainingSettings
from pter_agents.worlds import TrainingWorlds
from pter_gym.params import require_number


@dataclass(frozen=True, kw_only=True)
class AdvantageSettings(TrainingSettings):
    """Hyper-parameters of the policy gradient."""

    rate: float

    def __post_init__(self) -> None:
        """Check each number by itself."""
        super().__post_init__()
        require_number(self, "rate", above=0.0)


class PolicyGradient:
    """The gradient of one control step's reward, less its value, after each."""

    def __init__(self, settings: AdvantageSettings, worlds: TrainingWorlds, total: int, seed: int) -> None:
        torch.manual_seed(seed)
        self._worlds = worlds
        self.steps, self.rollout = 0, settings.worlds * settings.steps
        self._length = settings.steps
        sizes = self._worlds.interface.size, self._worlds.size
        self._networks = ActorCritic(*sizes, settings.hidden, settings.value_hidden, settings.start)
        self._descent = torch.optim.SGD(self._networks.parameters(), lr=settings.rate)
        self._inputs = self._worlds.reset(seed)

    def advance(self) -> dict[str, float]:
        losses = [self._step() for _ in range(self._length)]
        self.steps += self.rollout
        return {"train/loss": float(np.mean(losses))}

    def _step(self) -> float:
        inputs = torch.from_numpy(self._inputs)
        drawn = torch.randn(len(inputs), 4)
        means, values = self._networks.act(inputs), self._networks.worth(inputs)
        step = self._worlds.step((means + 0.3 * drawn).detach().numpy())
        self._inputs = step.inputs
        missed = torch.from_numpy(step.rewards.astype(np.float32)) - values
        loss = missed.square().mean() - (missed.detach() * (means * drawn).sum(1)).mean()
        self._descent.zero_grad()
        loss.backward()
        self._descent.step()
        return float(loss.detach())

    def actor(self) -> Actor:
        return Actor(self._networks.policy)

    def get_state(self) -> State:
        own = {"steps": self.steps, "inputs": self._inputs, "torch": torch.get_rng_state()}
        return {**own, "networks": self._networks.state_dict(), "worlds": self._worlds.get_state()}

    def set_state(self, state: State) -> None:
        self.set_weights(state)
        self._worlds.set_state(state["worlds"])
        self.steps, self._inputs = state["steps"], np.asarray(state["inputs"])
        torch.set_rng_state(state["torch"])

    def set_weights(self, state: State) -> None:
        self._networks.load_state_dict(state["networks"])

    def close(self) -> None:
        pass


LEARNER = Learner(settings=AdvantageSettings, smoke={}, make_model=PolicyGradient)
