"""Other simulators, each measured in turn with ours in the same run. All are optional.

None of them does what ours does; each says what one of its steps is. Reacher is a planar arm of two links as well, but
with two motors, a target and no clutch; one of its steps is two substeps of 10 ms and ours four of 2.5 ms.
"""

import importlib
import importlib.metadata
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from itertools import cycle
from typing import Any

import gymnasium
import numpy as np

from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tools.speed.mujoco_arm import ArmNumbers, build
from pter_gym.tools.speed.ours import ID, Skipped, all_threads, substeps_per_step, vector_load
from pter_gym.tools.speed.timing import Effort, Load, compare, rate

_PREPARED = 4
ROLLOUT_SUBSTEPS = 100
"""Substeps for which a rollout holds the voltages: a quarter of a second."""


class Kind(StrEnum):
    """The kind of our steps that a peer's are compared with."""

    ENV_STEPS = "env-steps"
    """Whole control steps."""

    SUBSTEPS = "substeps"
    """Substeps of control steps that hold the voltages for as many substeps as a rollout does."""

    SUBSTEPS_OF_ENV_STEPS = "substeps of env-steps"
    """Substeps of whole control steps of the usual length."""


@dataclass(frozen=True)
class Peer:
    """Another simulator.

    Attributes
    ----------
    name, package
        What is measured, and the distribution that provides it.
    modules
        What must be importable.
    one_step
        What it does in one step, and on how many threads.
    kind
        Which of our steps compare with its own.
    worlds
        Numbers of worlds to try; the fastest one is compared.
    load
        Opens it with a number of worlds.
    """

    name: str
    package: str
    modules: tuple[str, ...]
    one_step: str
    kind: Kind
    worlds: tuple[int, ...]
    load: Callable[[int], Load]


@dataclass(frozen=True)
class Ratio:
    """Ours and a peer: rates [1/s] of the same kind of step, and the median of the ratios of alternating blocks."""

    name: str
    package: str
    version: str
    one_step: str
    kind: Kind
    worlds: int
    steps_per_second: float
    our_worlds: int
    our_steps_per_second: float
    ratio: float


def our_loads(worlds: int) -> dict[Kind, Load]:
    """Return our side of the comparisons with as many worlds, all threads."""
    whole = vector_load(worlds)
    held = vector_load(worlds, task=PathFollowing(control_period=ROLLOUT_SUBSTEPS * BASELINE.substep))
    return {
        Kind.ENV_STEPS: whole,
        Kind.SUBSTEPS: Load(held.call, worlds * ROLLOUT_SUBSTEPS, held.close),
        Kind.SUBSTEPS_OF_ENV_STEPS: Load(whole.call, worlds * substeps_per_step(), whole.close),
    }


def measure_peer(peer: Peer, ours: Mapping[Kind, Load], our_worlds: int, effort: Effort) -> Ratio | Skipped:
    """Compare a peer at its fastest number of worlds with ours, or say that it is not installed."""
    try:
        for module in peer.modules:
            importlib.import_module(module)
        worlds = _fastest(peer, effort)
        load = peer.load(worlds)
    except (ImportError, gymnasium.error.Error) as error:
        return Skipped(peer.name, f"not installed: {error}")
    found = compare(ours[peer.kind], load, effort)
    load.close()
    return Ratio(
        name=peer.name,
        package=peer.package,
        version=importlib.metadata.version(peer.package),
        one_step=peer.one_step,
        kind=peer.kind,
        worlds=worlds,
        steps_per_second=found.peer_rate,
        our_worlds=our_worlds,
        our_steps_per_second=found.rate,
        ratio=found.ratio,
    )


def _fastest(peer: Peer, effort: Effort) -> int:
    rates: dict[int, float] = {}
    for worlds in peer.worlds:
        load = peer.load(worlds)
        rates[worlds] = rate(load, Effort(effort.seconds, 1))
        load.close()
    return max(rates, key=lambda worlds: rates[worlds])


ROLLOUT = "mujoco.rollout"
ROLLOUT_WHOLE = "mujoco.rollout beside env-steps"
ROLLOUT_SOFT = "mujoco.rollout, soft friction"
REACHER = "Gymnasium Reacher-v5, sync"
ENVPOOL = "EnvPool Reacher-v5"
CARTPOLE = "Gymnasium CartPole-v1, native"


def peers(quick: bool) -> tuple[Peer, ...]:
    """Return all peers; a quick run tries one number of worlds each."""
    return *_rollouts(quick), *_environments(quick)


def _rollouts(quick: bool) -> tuple[Peer, ...]:
    """Return MuJoCo on the mechanism."""
    threads = all_threads()
    mechanism = (
        f"one physics step of {1e3 * BASELINE.substep:g} ms of the same arm and clutches, voltages held for "
        f"{ROLLOUT_SUBSTEPS} steps as in ours beside it, the hand's force given; no observation, reward or reset; "
        f"{threads} threads"
    )

    def peer(name: str, one_step: str, kind: Kind = Kind.SUBSTEPS, *, soft: bool = False) -> Peer:
        modules = ("mujoco", "mujoco.rollout")
        sizes = (64,) if quick else (64, 256)
        return Peer(name, "mujoco", modules, one_step, kind, sizes, partial(_rollout, threads=threads, soft=soft))

    return (
        peer(
            ROLLOUT,
            f"{mechanism}; friction as hard as ours (no-slip iterations), which agrees with ours to 1e-10 rad where no "
            "clutch changes within a step",
        ),
        peer(
            ROLLOUT_WHOLE,
            f"the same beside the substeps of our usual env-steps, {substeps_per_step()} each, which observe, reward "
            "and reset too",
            Kind.SUBSTEPS_OF_ENV_STEPS,
        ),
        peer(
            ROLLOUT_SOFT,
            f"{mechanism}; friction as soft as by default, which lets a stuck clutch creep",
            soft=True,
        ),
    )


def _environments(quick: bool) -> tuple[Peer, ...]:
    """Return other environments."""
    threads = all_threads()
    reacher = "two physics steps of 10 ms of a two-link arm with motors, observation and reward"
    return (
        Peer(
            REACHER,
            "gymnasium",
            ("mujoco",),
            f"{reacher}; one thread, worlds one after another",
            Kind.ENV_STEPS,
            (64,) if quick else (16, 64, 256),
            lambda worlds: _gymnasium(gymnasium.make_vec("Reacher-v5", worlds, "sync")),
        ),
        Peer(
            ENVPOOL,
            "envpool",
            ("envpool",),
            f"{reacher}; {threads} threads in C++",
            Kind.ENV_STEPS,
            (256,) if quick else (16, 64, 256, 1024),
            lambda worlds: _envpool(worlds, threads),
        ),
        Peer(
            CARTPOLE,
            "gymnasium",
            (),
            "one Euler step of 20 ms of a cart and pole in NumPy, observation and reward; one thread",
            Kind.ENV_STEPS,
            (16_384,) if quick else (1_024, 4_096, 16_384, 65_536),
            lambda worlds: _gymnasium(gymnasium.make_vec("CartPole-v1", worlds, "vector_entry_point")),
        ),
    )


def _gymnasium(env: Any) -> Load:
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = cycle([env.action_space.sample() for _ in range(_PREPARED)])
    return Load(lambda: env.step(next(actions)), env.num_envs, env.close)


def _envpool(worlds: int, threads: int) -> Load:
    envpool: Any = importlib.import_module("envpool")
    env = envpool.make_gymnasium("Reacher-v5", num_envs=worlds, num_threads=min(threads, worlds), seed=0)
    env.reset()
    rng = np.random.default_rng(0)
    actions = cycle([rng.uniform(-1.0, 1.0, (worlds, 2)) for _ in range(_PREPARED)])
    return Load(lambda: env.step(next(actions)), worlds, env.close)


def _rollout(worlds: int, threads: int, *, soft: bool) -> Load:
    """Open MuJoCo on the mechanism: all worlds from the environment's start, with random voltages of their own."""
    mujoco: Any = importlib.import_module("mujoco")
    rollout: Any = importlib.import_module("mujoco.rollout")
    arm = BASELINE.arm
    numbers = ArmNumbers(arm.length_a, arm.length_b, arm.inertia_a, arm.inertia_b, arm.coupling)
    volts = np.random.default_rng(0).uniform(0.0, BASELINE.clutch.voltage_max, (worlds, 4))
    torques = [[BASELINE.clutch.dynamic.torque(v) for v in row] for row in volts.tolist()]
    models = [build(numbers, BASELINE.substep, row, soft=soft) for row in torques]
    data = [mujoco.MjData(models[0]) for _ in range(threads)]
    state = np.zeros((worlds, mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    env: Any = gymnasium.make(ID)
    _, info = env.reset(seed=0)
    env.close()
    angle_a, angle_b = (info["telemetry"][row] for row in COLUMN.theta)
    state[:, 1], state[:, 2] = angle_a, angle_b - angle_a
    forces = np.broadcast_to(_hand_forces(ROLLOUT_SUBSTEPS), (worlds, ROLLOUT_SUBSTEPS, 2)).copy()
    pool = rollout.Rollout(nthread=threads)
    return Load(lambda: pool.rollout(models, data, state, forces), worlds * ROLLOUT_SUBSTEPS, pool.close)


def _hand_forces(count: int) -> Any:
    """Return the hand's force on the tip in the middle of each substep [N], (count, 2), at the path's first heading."""
    hand = MultiSineHand()
    heading = PathFollowing().path.heading(0.0)
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-along[1], along[0]])
    waves = np.array([hand.normal_force(BASELINE.substep * (k + 0.5)) for k in range(count)])
    return hand.push * along + waves[:, None] * across
