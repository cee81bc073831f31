"""The worlds to train on: a scenario's training draws with a policy's inputs and outputs."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pter_agents.algorithms import ALL
from pter_gym.benchmark import PACES
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.errors import unknown_name
from pter_gym.params import BASELINE, Machine
from pter_gym.policies._interface import LIMIT, Interface
from pter_gym.scenarios import find_scenario
from pter_gym.scenarios._own_machine import OwnMachine
from pter_gym.scenarios.randomisation import Mixture, OneOf, Randomisation, Vary
from pter_gym.tasks.path_following import Sensors

MIXED = ("standard", "paths", "hands", "materials", "everything")
"""The scenarios of ``ALL``, on which shipped policies were trained; later ones show how policies do on others."""

WIDEST = "everything"
"""The scenario that has half of the draws of ``ALL``; the others share the rest evenly."""

Rows = NDArray[np.float32]
Mask = NDArray[np.bool_]


def draws_for(
    scenario: str, pace: str, *, contexts: int, seed: int, machine: OwnMachine | None = None, **stated: Any
) -> Randomisation | Mixture:
    """Return machines and tasks of a scenario at a pace.

    Parameters
    ----------
    scenario
        Its name, or ``"all"`` for the scenarios in ``MIXED``.
    pace
        Name of a commanded pace, or ``"all"``.
    contexts, seed
        Number of pairs of machine and task, rounded up to equal shares of the scenarios, and the seed of their list.
    machine
        A machine in place of those that the scenarios draw.
    **stated
        Fields of the task that all episodes share, such as ``reward``, ``starts`` and ``truncation_error``.

    Raises
    ------
    ParameterError
        If there is no such scenario or pace; the message suggests the nearest.
    """
    if pace not in (ALL, *PACES):
        raise unknown_name("pace", pace, (ALL, *PACES))
    if scenario == ALL:
        share = -(-contexts // (2 * (len(MIXED) - 1)))
        shares = {each: (len(MIXED) - 1) * share if each == WIDEST else share for each in MIXED}
        return Mixture(
            parts=tuple(_draws(each, pace, machine, contexts=own, seed=seed, **stated) for each, own in shares.items())
        )
    return _draws(scenario, pace, machine, contexts=contexts, seed=seed, **stated)


def _draws(
    scenario: str, pace: str, machine: OwnMachine | None, *, contexts: int, seed: int, **stated: Any
) -> Randomisation:
    """Return machines and tasks of one scenario."""
    speeds = all_paces() if pace == ALL else (PACES[pace],)
    drawn = find_scenario(scenario, machine).randomisation(None, contexts=contexts, seed=seed, **stated)
    task: Any = drawn.task
    return replace(drawn, task=Vary(task.base, **{**task.fields, "pace": OneOf(speeds)}))


def all_paces() -> tuple[float, ...]:
    """Return the commanded paces [m/s], with fast ones repeated so that all take about the same share of time."""
    slowest = min(PACES.values())
    return tuple(pace for pace in PACES.values() for _ in range(round(pace / slowest)))


def make_worlds(
    draws: Randomisation | Mixture, count: int, episode: int, sensors: Sensors = "torque", frame_skip: int = 1
) -> PathFollowingVectorEnv:
    """Return worlds that take voltages and are reset in the same step in which they end.

    Parameters
    ----------
    draws
        Machines and tasks.
    count
        Number of worlds.
    episode
        Steps after which an episode is truncated.
    sensors
        The sensors.
    frame_skip
        Control steps in a step.
    """
    return PathFollowingVectorEnv(
        count,
        randomisation=draws,
        max_episode_steps=episode,
        sensors=sensors,
        frame_skip=frame_skip,
        autoreset_mode=AutoresetMode.SAME_STEP,
        telemetry=False,
        num_threads=1,
    )


class Truth(NamedTuple):
    """The entries of ``Batch.truth`` that vary, with their centres and scales."""

    entries: NDArray[np.intp]
    center: NDArray[np.float64]
    scale: NDArray[np.float64]


class Step(NamedTuple):
    """Result of a step of N worlds.

    Attributes
    ----------
    inputs
        The networks' current inputs, (N, size); for worlds that have ended, after their reset.
    rewards, terminated, truncated
        (N,) each.
    ended, last
        Indices of the worlds that have ended, and the networks' inputs at their end.
    """

    inputs: Rows
    rewards: NDArray[np.float64]
    terminated: Mask
    truncated: Mask
    ended: NDArray[np.intp]
    last: Rows


class TrainingWorlds:
    """Worlds with a policy's inputs as observations and its outputs as actions.

    The inputs of the value network alone follow those of the policy. With an episode's last observation, they are from
    one control step earlier, since the world has already been reset.

    Parameters
    ----------
    env
        The worlds.
    interface
        The network's inputs and outputs.
    truth
        Scaling of the truth about a world for the value network; None if it has the same inputs as the policy.
    nominal
        The machine that a base controller is bound to.
    """

    def __init__(
        self,
        env: PathFollowingVectorEnv,
        interface: Interface,
        truth: Truth | None = None,
        nominal: Machine = BASELINE,
    ) -> None:
        self.env = env
        self.count = env.num_envs
        self.interface = interface.bind(nominal, env.observation_layout)
        self.size = interface.size + (0 if truth is None else len(truth.center))
        self._past = self.interface.begin(self.count)
        self._base = np.zeros((self.count, 4))
        self.truth = truth
        self._known = np.zeros((self.count, self.size - interface.size))
        self._returns = np.zeros(self.count)
        self.finished: list[float] = []
        """Returns of the episodes that have ended; a reader may clear the list."""

    def reset(self, seed: int) -> Rows:
        """Start new episodes with consecutive seeds from ``seed`` on, and return the networks' inputs, (N, size)."""
        self._returns[:] = 0.0
        self._past.forget(np.ones(self.count, np.bool_))
        return self._see(self.env.reset(seed=seed)[0])

    def step(self, outputs: Rows) -> Step:
        """Advance all worlds by one decision, the network's outputs (N, 4)."""
        obs, rewards, terminated, truncated, infos = self.env.step(self.interface.volts(self._base, outputs))
        done = terminated | truncated
        ended = np.flatnonzero(done)
        last = np.empty((0, self.size), np.float32)
        self._returns += rewards
        if len(ended):
            final = obs.copy()
            final[ended] = np.stack(list(infos["final_obs"][ended]))
            seen = self.interface.see(final, deepcopy(self._past))[0]
            last = np.hstack([seen, self._known])[ended].astype(np.float32)
            self._past.forget(done)
            self.finished += self._returns[ended].tolist()
            self._returns[ended] = 0.0
        return Step(self._see(obs), rewards, terminated, truncated, ended, last)

    def get_state(self) -> dict[str, Any]:
        """Return the changing state."""
        own = {"base": self._base, "known": self._known, "returns": self._returns}
        return {**own, "worlds": self.env.get_state(), "past": self._past.get_state()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore the state from ``get_state``; arrays may be tensors."""
        self.env.set_state({name: np.asarray(part) for name, part in state["worlds"].items()})
        self._past.set_state(state["past"])
        for name, mine in (("base", self._base), ("known", self._known), ("returns", self._returns)):
            mine[:] = state[name]

    def close(self) -> None:
        """Stop the worlds."""
        self.env.close()

    def _see(self, obs: Any) -> Rows:
        inputs, self._base = self.interface.see(obs, self._past)
        if self.truth is not None:
            known = (self.env.batch.truth()[:, self.truth.entries] - self.truth.center) / self.truth.scale
            self._known = known.clip(-LIMIT, LIMIT)
        return np.hstack([inputs, self._known]).astype(np.float32)
