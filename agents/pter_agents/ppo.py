# pyright: basic
"""Proximal policy optimisation (Schulman et al., arXiv:1707.06347) in one compiled call, with
persistent exploration.

The worlds are split into two parts, each on its own JAX device (a CPU core), which collects their
rollout and computes the gradients of its half of each minibatch. The sum of two does not depend on
the order, so the result is the same on any number of cores.

The clutches' lag filters out most noise that is independent at each control step. So the noise is
autoregressive: n = ρ·n' + σ·ε with a standard normal ε. Given n', the action a has mean μ + ρ·n'
and standard deviation σ, so its likelihood is exact.

A path pays the same at any pace, so a slow step pays a quarter of a brisk one, and its advantages
would be lost among theirs. So rewards are divided by the commanded pace: each control step is worth
the same."""

import math
import os
from contextlib import suppress
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

# small networks are slower with more threads
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")

import jax
import numpy as np
import optax
from jax import lax, numpy as jnp
from jax.sharding import NamedSharding, PartitionSpec as Spec

from pter_agents.jax_worlds import JaxWorlds, RolloutState, SharedConstants
from pter_agents.runs import policy_of
from pter_agents.settings import PARTS, Settings
from pter_agents.worlds import Training
from pter_gym.errors import ParameterError
from pter_gym.policies import TrainedPolicy
from pter_gym.scenarios import PACES

PART = "part"
"""Name of the axis of the parts."""

with suppress(RuntimeError):  # JAX has run already, with the devices that it has
    jax.config.update("jax_num_cpu_devices", PARTS)

if not getattr(jax.config, "jax_compilation_cache_dir"):  # noqa: B009  (pyright does not know it)
    jax.config.update(
        "jax_compilation_cache_dir",
        str(Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "pter_gym"),
    )

Layers = list[tuple[jax.Array, jax.Array]]
"""Weights (inputs, outputs) and biases of linear layers with tanh between them."""


class Samples(NamedTuple):
    """Samples of a rollout, one per row.

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
        """Return the mean actions, (…, clutches); the policy sees the first inputs."""
        return _apply(self.policy, inputs[..., : len(self.policy[0][0])])

    def value_of(self, inputs: jax.Array) -> jax.Array:
        """Return the values of states, (…,)."""
        return _apply(self.value, inputs)[..., 0]


class Carry(NamedTuple):
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

    worlds: RolloutState
    noise: jax.Array
    returns: jax.Array


class RolloutBuffer(NamedTuple):
    """Data of each step and world, (T, N, …); ``finals`` are values of final states, or 0."""

    inputs: jax.Array
    targets: jax.Array
    drawn: jax.Array
    rewards: jax.Array
    ends: jax.Array
    finals: jax.Array
    finished: jax.Array


class UpdateLog(NamedTuple):
    """The mean loss, and the number and total return of episodes that ended."""

    loss: jax.Array
    episodes: jax.Array
    returns: jax.Array


def estimate(
    rewards: jax.Array,
    values: jax.Array,
    ends: jax.Array,
    finals: jax.Array,
    discount: float,
    trace: float,
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
    discounts = jnp.where(ends, 0.0, discount * trace)

    def back(following: jax.Array, row: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        advantage = row[0] + row[1] * following
        return advantage, advantage

    return lax.scan(back, jnp.zeros_like(missed[0]), (missed, discounts), reverse=True)[1]


def loss_of(
    weights: Weights, samples: Samples, deviation: Any, clip: float, value_weight: float
) -> jax.Array:
    """Return the clipped surrogate loss plus the value loss, as in Stable-Baselines3."""
    drawn = (samples.targets - weights.act(samples.inputs)) / deviation
    ratio = jnp.exp(0.5 * (jnp.square(samples.drawn) - jnp.square(drawn)).sum(1))
    gain = jnp.minimum(
        samples.advantages * ratio, samples.advantages * jnp.clip(ratio, 1.0 - clip, 1.0 + clip)
    )
    missed = jnp.square(weights.value_of(samples.inputs) - samples.returns)
    return value_weight * missed.mean() - gain.mean()


def optimiser(max_gradient: float) -> optax.GradientTransformation:
    """Return Adam without its learning rate, with clipped gradient norms."""
    return optax.chain(optax.clip_by_global_norm(max_gradient), optax.scale_by_adam(eps=1e-5))


def collect(
    s: Settings,
    worlds: JaxWorlds,
    shared: SharedConstants,
    weights: Weights,
    carry: Carry,
    drawn: jax.Array,
    deviation: Any,
) -> tuple[Carry, RolloutBuffer]:
    """Follow the policy with noise ε, ``drawn`` (T, N, clutches); return state and rollout."""

    def act(carry: Carry, drawn: jax.Array) -> tuple[Carry, RolloutBuffer]:
        inputs = worlds.inputs(carry.worlds)
        means = weights.act(inputs)
        noise = s.persistence * carry.noise + deviation * drawn
        after, step = worlds.step(shared, carry.worlds, means + noise)
        ends = step.terminated | step.truncated
        final_values = lax.cond(
            ends.any(),
            lambda: weights.value_of(worlds.last_inputs(shared, carry.worlds, step.last_obs)),
            lambda: jnp.zeros(len(ends)),
        )
        returns = carry.returns + step.rewards
        carry = Carry(after, jnp.where(ends[:, None], 0.0, noise), jnp.where(ends, 0.0, returns))
        finals = jnp.where(ends & ~step.terminated, final_values, 0.0)
        finished = jnp.where(ends, returns, 0.0)
        rewards = s.reward_scale * (PACES["medium"] / step.paces) * step.rewards
        return carry, RolloutBuffer(
            inputs, means + deviation * drawn, drawn, rewards, ends, finals, finished
        )

    return lax.scan(act, carry, drawn)


def samples_of(
    s: Settings, worlds: JaxWorlds, weights: Weights, carry: Carry, rows: RolloutBuffer
) -> Samples:
    """Return the samples of a rollout, with advantages normalised over all parts."""
    values = jnp.concatenate(
        [weights.value_of(rows.inputs), weights.value_of(worlds.inputs(carry.worlds))[None]]
    )
    advantages = estimate(rows.rewards, values, rows.ends, rows.finals, s.discount, s.trace)
    count = lax.psum(advantages.size, PART)
    mean = lax.psum(advantages.sum(), PART) / count
    deviation = jnp.sqrt(lax.psum(jnp.square(advantages - mean).sum(), PART) / (count - 1))
    even = (advantages - mean) / (deviation + 1e-8)
    every = Samples(rows.inputs, rows.targets, rows.drawn, even, advantages + values[:-1])
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), every)


def descend(
    s: Settings, weights: Weights, adam: Any, samples: Samples, deviation: Any, rate: Any
) -> tuple[Weights, Any, jax.Array]:
    """Make a gradient step with the gradients of all parts and return the mean loss."""
    found: Any = jax.value_and_grad(loss_of)(weights, samples, deviation, s.clip, s.value_weight)
    loss, gradient = lax.pmean(found, PART)
    change, adam = optimiser(s.max_gradient).update(gradient, adam)
    return jax.tree.map(lambda w, d: w - rate * d, weights, change), adam, loss


class Learned(NamedTuple):
    """All that the future of a training depends on: weights, state of Adam, and the worlds."""

    weights: Weights
    adam: Any
    carry: Carry


class PPO:
    """Proximal policy optimisation.

    Parameters
    ----------
    settings
        Hyper-parameters.
    training
        Worlds to learn in.
    total
        Steps of the training.
    seed
        Seed of weights, worlds and noise.

    Attributes
    ----------
    steps
        Steps so far.
    rollout
        Steps that ``advance`` adds.

    Raises
    ------
    ParameterError
        If JAX is already running with fewer devices than there are parts.
    """

    def __init__(self, settings: Settings, training: Training, total: int, seed: int) -> None:
        if jax.device_count() < PARTS:
            raise ParameterError(
                f"JAX must have {PARTS} devices, got {jax.device_count()}: "
                "import pter_agents.ppo before it runs "
                f"anything, or set JAX_NUM_CPU_DEVICES={PARTS}"
            )
        self._settings, self._training, self._total, self._seed = settings, training, total, seed
        self._actions = len(training.interface.clutches)
        self.steps = 0
        self.rollout = settings.worlds * settings.steps
        mesh = jax.make_mesh((PARTS,), (PART,), axis_types=(jax.sharding.AxisType.Auto,))
        self._whole, self._split = NamedSharding(mesh, Spec()), NamedSharding(mesh, Spec(PART))
        self._worlds = JaxWorlds(training)
        self._shared = jax.device_put(self._worlds.shared, self._whole)
        self._effortless = (
            self._shared
            if settings.effort == 0.0
            else jax.device_put(self._worlds.effortless, self._whole)
        )
        whole, split = Spec(), Spec(PART)
        over = partial(jax.shard_map, mesh=mesh, check_vma=False)
        learned = Learned(whole, whole, split)  # type: ignore[arg-type]
        self._begin = jax.jit(over(self._reset, in_specs=(whole, split), out_specs=split))
        self._advance = jax.jit(
            over(
                self._learn,
                in_specs=(whole, learned, split, split, whole, whole),
                out_specs=(learned, whole),
            ),
            donate_argnums=1,
        )
        keys = jax.random.split(jax.random.key(seed))
        weights = jax.device_put(
            Weights(
                layers(
                    keys[0], (training.interface.size, *settings.hidden, self._actions), last=0.01
                ),
                layers(keys[1], (training.size, *settings.value_hidden, 1), last=1.0),
            ),
            self._whole,
        )
        adam = jax.device_put(optimiser(settings.max_gradient).init(weights), self._whole)
        seeds = seed * settings.worlds + np.arange(settings.worlds, dtype=np.uint64)
        halves = jax.device_put(seeds.view(np.uint32).reshape(-1, 2), self._split)
        self._learned = Learned(weights, adam, self._begin(self._shared, halves))

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
        shared = self._shared if done < s.effort_share else self._effortless
        self._learned, log = self._advance(
            shared, self._learned, *self._draw(), np.float32(deviation), np.float32(rate)
        )
        self.steps += self.rollout
        loss, episodes, returns = map(float, log)
        weights = jax.tree.leaves(self._learned.weights)
        if not math.isfinite(loss) or not all(np.isfinite(part).all() for part in weights):
            raise FloatingPointError("a loss or a weight is not finite")
        mean_return = returns / episodes if episodes else math.nan
        return {
            "loss": loss,
            "learning_rate": rate,
            "deviation": deviation,
            "mean_return": mean_return,
        }

    def policy(self) -> TrainedPolicy:
        """Return the policy's mean action."""
        return policy_of(self._training.interface, self.get_state())

    def get_state(self) -> dict[str, np.ndarray]:
        """Return the arrays of the training's state by name."""
        leaves, _ = jax.tree_util.tree_flatten_with_path(self._learned)
        return {jax.tree_util.keystr(path): np.array(leaf) for path, leaf in leaves}

    def set_state(self, state: dict[str, np.ndarray], steps: int) -> None:
        """Restore the state from ``get_state`` after so many steps.

        Raises
        ------
        ValueError
            If it is the state of another training.
        """
        leaves, tree = jax.tree_util.tree_flatten_with_path(self._learned)
        restored: list[Any] = []
        for path, leaf in leaves:
            value = state[jax.tree_util.keystr(path)]
            if value.shape != leaf.shape or value.dtype != leaf.dtype:
                raise ValueError(
                    f"{jax.tree_util.keystr(path)} must be {leaf.dtype} {leaf.shape}, "
                    f"got {value.shape}"
                )
            restored.append(jax.device_put(value, leaf.sharding))
        self._learned = jax.tree.unflatten(tree, restored)
        self.steps = steps

    def _draw(self) -> tuple[Any, Any]:
        """Return the ε of a rollout, and the samples of each epoch and minibatch, for each part."""
        s = self._settings
        mine = s.worlds // PARTS
        rngs = [np.random.default_rng((self._seed, self.steps, part)) for part in range(PARTS)]
        noise = [rng.standard_normal((s.steps, mine, self._actions), np.float32) for rng in rngs]
        orders = [
            [rng.permutation(s.steps * mine).astype(np.int32) for _ in range(s.epochs)]
            for rng in rngs
        ]
        shares = np.array(orders).reshape(PARTS, -1, s.minibatch // PARTS)
        return jax.device_put((np.array(noise), shares), self._split)

    def _reset(self, shared: SharedConstants, seeds: jax.Array) -> Carry:
        worlds = self._worlds.reset(shared, seeds)
        return Carry(worlds, jnp.zeros((len(seeds), self._actions)), jnp.zeros(len(seeds)))

    def _learn(
        self,
        shared: SharedConstants,
        learned: Learned,
        drawn: jax.Array,
        orders: jax.Array,
        deviation: jax.Array,
        rate: jax.Array,
    ) -> tuple[Learned, UpdateLog]:
        """Collect and learn in one part."""
        s = self._settings
        carry, rows = collect(
            s, self._worlds, shared, learned.weights, learned.carry, drawn[0], deviation
        )
        samples = samples_of(s, self._worlds, learned.weights, carry, rows)

        def update(kept: Any, chosen: jax.Array) -> tuple[Any, jax.Array]:
            mine = jax.tree.map(lambda x: x[chosen], samples)
            weights, adam, loss = descend(s, kept[0], kept[1], mine, deviation, rate)
            return (weights, adam), loss

        (weights, adam), losses = lax.scan(update, learned[:2], orders[0])
        log = UpdateLog(losses.mean(), *lax.psum((rows.ends.sum(), rows.finished.sum()), PART))
        return Learned(weights, adam, carry), log


def layers(key: jax.Array, sizes: tuple[int, ...], last: float) -> Layers:
    """Return layers with orthogonal weights, the last scaled by ``last``, and biases of 0."""
    gains = [math.sqrt(2.0)] * (len(sizes) - 2) + [last]
    keys = jax.random.split(key, len(gains))
    return [
        (jax.nn.initializers.orthogonal(gain)(each, shape, jnp.float32), jnp.zeros(shape[1]))
        for gain, each, shape in zip(gains, keys, pairwise(sizes), strict=True)
    ]


def _apply(layers: Layers, values: jax.Array) -> jax.Array:
    for weight, bias in layers[:-1]:
        values = jnp.tanh(values @ weight + bias)
    weight, bias = layers[-1]
    return values @ weight + bias
