"""How fast `pter train ppo` is beside Stable-Baselines3's PPO, and where its time goes: a block of docs/agents.md.

    NUMBA_NUM_THREADS=1 python docs/make/training_speed.py

Both train the same networks, the value not privileged, on as many worlds with as many samples, epochs and minibatches,
by turns in one process, and the median of some turns counts. Needs the agents extra and two idle cores.
"""

from dataclasses import replace
from functools import partial
from statistics import median
from textwrap import fill
from time import perf_counter
from typing import Any

import jax
import torch
import tyro
from jax import numpy as jnp
from jax.sharding import PartitionSpec as Spec
from pages import put_block, table
from stable_baselines3 import PPO

from pter_agents import training
from pter_agents.algorithms import load_settings
from pter_agents.ppo import PART, collect
from pter_agents.prepare import make_interface
from pter_gym.envs.sb3 import make_sb3_vec_env


def ours(arguments: training.Arguments) -> Any:
    draws = training.make_draws(arguments)
    interface = make_interface(arguments.settings, arguments.scenario, draws, arguments.seed)
    return training.make_model(arguments, training.make_training_worlds(arguments, draws, interface))


def theirs(arguments: training.Arguments) -> Any:
    """Stable-Baselines3's PPO on as many worlds."""
    s: Any = arguments.settings
    draws = training.make_draws(arguments)
    return PPO(
        "MlpPolicy",
        make_sb3_vec_env(s.worlds, randomisation=draws, max_episode_steps=s.episode, num_threads=1),
        n_steps=s.steps,
        batch_size=s.minibatch,
        n_epochs=s.epochs,
        learning_rate=s.learning_rate,
        gamma=s.discount,
        policy_kwargs={"net_arch": {"pi": list(s.hidden), "vf": list(s.value_hidden)}},
        device="cpu",
        seed=0,
    )


def seconds(do: Any) -> float:
    """Return how long something takes."""
    begin = perf_counter()
    jax.block_until_ready(do())
    return perf_counter() - begin


def profile(model: Any, times: int) -> dict[str, float]:
    """Return the shares of the time of a rollout: the worlds alone, then with the networks, then with all the rest."""
    s, worlds, shared = model._settings, model._worlds, model._shared
    drawn, _ = model._draw()

    def follow(shared: Any, weights: Any, going: Any, drawn: Any) -> Any:
        return collect(s, worlds, shared, weights, going, drawn[0], 0.1)

    def step(shared: Any, weights: Any, going: Any, drawn: Any) -> Any:  # noqa: ARG001
        return jax.lax.scan(lambda state, each: worlds.step(shared, state, each), going.worlds, drawn[0])

    def alone(part: Any) -> float:
        specs = Spec(), Spec(), Spec(PART), Spec(PART)
        call = jax.jit(
            jax.shard_map(part, mesh=model._split.mesh, in_specs=specs, out_specs=Spec(PART), check_vma=False)
        )
        run = partial(call, shared, model._weights, model._going, drawn)
        seconds(run)
        return median(seconds(run) for _ in range(times))

    stepping, following = alone(step), alone(follow)
    drawing = median(seconds(model._draw) for _ in range(times))
    whole = median(seconds(model.advance) for _ in range(times))
    return {
        "gradients, Adam, advantages": (whole - following - drawing) / whole,
        "worlds and scaling of inputs": stepping / whole,
        "networks in the rollout": (following - stepping) / whole,
        "random numbers": drawing / whole,
    }


def main(turns: int = 7, rollouts: int = 20, *, write: bool = True) -> None:
    """Measure, and write the block into the page, or print it."""
    usual = training.Arguments(
        algorithm="ppo", scenario="standard", pace="all", steps=10**9, seed=0, settings=load_settings("ppo")
    )
    alike = replace(usual, settings=replace(usual.settings, privileged=False))
    model, other, shipped = ours(alike), theirs(alike), ours(usual)
    other.learn(model.rollout)
    model.advance()
    shipped.advance()
    paired: list[tuple[float, float]] = []
    for _ in range(turns):
        mine = seconds(lambda: jnp.asarray([model.advance()["train/loss"] for _ in range(rollouts)])) / rollouts
        torch.set_num_threads(2)
        paired.append((mine, seconds(lambda: other.learn(model.rollout, reset_num_timesteps=False) and None)))
        torch.set_num_threads(1)
    speeds = [median(model.rollout / pair[k] for pair in paired) for k in range(2)]
    ratio = median(there / here for here, there in paired)
    text = (
        f"`pter train ppo` makes {speeds[0]:,.0f} control steps a second on two cores, Stable-Baselines3's PPO with "
        f"the same networks, worlds, samples and epochs {speeds[1]:,.0f}: a ratio of {ratio:.1f}, the median of "
        f"{turns} pairs. With the privileged value network, whose inputs are five times as many, it makes "
        f"{shipped.rollout / median(seconds(shipped.advance) for _ in range(5 * turns)):,.0f}. Of the time of that:"
    )
    rows = [[label, f"{100 * share:.0f}"] for label, share in profile(shipped, 5 * turns).items()]
    block = f"{fill(text, 120)}\n\n{table(['What', 'Share [%]'], rows, '---')}"
    put_block("docs/agents.md", "speed", block, write=write)


if __name__ == "__main__":
    tyro.cli(main)
