"""Path errors of a policy for any machine on PTER with quicker clutches, beside its base law's.

    python benchmarks/short_lags.py [POLICY]

prints, for 8 training episodes of `standard` at each pace, the lines of the table in
docs/development/any-device.md: means in mm of the base law, of the policy, and of the policy whose
correction is behind a low-pass filter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import tyro

from pter_gym._compiled.layout import Layout
from pter_gym.benchmark import evaluate, training_episodes
from pter_gym.controllers import AnyPolicy, Policy
from pter_gym.params import BASELINE, Machine
from pter_gym.policies import TrainedController, read_policy
from pter_gym.scenarios import PACES

LAGS = (0.005, 0.008, 0.012, 0.02)
FILTER, PERIOD = 0.02, 0.01
EPISODES, SEED = 8, 2**32 + 9


@dataclass
class Memories:
    """What policy and base remember, and the correction [V], (N, 4)."""

    own: Any
    base: Any
    correction: Any

    def __getitem__(self, rows: Any) -> "Memories":
        """Return the memory of some worlds."""
        return Memories(self.own[rows], self.base[rows], self.correction[rows])

    def __setitem__(self, rows: Any, other: "Memories") -> None:
        """Change the memory of some worlds."""
        self.own[rows], self.base[rows] = other.own, other.base
        self.correction[rows] = other.correction


@dataclass(frozen=True)
class Filtered:
    """A policy whose correction of its base passes a first-order low-pass filter."""

    policy: TrainedController

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        """Return it for a machine."""
        assert self.policy.interface.base is not None
        own = self.policy.bind(machine, layout)
        base = self.policy.interface.base.bind(machine, layout)
        share = 1.0 - math.exp(-PERIOD / FILTER)

        def start(worlds: int, episodes: Sequence[int] | None = None) -> Memories:
            nothing = np.zeros((worlds, len(machine.clutches)))
            return Memories(own.start(worlds, episodes), base.start(worlds, episodes), nothing)

        def act(obs: Any, memory: Memories) -> Any:
            law = np.maximum(base.act(obs, memory.base), 0.0)
            memory.correction += share * (own.act(obs, memory.own) - law - memory.correction)
            return np.clip(law + memory.correction, 0.0, machine.clutch.voltage_max)

        return replace(own, act=act, start=start, made=None)


def errors(policy: AnyPolicy, lag: float) -> str:
    """Return mean path errors [mm] at all paces."""
    machine, found = replace(BASELINE, clutch=replace(BASELINE.clutch, time_constant=lag)), []
    for pace in PACES:
        scores = evaluate(policy, training_episodes("standard", pace, EPISODES, SEED, machine))
        found.append(f"{1e3 * scores['path_error_m'].mean():.2f}")
    return " / ".join(found)


def main(policy: tyro.conf.Positional[str] = "universal") -> None:
    """Print a line for each time constant."""
    network = read_policy(policy)
    assert network.interface.base is not None
    for lag in LAGS:
        cells = [errors(each, lag) for each in (network.interface.base, network, Filtered(network))]
        print(f"| {1e3 * lag:g} ms | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
