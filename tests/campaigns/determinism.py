"""One number for all bits of many world-steps: equal on any number of threads, in any batch, alone, in processes.

    python -m tests.campaigns.determinism --write                              the digest of 1e9 world-steps
    python -m tests.campaigns.determinism --steps 2e5 --everywhere --write     of every way to run; do all agree?

World number k has the machine and the task of kind k mod 24 and the seed k, and gets voltages that follow from k and
the step by whole numbers alone. It makes ``STEPS`` steps over automatic resets. Its bits are summed up to one word of
64 bits at each step, and the digest is the SHA-256 of the words of all worlds in order, with what the worlds are at
the end. So it tells nothing of how the worlds were run. Other versions of Python, NumPy or numba print the same
digest in an environment of their own.
"""

import hashlib
import multiprocessing
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import gymnasium
import numba
import numpy as np
import tyro
from numpy.typing import NDArray

from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW, SAME_STEP
from pter_gym.hands import HumanArm, MultiSineHand, RecordedForces
from pter_gym.params import BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL, Hand, Machine
from pter_gym.paths import Arc, Circle, Line, Sine
from pter_gym.tasks.path_following import STARTS, PathFollowing, Sensing

from .reports import put, table

STEPS = 500
LIMIT = 180
BATCH = 4096

Words = NDArray[np.uint64]

_ODD = np.uint64(0x9E3779B97F4A7C15)
_MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))


def machines() -> list[Machine]:
    """Materials, time constants, kinds of lag, a held tip."""
    kinds = [
        replace(material, clutch=replace(material.clutch, time_constant=time_constant, lag=lag))
        for material in (BASELINE, DELRIN_EXPERIMENTAL, DELRIN_THEORETICAL)
        for time_constant, lag in ((0.105, "normal_force"), (0.02, "voltage"))
    ]
    return [
        *kinds,
        replace(BASELINE, hand=Hand(mass=1.5, damping=10.0)),
        replace(BASELINE, clutch_scale=(0.5, 1.5, 1.0, 0.8)),
    ]


def tasks() -> list[PathFollowing]:
    """Paths, hands, sensors and starts for every machine."""
    noise = Sensing(angle_resolution=1e-3, velocity_noise=0.02, torque_noise=0.1, force_noise=0.5, delay=2)
    return [
        PathFollowing(start_offset=0.01, hand=MultiSineHand(random_phases=True), starts=STARTS["path"]),
        PathFollowing(
            path=Sine(x=-0.5, y=0.65, extent=0.8, amplitude=0.04),
            hand=RecordedForces(times=(0.0, 0.013, 0.3), along=(40.0, 60.0, 80.0), across=(0.0, 9.0, -9.0)),
            error_max=0.1,
            friction_drift=0.1,
        ),
        PathFollowing(path=Arc(x=-0.3, y=0.6, radius=0.3, angle=-1.0), error_max=0.1, sensing=noise),
    ]


def kinds() -> list[tuple[Machine, PathFollowing]]:
    """The 24 pairs of machine and task."""
    pairs = [(machine, task) for machine in machines() for task in tasks()]
    human = PathFollowing(path=Circle(), hand=HumanArm(random_phases=True), error_max=0.08)
    pairs[:3] = [(BASELINE, PathFollowing()), (BASELINE, human), (BASELINE, PathFollowing(path=Line(), pace=1.0))]
    return pairs


def mixed(words: Words) -> Words:
    """Return words whose bits all depend on all bits of the given ones (SplitMix64)."""
    words = (words ^ (words >> np.uint64(30))) * _MIX[0]
    words = (words ^ (words >> np.uint64(27))) * _MIX[1]
    return words ^ (words >> np.uint64(31))


def voltages(worlds: Words, step: int) -> NDArray[np.float32]:
    """Return the voltages (N, 4) of worlds at a step, from whole numbers alone: half of them are zero."""
    places = (worlds[:, None] * np.uint64(STEPS) + np.uint64(step)) * np.uint64(4) + np.arange(4, dtype=np.uint64)
    drawn = mixed((places + np.uint64(1)) * _ODD)
    volts = (drawn >> np.uint64(41)).astype(np.float32) * np.float32(24.0 / 2**23)
    return np.where(drawn & np.uint64(1), volts, np.float32(0.0))


def summed(words: Words, *parts: NDArray[Any]) -> Words:
    """Return the words of worlds after the bits of arrays (N, …) in order."""
    for part in parts:
        bits = np.ascontiguousarray(part).reshape(len(words), -1)
        bits = bits.view(np.uint32 if bits.dtype.itemsize == 4 else np.uint64 if bits.dtype.itemsize == 8 else np.uint8)
        factors = mixed(np.arange(1, bits.shape[1] + 1, dtype=np.uint64)) | np.uint64(1)
        words = mixed(words + (bits.astype(np.uint64) * factors).sum(axis=1, dtype=np.uint64) + _ODD)
    return words


def of_batch(first: int, last: int, batch: int = BATCH, threads: int = 1) -> Iterator[bytes]:
    """Yield the words of worlds, which run in batches of a size."""
    pairs = kinds()
    for begin in range(first, last, batch):
        worlds = np.arange(begin, min(begin + batch, last), dtype=np.uint64)
        chosen = [pairs[k % len(pairs)] for k in worlds.tolist()]
        engine = Batch(
            [machine for machine, _ in chosen],
            [task for _, task in chosen],
            sensors="force",
            max_steps=LIMIT,
            telemetry=False,
            num_threads=threads,
        )
        obs, _ = engine.reset(worlds.tolist())
        words = summed(mixed(worlds), obs)
        for step in range(STEPS):
            returns = engine.step(voltages(worlds, step), SAME_STEP)
            ended = returns.flags.any(axis=0)
            last_obs = np.where(ended[:, None], returns.final_obs, np.float32(0.0))
            words = summed(words, returns.obs, last_obs, returns.rewards, np.ascontiguousarray(returns.flags.T))
        engine.close()
        yield summed(words, engine.truth()[:, : ROW.context_at]).tobytes()


def alone(first: int, last: int) -> Iterator[bytes]:
    """Yield the words of worlds, each of which runs as an environment of its own by ``gymnasium.make``."""
    pairs = kinds()
    for world in range(first, last):
        machine, task = pairs[world % len(pairs)]
        env = gymnasium.make(
            "pter_gym:PTER/PathFollowing-v0",
            machine=machine,
            task=task,
            sensors="force",
            max_episode_steps=LIMIT,
            disable_env_checker=True,
        )
        number = np.array([world], np.uint64)
        obs, _ = env.reset(seed=world)
        words = summed(mixed(number), obs[None])
        for step in range(STEPS):
            obs, reward, terminated, truncated, info = env.step(voltages(number, step)[0])
            final = np.zeros_like(obs)
            if terminated or truncated:
                final = obs
                obs, _ = env.reset()
            flags = np.array([[terminated, truncated, info["is_success"]]])
            words = summed(words, obs[None], final[None], np.array([[reward]]), flags)
        yield summed(words, env.unwrapped.batch.truth()[:, : ROW.context_at]).tobytes()  # pyright: ignore[reportAttributeAccessIssue]


def digest(steps: int, parts: Callable[[int, int], Iterator[bytes]] = of_batch) -> str:
    """Return the digest of so many world-steps, rounded up to whole worlds."""
    found = hashlib.sha256()
    for part in parts(0, worlds_of(steps)):
        found.update(part)
    return found.hexdigest()


def worlds_of(steps: int) -> int:
    """Return how many worlds make so many world-steps."""
    return -(-steps // STEPS)


def _share(limits: tuple[int, int]) -> bytes:
    return b"".join(of_batch(*limits))


def in_processes(steps: int, count: int, method: str) -> str:
    """Return the digest of world-steps that several processes share."""
    worlds = worlds_of(steps)
    limits = [(worlds * k // count, worlds * (k + 1) // count) for k in range(count)]
    with multiprocessing.get_context(method).Pool(count) as pool:
        return hashlib.sha256(b"".join(pool.map(_share, limits))).hexdigest()


def ways(steps: int) -> Iterator[tuple[str, Callable[[], str]]]:
    """Yield every way to run worlds, by name."""
    yield "one thread, batches of 4,096", lambda: digest(steps)
    for threads in (2, 3, 4, 16):
        yield f"{threads} threads", lambda threads=threads: digest(steps, lambda a, b: of_batch(a, b, 2048, threads))
    for batch in (1, 7, 64, 10_000):
        yield f"batches of {batch:,}", lambda batch=batch: digest(steps, lambda a, b: of_batch(a, b, batch))
    yield "single environments", lambda: digest(steps, alone)
    for method in ("fork", "spawn"):
        yield f"three processes, {method}", lambda method=method: in_processes(steps, 3, method)


def main(steps: float = 1e9, everywhere: bool = False, write: bool = False) -> int:
    """Find the digest, or that of every way to run; 1 if they differ.

    Args:
        steps: World-steps.
        everywhere: Run in every way and compare.
        write: Put the digests into docs/robustness.md.
    """
    here = f"Python {platform.python_version()}, NumPy {np.__version__}, numba {numba.__version__}, one thread"
    begin = time.perf_counter()
    found = {name: find() for name, find in ways(int(steps))} if everywhere else {here: digest(int(steps))}
    seconds, count = time.perf_counter() - begin, worlds_of(int(steps)) * STEPS
    told = f"{count:,} world-steps on {platform.machine()}, {seconds:,.0f} s:\n\n"
    content = told + table(["", "Digest"], ([name, f"`{value}`"] for name, value in found.items()), "---")
    put("determinism everywhere" if everywhere else "determinism", content, write=write)
    return int(len(set(found.values())) > 1)


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
