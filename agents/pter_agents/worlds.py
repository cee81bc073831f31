"""The worlds to train on: a scenario's training episodes, and what the networks see of them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pter_agents.draws import training_draws
from pter_agents.settings import ALL, NO_BASE, TrainingArguments
from pter_gym.benchmark import find_policy
from pter_gym.controllers import PaceSchedule
from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.policies import Input, Interface
from pter_gym.policies._interface import clutch_rows, input_names, input_values

BASE_SCENARIO = "standard"
"""Scenario whose gains the base has for ``ALL``: those of ``everything`` are poor elsewhere."""

FIXED = {"normal_error": 0.01, "pace_error": 0.5, "speed_across": 0.1}
"""Chosen scales [m, 1, m/s]: random actions make these far larger than a good policy does."""

SAMPLE_WORLDS, SAMPLE_STEPS = 256, 200

DEVIATION = 0.4
"""Standard deviation of the random actions."""


@dataclass(frozen=True)
class Truth:
    """The entries of ``Batch.truth`` that vary, with their centers and scales."""

    entries: NDArray[np.intp]
    center: NDArray[np.float64]
    scale: NDArray[np.float64]


@dataclass(frozen=True)
class Training:
    """The worlds of a training, as the networks meet them.

    Attributes
    ----------
    env
        The worlds.
    interface
        The policy's inputs and outputs.
    truth
        Inputs of the value network alone.
    effortless
        The same worlds, in which voltage costs nothing.
    """

    env: PathFollowingVectorEnv
    interface: Interface
    truth: Truth
    effortless: PathFollowingVectorEnv

    @property
    def size(self) -> int:
        """Number of inputs of the value network."""
        return self.interface.size + len(self.truth.entries)


def make_training(arguments: TrainingArguments) -> Training:
    """Return the worlds of a training; a short run without a network gives the inputs' scales."""
    s, nominal = arguments.settings, arguments.nominal
    base = find_base(s.base, arguments.scenario)
    interface = Interface(
        (Input("pace"),),
        s.reach,
        base,
        s.history,
        s.averages,
        base is None,
        s.frame_skip,
        nominal.clutch.voltage_max,
        clutch_rows(nominal),
    )
    env = _make_worlds(arguments)
    inputs, truth = _sample(_make_worlds(arguments, SAMPLE_WORLDS), arguments.seed)
    free = replace(s, effort=0.0)
    effortless = env if s == free else _make_worlds(replace(arguments, settings=free))
    return Training(env, replace(interface, inputs=inputs), truth, effortless)


def find_base(name: str, scenario: str) -> PaceSchedule | None:
    """Return the base law with its gains over the commanded pace, or None."""
    if name == NO_BASE:
        return None
    policy = find_policy(name, scenario=BASE_SCENARIO if scenario == ALL else scenario)
    assert isinstance(policy, PaceSchedule)
    return policy


def _make_worlds(arguments: TrainingArguments, count: int | None = None) -> PathFollowingVectorEnv:
    """Return worlds that are reset in the same step in which they end."""
    settings = arguments.settings
    base = find_base(settings.base, arguments.scenario)
    return PathFollowingVectorEnv(
        settings.worlds if count is None else count,
        scenario=training_draws(arguments),
        contexts=settings.contexts,
        context_seed=arguments.seed,
        base=base,
        reach=None if base is None else settings.reach,
        max_episode_steps=settings.episode,
        frame_skip=settings.frame_skip,
        autoreset_mode=AutoresetMode.SAME_STEP,
        telemetry=False,
        num_threads=1,
    )


def _sample(env: PathFollowingVectorEnv, seed: int) -> tuple[tuple[Input, ...], Truth]:
    """Return the inputs and the truth, with mean and standard deviation under random actions."""
    layout, rng = env.observation_layout, np.random.default_rng(seed)
    obs: Any = env.reset(seed=seed)[0]
    inputs_seen: list[NDArray[Any]] = []
    true: list[NDArray[Any]] = []
    for _ in range(SAMPLE_STEPS):
        inputs_seen.append(input_values(obs * layout.scales, layout))
        true.append(env.batch.truth())
        actions = DEVIATION * rng.standard_normal((len(obs), env.batch.num_actions))
        obs = env.step(np.clip(actions, -1.0, 1.0).astype(np.float32))[0]
    env.close()
    center, scale, varies = _moments(inputs_seen)
    names = input_names(layout, residual=False)
    inputs = (
        Input(name, 0.0, FIXED[name])
        if name in FIXED
        else Input(name, _rounded(c), _rounded(s) if v else 1.0)
        for name, c, s, v in zip(names, center, scale, varies, strict=True)
    )
    center, scale, varies = _moments(true)
    return tuple(inputs), Truth(np.flatnonzero(varies), center[varies], scale[varies])


def _moments(rows: list[NDArray[Any]]) -> tuple[Any, Any, Any]:
    """Return mean and standard deviation of each column, and whether it varies."""
    values = np.concatenate(rows)
    deviation = values.std(axis=0)
    return values.mean(axis=0), deviation, deviation > 1e-6 * (1.0 + np.abs(values).max(axis=0))


def _rounded(value: float) -> float:
    """Return a number with four significant digits."""
    return float(f"{value:.4g}")
