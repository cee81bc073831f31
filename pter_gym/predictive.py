"""How good could it be? Model-predictive control that knows the true machine, the true hand and its future.

No controller of a real machine can have that knowledge: it is *privileged*, and marked so wherever its scores stand. It
shows what the clutches can do, beside what laws do with them.

The method is model-predictive control by random shooting. The voltages of the coming ``horizon`` are linear between
knots. Many perturbed copies of the present plan, and of what a guiding controller would do, run through the compiled
simulator from the true state; the best is perturbed again, less; the first voltages of the best plan are applied.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._jit import device
from pter_gym.controllers import Controller, PerClutch
from pter_gym.controllers.laws import KEPT, WORLD
from pter_gym.envs.batch import Batch
from pter_gym.params import BASELINE, Machine, quantity, require, require_number
from pter_gym.tasks.path_following import (
    T_ARC_LENGTH,
    T_ERROR,
    T_SUCCESS,
    T_TERMINATED,
    T_TIME,
    T_VOLTS,
    PathFollowing,
)

Array = NDArray[np.float64]

SIZES = (0.1, 0.3, 1.0, 2.0)
"""Sizes of the perturbations in the first round, relative to their spread."""

PRIVILEGED = "privileged: knows machine, hand and future"
"""What stands beside its scores."""


@dataclass(frozen=True, kw_only=True)
class Predictive:
    """Settings of the predictive controller."""

    samples: int = quantity("1", "chosen: plans that are simulated for each decision", default=512)
    horizon: int = quantity("1", "chosen: control steps that a plan covers, a multiple of knot_steps", default=30)
    knot_steps: int = quantity("1", "chosen: control steps between knots of a plan", default=5)
    spread: float = quantity("V", "chosen: standard deviation of the perturbations", default=4.0)
    rounds: int = quantity("1", "chosen: rounds of plans, each about the best so far", default=2)
    pace_weight: float = quantity("s", "chosen: cost of a speed along the path that is off the pace", default=0.02)
    seed: int = quantity("1", "chosen", default=0)

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name, least in (("samples", 4), ("horizon", 1), ("knot_steps", 1), ("rounds", 1), ("seed", 0)):
            require_number(self, name, at_least=least)
            require(getattr(self, name) == int(getattr(self, name)), self, name, getattr(self, name), "a whole number")
        require(self.horizon % self.knot_steps == 0, self, "horizon", self.horizon, "a multiple of knot_steps")
        require_number(self, "spread", above=0.0)
        require_number(self, "pace_weight", at_least=0.0)

    @property
    def knots(self) -> int:
        """Number of knots of a plan, both ends included."""
        return self.horizon // self.knot_steps + 1


@device
def play(obs: Any, scales: Any, gains: Any, memory: Any) -> PerClutch:  # noqa: ARG001
    """Return the voltages of a world's own plan: gains hold the knots' distance and number, then the plans."""
    step = memory[KEPT]
    memory[KEPT] = step + 1.0
    count = int(gains[1])
    place = step / gains[0]
    knot = min(int(place), count - 2)
    part = min(place - knot, 1.0)
    at = 2 + (int(memory[WORLD]) * count + knot) * 4
    return PerClutch(
        gains[at] + part * (gains[at + 4] - gains[at]),
        gains[at + 1] + part * (gains[at + 5] - gains[at + 1]),
        gains[at + 2] + part * (gains[at + 6] - gains[at + 2]),
        gains[at + 3] + part * (gains[at + 7] - gains[at + 3]),
    )


class Planner:
    """Plans for one world.

    Parameters
    ----------
    settings
        Of the method.
    machine, task
        The true ones.
    guide
        A controller whose voltages are among the plans, and the first plan.

    Attributes
    ----------
    latest
        The plan of the latest decision, voltages (knots, 4) [V].
    """

    def __init__(self, settings: Predictive, machine: Machine, task: PathFollowing, guide: Controller) -> None:
        self.settings = settings
        self.task = task
        self.top = machine.clutch.voltage_max
        self.batch = Batch(machine, task, settings.samples)
        self.one = Batch(machine, task, 1)
        self.guide: Any = guide.bind(BASELINE, self.one.layout)
        self.rng = np.random.default_rng(settings.seed)
        self.plan: Array | None = None
        self.latest = np.zeros((settings.knots, 4))

    def decide(self, world: Batch, obs: NDArray[np.float32], begin: float) -> Array:
        """Return the voltages for the next control step of a world, (4,).

        Parameters
        ----------
        world
            The true world, a batch of one, which stays as it is.
        obs
            Its observation (1, entries).
        begin
            Its arc length [m].
        """
        s = self.settings
        state = world.get_state()
        guided = self.guided(state, obs)
        if self.plan is None:
            self.plan = guided
        sizes = self.rng.choice(SIZES, (s.samples, 1, 1)) * s.spread
        plans = self.rng.normal(0.0, 1.0, (s.samples, s.knots, 4)) * sizes + self.plan
        plans[1::2] += guided - self.plan
        plans[0], plans[1] = self.plan, guided
        best, cost = self._best(state, obs, plans, begin)
        for k in range(1, s.rounds):
            plans = best + self.rng.normal(0.0, s.spread * 0.5**k, plans.shape)
            better, lower = self._best(state, obs, plans, begin)
            best, cost = (better, lower) if lower < cost else (best, cost)
        self.latest, self.plan = best, self._later(best)
        return best[0]

    def guided(self, state: dict[str, NDArray[Any]], obs: NDArray[np.float32]) -> Array:
        """Return the plan that the guide's voltages make, (knots, 4)."""
        s = self.settings
        self.one.set_state(state)
        _, rows = self.one.rollout(obs, self.guide.law, self.guide.gains, s.horizon)
        at = np.minimum(np.arange(s.knots) * s.knot_steps, s.horizon - 1)
        return np.nan_to_num(rows[at, 0, T_VOLTS : T_VOLTS + 4])

    def _best(
        self, state: dict[str, NDArray[Any]], obs: NDArray[np.float32], plans: Array, begin: float
    ) -> tuple[Array, float]:
        """Return the best of plans and its cost."""
        plans = np.clip(plans, 0.0, self.top)
        costs = self.costs(state, obs, plans, begin)
        return plans[costs.argmin()], float(costs.min())

    def _later(self, plan: Array) -> Array:
        """Return a plan as it is one control step later."""
        count = self.settings.knots
        places = np.minimum(np.arange(count) + 1.0 / self.settings.knot_steps, count - 1.0)
        low = np.minimum(places.astype(int), count - 2)
        return plan[low] + (places - low)[:, None] * (plan[low + 1] - plan[low])

    def costs(self, state: dict[str, NDArray[Any]], obs: NDArray[np.float32], plans: Array, begin: float) -> Array:
        """Return the cost of each plan [m]: means of the path error and of how far the speed along is off the pace."""
        s = self.settings
        rows = self.foresee(state, obs, plans)
        alive = np.isfinite(rows[..., T_TIME])
        steps = alive.sum(axis=0)
        error = np.where(alive, np.abs(rows[..., T_ERROR]), 0.0).sum(axis=0) / steps
        arc_length = np.concatenate([np.full((1, s.samples), begin), rows[..., T_ARC_LENGTH]])
        speeds = np.diff(arc_length, axis=0) / self.task.control_period
        off = np.where(alive, np.abs(speeds - self.task.pace), 0.0).sum(axis=0) / steps
        failed = (rows[..., T_TERMINATED] == 1.0).any(axis=0) & ~(rows[..., T_SUCCESS] == 1.0).any(axis=0)
        return error + s.pace_weight * off + np.where(failed, self.task.error_max, 0.0)

    def foresee(self, state: dict[str, NDArray[Any]], obs: NDArray[np.float32], plans: Array) -> Array:
        """Return the telemetry of each plan from a state, (horizon, samples, len(TELEMETRY)), NaN after an end."""
        s = self.settings
        own = self.batch.get_state()
        self.batch.set_state(
            {
                "worlds": np.broadcast_to(state["worlds"][:1, :, :1], own["worlds"].shape).copy(),
                "words": np.broadcast_to(state["words"], own["words"].shape).copy(),
                "seeded": np.ones_like(own["seeded"]),
            }
        )
        gains = np.concatenate([[s.knot_steps, s.knots], plans.ravel()])
        many = np.broadcast_to(obs, (s.samples, obs.shape[1])).copy()
        _, rows = self.batch.rollout(many, play, gains, s.horizon)
        return rows


def run_predictive(
    settings: Predictive, machine: Machine, task: PathFollowing, seed: int, guide: Controller, max_steps: int
) -> Array:
    """Return the telemetry of an episode under predictive control, (steps + 1, len(TELEMETRY)).

    Parameters
    ----------
    settings
        Of the method.
    machine, task, seed
        The episode.
    guide
        A controller whose voltages are among the plans; it is bound to the nominal machine.
    max_steps
        Control steps after which it is truncated.
    """
    planner = Planner(settings, machine, task, guide)
    world = Batch(machine, task, 1)
    obs, row = world.reset([seed])
    rows = [row[0]]
    while len(rows) <= max_steps and rows[-1][T_TERMINATED] != 1.0:
        returns = world.step(planner.decide(world, obs, float(rows[-1][T_ARC_LENGTH]))[None])
        obs = returns.obs
        rows.append(returns.telemetry[0, 0])
    return np.array(rows)
