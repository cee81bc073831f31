"""PPO in one file of JAX, all of it in one `jit`, in the style of PureJaxRL: `python agents/stock/jax_ppo.py`."""

import os
from functools import partial
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")  # small networks are slower with more threads

import jax
import numpy as np
import tyro
from jax import lax
from jax import numpy as jnp
from jax.example_libraries.optimizers import adam, clip_grads

from pter_gym.benchmark import ResultsFolder, find_policy, from_actions, print_boards, run_scenario
from pter_gym.envs.jax import make

DISCOUNT, TRACE, CLIP = 0.99, 0.95, 0.2


class Samples(NamedTuple):
    obs: jax.Array
    action: jax.Array
    log_prob: jax.Array
    value: jax.Array
    following: jax.Array
    reward: jax.Array
    done: jax.Array


def network(key, *sizes, last):
    gains = [2.0**0.5] * (len(sizes) - 2) + [last]
    keys = jax.random.split(key, len(gains))
    scaled = [jax.nn.initializers.orthogonal(gain) for gain in gains]
    return [(f(k, (a, b)), jnp.zeros(b)) for f, k, a, b in zip(scaled, keys, sizes[:-1], sizes[1:], strict=True)]


def apply(layers, x):
    for weight, bias in layers[:-1]:
        x = jnp.tanh(x @ weight + bias)
    return x @ layers[-1][0] + layers[-1][1]


def log_prob(actor, obs, action):
    layers, spread = actor
    z = (action - apply(layers, obs)) / jnp.exp(spread)
    return -0.5 * jnp.square(z).sum(-1) - spread.sum()


def estimate(gain, row):
    gain = row.reward + DISCOUNT * row.following - row.value + DISCOUNT * TRACE * (1.0 - row.done) * gain
    return gain, gain


def loss(weights, batch, gains):
    actor, critic = weights
    ratio = jnp.exp(log_prob(actor, batch.obs, batch.action) - batch.log_prob)
    better = (gains - gains.mean()) / (gains.std() + 1e-8)
    surrogate = jnp.minimum(ratio * better, jnp.clip(ratio, 1.0 - CLIP, 1.0 + CLIP) * better).mean()
    return 0.5 * jnp.square(apply(critic, batch.obs)[:, 0] - batch.value - gains).mean() - surrogate


def learn(env, params, seed, steps, worlds, horizon, minibatches, epochs, rate):
    """Return the actor after so many decisions."""
    updates = steps // (worlds * horizon)
    size, gradients = len(env.observation_layout), updates * epochs * minibatches
    begin, update, weights_of = adam(lambda k: rate * (1.0 - k / gradients), eps=1e-5)
    key, *keys = jax.random.split(jax.random.key(seed), 4)
    actor = network(keys[0], size, 64, 64, 4, last=0.01), jnp.zeros(4)
    optimiser = begin((actor, network(keys[1], size, 64, 64, 1, last=1.0)))
    obs, state = jax.vmap(env.reset, in_axes=(0, None))(jax.random.split(keys[2], worlds), params)
    step_all = jax.vmap(env.step, in_axes=(None, 0, 0, None))

    def act(weights, carry, key):
        state, obs, returns, seen = carry
        (layers, spread), critic = weights
        action = apply(layers, obs) + jnp.exp(spread) * jax.random.normal(key, (worlds, 4))
        after, state, reward, terminated, truncated, info = step_all(None, state, action, params)
        done = terminated | truncated
        returns = DISCOUNT * returns + reward
        seen = moments(seen, returns)
        following = jnp.where(terminated, 0.0, apply(critic, info["final_observation"])[:, 0])
        row = Samples(
            obs,
            action,
            log_prob((layers, spread), obs, action),
            apply(critic, obs)[:, 0],
            following,
            reward / jnp.sqrt(seen[1] + 1e-8),
            done.astype(jnp.float32),
        )
        return (state, after, jnp.where(done, 0.0, returns), seen), row

    def descend(carry, batch):
        optimiser, k = carry
        gradient = clip_grads(jax.grad(loss)(weights_of(optimiser), *batch), 0.5)
        return (update(k, gradient, optimiser), k + 1), None

    def rollout_and_learn(carry, key):
        optimiser, k, *worlds_now = carry
        keys = jax.random.split(key, horizon + epochs)
        worlds_now, rows = lax.scan(partial(act, weights_of(optimiser)), tuple(worlds_now), keys[:horizon])
        _, gains = lax.scan(estimate, jnp.zeros(worlds), rows, reverse=True)
        flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), (rows, gains))

        def epoch(carry, key):
            order = jax.random.permutation(key, worlds * horizon).reshape(minibatches, -1)
            return lax.scan(lambda c, i: descend(c, jax.tree.map(lambda x: x[i], flat)), carry, order)

        (optimiser, k), _ = lax.scan(epoch, (optimiser, k), keys[horizon:])
        return (optimiser, k, *worlds_now), rows.reward.mean()

    scaling = (jnp.zeros(()), jnp.ones(()), jnp.full((), 1e-4))
    carry = optimiser, 0, state, obs, jnp.zeros(worlds), scaling
    carry, _ = lax.scan(rollout_and_learn, carry, jax.random.split(key, updates))
    return weights_of(carry[0])[0][0]


def moments(seen, values):
    """Return mean, variance and count with some values more."""
    mean, variance, count = seen
    more, total = values.size, count + values.size
    shift = values.mean() - mean
    pooled = (variance * count + values.var() * more + shift**2 * count * more / total) / total
    return mean + shift * more / total, pooled, total


def train(
    seed: int = 0, steps: int = 5_000_000, worlds: int = 256, horizon: int = 64, out: Path = Path("stock")
) -> None:
    env, params = make("PTER/Standard-v0")
    settings = {"steps": steps, "worlds": worlds, "horizon": horizon, "minibatches": 8, "epochs": 10, "rate": 1e-3}
    layers = jax.jit(partial(learn, env, **settings))(params, seed)
    layers = jax.tree.map(np.asarray, layers)

    def act(obs):
        for weight, bias in layers[:-1]:
            obs = np.tanh(obs @ weight + bias)
        return obs @ layers[-1][0] + layers[-1][1]

    policies = {f"jax-ppo-{seed}": from_actions(act, env.env), "torque-feedback": find_policy("torque-feedback")}
    print_boards(run_scenario("standard", policies, seed=seed, results=ResultsFolder(out)))


if __name__ == "__main__":
    tyro.cli(train)
