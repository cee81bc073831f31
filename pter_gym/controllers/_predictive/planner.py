"""The cross-entropy method on the compiled simulator: the best of many plans for the coming voltages.

The voltages of the coming ``horizon`` are linear between knots. Many perturbed copies of the current plan, and of a
guiding controller's plan, are simulated with a model of the world. The mean and spread of the best ones define the next
round's plans, and so on. The first voltages of the best plan overall are applied, and the rest of it becomes the
current plan.
"""

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import device
from pter_gym._compiled.records import Entry, rows
from pter_gym._engine.batch import Batch
from pter_gym._engine.law import empty_memory
from pter_gym._engine.world import FLAG
from pter_gym.controllers import Controller, PerClutch
from pter_gym.controllers._laws import physical
from pter_gym.controllers._simple import largest_voltages
from pter_gym.params import BASELINE, Machine, quantity, require, require_number, require_whole
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tasks.path_following._observation import SEEN

Array = NDArray[np.float64]
Observations = NDArray[np.float32]

SIZES = (0.1, 0.3, 1.0, 2.0)
"""Sizes of the perturbations in the first round, relative to their spread."""


class Played(NamedTuple):
    """The state of a world that ``play`` keeps."""

    step: Annotated[float, Entry("1", "control steps so far")]
    cost: Annotated[float, Entry("m", "sum of the costs so far")]
    world: Annotated[float, Entry("1", "number of the world")]


PLAYED = rows(Played)

PLANS = 3
"""Where the plans begin in the gains of ``play``."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of a predictive controller."""

    samples: int = quantity("1", "chosen: plans that are simulated in a round", default=512)
    rounds: int = quantity("1", "chosen: rounds of plans, each drawn as the best of the last were spread", default=4)
    elite: int = quantity(
        "1", "chosen: number of the best plans of a round that the next one is drawn from", default=16
    )
    horizon: int = quantity("1", "chosen: control steps that a plan covers, a multiple of knot_steps", default=30)
    knot_steps: int = quantity("1", "chosen: control steps between knots of a plan", default=5)
    spread: float = quantity("V", "chosen: standard deviation of the first round's perturbations", default=4.0)
    spread_min: float = quantity("V", "chosen: smallest standard deviation of a later round's", default=0.3)
    pace_weight: float = quantity("s", "chosen: path error that costs as much as a speed error of 1 m/s", default=0.04)
    seed: int = quantity("1", "chosen: of the perturbations", default=0)

    def __post_init__(self) -> None:
        """Check the numbers."""
        least = {"samples": 4, "rounds": 1, "elite": 1, "horizon": 1, "knot_steps": 1, "seed": 0}
        for name, at_least in least.items():
            require_whole(self, name, at_least=at_least)
        require(self.elite <= self.samples, self, "elite", self.elite, "at most samples")
        require(self.horizon % self.knot_steps == 0, self, "horizon", self.horizon, "a multiple of knot_steps")
        require_number(self, "spread", above=0.0)
        require_number(self, "spread_min", at_least=0.0)
        require_number(self, "pace_weight", at_least=0.0)

    @property
    def knots(self) -> int:
        """Number of knots of a plan, both ends included."""
        return self.horizon // self.knot_steps + 1

    @property
    def rollouts(self) -> int:
        """Plans that are simulated for each decision."""
        return self.samples * self.rounds


@device
def cost(obs: Any, scales: Any, weight: float) -> float:
    """Return the cost of an instant [m]: the path error, and the weighted error of the speed along the path."""
    error = physical(obs, scales, SEEN.normal_error)
    speed = physical(obs, scales, SEEN.speed.along)
    pace = physical(obs, scales, SEEN.pace)
    return abs(error) + weight * abs(speed - pace)


@device
def play(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:
    """Return the voltages of a world's own plan, and add up its costs so far.

    Gains hold the control steps between knots, the number of knots and the weight of the pace, then the plans.
    """
    step = memory[PLAYED.step]
    if step > 0.0:
        memory[PLAYED.cost] += cost(obs, scales, gains[2])
    memory[PLAYED.step] = step + 1.0
    count = int(gains[1])
    place = step / gains[0]
    knot = min(int(place), count - 2)
    part = min(place - knot, 1.0)
    at = PLANS + (int(memory[PLAYED.world]) * count + knot) * 4
    return PerClutch(
        gains[at] + part * (gains[at + 4] - gains[at]),
        gains[at + 1] + part * (gains[at + 5] - gains[at + 1]),
        gains[at + 2] + part * (gains[at + 6] - gains[at + 2]),
        gains[at + 3] + part * (gains[at + 7] - gains[at + 3]),
    )


class Planner:
    """A planner for one world, with a model of it.

    Parameters
    ----------
    settings
        Of the method.
    machine, task
        The model.
    guide
        A controller whose voltages are one of the plans, and the initial plan.
    nominal
        The machine that the guide is bound to.

    Attributes
    ----------
    batch
        The model, a world for each plan.
    latest
        The plan of the latest decision, voltages (knots, 4) [V].
    """

    def __init__(
        self,
        settings: Settings,
        machine: Machine,
        task: PathFollowing,
        guide: Controller,
        nominal: Machine = BASELINE,
    ) -> None:
        self.settings = settings
        self.task = task
        self.top = largest_voltages(machine)
        self.batch = Batch(machine, task, settings.samples)
        self.one = Batch(machine, task, 1)
        self.guide: Any = guide.bind(nominal, self.one.layout)
        self.rng = np.random.default_rng(settings.seed)
        self.plan: Array | None = None
        self.latest = np.zeros((settings.knots, 4))

    def decide(self, state: Array, obs: Observations) -> Array:
        """Return the voltages for the next control step, (4,).

        Parameters
        ----------
        state
            The rows of a world as in the model, possibly followed by more, shape (rows,).
        obs
            Its observation, (entries,), which begins with the model's entries.
        """
        s = self.settings
        seen = obs[: len(self.batch.layout)]
        guided = self.guided(state, seen)
        present = guided if self.plan is None else self.plan
        plans = self._first_round(present, guided)
        costs = self.costs(state, seen, plans)
        for _ in range(1, s.rounds):
            plans = self._next_round(plans, costs)
            costs = self.costs(state, seen, plans)
        self.latest = plans[costs.argmin()]
        self.plan = self._later(self.latest)
        return self.latest[0]

    def _first_round(self, present: Array, guided: Array) -> Array:
        """Return perturbed copies of the current plan and the guide's plan, and both unperturbed."""
        s = self.settings
        sizes = self.rng.choice(SIZES, (s.samples, 1, 1)) * s.spread
        plans = self.rng.normal(0.0, 1.0, (s.samples, s.knots, 4)) * sizes + present
        plans[1::2] += guided - present
        plans[0], plans[1] = present, guided
        return np.clip(plans, 0.0, self.top)

    def _next_round(self, plans: Array, costs: Array) -> Array:
        """Return plans with the spread of a round's best ones, half around the best plan and half around their mean.

        The first is the best plan itself, so no round is worse than the previous one.
        """
        s = self.settings
        elite = plans[np.argpartition(costs, s.elite - 1)[: s.elite]]
        best, mean = plans[costs.argmin()], elite.mean(axis=0)
        plans = self.rng.normal(0.0, 1.0, plans.shape) * np.maximum(elite.std(axis=0), s.spread_min) + mean
        plans[1::2] += best - mean
        plans[0] = best
        return np.clip(plans, 0.0, self.top)

    def record_forces(self, forces: Array) -> None:
        """Set the hand's future forces in the model; see ``Batch.record_forces``."""
        self.batch.record_forces(forces)
        self.one.record_forces(forces)

    def guided(self, state: Array, obs: Observations) -> Array:
        """Return the plan made by the guide's voltages, (knots, 4)."""
        s = self.settings
        bring_to(self.one, state)
        rows: Any = self.one.rollout(obs[None], self.guide.law, self.guide.gains, s.horizon)[1]
        at = np.minimum(np.arange(s.knots) * s.knot_steps, s.horizon - 1)
        return np.nan_to_num(rows[at, 0][:, [*COLUMN.volts]])

    def _later(self, plan: Array) -> Array:
        """Return a plan shifted by one control step."""
        count = self.settings.knots
        places = np.minimum(np.arange(count) + 1.0 / self.settings.knot_steps, count - 1.0)
        low = np.minimum(places.astype(int), count - 2)
        return plan[low] + (places - low)[:, None] * (plan[low + 1] - plan[low])

    def costs(self, state: Array, obs: Observations, plans: Array) -> Array:
        """Return the cost of each plan [m], its mean over control steps, plus the workspace's bound if it fails."""
        s = self.settings
        bring_to(self.batch, state)
        memory: Any = empty_memory(s.samples, Played)
        gains = np.concatenate([[s.knot_steps, s.knots, s.pace_weight], plans.ravel()])
        many = np.broadcast_to(obs, (s.samples, len(obs)))
        last, flags = self.batch.outcome(many, play, gains, s.horizon, memory)
        total = memory[:, PLAYED.cost] + self._cost(last)
        failed = flags[int(FLAG.terminated)] & ~flags[int(FLAG.success)]
        return total / memory[:, PLAYED.step] + np.where(failed, self.task.error_max, 0.0)

    def _cost(self, obs: Observations) -> Array:
        """Return ``cost`` for many observations (N, entries)."""
        layout = self.batch.layout
        speed, pace = layout.physical(obs, "speed_along"), layout.physical(obs, "pace")
        return np.abs(layout.physical(obs, "normal_error")) + self.settings.pace_weight * np.abs(speed - pace)


def bring_to(batch: Batch, state: Array) -> None:
    """Bring all worlds of a batch to a state, the rows of one world, (rows,) or longer."""
    own = batch.get_state()
    worlds = own["worlds"]
    worlds[:] = state[: worlds.shape[1], None]
    batch.set_state({"worlds": worlds, "words": own["words"], "seeded": np.ones_like(own["seeded"])})
