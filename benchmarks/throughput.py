"""How fast the simulator is, as ratios to peers that are measured in turn with it.

    python benchmarks/throughput.py [--quick]

takes a minute or two on an otherwise idle machine. A rate is the median of some blocks; a ratio is
the median over pairs of blocks, ours and the peer's in turn, so other load on the machine affects
both. Peers that are not installed (MuJoCo, Stable-Baselines3) are skipped.

No peer does the same work. ``mujoco.rollout`` steps the same arm, clutches and load with the same
step, and holds the voltages for 100 steps, as ours do beside it, but observes, rewards and resets
nothing; "soft" has MuJoCo's default friction, with which a stuck clutch creeps. Reacher is another
planar arm, with two motors and no clutch. CartPole's native environment is a few lines of NumPy.
"""

import sys
import time
from collections.abc import Callable
from functools import partial
from itertools import cycle
from statistics import median
from typing import Any, NamedTuple

import gymnasium
import llvmlite.binding as llvm
import numpy as np
from gymnasium.vector import AutoresetMode

from pter_gym.benchmark import evaluate, find_policy, training_episodes
from pter_gym.envs._computer import available_cores
from pter_gym.hands import MultiSineHand
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tasks.path_following._specification import substeps

ID = "PTER/PathFollowing-v0"
QUICK = "--quick" in sys.argv
SECONDS, BLOCKS = (0.05, 3) if QUICK else (0.4, 7)
SIZES = (1, 16, 256) if QUICK else (1, 16, 256, 4_096, 16_384, 65_536, 262_144)
WORLDS = 256 if QUICK else 16_384
THREADS = available_cores()
HELD = 100


class Workload(NamedTuple):
    """Something to time: a call, and how many steps it advances, over all worlds."""

    call: Callable[[], object]
    steps: int

    def rate(self) -> float:
        """Return the steps per second [1/s] of calls repeated for a block of time."""
        calls, begin = 0, time.perf_counter()
        while (elapsed := time.perf_counter() - begin) < SECONDS or not calls:
            self.call()
            calls += 1
        return calls * self.steps / elapsed


def stepping(env: Any, worlds: int, steps: int = 1) -> Workload:
    """Return the load of an environment under random actions that are drawn beforehand."""
    env.reset()
    space = getattr(env, "single_action_space", env.action_space)
    actions = cycle([np.array([space.sample() for _ in range(worlds)]) for _ in range(4)])
    for _ in range(10):
        env.step(next(actions))
    return Workload(lambda: env.step(next(actions)), worlds * steps)


def ours(worlds: int, threads: int, steps: int = 1, **keywords: Any) -> Workload:
    """Return our vector environment without telemetry, which resets worlds in the step they end."""
    settings: Any = {
        "action_unit": "volt",  # MuJoCo's are drawn as evenly
        "telemetry": False,
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "num_threads": threads,
    }
    return stepping(gymnasium.make_vec(ID, worlds, **settings, **keywords), worlds, steps)


def single(name: str) -> Workload:
    """Return one environment through ``gymnasium.make``, reset when an episode ends."""
    env = gymnasium.make(name)
    env.reset(seed=0)
    actions = cycle([env.action_space.sample() for _ in range(64)])

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(next(actions))
        if terminated or truncated:
            env.reset()

    return Workload(step, 1)


def mujoco_rollout(worlds: int, *, soft: bool = False) -> Workload:
    """Return MuJoCo on the same arm, from the environment's start, with random voltages."""
    import mujoco
    from mujoco import rollout
    from mujoco_arm import ArmNumbers, build

    arm, clutch, hand = BASELINE.arm, BASELINE.clutch, MultiSineHand()
    numbers = ArmNumbers(arm.length_a, arm.length_b, arm.inertia_a, arm.inertia_b, arm.coupling)
    volts = np.random.default_rng(0).uniform(0.0, clutch.voltage_max, (worlds, 4))
    torques = [[clutch.dynamic.torque(v) for v in row] for row in volts.tolist()]
    models = [build(numbers, BASELINE.substep, row, soft=soft) for row in torques]
    data = [mujoco.MjData(models[0]) for _ in range(THREADS)]
    state = np.zeros((worlds, mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    _, info = gymnasium.make(ID).reset(seed=0)
    angle_a, angle_b = info["telemetry"][[*COLUMN.theta]]
    state[:, 1], state[:, 2] = angle_a, angle_b - angle_a
    heading = PathFollowing().path.heading(0.0)
    along = np.array([np.cos(heading), np.sin(heading)])
    waves = np.array([hand.normal_force(BASELINE.substep * (k + 0.5)) for k in range(HELD)])
    force = hand.push * along + waves[:, None] * np.array([-along[1], along[0]])
    forces = np.broadcast_to(force, (worlds, HELD, 2)).copy()
    pool = rollout.Rollout(nthread=THREADS)
    return Workload(lambda: pool.rollout(models, data, state, forces), worlds * HELD)


def sb3(*, draws: bool) -> Workload:
    """Return Stable-Baselines3's ``make_vec_env``, which asks for pictures, or the same without."""
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import DummyVecEnv

    return stepping(
        make_vec_env(ID, 8) if draws else DummyVecEnv([lambda: gymnasium.make(ID)] * 8), 8
    )


def vectorised(name: str, worlds: int, mode: str) -> Workload:
    """Return one of Gymnasium's own environments."""
    return stepping(gymnasium.make_vec(name, worlds, mode), worlds)


def scoring(name: str) -> Workload:
    """Return the scoring of ranks of a policy in episodes of ``standard``, on one thread."""
    policy, episodes = find_policy(name), training_episodes("standard", "medium", 512, 0)
    steps = evaluate(policy, episodes, 1)["duration_s"].sum() / episodes.tasks[0].control_period
    return Workload(lambda: evaluate(policy, episodes, 1, ranking=True), round(steps))


PER_STEP = substeps(PathFollowing(), BASELINE)
WHOLE = partial(ours, WORLDS, THREADS)
SUBSTEPS = partial(
    ours, WORLDS, THREADS, HELD, task=PathFollowing(control_period=HELD * BASELINE.substep)
)
PAIRS: dict[str, tuple[Callable[[], Workload], Callable[[], Workload]]] = {
    "mujoco.rollout, substeps": (SUBSTEPS, partial(mujoco_rollout, 256)),
    "mujoco.rollout, substeps of env-steps": (
        partial(WHOLE, PER_STEP),
        partial(mujoco_rollout, 256),
    ),
    "mujoco.rollout, soft friction": (SUBSTEPS, partial(mujoco_rollout, 64, soft=True)),
    "Reacher-v5, sync": (WHOLE, partial(vectorised, "Reacher-v5", 16, "sync")),
    "CartPole-v1, native": (
        WHOLE,
        partial(vectorised, "CartPole-v1", WORLDS, "vector_entry_point"),
    ),
    "CartPole-v1, single env.step": (partial(single, ID), partial(single, "CartPole-v1")),
    "Reacher-v5, single env.step": (partial(single, ID), partial(single, "Reacher-v5")),
    "make_vec_env with rgb_array / without": (partial(sb3, draws=True), partial(sb3, draws=False)),
    **{
        f"scoring {name} / stepping 256 worlds": (partial(scoring, name), partial(ours, 256, 1))
        for name in ("single-dof-tuned", "residual")
    },
}


def processor() -> str:
    """Return the processor's kind, and the width of its vectors."""
    features = llvm.get_host_cpu_features()
    widths = {"avx512f": 512, "avx2": 256, "sse2": 128, "neon": 128}
    bits = next((bits for name, bits in widths.items() if features.get(name)), 64)
    return f"{llvm.get_host_cpu_name()}, vectors of {bits} bits"


def main() -> None:
    """Measure and print."""
    print(f"{ID}, {PER_STEP} substeps a step, {THREADS} threads on {processor()}")
    print(f"\n{'worlds':>10} {'1/s':>14} {'ns':>9} {'ns, 1 thread':>13}")
    for worlds in SIZES:
        loads = ours(worlds, THREADS), ours(worlds, 1)
        every, one = (median(load.rate() for _ in range(BLOCKS)) for load in loads)
        print(f"{worlds:>10,} {every:>14,.0f} {1e9 / every:>9,.1f} {1e9 / one:>13,.1f}")
    print(f"\n{'in turn with':40} {'peer [1/s]':>14} {'ours [1/s]':>14} {'ours / peer':>12}")
    for name, (make_ours, make_peer) in PAIRS.items():
        try:
            mine, peer = make_ours(), make_peer()
        except (ImportError, gymnasium.error.Error) as error:
            print(f"{name:40} skipped: {error}")
            continue
        rates = [(mine.rate(), peer.rate()) for _ in range(BLOCKS)]
        a, b = (median(each) for each in zip(*rates, strict=True))
        print(f"{name:40} {b:>14,.0f} {a:>14,.0f} {median(x / y for x, y in rates):>12.3g}")


if __name__ == "__main__":
    main()
