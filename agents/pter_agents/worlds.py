"""The worlds to train on: a scenario's training draws behind the interface of a policy."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnvWrapper

from pter_gym.benchmark import PACES
from pter_gym.envs.sb3 import PterVecEnv, make_sb3_vec_env
from pter_gym.errors import unknown_name
from pter_gym.params import BASELINE
from pter_gym.policies.interface import LIMIT, Interface
from pter_gym.scenarios import find_scenario
from pter_gym.scenarios.randomisation import OneOf, Randomisation, Vary
from pter_gym.tasks.path_following import PathFollowing, RewardWeights, Sensors

ALL = "all"
"""Name for a commanded pace that is drawn among those at which a scenario is scored."""


def training_draws(
    scenario: str, pace: str, *, contexts: int, seed: int, reward: RewardWeights | None = None
) -> Randomisation:
    """Return machines and tasks of a scenario at a pace.

    Parameters
    ----------
    scenario
        Its name.
    pace
        Name of a commanded pace, or ``"all"``.
    contexts, seed
        Number of pairs of machine and task, and the seed of their list.
    reward
        Weights of the reward; those of the scenario by default.

    Raises
    ------
    ParameterError
        If there is no such scenario or pace; it tells the nearest.
    """
    if pace not in (ALL, *PACES):
        raise unknown_name("pace", pace, (ALL, *PACES))
    speeds = all_paces() if pace == ALL else (PACES[pace],)
    drawn = find_scenario(scenario).randomisation(None, contexts=contexts, seed=seed)
    task: Any = drawn.task
    base: PathFollowing = task.base if reward is None else replace(task.base, reward=reward)
    return replace(drawn, task=Vary(base, **{**task.fields, "pace": OneOf(speeds)}))


def all_paces() -> tuple[float, ...]:
    """Return the commanded paces [m/s], each as often as it is fast, so all take about the same share of time."""
    slowest = min(PACES.values())
    return tuple(pace for pace in PACES.values() for _ in range(round(pace / slowest)))


def make_worlds(draws: Randomisation, count: int, episode: int, sensors: Sensors = "torque") -> PterVecEnv:
    """Return worlds that take voltages.

    Parameters
    ----------
    draws
        Machines and tasks.
    count
        Number of worlds.
    episode
        Control steps after which an episode is truncated.
    sensors
        What they measure.
    """
    return make_sb3_vec_env(
        count,
        action_unit="volt",
        randomisation=draws,
        max_episode_steps=episode,
        sensors=sensors,
        num_threads=1,
    )


class Truth(NamedTuple):
    """Centres and scales of what is true of a world, see ``Batch.truth``."""

    center: NDArray[np.float64]
    scale: NDArray[np.float64]


class InterfaceVecEnv(VecEnvWrapper):
    """Worlds as the network of a policy meets them: its inputs as observations, its outputs as actions.

    The inputs of the value network alone follow those of the policy. Those of an episode's last observation are from
    one control step earlier: the world has begun again by then.

    ``infos`` of an episode's last step hold ``episode`` with its return and length, as Stable-Baselines3 logs them.

    Parameters
    ----------
    venv
        The worlds.
    interface
        What the network sees and does.
    truth
        How to scale what is true of a world for the value network; None if it sees what the policy sees.
    """

    def __init__(self, venv: PterVecEnv, interface: Interface, truth: Truth | None = None) -> None:
        size = interface.size + (0 if truth is None else len(truth.center))
        super().__init__(
            venv,
            observation_space=spaces.Box(-LIMIT, LIMIT, (size,), np.float32),
            action_space=spaces.Box(-1.0, 1.0, (4,), np.float32),
        )
        self.worlds = venv.env
        self.interface = interface.bind(BASELINE, self.worlds.observation_layout)
        self._past = self.interface.begin(venv.num_envs)
        self._base = np.zeros((venv.num_envs, 4))
        self._truth = truth
        self._known = np.zeros((venv.num_envs, size - interface.size))
        self._returns = np.zeros(venv.num_envs)
        self._lengths = np.zeros(venv.num_envs, np.int64)

    def reset(self) -> NDArray[np.float32]:
        """Start new episodes."""
        self._returns[:] = 0.0
        self._lengths[:] = 0
        self._past.forget(np.ones(self.num_envs, np.bool_))
        return self._see(self.venv.reset())

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Turn the network's outputs (N, 4) to voltages."""
        self.venv.step_async(self.interface.volts(self._base, actions))

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Advance all worlds by one control period."""
        venv: Any = self.venv
        obs, rewards, done, infos = venv.step_wait()
        ended = np.flatnonzero(done)
        final = np.array(obs)
        for world in map(int, ended):
            final[world] = infos[world]["terminal_observation"]
        self._returns += rewards
        self._lengths += 1
        if len(ended):
            last = np.hstack([self.interface.see(final, self._past, passing=True)[0], self._known])
            self._past.forget(done)
            for world in map(int, ended):
                infos[world]["terminal_observation"] = last[world].astype(np.float32)
                infos[world]["episode"] = {"r": float(self._returns[world]), "l": int(self._lengths[world])}
            self._returns[ended] = 0.0
            self._lengths[ended] = 0
        return self._see(obs), rewards, done, infos

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all that changes."""
        own = {
            "base": self._base,
            "known": self._known,
            "returns": self._returns,
            "lengths": self._lengths,
        }
        return {
            **self.worlds.get_state(),
            **self._past.get_state(),
            **{name: part.copy() for name, part in own.items()},
        }

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Go on where ``get_state`` was called."""
        self.worlds.set_state(state)
        self._past.set_state(state)
        self._base = state["base"]
        self._known = state["known"]
        self._returns = state["returns"]
        self._lengths = state["lengths"]

    def _see(self, obs: Any) -> NDArray[np.float32]:
        inputs, self._base = self.interface.see(obs, self._past)
        if self._truth is not None:
            known = (self.worlds.batch.truth() - self._truth.center) / self._truth.scale
            self._known = known.clip(-LIMIT, LIMIT)
        return np.hstack([inputs, self._known]).astype(np.float32)
