# pyright: standard
"""Proximal policy optimisation (Schulman et al., arXiv:1707.06347), from top to bottom.

A rollout and its gradient steps are one compiled call. The worlds are split into two parts, each on
its own JAX device (a CPU core), which collects their rollout and computes the gradients of its half
of each minibatch. The sum of two does not depend on the order, so the result is the same on any
number of cores.

The clutches' lag filters out most noise that is independent at each control step. So the noise is
autoregressive: n = ρ·n' + σ·ε with a standard normal ε. Given n', the action a has mean μ + ρ·n'
and standard deviation σ, so its likelihood is exact.

With a teacher, the loss is at first how far the policy is from it (kickstarting, Schmitt et al.,
arXiv:1803.03835): the Kullback-Leibler divergence of their actions under the exploration's noise,
in the states that the policy itself meets.

A path pays the same at any pace, so a slow step pays a quarter of a brisk one, and its advantages
would be lost among theirs. So rewards are divided by the commanded pace: each control step is worth
the same.
"""

import math
import os
import time
from collections.abc import Callable
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
from numpy.typing import NDArray
from tensorboard.summary import Writer

from pter_agents.adversary import Adversary
from pter_agents.draws import PaceScores, validate, validation_episodes
from pter_agents.runs import RunFolder, Tensors, policy_of
from pter_agents.settings import PARTS, TrainingArguments
from pter_agents.worlds import JaxWorlds, RolloutState, SharedConstants
from pter_gym._internal.files import FilePath, make_folder, remove_leftovers
from pter_gym.errors import ParameterError, PterError, StorageError
from pter_gym.policies import TrainedController
from pter_gym.policies._files import encode_policy
from pter_gym.scenarios import PACES

PART = "part"
"""Name of the axis of the parts."""

HANDS = "hands"
"""Name of the adversary's populations among the arrays of a state."""

SEARCH_EVERY = 96
"""Rollouts between two searches of the adversary."""

with suppress(RuntimeError):  # JAX has run already, with the devices that it has
    jax.config.update("jax_num_cpu_devices", PARTS)

if not getattr(jax.config, "jax_compilation_cache_dir"):  # noqa: B009  (pyright does not know it)
    jax.config.update(
        "jax_compilation_cache_dir",
        str(Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "pter_gym"),
    )

Number = float | jax.Array

Layers = list[tuple[jax.Array, jax.Array]]
"""Weights (inputs, outputs) and biases of linear layers with tanh between them."""


class TrainingDivergedError(PterError, ArithmeticError):
    """A loss or a weight is not finite; the message names the last good checkpoint."""


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


def _apply(layers: Layers, values: jax.Array) -> jax.Array:
    for weight, bias in layers[:-1]:
        values = jnp.tanh(values @ weight + bias)
    weight, bias = layers[-1]
    return values @ weight + bias


def _layers(key: jax.Array, sizes: tuple[int, ...], last: float) -> Layers:
    """Return layers with orthogonal weights, the last scaled by ``last``, and biases of 0."""
    gains = [math.sqrt(2.0)] * (len(sizes) - 2) + [last]
    keys = jax.random.split(key, len(gains))
    return [
        (jax.nn.initializers.orthogonal(gain)(each, shape, jnp.float32), jnp.zeros(shape[1]))
        for gain, each, shape in zip(gains, keys, pairwise(sizes), strict=True)
    ]


class Carry(NamedTuple):
    """What goes from rollout to rollout, worlds first: their state, and the exploration's noise."""

    worlds: RolloutState
    noise: jax.Array


class TrainState(NamedTuple):
    """State of a training: weights, optimiser and worlds."""

    weights: Weights
    adam: optax.OptState
    carry: Carry


class RolloutBuffer(NamedTuple):
    """Each step of each world, (T, N, …): inputs of the networks, actions minus the remainder of
    the earlier noise, ρ·n', ε, rewards for learning, whether an episode ended, and the value of its
    last state, 0 if it was terminated."""

    inputs: jax.Array
    targets: jax.Array
    drawn: jax.Array
    rewards: jax.Array
    ends: jax.Array
    finals: jax.Array


class Samples(NamedTuple):
    """Samples of a rollout, one per row, with generalised advantages and returns."""

    inputs: jax.Array
    targets: jax.Array
    drawn: jax.Array
    advantages: jax.Array
    returns: jax.Array


def estimate(rows: RolloutBuffer, values: jax.Array, discount: float, trace: float) -> jax.Array:
    """Return generalised advantages (T, N), Schulman et al., arXiv:1506.02438.

    ``values`` are those of the states before each step and after the last, (T + 1, N).
    """
    after = jnp.where(rows.ends, rows.finals, values[1:])
    missed = rows.rewards + discount * after - values[:-1]
    discounts = jnp.where(rows.ends, 0.0, discount * trace)

    def back(following: jax.Array, row: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        advantage = row[0] + row[1] * following
        return advantage, advantage

    return lax.scan(back, jnp.zeros_like(missed[0]), (missed, discounts), reverse=True)[1]


class PPO:
    """A training, which ``advance`` continues by a rollout.

    Attributes
    ----------
    worlds, state
        What it learns in, and what it has learned.
    steps, rollout
        Steps so far, and those that ``advance`` adds.

    Raises
    ------
    ParameterError
        If JAX is already running with fewer CPU devices than there are parts.
    """

    def __init__(self, arguments: TrainingArguments) -> None:
        cpus = jax.devices("cpu")[:PARTS]
        if len(cpus) < PARTS:
            raise ParameterError(
                f"JAX must have {PARTS} CPU devices, got {len(cpus)}: import pter_agents.ppo "
                f"before it runs anything, or set JAX_NUM_CPU_DEVICES={PARTS}"
            )
        s = self._settings = arguments.settings
        self._total, self._seed = arguments.steps, arguments.seed
        self.steps, self.rollout = 0, s.worlds * s.steps
        with jax.default_device(cpus[0]):
            self.worlds = JaxWorlds(arguments)
            interface = self.worlds.interface
            taught = self.worlds.teacher.layers if self.worlds.teacher else ()
            self._teacher = [(jnp.asarray(weight.T), jnp.asarray(bias)) for weight, bias in taught]
            self._actions = len(interface.clutches)
            for_policy, for_value = jax.random.split(jax.random.key(self._seed))
            weights = Weights(
                _layers(for_policy, (interface.size, *s.hidden, self._actions), last=0.01),
                _layers(for_value, (self.worlds.size, *s.value_hidden, 1), last=1.0),
            )
        # Adam without its learning rate, with clipped gradient norms
        clip = optax.clip_by_global_norm(s.max_gradient)
        self._optimiser = optax.chain(clip, optax.scale_by_adam(eps=1e-5))
        mesh = jax.make_mesh((PARTS,), (PART,), (jax.sharding.AxisType.Auto,), devices=cpus)
        whole, split = Spec(), Spec(PART)
        self._whole, self._split = NamedSharding(mesh, whole), NamedSharding(mesh, split)
        over = partial(jax.shard_map, mesh=mesh, check_vma=False)
        state: Any = TrainState(whole, whole, split)  # pyright: ignore[reportArgumentType]
        given = (whole, state, split, split, whole, whole, whole)
        update = over(self._update, in_specs=given, out_specs=(state, whole))
        self._compiled = jax.jit(update, donate_argnums=1)
        self._compiled_begin = jax.jit(over(self._begin, in_specs=(whole, split), out_specs=split))
        self._adversary = Adversary(arguments) if s.adversary else None
        self.hands = self._adversary.begin() if self._adversary else np.zeros((0, 0, 0))
        self._meet()
        weights = jax.device_put(weights, self._whole)
        adam = jax.device_put(self._optimiser.init(weights), self._whole)
        seeds = self._seed * s.worlds + np.arange(s.worlds, dtype=np.uint64)
        self.state = TrainState(weights, adam, self._reset(seeds))

    def _meet(self) -> None:
        """Let the worlds draw from the hands that the adversary has."""
        hands = self._adversary.pairs(self.hands) if self._adversary else ()
        shared = self.worlds.shared(hands)
        free = self.worlds.shared(hands, effort=False) if self._settings.effort else shared
        self._shared, self._effortless = jax.device_put((shared, free), self._whole)

    def _reset(self, seeds: NDArray[np.uint64]) -> Carry:
        """Return new worlds."""
        halves = jax.device_put(seeds.view(np.uint32).reshape(-1, 2), self._split)
        return self._compiled_begin(self._shared, halves)

    def _begin(self, shared: SharedConstants, seeds: jax.Array) -> Carry:
        noise = jnp.zeros((len(seeds), self._actions))
        return Carry(self.worlds.reset(shared, seeds), noise)

    def collect(
        self,
        shared: SharedConstants,
        weights: Weights,
        carry: Carry,
        drawn: jax.Array,
        deviation: Number,
    ) -> tuple[Carry, RolloutBuffer]:
        """Follow the policy with noise ε, ``drawn`` (T, N, clutches); return state and rollout."""
        s, worlds = self._settings, self.worlds

        def act(carry: Carry, drawn: jax.Array) -> tuple[Carry, RolloutBuffer]:
            inputs = worlds.inputs(carry.worlds)
            means = weights.act(inputs)
            noise = s.persistence * carry.noise + deviation * drawn
            after, step = worlds.step(shared, carry.worlds, means + noise)
            ends = step.terminated | step.truncated
            last_values = lax.cond(
                ends.any(),
                lambda: weights.value_of(worlds.last_inputs(shared, carry.worlds, step.last_obs)),
                lambda: jnp.zeros(len(ends)),
            )
            finals = jnp.where(ends & ~step.terminated, last_values, 0.0)
            rewards = s.reward_scale * (PACES["medium"] / step.paces) * step.rewards
            targets = means + deviation * drawn
            row = RolloutBuffer(inputs, targets, drawn, rewards, ends, finals)
            return Carry(after, jnp.where(ends[:, None], 0.0, noise)), row

        return lax.scan(act, carry, drawn)

    def _samples_of(self, weights: Weights, carry: Carry, rows: RolloutBuffer) -> Samples:
        """Return the samples of a rollout, with advantages normalised over all parts."""
        s, last = self._settings, weights.value_of(self.worlds.inputs(carry.worlds))
        values = jnp.concatenate([weights.value_of(rows.inputs), last[None]])
        advantages = estimate(rows, values, s.discount, s.trace)
        count = lax.psum(advantages.size, PART)
        mean = lax.psum(advantages.sum(), PART) / count
        deviation = jnp.sqrt(lax.psum(jnp.square(advantages - mean).sum(), PART) / (count - 1))
        even = (advantages - mean) / (deviation + 1e-8)
        every = Samples(*rows[:3], even, advantages + values[:-1])
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), every)

    def _loss(
        self, weights: Weights, samples: Samples, deviation: Number, imitation: Number
    ) -> jax.Array:
        """Return the clipped surrogate loss plus the value loss, as in Stable-Baselines3.

        The divergence from the teacher takes the place of a share ``imitation`` of the former.
        """
        s = self._settings
        means = weights.act(samples.inputs)
        drawn = (samples.targets - means) / deviation
        ratio = jnp.exp(0.5 * (jnp.square(samples.drawn) - jnp.square(drawn)).sum(1))
        clipped = jnp.clip(ratio, 1.0 - s.clip, 1.0 + s.clip)
        gain = jnp.minimum(samples.advantages * ratio, samples.advantages * clipped)
        missed = jnp.square(weights.value_of(samples.inputs) - samples.returns)
        loss = s.value_weight * missed.mean() - (1.0 - imitation) * gain.mean()
        if not self._teacher:
            return loss
        shown = jnp.clip(
            _apply(self._teacher, samples.inputs[:, : self.worlds.interface.size]), -1, 1
        )
        divergence = 0.5 * jnp.square((shown - means) / deviation).sum(1)
        return loss + imitation * divergence.mean()

    def _update(
        self,
        shared: SharedConstants,
        state: TrainState,
        drawn: jax.Array,
        orders: jax.Array,
        deviation: Number,
        rate: Number,
        imitation: Number,
    ) -> tuple[TrainState, jax.Array]:
        """Collect and learn in one part; return the state and the mean loss."""
        before, adam, carry = state
        carry, rows = self.collect(shared, before, carry, drawn[0], deviation)
        samples = self._samples_of(before, carry, rows)

        def descend(kept: tuple[Weights, optax.OptState], chosen: jax.Array) -> Any:
            weights, adam = kept
            some = jax.tree.map(lambda x: x[chosen], samples)
            found = jax.value_and_grad(self._loss)(weights, some, deviation, imitation)
            loss, gradient = lax.pmean(found, PART)
            change, adam = self._optimiser.update(gradient, adam)
            return (jax.tree.map(lambda w, d: w - rate * d, weights, change), adam), loss

        (weights, adam), losses = lax.scan(descend, (before, adam), orders[0])
        return TrainState(weights, adam, carry), losses.mean()

    def advance(self) -> None:
        """Collect a rollout and learn from it.

        Raises
        ------
        FloatingPointError
            If a loss or a weight is not finite.
        """
        s, done = self._settings, self.steps / self._total
        if self._adversary and self.steps // self.rollout % SEARCH_EVERY == 0:
            self.hands = self._adversary.search(self.policy(), self.hands, self.steps)
            self._meet()
            rng = np.random.default_rng([self._seed, self.steps, *b"worlds"])
            seeds = rng.integers(1 << 64, size=s.worlds, dtype=np.uint64)
            self.state = self.state._replace(carry=self._reset(seeds))
        mine = s.worlds // PARTS
        rngs = [np.random.default_rng((self._seed, self.steps, part)) for part in range(PARTS)]
        drawn = [rng.standard_normal((s.steps, mine, self._actions), np.float32) for rng in rngs]
        orders = [[rng.permutation(s.steps * mine) for _ in range(s.epochs)] for rng in rngs]
        shares = np.array(orders, np.int32).reshape(PARTS, -1, s.minibatch // PARTS)
        given = jax.device_put((np.array(drawn), shares), self._split)
        shared = self._shared if done < s.effort_share else self._effortless
        now = s.deviation_at(done), s.learning_rate_at(done), s.imitation_at(done)
        numbers = map(np.float32, now)
        self.state, loss = self._compiled(shared, self.state, *given, *numbers)
        self.steps += self.rollout
        if not all(np.isfinite(x).all() for x in (loss, *jax.tree.leaves(self.state.weights))):
            raise FloatingPointError("a loss or a weight is not finite")

    def policy(self) -> TrainedController:
        """Return the policy's mean action."""
        return policy_of(self.worlds.interface, self.get_state())

    def get_state(self) -> Tensors:
        """Return the arrays of the training's state by name."""
        leaves, _ = jax.tree_util.tree_flatten_with_path(self.state)
        arrays = {jax.tree_util.keystr(path): np.array(leaf) for path, leaf in leaves}
        return {**arrays, HANDS: self.hands} if self._adversary else arrays

    def set_state(self, state: Tensors, steps: int) -> None:
        """Restore the state from ``get_state`` after so many steps, or raise a ValueError if it is
        that of another training."""

        def restored(path: Any, leaf: jax.Array) -> jax.Array:
            name = jax.tree_util.keystr(path)
            value = state[name]
            if value.shape != leaf.shape or value.dtype != leaf.dtype:
                raise ValueError(f"{name} must be {leaf.dtype} {leaf.shape}, got {value.shape}")
            return jax.device_put(value, leaf.sharding)

        self.state = jax.tree_util.tree_map_with_path(restored, self.state)
        self.steps = steps
        if self._adversary:
            self.hands = state[HANDS]
            self._meet()


def train(
    arguments: TrainingArguments,
    out: FilePath,
    *,
    resume: bool = False,
    on_progress: Callable[[int], None] = lambda _: None,
    on_scores: Callable[[int, PaceScores], None] = lambda _steps, _scores: None,
) -> Path:
    """Train a policy and return its last checkpoint.

    Parameters
    ----------
    arguments
        What to train. With ``resume``, they must equal those of the run in the folder, except for
        the steps.
    out
        Folder of the run.
    resume
        Whether to continue from the newest checkpoint in the folder.
    on_progress
        Called with the steps so far after each rollout.
    on_scores
        Called with the steps so far and the scores after each validation.

    Raises
    ------
    ParameterError
        If the folder already holds a run, or none to resume, or a different one, or another process
        trains in it; or if the policy could not be exported.
    DataError
        If a file of the run to resume cannot be read.
    StorageError
        If the folder can no longer be written to; the message names the newest checkpoint.
    TrainingDivergedError
        If a loss or a weight is no longer finite; the message names the last good checkpoint.
    """
    folder = RunFolder(out)
    if resume:
        arguments.check_same(folder.read()[0])
    make_folder(folder.path)
    with folder.lock():
        remove_leftovers(folder.path)
        model = PPO(arguments)
        encode_policy(model.policy())
        if not resume:
            folder.begin(arguments, model.worlds.interface)
        else:
            folder.resume()
            if folder.checkpoints():
                steps, state = folder.load()
                model.set_state(state, steps)
        return _train(arguments, model, folder, on_progress, on_scores)


def _train(
    arguments: TrainingArguments,
    model: PPO,
    folder: RunFolder,
    on_progress: Callable[[int], None],
    on_scores: Callable[[int, PaceScores], None],
) -> Path:
    """Train a model with checkpoints and validation, and return its last checkpoint."""
    episodes = validation_episodes(arguments)
    before = folder.progress(model.steps)
    began = time.perf_counter() - (float(before[-1].split(",")[0]) if before else 0.0)
    events = Writer(str(folder.path))

    def score() -> None:
        scores = validate(model.policy(), episodes)
        folder.add_scores(model.steps, time.perf_counter() - began, scores)
        for pace, values in scores.items():
            for name in ("path_error_m", "completed"):
                events.add_scalar(f"{name}/{pace}", values[name], model.steps)
        events.flush()
        on_scores(model.steps, scores)

    try:
        while model.steps < arguments.steps:
            rollouts = model.steps // model.rollout
            if rollouts % arguments.checkpoint_every == 0:
                folder.save(model.steps, model.get_state())
            if rollouts and rollouts % arguments.validate_every == 0:
                score()
            model.advance()
            on_progress(model.steps)
        score()
        return folder.save(model.steps, model.get_state())
    except (FloatingPointError, OSError) as error:
        newest = "".join(
            f"; the newest checkpoint is {path}" for _, path in folder.checkpoints()[-1:]
        )
        message = f"training stopped after {model.steps} steps: {error}{newest}"
        kind = StorageError if isinstance(error, OSError) else TrainingDivergedError
        raise kind(message) from error
    finally:
        with suppress(OSError):  # of a full disk, which has been told
            events.close()
