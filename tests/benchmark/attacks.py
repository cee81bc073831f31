"""Ways to move that may look better than they are, each made from an honest policy."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.layout import Layout
from pter_gym.benchmark import training_episodes
from pter_gym.benchmark.boards import mean_of, over_limits
from pter_gym.benchmark.measures import SEGMENTS
from pter_gym.benchmark.rollout import record_episodes
from pter_gym.benchmark.scores import Scores
from pter_gym.controllers import Policy
from pter_gym.params import BASELINE, Machine
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import observation_layout

EPISODES = 32
SEED = 77
"""Of the draws, which are no stored episodes."""

Array = NDArray[np.float64]
Observations = NDArray[np.float32]
Factor = Callable[[Array], Array | float]


class Changed:
    """A policy of which the observations, or the volts, are changed; ``steps`` counts its steps."""

    def __init__(self, honest: Policy, act: Callable[["Changed", Observations], Any]) -> None:
        self.honest = honest
        self._act = act

    def bind(self, machine: Machine, layout: Layout) -> Policy:
        return Policy.from_function(self.decide, layout, start=self.start)

    def start(self, worlds: int) -> None:
        self.steps = 0
        self.memory = self.honest.start(worlds)

    def observe(self, obs: Observations, name: str) -> Array:
        """Return an entry of observations in its unit."""
        place = self.honest.layout.index(name)
        return obs[:, place] * float(self.honest.layout.scales[place])

    def decide(self, obs: Observations, memory: None) -> Any:
        volts = self._act(self, obs)
        self.steps += 1
        return volts


Attack = Callable[[Policy], Changed]
When = Callable[[Changed, Observations], Any]


def tells(pace: When = lambda *_: 1.0, error: When = lambda *_: 0.0) -> Attack:
    """Tell the policy its pace times a factor, and its error plus so many metres."""

    def act(self: Changed, obs: Observations) -> Any:
        changed = obs.copy()
        layout, factor = self.honest.layout, pace(self, obs)
        off = layout.index("pace_error")
        changed[:, layout.index("pace")] *= factor
        changed[:, off] = (changed[:, off] + 1.0) / factor - 1.0
        place = layout.index("normal_error")
        changed[:, place] += error(self, obs) / float(layout.scales[place])
        return self.honest.act(changed, self.memory)

    return lambda honest: Changed(honest, act)


def rides(factor: Factor) -> Attack:
    """Move at the pace times a function of progress."""
    return tells(pace=lambda self, obs: factor(self.observe(obs, "progress")))


def sets(volts: float, when: When) -> Attack:
    """Set all clutches to a voltage at times."""

    def act(self: Changed, obs: Observations) -> Any:
        decided = np.array(self.honest.act(obs, self.memory))
        decided[when(self, obs)] = volts
        return decided

    return lambda honest: Changed(honest, act)


def locks(when: When) -> Attack:
    """Lock all clutches at times."""
    return sets(BASELINE.clutch.voltage_max, when)


def every(self: Changed, obs: Observations, *, steps: int, of: int) -> NDArray[np.bool_]:
    """Return whether this is one of the first steps of so many, in all worlds."""
    return np.full(len(obs), self.steps % of < steps)


def beyond(progress: float) -> When:
    """Return whether the tip is beyond a part of the path."""
    return lambda self, obs: self.observe(obs, "progress") >= progress


def beside(error: float, until: float = 2.0) -> Attack:
    """Move so many metres beside the path, to a part of it."""
    return tells(error=lambda self, obs: np.where(beyond(until)(self, obs), 0.0, error))


def lingers(factor: float) -> Attack:
    """Move along the first segment at another pace."""
    return rides(lambda progress: np.where(progress * SEGMENTS < 1.0, factor, 1.0))


def alternates(slow: float, fast: float, parts: int) -> Attack:
    """Move slowly and fast in turn behind the start, in equal parts of the path."""

    def factor(progress: Array) -> Array:
        in_turn = np.where(np.floor(parts * progress) % 2 == 0, slow, fast)
        return np.where(progress < 0.5 / SEGMENTS, 1.0, in_turn)

    return rides(factor)


class Course:
    """Fresh draws of a scenario at a pace, and how policies do on them."""

    def __init__(
        self, scenario: str, pace: str, episodes: int = EPISODES, seed: int = SEED
    ) -> None:
        self.scenario, self.pace = scenario, PACES[pace]
        self.episodes = training_episodes(scenario, pace, episodes, seed)
        self.tasks = self.episodes.tasks
        self.layout = observation_layout(BASELINE, "torque")

    def telemetry(self, policy: Any) -> Array:
        return record_episodes(policy, self.episodes).telemetry

    def ranked(self, scores: Scores) -> bool:
        """Return whether the means are within the limits: intervals of so few draws are wide."""
        over = over_limits({name: mean_of(each) for name, each in scores.items()})
        return max(over.values()) <= 0.0
