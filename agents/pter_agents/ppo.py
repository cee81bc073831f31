# pyright: basic
"""Proximal policy optimisation (Schulman et al., arXiv:1707.06347) in one compiled call, with persistent exploration.

The worlds are split into two parts, each on its own JAX device (a CPU core), which collects their rollout and computes
the gradients of its half of each minibatch. The sum of two does not depend on the order, so the result is the same on
any number of cores.

The clutches' lag filters out most noise that is independent at each control step. So the noise is autoregressive:
n = ρ·n' + σ·ε with a standard normal ε. Given n', the action a has mean μ + ρ·n' and standard deviation σ, so its
likelihood is exact.
"""

import math
import os
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")  # small networks are slower with more threads

import jax
import numpy as np
import optax
import torch
from jax import lax
from jax import numpy as jnp
from jax.sharding import NamedSharding
from jax.sharding import PartitionSpec as Spec
from torch import nn

from pter_agents.algorithms import Learner, State
from pter_agents.jax_worlds import JaxWorlds, Shared
from pter_agents.jax_worlds import State as WorldsState
from pter_agents.networks import Actor, ActorCritic
from pter_agents.settings import TrainingSettings
from pter_agents.worlds import TrainingWorlds
from pter_gym.errors import ParameterError
from pter_gym.params import require, require_number, require_whole

PARTS = 2
"""Parts of the worlds; the results depend on their number, not on the number of cores."""

PART = "part"
"""Name of the axis of the parts."""

with suppress(RuntimeError):  # JAX has run already, with the devices that it has
    jax.config.update("jax_num_cpu_devices", PARTS)

if not getattr(jax.config, "jax_compilation_cache_dir"):  # noqa: B009  (pyright does not know it)
    jax.config.update(
        "jax_compilation_cache_dir", str(Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "pter_gym")
    )

Layers = list[tuple[jax.Array, jax.Array]]
"""Weights (inputs, outputs) and biases of linear layers with tanh between them."""


@dataclass(frozen=True, kw_only=True)
class PPOSettings(TrainingSettings):
    """Hyper-parameters of proximal policy optimisation, in addition to those of ``TrainingSettings``.

    Attributes
    ----------
    minibatch, epochs
        Samples of a gradient step, and gradient steps for each sample.
    learning_rate
        Initial learning rate; it falls linearly to ``learning_rate_end``.
    discount, trace
        γ, and λ of generalised advantage estimation, for one control step.
    deviation, deviation_end
        Initial and final σ of the exploration. After ``exploring``, a share of the training, it falls exponentially.
    persistence
        ρ of the exploration: the share of its noise that remains one control step later.
    reward_scale
        Factor of the rewards for the value network.
    clip, value_weight, max_gradient
        Clip range of the likelihood ratio, weight of the value loss, and limit of the gradient norm.
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
        Inputs of the networks.
    targets
        Actions minus the remainder of the earlier noise, ρ·n'.
    drawn
        ε.
    advantages, returns
        Advantages and returns of generalised advantage estimation.
    """

    inputs: jax.Array
    targets: jax.Array
    drawn: jax.Array
    advantages: jax.Array
    returns: jax.Array


class Weights(NamedTuple):
    """Weights of the policy and value networks."""

    policy: Layers
    value: Layers

    def act(self, inputs: jax.Array) -> jax.Array:
        """Return the mean actions, (…, 4); the policy sees the first inputs."""
        return _apply(self.policy, inputs[..., : len(self.policy[0][0])])

    def worth(self, inputs: jax.Array) -> jax.Array:
        """Return the values of states, (…,)."""
        return _apply(self.value, inputs)[..., 0]


class Going(NamedTuple):
    """The state carried from rollout to rollout; the first axis is always the worlds.

    Attributes
    ----------
    worlds
        State of the worlds.
    noise
        Noise of the exploration.
    returns
        Returns of the episodes so far.
    """

    worlds: WorldsState
    noise: jax.Array
    returns: jax.Array


class Rollout(NamedTuple):
    """Data of each step and world, (T, N, …); ``finals`` are values of last states, 0 where one was terminated."""

    inputs: jax.Array
    targets: jax.Array
    drawn: jax.Array
    rewards: jax.Array
    ends: jax.Array
    finals: jax.Array
    finished: jax.Array


class Told(NamedTuple):
    """For the logs: the mean loss, and the number and total return of episodes that ended."""

    loss: jax.Array
    episodes: jax.Array
    returns: jax.Array


def estimate(
    rewards: jax.Array, values: jax.Array, ends: jax.Array, finals: jax.Array, discount: float, trace: float
) -> jax.Array:
    """Return generalised advantages (T, N), Schulman et al., arXiv:1506.02438.

    Parameters
    ----------
    rewards, ends
        Rewards of each control step, and whether an episode ended there; (T, N).
    values
        Values of the states before each control step and after the last, (T + 1, N).
    finals
        Values of the last states of episodes, 0 where one was terminated; (T, N).
    discount, trace
        γ and λ.
    """
    after = jnp.where(ends, finals, values[1:])
    missed = rewards + discount * after - values[:-1]
    kept = jnp.where(ends, 0.0, discount * trace)

    def back(following: jax.Array, row: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        found = row[0] + row[1] * following
        return found, found

    return lax.scan(back, jnp.zeros_like(missed[0]), (missed, kept), reverse=True)[1]


def loss_of(weights: Weights, samples: Samples, deviation: Any, clip: float, value_weight: float) -> jax.Array:
    """Return the clipped surrogate loss plus the value loss, as in Stable-Baselines3, without an entropy bonus."""
    drawn = (samples.targets - weights.act(samples.inputs)) / deviation
    ratio = jnp.exp(0.5 * (jnp.square(samples.drawn) - jnp.square(drawn)).sum(1))
    gain = jnp.minimum(samples.advantages * ratio, samples.advantages * jnp.clip(ratio, 1.0 - clip, 1.0 + clip))
    missed = jnp.square(weights.worth(samples.inputs) - samples.returns)
    return value_weight * missed.mean() - gain.mean()


def optimiser(max_gradient: float) -> optax.GradientTransformation:
    """Return Adam without its learning rate, with clipped gradient norms."""
    return optax.chain(optax.clip_by_global_norm(max_gradient), optax.scale_by_adam(eps=1e-5))


def collect(
    s: PPOSettings, worlds: JaxWorlds, shared: Shared, weights: Weights, going: Going, drawn: jax.Array, deviation: Any
) -> tuple[Going, Rollout]:
    """Follow the policy with noise, ε being ``drawn`` (T, N, 4), and return the carried state and the rollout."""

    def act(going: Going, drawn: jax.Array) -> tuple[Going, Rollout]:
        inputs = worlds.inputs(going.worlds)
        means = weights.act(inputs)
        noise = s.persistence * going.noise + deviation * drawn
        after, step = worlds.step(shared, going.worlds, means + noise)
        ends = step.terminated | step.truncated
        worth = lax.cond(
            ends.any(),
            lambda: weights.worth(worlds.last_inputs(shared, going.worlds, step.last_obs)),
            lambda: jnp.zeros(len(ends)),
        )
        returns = going.returns + step.rewards
        going = Going(after, jnp.where(ends[:, None], 0.0, noise), jnp.where(ends, 0.0, returns))
        finals = jnp.where(ends & ~step.terminated, worth, 0.0)
        finished = jnp.where(ends, returns, 0.0)
        return going, Rollout(
            inputs, means + deviation * drawn, drawn, s.reward_scale * step.rewards, ends, finals, finished
        )

    return lax.scan(act, going, drawn)


def samples_of(s: PPOSettings, worlds: JaxWorlds, weights: Weights, going: Going, rows: Rollout) -> Samples:
    """Return the samples of a rollout, with advantages normalised to mean 0 and standard deviation 1 over all parts."""
    values = jnp.concatenate([weights.worth(rows.inputs), weights.worth(worlds.inputs(going.worlds))[None]])
    advantages = estimate(rows.rewards, values, rows.ends, rows.finals, s.discount, s.trace)
    count = lax.psum(advantages.size, PART)
    mean = lax.psum(advantages.sum(), PART) / count
    deviation = jnp.sqrt(lax.psum(jnp.square(advantages - mean).sum(), PART) / (count - 1))
    even = (advantages - mean) / (deviation + 1e-8)
    every = Samples(rows.inputs, rows.targets, rows.drawn, even, advantages + values[:-1])
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), every)


def descend(
    s: PPOSettings, weights: Weights, adam: Any, samples: Samples, deviation: Any, rate: Any
) -> tuple[Weights, Any, jax.Array]:
    """Make a gradient step with the gradients of all parts and return the mean loss."""
    found: Any = jax.value_and_grad(loss_of)(weights, samples, deviation, s.clip, s.value_weight)
    loss, gradient = lax.pmean(found, PART)
    change, adam = optimiser(s.max_gradient).update(gradient, adam)
    return jax.tree.map(lambda w, d: w - rate * d, weights, change), adam, loss


class PPO:
    """Proximal policy optimisation.

    Parameters
    ----------
    settings
        Hyper-parameters.
    worlds
        Worlds to learn in.
    total
        Control steps of the training.
    seed
        Seed of weights, worlds and noise.

    Raises
    ------
    ParameterError
        If JAX is already running with fewer devices than there are parts.
    """

    def __init__(self, settings: PPOSettings, worlds: TrainingWorlds, total: int, seed: int) -> None:
        self._settings = settings
        self._total = total
        self.steps = 0
        self.rollout = settings.worlds * settings.steps
        torch.manual_seed(seed)
        self.networks = ActorCritic(
            worlds.interface.size, worlds.size, settings.hidden, settings.value_hidden, settings.start
        )
        if jax.device_count() < PARTS:
            raise ParameterError(
                f"JAX must have {PARTS} devices, got {jax.device_count()}: import pter_agents.ppo before it runs "
                f"anything, or set JAX_NUM_CPU_DEVICES={PARTS}"
            )
        mesh = jax.make_mesh((PARTS,), (PART,), axis_types=(jax.sharding.AxisType.Auto,))
        self._whole, self._split = NamedSharding(mesh, Spec()), NamedSharding(mesh, Spec(PART))
        self._weights = self._taken()
        self._adam: Any = jax.device_put(optimiser(settings.max_gradient).init(self._weights), self._whole)
        self._worlds = JaxWorlds(worlds)
        self._shared = jax.device_put(self._worlds.shared, self._whole)
        self._first = seed * settings.worlds
        self._rngs = [np.random.default_rng((seed, number)) for number in range(PARTS)]
        self._going: Going | None = None
        whole, split = Spec(), Spec(PART)
        over = partial(jax.shard_map, mesh=mesh, check_vma=False)
        self._begin = jax.jit(over(self._reset, in_specs=(whole, split), out_specs=split))
        learn = over(
            self._learn,
            in_specs=(whole, whole, whole, split, split, split, whole, whole),
            out_specs=(whole, whole, split, whole),
        )
        self._advance = jax.jit(learn, donate_argnums=(1, 2, 3))

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
        going = self._begin(self._shared, self._seeds()) if self._going is None else self._going
        self._weights, self._adam, self._going, told = self._advance(
            self._shared, self._weights, self._adam, going, *self._draw(), np.float32(deviation), np.float32(rate)
        )
        self.steps += self.rollout
        loss, episodes, returns = map(float, told)
        if not math.isfinite(loss) or not all(np.isfinite(part).all() for part in jax.tree.leaves(self._weights)):
            raise FloatingPointError("a loss or a weight is not finite")
        logged = {"train/loss": loss, "train/learning_rate": rate, "train/deviation": deviation}
        return {**logged, **({"rollout/mean_return": returns / episodes} if episodes else {})}

    def _seeds(self) -> Any:
        """Return the two halves of each world's seed."""
        seeds = self._first + np.arange(self._settings.worlds, dtype=np.uint64)
        return jax.device_put(seeds.view(np.uint32).reshape(-1, 2), self._split)

    def _draw(self) -> tuple[Any, Any]:
        """Return the ε of a rollout, and the samples of each epoch and minibatch, for each part."""
        s = self._settings
        mine = s.worlds // PARTS
        drawn = [rng.standard_normal((s.steps, mine, 4), np.float32) for rng in self._rngs]
        orders = [[rng.permutation(s.steps * mine).astype(np.int32) for _ in range(s.epochs)] for rng in self._rngs]
        shares = np.array(orders).reshape(PARTS, -1, s.minibatch // PARTS)
        return jax.device_put((np.array(drawn), shares), self._split)

    def _reset(self, shared: Shared, seeds: jax.Array) -> Going:
        worlds = self._worlds.reset(shared, seeds)
        return Going(worlds, jnp.zeros((len(seeds), 4)), jnp.zeros(len(seeds)))

    def _learn(
        self,
        shared: Shared,
        weights: Weights,
        adam: Any,
        going: Going,
        drawn: jax.Array,
        orders: jax.Array,
        deviation: jax.Array,
        rate: jax.Array,
    ) -> tuple[Weights, Any, Going, Told]:
        """Collect and learn in one part."""
        s = self._settings
        going, rows = collect(s, self._worlds, shared, weights, going, drawn[0], deviation)
        samples = samples_of(s, self._worlds, weights, going, rows)

        def one(kept: Any, chosen: jax.Array) -> tuple[Any, jax.Array]:
            weights, adam = kept
            mine = jax.tree.map(lambda x: x[chosen], samples)
            weights, adam, loss = descend(s, weights, adam, mine, deviation, rate)
            return (weights, adam), loss

        (weights, adam), losses = lax.scan(one, (weights, adam), orders[0])
        told = Told(losses.mean(), *lax.psum((rows.ends.sum(), rows.finished.sum()), PART))
        return weights, adam, going, told

    def actor(self) -> Actor:
        """Return the policy's mean action."""
        self._give()
        return Actor(self.networks.policy)

    def get_state(self) -> State:
        """Return the complete training state."""
        self._give()
        going = self._begin(self._shared, self._seeds()) if self._going is None else self._going
        return {
            "steps": self.steps,
            "networks": self.networks.state_dict(),
            "adam": _arrays(self._adam),
            "going": _arrays(going),
            "rngs": [rng.bit_generator.state for rng in self._rngs],
        }

    def set_state(self, state: State) -> None:
        """Restore the state from ``get_state``."""
        self.set_weights(state)
        self._adam = jax.device_put(_like(self._adam, state["adam"]), self._whole)
        going = jax.eval_shape(self._begin, self._shared, self._seeds())
        self._going = jax.device_put(_like(going, state["going"]), self._split)
        self.steps = state["steps"]
        for rng, kept in zip(self._rngs, state["rngs"], strict=True):
            rng.bit_generator.state = kept

    def set_weights(self, state: State) -> None:
        """Restore the networks of a state."""
        self.networks.load_state_dict(state["networks"])
        self._weights = self._taken()

    def close(self) -> None:
        """Nothing to stop."""

    def _taken(self) -> Weights:
        """Return the weights of torch's networks."""
        both: list[Any] = [
            [(each.weight.detach().numpy().T.copy(), each.bias.detach().numpy().copy()) for each in _linear(part)]
            for part in (self.networks.policy, self.networks.value)
        ]
        return jax.device_put(Weights(*both), self._whole)

    @torch.no_grad()
    def _give(self) -> None:
        """Copy the weights to torch's networks."""
        for part, layers in zip((self.networks.policy, self.networks.value), self._weights, strict=True):
            for each, (weight, bias) in zip(_linear(part), layers, strict=True):
                each.weight.copy_(torch.from_numpy(np.array(weight).T))
                each.bias.copy_(torch.from_numpy(np.array(bias)))


def _linear(layers: nn.Sequential) -> list[nn.Linear]:
    return [layer for layer in layers if isinstance(layer, nn.Linear)]


def _apply(layers: Layers, values: jax.Array) -> jax.Array:
    for weight, bias in layers[:-1]:
        values = jnp.tanh(values @ weight + bias)
    weight, bias = layers[-1]
    return values @ weight + bias


def _arrays(tree: Any) -> list[Any]:
    """Return the arrays of a tree, with unsigned words as signed integers for torch."""
    found = [np.array(leaf) for leaf in jax.tree.leaves(tree)]
    return [each.view(np.int32) if each.dtype == np.uint32 else each for each in found]


def _like(tree: Any, given: list[Any]) -> Any:
    """Return arrays of ``_arrays`` as a tree.

    Raises
    ------
    ValueError
        If they belong to another tree.
    """
    leaves, kind = jax.tree.flatten(tree)
    found = [np.asarray(part).view(leaf.dtype) for leaf, part in zip(leaves, given, strict=True)]
    for leaf, part in zip(leaves, found, strict=True):
        if leaf.shape != part.shape:
            raise ValueError(f"it holds an array of {part.shape} in place of {leaf.shape}")
    return jax.tree.unflatten(kind, found)


LEARNER = Learner(settings=PPOSettings, smoke={"minibatch": 512, "epochs": 2}, make_model=PPO)
