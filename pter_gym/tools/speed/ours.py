"""Our own speed: whole control steps through the public interfaces, on the CPU and on a CUDA device."""

import os
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from pter_gym._internal.computer import available_cores, available_memory
from pter_gym.errors import DependencyError, ParameterError
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing, substeps
from pter_gym.tools.speed.timing import Effort, Load, block_rate, rate, seconds_of

ID = "PTER/PathFollowing-v0"

CPU_SIZES = (1, 16, 256, 4_096, 16_384, 65_536, 262_144, 1_000_000)
CUDA_SIZES = (1, 1_024, 65_536, 262_144, 1_000_000, 4_000_000)

_PREPARED = 4
_WARM_UP = 10
_BYTES_PER_WORLD = 2_500  # measured: its state, spaces and prepared actions, and what steps return
_CUDA_STEPS = 200
_CUDA_BLOCK = 100_000_000


@dataclass(frozen=True)
class Throughput:
    """Whole control steps per second [1/s] of all worlds together, and the time of one [ns]."""

    worlds: int
    threads: int
    steps_per_second: float
    nanoseconds_per_step: float


@dataclass(frozen=True)
class Skipped:
    """What was not measured, and why."""

    what: str
    why: str


@dataclass(frozen=True)
class Sweep:
    """Throughput over the number of worlds; ``bytes_per_world`` is the largest batch's memory between steps."""

    rows: tuple[Throughput, ...]
    skipped: tuple[Skipped, ...]
    bytes_per_world: float


@dataclass(frozen=True)
class SingleStep:
    """Time of one ``env.step`` through ``gymnasium.make`` [µs], ours and a peer's in turn, and the median ratio."""

    peer: str
    microseconds: float
    peer_microseconds: float
    ratio: float


@dataclass(frozen=True)
class Cuda:
    """A CUDA device: time to compile [s], time of an asynchronous ``step`` with few worlds [µs], throughput."""

    device: str
    compile_seconds: float
    overhead_worlds: int
    overhead_microseconds: float
    rows: tuple[Throughput, ...]
    skipped: tuple[Skipped, ...]


def make_vec(worlds: int, threads: int | None = None, **keywords: Any) -> Any:
    """Return the native vector environment as measured: no telemetry, ended worlds reset in the same step."""
    return gymnasium.make_vec(
        ID,
        num_envs=worlds,
        telemetry=False,
        autoreset_mode=AutoresetMode.SAME_STEP,
        num_threads=threads,
        **keywords,
    )


def random_actions(env: Any, seed: int = 0) -> list[Any]:
    """Return some arrays of random actions over the whole action space, prepared before timing starts."""
    space = env.single_action_space
    rng = np.random.default_rng(seed)
    return [rng.uniform(space.low, space.high, (env.num_envs, 4)).astype(np.float32) for _ in range(_PREPARED)]


def vector_load(worlds: int, threads: int | None = None, **keywords: Any) -> Load:
    """Return the load of ``worlds`` running worlds; keywords as for ``make_vec``."""
    env = make_vec(worlds, threads, **keywords)
    env.reset(seed=0)
    actions = cycle(random_actions(env))
    for _ in range(_WARM_UP):
        env.step(next(actions))
    return Load(lambda: env.step(next(actions)), worlds, env.close)


def sweep(sizes: Sequence[int], threads: int, effort: Effort) -> Sweep:
    """Measure whole control steps per second for each number of worlds, block by block in turn over the sizes."""
    loads: dict[int, Load] = {}
    skipped: list[Skipped] = []
    for worlds in sizes:
        needed, most = _BYTES_PER_WORLD * (worlds + sum(loads)), available_memory()
        if needed > most:
            why = f"{needed / 2**30:.3g} GiB are more than the {most / 2**30:.3g} GiB of this machine's memory"
            skipped.append(Skipped(f"{worlds:,} worlds", why))
        else:
            loads[worlds] = vector_load(worlds, threads)
    rounds = [[block_rate(load, effort.seconds) for load in loads.values()] for _ in range(effort.rounds)]
    for load in loads.values():
        load.close()
    medians = map(statistics.median, zip(*rounds, strict=True))
    rows = [throughput(worlds, threads, found) for worlds, found in zip(loads, medians, strict=True)]
    return Sweep(tuple(rows), tuple(skipped), bytes_per_world(max(loads)))


def throughput(worlds: int, threads: int, steps_per_second: float) -> Throughput:
    """Return a row from its rate [1/s]."""
    return Throughput(worlds, threads, steps_per_second, 1e9 / steps_per_second)


def bytes_per_world(worlds: int) -> float:
    """Return a batch's memory between steps, per world [B]."""
    env = make_vec(worlds, 1)
    env.reset(seed=0)
    env.step(random_actions(env)[0])
    size = env.batch.nbytes / worlds
    env.close()
    return size


def single_steps(peers: Sequence[str], steps: int, rounds: int) -> tuple[list[SingleStep], list[Skipped]]:
    """Measure one ``env.step`` through ``gymnasium.make``, ours and each peer's, block by block in turn.

    Resets between episodes do not count. The first block of each is left out.
    """
    envs: dict[str, Any] = {ID: gymnasium.make(ID)}
    skipped: list[Skipped] = []
    for peer in peers:
        try:
            envs[peer] = gymnasium.make(peer)
        except (ImportError, gymnasium.error.Error) as error:
            skipped.append(Skipped(f"{peer}, single step", f"not installed: {error}"))
    actions = {name: _samples(env, steps) for name, env in envs.items()}
    blocks = [{name: _step_seconds(env, actions[name]) for name, env in envs.items()} for _ in range(rounds + 1)][1:]
    for env in envs.values():
        env.close()
    found = [
        SingleStep(
            peer=peer,
            microseconds=1e6 * statistics.median(block[ID] for block in blocks),
            peer_microseconds=1e6 * statistics.median(block[peer] for block in blocks),
            ratio=statistics.median(block[ID] / block[peer] for block in blocks),
        )
        for peer in envs
        if peer != ID
    ]
    return found, skipped


def _samples(env: Any, count: int) -> list[Any]:
    env.action_space.seed(0)
    return [env.action_space.sample() for _ in range(count)]


def _step_seconds(env: Any, actions: list[Any]) -> float:
    env.reset(seed=0)
    resets = 0.0
    begin = time.perf_counter()
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            resets += seconds_of(env.reset)
    return (time.perf_counter() - begin - resets) / len(actions)


def cuda(sizes: Sequence[int], effort: Effort) -> Cuda | Skipped:
    """Measure the CUDA device, if there is one."""
    if os.environ.get("NUMBA_ENABLE_CUDASIM") == "1":
        return Skipped("CUDA device", "numba's simulator is on, whose times mean nothing")
    try:
        make_vec(1, device="cuda").close()
    except DependencyError as error:
        return Skipped("CUDA device", str(error))
    return measure_device(sizes, effort)


def measure_device(sizes: Sequence[int], effort: Effort) -> Cuda:
    """Measure the CUDA device; actions are on the device, and each block ends by waiting for it."""
    env = make_vec(sizes[0], device="cuda")
    actions = _device_actions(env)
    compiling = seconds_of(partial(_begin, env, actions[0]))
    overhead = min(_steps_seconds(env, actions, _CUDA_STEPS, wait=False) for _ in range(effort.rounds)) / _CUDA_STEPS
    size = env.batch.nbytes / env.num_envs
    env.close()
    rows: list[Throughput] = []
    skipped: list[Skipped] = []
    for worlds in sizes:
        try:
            _check_device_memory(worlds, size)
            load = _cuda_load(worlds)
        except ParameterError as error:
            skipped.append(Skipped(f"{worlds:,} worlds on the CUDA device", str(error)))
            continue
        rows.append(throughput(worlds, 0, rate(load, effort)))
        load.close()
    return Cuda(_device_name(), compiling, sizes[0], 1e6 * overhead, tuple(rows), tuple(skipped))


def _begin(env: Any, action: Any) -> None:
    """Compile both kernels: reset, step once and wait for the device."""
    env.reset(seed=0)
    env.step(action)
    env.check()


def _steps_seconds(env: Any, actions: list[Any], steps: int, *, wait: bool) -> float:
    """Return how long some steps take to launch [s], or to finish."""
    given = cycle(actions)
    begin = time.perf_counter()
    for _ in range(steps):
        env.step(next(given))
    asked = time.perf_counter()
    env.check()
    return (time.perf_counter() if wait else asked) - begin


def _check_device_memory(worlds: int, size: float) -> None:
    """Raise a ParameterError if worlds of a size [B], with as much again for what steps return, do not fit."""
    from numba import cuda as numba_cuda

    driver: Any = numba_cuda
    free = driver.current_context().get_memory_info().free
    if 2.0 * size * worlds > free:
        raise ParameterError(f"num_envs must be ≤ {int(free / (2.0 * size))}, which fit into the device, got {worlds}")


def _cuda_load(worlds: int) -> Load:
    env = make_vec(worlds, device="cuda")
    actions = _device_actions(env)
    _begin(env, actions[0])
    steps = max(_CUDA_STEPS // 10, min(_CUDA_STEPS, _CUDA_BLOCK // worlds))
    return Load(lambda: _steps_seconds(env, actions, steps, wait=True), steps * worlds, env.close)


def _device_actions(env: Any) -> list[Any]:
    """Return random actions on the device."""
    from numba import cuda as numba_cuda

    driver: Any = numba_cuda
    return [driver.to_device(action) for action in random_actions(env)]


def _device_name() -> str:
    from numba import cuda as numba_cuda

    driver: Any = numba_cuda
    name = getattr(driver.get_current_device(), "name", "simulated device")
    return name.decode() if isinstance(name, bytes) else str(name)


def all_threads() -> int:
    """Return how many threads a measurement with all cores uses."""
    return available_cores()


def substeps_per_step() -> int:
    """Return the number of substeps in one control step of the measured environment."""
    return substeps(PathFollowing(), BASELINE)
