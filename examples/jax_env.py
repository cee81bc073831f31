"""Step the environment inside `jax.jit` and `lax.scan`; `vmap` makes one world many."""

import jax
from jax import numpy as jnp

from pter_gym.envs.jax import make

WORLDS, STEPS = 64, 100

env, params = make("PTER/Standard-v0")
weights = 0.1 * jax.random.normal(jax.random.key(1), (len(env.observation_layout), 4))


@jax.jit
def rollout(key, weights):
    """Return the mean reward of a linear policy with noise."""
    reset_key, step_key = jax.random.split(key)
    observations, states = jax.vmap(env.reset, in_axes=(0, None))(
        jax.random.split(reset_key, WORLDS), params
    )

    def step(carry, key):
        observations, states = carry
        actions = jnp.tanh(observations @ weights) + 0.1 * jax.random.normal(key, (WORLDS, 4))
        observations, states, rewards, terminated, truncated, info = jax.vmap(
            env.step, in_axes=(None, 0, 0, None)
        )(key, states, jnp.clip(actions, -1.0, 1.0), params)
        return (observations, states), rewards

    _, rewards = jax.lax.scan(step, (observations, states), jax.random.split(step_key, STEPS))
    return rewards.mean()


# evolution strategies in two lines: of some random changes of the weights, take the best
changes = 0.1 * jax.random.normal(jax.random.key(2), (8, *weights.shape))
found = jnp.array([rollout(jax.random.key(0), weights + change) for change in changes])
print(
    f"mean reward: {rollout(jax.random.key(0), weights):.2f}, "
    f"best of eight changes: {found.max():.2f}"
)
