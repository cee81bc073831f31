"""How fast `pter train ppo` is beside Stable-Baselines3's PPO, and where its time goes: a block of docs/agents.md.

    NUMBA_NUM_THREADS=1 python docs/make/training_speed.py

Both train the same networks on as many worlds with as many samples, epochs and minibatches, by turns in one process,
and the median of some turns counts. Needs the agents extra and two idle cores.
"""

import statistics
import time
from collections.abc import Callable
from contextlib import contextmanager
from textwrap import fill
from typing import Any

import torch
import tyro
from pages import AGENTS, put_block, table
from stable_baselines3 import PPO

from pter_agents import ppo, training
from pter_agents.algorithms import load_settings
from pter_agents.prepare import make_interface
from pter_agents.worlds import Worlds
from pter_gym.envs.sb3 import make_sb3_vec_env

Shares = dict[str, float]


@contextmanager
def timed(shares: Shares, owner: Any, name: str, label: str) -> Any:
    """Add the seconds of a function to its label while it lasts."""
    real: Callable[..., Any] = getattr(owner, name)

    def watched(*given: Any, **named: Any) -> Any:
        begin = time.perf_counter()
        try:
            return real(*given, **named)
        finally:
            shares[label] = shares.get(label, 0.0) + time.perf_counter() - begin

    setattr(owner, name, watched)
    try:
        yield
    finally:
        setattr(owner, name, real)


def ours(arguments: training.Arguments) -> tuple[Any, Callable[[], None]]:
    """The lean loop, and what closes it."""
    draws = training.make_draws(arguments)
    interface = make_interface(arguments.settings, arguments.scenario, draws, arguments.seed)
    parts = training.make_parts(arguments, draws, interface)
    model = training.make_model(arguments, parts)
    return model, model.close


def theirs(arguments: training.Arguments) -> Any:
    """Stable-Baselines3's PPO on as many worlds."""
    s: Any = arguments.settings
    worlds = make_sb3_vec_env(
        s.worlds, randomisation=training.make_draws(arguments), max_episode_steps=s.episode, num_threads=1
    )
    return PPO(
        "MlpPolicy",
        worlds,
        n_steps=s.steps,
        batch_size=s.minibatch,
        n_epochs=s.epochs,
        learning_rate=s.learning_rate,
        gamma=s.discount,
        policy_kwargs={"net_arch": {"pi": list(s.hidden), "vf": list(s.value_hidden)}},
        device="cpu",
        seed=0,
    )


def seconds(do: Callable[[], Any]) -> float:
    """Return how long something takes."""
    begin = time.perf_counter()
    do()
    return time.perf_counter() - begin


def profile(model: Any, rollouts: int) -> Shares:
    """Return the shares of the time of one part, which a core has, in some rollouts."""
    shares: Shares = {}
    begin = time.perf_counter()
    with (
        timed(shares, Worlds, "step", "worlds and scaling of inputs"),
        timed(shares, ppo.Part, "collect", "rollout"),
        timed(shares, ppo.PPO, "_gradient", "gradients"),
    ):
        for _ in range(rollouts):
            model.advance()
    whole = ppo.PARTS * (time.perf_counter() - begin)
    shares["networks in the rollout, advantages"] = shares.pop("rollout") - shares["worlds and scaling of inputs"]
    shares["sum of the halves, Adam, waiting"] = whole - sum(shares.values())
    return {label: each / whole for label, each in shares.items()}


def main(turns: int = 7, rollouts: int = 10, write: bool = True) -> None:
    """Measure, and write the block into the page, or print it."""
    arguments = training.Arguments(
        algorithm="ppo", scenario="standard", pace="all", steps=10**9, seed=0, settings=load_settings("ppo")
    )
    model, close = ours(arguments)
    other = theirs(arguments)
    other.learn(model.rollout)
    model.advance()
    paired: list[tuple[float, float]] = []
    for _ in range(turns):
        torch.set_num_threads(1)
        mine = seconds(lambda: [model.advance() for _ in range(rollouts)]) / rollouts
        torch.set_num_threads(2)
        paired.append((mine, seconds(lambda: other.learn(model.rollout, reset_num_timesteps=False))))
    torch.set_num_threads(1)
    shares = profile(model, rollouts)
    close()
    speeds = [statistics.median(model.rollout / pair[k] for pair in paired) for k in range(2)]
    ratio = statistics.median(there / here for here, there in paired)
    text = (
        f"`pter train ppo` makes {speeds[0]:,.0f} control steps a second on two cores, Stable-Baselines3's PPO with "
        f"the same networks, worlds, samples and epochs {speeds[1]:,.0f}: a ratio of {ratio:.1f}, the median of "
        f"{turns} pairs. Of the time of the two cores:"
    )
    rows = [[label, f"{100 * share:.0f}"] for label, share in sorted(shares.items(), key=lambda pair: -pair[1])]
    block = f"{fill(text, 120)}\n\n{table(['What', 'Share [%]'], rows, '---')}"
    put_block(AGENTS, "speed", block, write=write)


if __name__ == "__main__":
    tyro.cli(main)
