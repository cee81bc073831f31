"""Before training: the base controller at all paces, and the centres and scales of a network's inputs."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pter_agents.settings import PLAIN, TrainingSettings
from pter_agents.worlds import ALL, Truth, make_worlds
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.tuned import FALLBACK, SUFFIX
from pter_gym.controllers import PaceSchedule
from pter_gym.params import BASELINE, Machine
from pter_gym.policies._interface import Base, Input, Interface, available, quantities, seen_without
from pter_gym.policies._stored_gains import gains_of
from pter_gym.scenarios.randomisation import Mixture, Randomisation

FIXED = {"normal_error": 0.01, "pace_error": 0.5, "speed_across": 0.1}
"""Chosen scales [m, 1, m/s]: with a good policy these are far smaller than random actions make them."""

SAMPLE_WORLDS, SAMPLE_STEPS = 256, 200

DEVIATION = 0.4
"""Standard deviation of the random actions."""

DIGITS = 4
"""Significant digits of centres and scales."""


def find_base(name: str, scenario: str) -> Base | None:
    """Return the base controller with its gains over the commanded pace, or None."""
    if name == PLAIN:
        return None
    policy = find_policy(name, scenario=FALLBACK if scenario == ALL else scenario)
    assert isinstance(policy, PaceSchedule)
    paces, controllers = zip(*policy.knots, strict=True)
    return Base(controller=name.removesuffix(SUFFIX), paces=paces, gains=tuple(map(gains_of, controllers)))


def make_interface(
    settings: TrainingSettings,
    scenario: str,
    draws: Randomisation | Mixture,
    seed: int,
    nominal: Machine = BASELINE,
    base: Base | None = None,
) -> Interface:
    """Return the interface of a policy, its scales taken from a short run without a network.

    Parameters
    ----------
    settings
        Hyper-parameters.
    scenario
        Scenario of the base controller's gains.
    draws
        Machines and tasks.
    seed
        Seed of the run and its random actions.
    nominal
        The machine that a base controller is bound to.
    base
        A base controller in place of the one that the settings name.
    """
    base = base or find_base(settings.base, scenario)
    plain = Interface(
        inputs=(Input("pace"),),
        reach=settings.reach,
        base=base,
        history=settings.history,
        averages=settings.averages,
        normalised=settings.normalised,
        frame_skip=settings.frame_skip,
    )
    return replace(plain, inputs=tuple(sample_inputs(plain, settings, draws, seed, nominal)))


def sample_inputs(
    plain: Interface, settings: TrainingSettings, draws: Randomisation | Mixture, seed: int, nominal: Machine
) -> Sequence[Input]:
    """Return the inputs, with the mean and standard deviation of each under random actions."""
    worlds = make_worlds(draws, SAMPLE_WORLDS, settings.episode, settings.sensors, settings.frame_skip)
    layout = worlds.observation_layout
    bound = plain.bind(nominal, layout)
    residual = plain.base is not None
    names = available(layout, residual=residual)
    shown = seen_without(names, settings.blind)
    rng = np.random.default_rng(seed)
    obs: Any = worlds.reset(seed=seed)[0]
    past = bound.begin(SAMPLE_WORLDS)
    seen: list[np.ndarray] = []
    for _ in range(SAMPLE_STEPS):
        _, base = bound.see(obs, past)
        seen.append(quantities(obs * layout.scales, base, layout, residual=residual))
        actions = settings.start + DEVIATION * rng.standard_normal((SAMPLE_WORLDS, 4))
        obs = worlds.step(bound.volts(base, actions))[0]
    worlds.close()
    values = np.concatenate(seen)
    return [_input(name, column) for name, column in zip(names, values.T, strict=True) if name in shown]


def sample_truth(settings: TrainingSettings, draws: Randomisation | Mixture, seed: int) -> Truth:
    """Return the entries of the truth about a world that vary, from a short run with random actions.

    Parameters
    ----------
    settings, draws, seed
        As in ``make_interface``.
    """
    worlds = make_worlds(draws, SAMPLE_WORLDS, settings.episode, settings.sensors, settings.frame_skip)
    rng = np.random.default_rng(seed)
    most = worlds.batch.machine.clutch.voltage_max
    worlds.reset(seed=seed)
    seen: list[np.ndarray] = []
    for _ in range(SAMPLE_STEPS):
        worlds.step(rng.uniform(0.0, most, (SAMPLE_WORLDS, 4)).astype(np.float32))
        seen.append(worlds.batch.truth())
    worlds.close()
    values = np.concatenate(seen)
    mean, spread = values.mean(axis=0), values.std(axis=0)
    entries = np.flatnonzero(spread > 1e-6 * (1.0 + np.abs(values).max(axis=0)))
    return Truth(entries, mean[entries], spread[entries])


def _input(name: str, values: np.ndarray) -> Input:
    if name in FIXED:
        return Input(name, 0.0, FIXED[name])
    spread = float(values.std())
    scale = spread if spread > 1e-6 * (1.0 + float(np.abs(values).max())) else 1.0
    return Input(name, _rounded(float(values.mean())), _rounded(scale))


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
