"""Policies in the worlds of a batch, for tests."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pter_gym._engine.batch import Batch
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.episodes import Episodes
from pter_gym.benchmark.rollout import RecordedEpisodes, record_episodes
from pter_gym.controllers import Policy
from pter_gym.params import BASELINE, Machine


def run(
    batch: Batch,
    policy: Any,
    seeds: Sequence[int],
    limits: Sequence[int],
    nominal: Machine = BASELINE,
) -> RecordedEpisodes:
    """Let a policy act in episodes of a batch's machines and tasks."""
    machines, tasks = zip(*(batch.pairs[pair] for pair in batch.context), strict=True)
    strata = ("",) * len(tasks)
    episodes = Episodes("", machines, tasks, tuple(seeds), strata, nominal, tuple(limits))
    return record_episodes(policy, episodes)


def simulate(
    batch: Batch, policy: Any, seeds: Sequence[int], max_steps: int, nominal: Machine = BASELINE
) -> np.ndarray:
    """Return the telemetry of episodes with one limit, (steps + 1, N, columns)."""
    return run(batch, policy, seeds, [max_steps] * batch.num_worlds, nominal).telemetry


def releasing(name: str, release: float = 0.001) -> Any:
    """Return a tuned or scaled law, or a trained policy on one, with a gain ``release`` [m]."""
    return _with_release(find_policy(name), release)


def _with_release(of: Any, release: float) -> Any:
    if hasattr(of, "interface"):
        if of.interface.base is None:
            return of
        base = _with_release(of.interface.base, release)
        return replace(of, interface=replace(of.interface, base=base))
    if hasattr(of, "schedule"):
        return replace(of, schedule=_with_release(of.schedule, release))
    knots = tuple((pace, replace(law, release=release)) for pace, law in of.knots)
    return replace(of, knots=knots)


class Acting:
    """A policy in worlds that go on, with its memory: ``volts = acting(observations)``."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self.reset()

    def reset(self) -> None:
        """Begin new episodes in all worlds."""
        self.memory: Any = None
        self.begins = True

    def __call__(self, observations: np.ndarray) -> Any:
        """Return voltages, (N, clutches), or (clutches,) for one observation."""
        rows = np.ascontiguousarray(np.atleast_2d(observations), np.float32)
        if self.begins:
            self.memory, self.begins = self.policy.start(len(rows)), False
        volts = self.policy.act(rows, self.memory)
        return volts[0] if np.ndim(observations) == 1 else volts
