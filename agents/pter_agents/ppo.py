"""Proximal policy optimisation (Schulman et al., arXiv:1707.06347) on both cores, with exploration that lasts.

The worlds are two parts, and a thread has each: it collects their rollout, and the gradients of its half of each
minibatch. The halves are added in a fixed order, so the result is the same on any number of cores.

Noise that is new at each control step hardly passes the clutches' lag. So it is autoregressive: n = ρ·n' + σ·ε with a
standard normal ε. Given n' the action a has mean μ + ρ·n' and deviation σ, with which its likelihood is exact.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
import torch
from torch import nn

from pter_agents.algorithms import Learner, State
from pter_agents.networks import Actor, ActorCritic
from pter_agents.settings import TrainingSettings
from pter_agents.worlds import Mask, Rows, TrainingWorlds
from pter_gym.params import require, require_number, require_whole

PARTS = 2
"""Parts of the worlds; the results depend on their number, not on the number of cores."""

P = TypeVar("P")
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class PPOSettings(TrainingSettings):
    """Hyper-parameters of proximal policy optimisation, in addition to those of ``TrainingSettings``.

    Attributes
    ----------
    minibatch, epochs
        Samples of a gradient step, and gradient steps for each sample.
    learning_rate
        At the beginning; it falls linearly to ``learning_rate_end``.
    discount, trace
        γ and the λ of generalised advantage estimation, for one control step.
    deviation, deviation_end
        σ of the exploration at the beginning and at the end. After ``exploring``, a share of the training, it falls
        exponentially.
    persistence
        ρ of the exploration: the share of its noise that is left one control step later.
    reward_scale
        Factor of the rewards for the value network.
    clip, value_weight, max_gradient
        Of the likelihood ratio, of the value's loss, and of the gradient's norm.
    """

    minibatch: int
    epochs: int
    learning_rate: float
    learning_rate_end: float
    discount: float
    trace: float
    deviation: float
    deviation_end: float
    exploring: float
    persistence: float
    reward_scale: float
    clip: float
    value_weight: float
    max_gradient: float

    def __post_init__(self) -> None:
        """Check each number by itself."""
        super().__post_init__()
        for name in ("minibatch", "epochs"):
            require_whole(self, name)
        for name in ("learning_rate", "max_gradient", "reward_scale", "deviation", "deviation_end"):
            require_number(self, name, above=0.0)
        for name in ("discount", "trace", "exploring"):
            require_number(self, name, at_least=0.0, at_most=1.0)
        for name in ("learning_rate_end", "value_weight"):
            require_number(self, name, at_least=0.0)
        require_number(self, "clip", above=0.0, below=1.0)
        require_number(self, "persistence", at_least=0.0, below=1.0)
        require(self.worlds % PARTS == 0, self, "worlds", self.worlds, f"a multiple of {PARTS}")
        samples = self.worlds * self.steps
        whole = samples % self.minibatch == 0 and self.minibatch % PARTS == 0
        require(whole, self, "minibatch", self.minibatch, f"an even divisor of worlds × steps = {samples}")

    def deviation_at(self, done: float) -> float:
        """Return σ after a share of the training."""
        fallen = max(0.0, done - self.exploring) / (1.0 - self.exploring) if self.exploring < 1.0 else 0.0
        return self.deviation * (self.deviation_end / self.deviation) ** min(fallen, 1.0)

    def learning_rate_at(self, done: float) -> float:
        """Return the learning rate after a share of the training."""
        return self.learning_rate_end + (self.learning_rate - self.learning_rate_end) * max(1.0 - done, 0.0)


class Samples(NamedTuple):
    """Samples of a rollout, a row for each.

    Attributes
    ----------
    inputs
        What the networks saw.
    targets
        Actions minus the rest of the earlier noise, ρ·n'.
    drawn
        ε.
    advantages, returns
        Of generalised advantage estimation.
    """

    inputs: torch.Tensor
    targets: torch.Tensor
    drawn: torch.Tensor
    advantages: torch.Tensor
    returns: torch.Tensor


class Part:
    """A part of the worlds, its exploration, and its rollouts."""

    def __init__(self, settings: PPOSettings, worlds: TrainingWorlds, seed: int, number: int) -> None:
        self._settings = settings
        self.worlds = worlds
        self.rng = np.random.default_rng((seed, number))
        self._noise = np.zeros((worlds.count, 4), np.float32)
        self._inputs = worlds.reset(seed * settings.worlds + number * worlds.count)

    @torch.no_grad()
    def collect(self, networks: ActorCritic, deviation: float) -> Samples:
        """Follow the policy with noise for a rollout and return the samples."""
        s = self._settings
        shape = (s.steps, self.worlds.count)
        inputs = np.empty((*shape, self.worlds.size), np.float32)
        targets, drawn = np.empty((*shape, 4), np.float32), np.empty((*shape, 4), np.float32)
        rewards, values = np.empty(shape, np.float32), np.empty((s.steps + 1, self.worlds.count), np.float32)
        ends, finals = np.zeros(shape, np.bool_), np.zeros(shape, np.float32)
        for t in range(s.steps):
            seen = torch.from_numpy(self._inputs)
            means = networks.act(seen).numpy()
            values[t] = networks.worth(seen).numpy()
            inputs[t] = self._inputs
            drawn[t] = self.rng.standard_normal(drawn[t].shape, np.float32)
            targets[t] = means + deviation * drawn[t]
            left = s.persistence * self._noise
            self._noise = left + deviation * drawn[t]
            step = self.worlds.step(means + self._noise)
            rewards[t] = s.reward_scale * step.rewards
            self._inputs = step.inputs
            if len(step.ended):
                ends[t, step.ended] = True
                worth = networks.worth(torch.from_numpy(step.last)).numpy()
                finals[t, step.ended] = np.where(step.terminated[step.ended], 0.0, worth)
                self._noise[step.ended] = 0.0
        values[s.steps] = networks.worth(torch.from_numpy(self._inputs)).numpy()
        advantages = estimate(rewards, values, ends, finals, s.discount, s.trace)
        rows = (inputs, targets, drawn, advantages, advantages + values[:-1])
        return Samples(*(torch.from_numpy(each.reshape(-1, *each.shape[2:])) for each in rows))

    def get_state(self) -> State:
        """Return all that changes."""
        own = {"noise": self._noise, "inputs": self._inputs, "rng": self.rng.bit_generator.state}
        return {**own, "worlds": self.worlds.get_state()}

    def set_state(self, state: State) -> None:
        """Go on where ``get_state`` was called."""
        self.worlds.set_state(state["worlds"])
        self._noise[:] = state["noise"]
        self._inputs[:] = state["inputs"]
        self.rng.bit_generator.state = state["rng"]


def estimate(rewards: Rows, values: Rows, ends: Mask, finals: Rows, discount: float, trace: float) -> Rows:
    """Return generalised advantages (T, N), Schulman et al., arXiv:1506.02438.

    Parameters
    ----------
    rewards, ends
        Of each control step, and whether an episode ended there; (T, N).
    values
        Of the states before each control step and after the last, (T + 1, N).
    finals
        Values of the last states of episodes, 0 where one was terminated; (T, N).
    discount, trace
        γ and λ.
    """
    advantages = np.empty_like(rewards)
    following = np.zeros(rewards.shape[1], np.float32)
    for t in reversed(range(len(rewards))):
        after = values[t + 1].copy()
        after[ends[t]] = finals[t, ends[t]]
        following[ends[t]] = 0.0
        following = rewards[t] - values[t] + np.float32(discount) * (after + np.float32(trace) * following)
        advantages[t] = following
    return advantages


class PPO:
    """Proximal policy optimisation.

    Parameters
    ----------
    settings
        Hyper-parameters.
    parts
        The worlds, in parts of the same size.
    total
        Control steps of the training.
    seed
        Of weights, worlds and noise.
    """

    def __init__(self, settings: PPOSettings, parts: Sequence[TrainingWorlds], total: int, seed: int) -> None:
        self._settings = settings
        self._total = total
        self.steps = 0
        self.rollout = settings.worlds * settings.steps
        torch.manual_seed(seed)
        first = parts[0]
        self.networks = ActorCritic(
            first.interface.size, first.size, settings.hidden, settings.value_hidden, settings.start
        )
        self._weights = list(self.networks.parameters())
        self._adam = torch.optim.Adam(self._weights, lr=settings.learning_rate, eps=1e-5, fused=True)
        self._threads = ThreadPoolExecutor(PARTS, initializer=torch.set_num_threads, initargs=(1,))
        self._parts = [Part(settings, worlds, seed, number) for number, worlds in enumerate(parts)]

    def advance(self) -> dict[str, float]:
        """Collect a rollout, learn from it, and return values for the logs.

        Raises
        ------
        FloatingPointError
            If a loss or a weight is not finite.
        """
        s = self._settings
        done = self.steps / self._total
        deviation, rate = s.deviation_at(done), s.learning_rate_at(done)
        self._adam.param_groups[0]["lr"] = rate
        samples = with_even_advantages(self._each(lambda part: part.collect(self.networks, deviation), self._parts))
        losses = [self._learn(samples, deviation) for _ in range(s.epochs)]
        self.steps += self.rollout
        loss = float(np.mean(losses))
        if not (math.isfinite(loss) and all(bool(torch.isfinite(weight).all()) for weight in self._weights)):
            raise FloatingPointError("a loss or a weight is not finite")
        returns = [value for part in self._parts for value in part.worlds.finished]
        for part in self._parts:
            part.worlds.finished.clear()
        logged = {"train/loss": loss, "train/learning_rate": rate, "train/deviation": deviation}
        return {**logged, **({"rollout/mean_return": float(np.mean(returns))} if returns else {})}

    def _learn(self, samples: Sequence[Samples], deviation: float) -> float:
        """Use each sample once and return the mean loss."""
        share = self._settings.minibatch // PARTS
        orders = [torch.from_numpy(part.rng.permutation(len(samples[0].inputs))) for part in self._parts]
        losses: list[float] = []
        for first in range(0, len(orders[0]), share):
            chosen = [
                Samples(*(rows[order[first : first + share]] for rows in part))
                for part, order in zip(samples, orders, strict=True)
            ]
            found = self._each(lambda part: self._gradient(part, deviation), chosen)
            for weight, *halves in zip(self._weights, *(gradients for _, gradients in found), strict=True):
                weight.grad = sum(halves[1:], halves[0]) / PARTS
            nn.utils.clip_grad_norm_(self._weights, self._settings.max_gradient)
            self._adam.step()
            losses.append(sum(loss for loss, _ in found) / PARTS)
        return float(np.mean(losses))

    def _gradient(self, samples: Samples, deviation: float) -> tuple[float, tuple[torch.Tensor, ...]]:
        """Return the loss of some samples and its gradient."""
        s = self._settings
        loss = loss_of(self.networks, samples, deviation, s.clip, s.value_weight)
        return float(loss.detach()), torch.autograd.grad(loss, self._weights)

    def _each(self, do: Callable[[P], T], over: Iterable[P]) -> list[T]:
        """Return the results of a function, called in a thread for each part."""
        return list(self._threads.map(do, over))

    def actor(self) -> Actor:
        """Return the policy's mean action."""
        return Actor(self.networks.policy)

    def get_state(self) -> State:
        """Return all that a training's future depends on."""
        return {
            "steps": self.steps,
            "networks": self.networks.state_dict(),
            "adam": self._adam.state_dict(),
            "parts": [part.get_state() for part in self._parts],
        }

    def set_state(self, state: State) -> None:
        """Go on where ``get_state`` was called."""
        self.set_weights(state)
        self._adam.load_state_dict(state["adam"])
        self.steps = state["steps"]
        for part, kept in zip(self._parts, state["parts"], strict=True):
            part.set_state(kept)

    def set_weights(self, state: State) -> None:
        """Take the networks of a state."""
        self.networks.load_state_dict(state["networks"])

    def close(self) -> None:
        """Stop the threads."""
        self._threads.shutdown()


def with_even_advantages(samples: Sequence[Samples]) -> list[Samples]:
    """Return samples whose advantages have mean 0 and deviation 1 over all parts."""
    every = torch.cat([part.advantages for part in samples])
    mean, deviation = every.mean(), every.std()
    return [part._replace(advantages=(part.advantages - mean) / (deviation + 1e-8)) for part in samples]


def loss_of(
    networks: ActorCritic, samples: Samples, deviation: float, clip: float, value_weight: float
) -> torch.Tensor:
    """Return the clipped surrogate's loss and that of the value, as in Stable-Baselines3, without an entropy bonus."""
    drawn = (samples.targets - networks.act(samples.inputs)) / deviation
    ratio = torch.exp(0.5 * (samples.drawn.square() - drawn.square()).sum(1))
    gain = torch.minimum(samples.advantages * ratio, samples.advantages * ratio.clamp(1.0 - clip, 1.0 + clip))
    missed = (networks.worth(samples.inputs) - samples.returns).square()
    return value_weight * missed.mean() - gain.mean()


LEARNER = Learner(settings=PPOSettings, smoke={"minibatch": 512, "epochs": 2}, make_model=PPO, parts=PARTS)
