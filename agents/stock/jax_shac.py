"""SHAC, a short-horizon actor-critic on exact gradients, in one file of JAX: `python agents/stock/jax_shac.py`.

The actor ascends the derivative of what it earns in a short rollout, through the environment itself, and of the value
of where that ends (Xu et al. 2022). Actions are the tanh of a normal variable, so none is out of range.
"""

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
from pter_gym.gradients.env import make

DISCOUNT, TRACE, FOLLOW, UNIT = 0.99, 0.95, 0.2, 10.0
"""γ, λ, part of the way that the target critic follows in an update, reward that counts as 1."""


class Samples(NamedTuple):
    obs: jax.Array
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


def value(critic, obs):
    return apply(critic, obs)[..., 0]


def learn(env, params, seed, steps, worlds, horizon, epochs, rates, noise):
    """Return the actor after so many decisions."""
    updates, size = steps // (worlds * horizon), len(env.observation_layout)
    (begin, ascend, actor_of), (begin_critic, fit, critic_of) = (
        adam(lambda k, rate=rate, last=last: rate * (1.0 - k / last), b1=0.7, b2=0.95)
        for rate, last in zip(rates, (updates, updates * epochs), strict=True)
    )
    key, *keys = jax.random.split(jax.random.key(seed), 4)
    critic = network(keys[1], size, 64, 64, 1, last=1.0)
    optimisers = begin(network(keys[0], size, 64, 64, 4, last=0.01)), begin_critic(critic)
    obs, state = jax.vmap(env.reset, in_axes=(0, None))(jax.random.split(keys[2], worlds), params)
    step_all = jax.vmap(env.step, in_axes=(None, 0, 0, None))

    def act(actor, target, spread, carry, key):
        state, obs, weight, earned = carry
        action = jnp.tanh(apply(actor, obs) + spread * jax.random.normal(key, (worlds, 4)))
        after, state, reward, terminated, truncated, info = step_all(None, state, action, params)
        done, reward = terminated | truncated, reward / UNIT
        following = jnp.where(terminated, 0.0, value(target, info["final_observation"]))
        earned += weight * (reward + DISCOUNT * jnp.where(done, following, 0.0))
        weight = jnp.where(done, 1.0, DISCOUNT * weight)
        return (state, after, weight, earned), Samples(obs, following, reward, done.astype(jnp.float32))

    def loss(actor, target, spread, state, obs, keys):
        carry = state, obs, jnp.ones(worlds), jnp.zeros(worlds)
        (state, obs, weight, earned), rows = lax.scan(partial(act, actor, target, spread), carry, keys)
        return -(earned + weight * value(target, obs)).mean() / horizon, (state, obs, rows)

    def update(carry, key):
        (actor, critic), target, k, state, obs = carry
        keys = jax.random.split(key, horizon + epochs)
        spread = noise * (1.0 - k / updates)
        given = actor_of(actor), target, spread, lax.stop_gradient(state), obs, keys[:horizon]
        gradient, (state, obs, rows) = jax.grad(loss, has_aux=True)(*given)
        actor = ascend(k, clip_grads(jax.tree.map(jnp.nan_to_num, gradient), 0.5), actor)

        def back(gain, row):
            later = row.following + (1.0 - row.done) * gain
            aim = row.reward + DISCOUNT * later
            return TRACE * (aim - value(target, row.obs)), aim

        _, aims = lax.scan(back, jnp.zeros(worlds), rows, reverse=True)
        samples = rows.obs.reshape(-1, size), aims.reshape(-1)

        def epoch(carry, key):
            critic, n = carry
            chosen = jax.random.choice(key, worlds * horizon, (worlds * horizon // 4,), replace=False)
            x, y = (each[chosen] for each in samples)
            by = jax.grad(lambda layers: jnp.square(value(layers, x) - y).mean())(critic_of(critic))
            return (fit(n, clip_grads(by, 0.5), critic), n + 1), None

        (critic, _), _ = lax.scan(epoch, (critic, k * epochs), keys[horizon:])
        target = jax.tree.map(lambda old, new: old + FOLLOW * (new - old), target, critic_of(critic))
        return ((actor, critic), target, k + 1, state, obs), rows.reward.mean()

    carry = optimisers, critic, 0, state, obs
    carry, _ = lax.scan(update, carry, jax.random.split(key, updates))
    return actor_of(carry[0][0])


def train(
    seed: int = 0, steps: int = 1_500_000, worlds: int = 32, horizon: int = 16, out: Path = Path("stock")
) -> None:
    env, params = make("PTER/Standard-v0", episode_end="constant")
    settings = {"steps": steps, "worlds": worlds, "horizon": horizon, "epochs": 8, "rates": (2e-3, 2e-3), "noise": 0.3}
    layers = jax.jit(partial(learn, env, **settings))(params, seed)
    layers = jax.tree.map(np.asarray, layers)

    def act(obs):
        for weight, bias in layers[:-1]:
            obs = np.tanh(obs @ weight + bias)
        return np.tanh(obs @ layers[-1][0] + layers[-1][1])

    policies = {f"jax-shac-{seed}": from_actions(act, env.env), "torque-feedback": find_policy("torque-feedback")}
    print_boards(run_scenario("standard", policies, seed=seed, results=ResultsFolder(out)))


if __name__ == "__main__":
    tyro.cli(train)
