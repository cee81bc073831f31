"""Step worlds natively, with the module's mathematical functions in place of this computer's.

    python native.py FUNCTIONS.so worlds FOLDER STEPS

steps worlds of every scenario, and writes what ``replay.mjs`` needs to do the same in the module
and hashes of all that came of it.

    python native.py FUNCTIONS.so trial FILE

repeats a trial of a page and prints, as JSON, at which steps something came of it that was not the
same bits.

    python native.py FUNCTIONS.so episodes FILE.npz POLICY COUNT STEPS own|recorded HYSTERESIS

lets a policy act in the first test episodes, with clutches of a hysteresis [V], and writes what
came of it; with ``recorded``, forces of a recording push the tip.

Where numba does not compile, Python calls the functions of the library."""

import ctypes
import hashlib
import json
import math
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba.core.registry import cpu_target

WORLDS, CHUNK, LIMIT = 8, 500, 400
LAWS = ("impedance-tuned", "torque-feedback", "single-dof-tuned", "velocity-ratio-tuned")
"""What drives half of the worlds; the others get voltages that are drawn and held."""

MATHEMATICS = ("sin", "cos", "sincos", "exp", "log", "atan2")


def link(functions: str) -> None:
    """Let compiled code call the functions of a library; before any of it is loaded."""
    _ = cpu_target.target_context  # numba names its own functions when this is made
    library = ctypes.CDLL(functions)
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        for name in set(MATHEMATICS) - {"sincos"}:
            function = getattr(library, f"pter_{name}")
            function.restype = ctypes.c_double
            function.argtypes = [ctypes.c_double] * (2 if name == "atan2" else 1)
            setattr(math, name, function)
        return
    for name in MATHEMATICS:
        address = ctypes.cast(getattr(library, f"pter_{name}"), ctypes.c_void_p).value
        llvm.add_symbol(name, address)


def held_volts(rng: np.random.Generator, now: Any, top: float) -> Any:
    """Keep most voltages and draw others: released, at the top, or anything between."""
    fresh = rng.random(now.shape) < 0.05
    drawn = rng.choice([0.0, 0.1, 1.0], now.shape, p=[0.4, 0.4, 0.2]) * rng.uniform(
        0.0, top, now.shape
    )
    return np.where(fresh, np.where(rng.random(now.shape) < 0.05, top, drawn), now)


def with_hysteresis(machine: Any, hysteresis: float) -> Any:
    """Return a machine whose clutches have a hysteresis [V]."""
    return replace(machine, clutch=replace(machine.clutch, hysteresis=hysteresis))


class Hashes:
    """A hash for each world and ``CHUNK`` steps."""

    def __init__(self) -> None:
        self.running = [hashlib.sha256() for _ in range(WORLDS)]
        self.done: list[list[str]] = []

    def add(self, world: int, *parts: Any) -> None:
        for part in parts:
            self.running[world].update(np.ascontiguousarray(part).tobytes())

    def close_chunk(self) -> None:
        self.done.append([each.hexdigest() for each in self.running])
        self.running = [hashlib.sha256() for _ in range(WORLDS)]


def run_scenario(name: str, steps: int, folder: Path) -> dict[str, Any]:
    """Step the worlds of a scenario and return what is needed to do it again."""
    from pter_gym._engine.batch import Batch
    from pter_gym._engine.world import BASIC_ROWS, FLAGS, SAME_STEP
    from pter_gym.benchmark.policies import find_policy
    from pter_gym.params import BASELINE
    from pter_gym.scenarios import find_scenario
    from pter_gym.tasks.path_following import STARTS
    from pter_gym.tools.web.tables import numbered_gains

    draws = find_scenario(name).draws.with_task(starts=STARTS["path"])
    drawn, tasks = zip(*draws.pairs(32, steps), strict=True)
    machines = [with_hysteresis(each, 1.2 * (k % 2)) for k, each in enumerate(drawn)]
    batch = Batch(
        machines, tasks, WORLDS, draws=True, sensors="force", observe_context=True, max_steps=LIMIT
    )
    arrays = batch.kernel_arrays()
    arrays["constants"].tofile(folder / f"{name}.constants")
    laws = [find_policy(law, scenario=name).bind(BASELINE, batch.layout) for law in LAWS]
    memories = [law.start(1) for law in laws]
    rows = arrays["worlds"].shape[1]
    begins, _ = batch.reset(list(range(1, WORLDS + 1)))
    obs, hashes, rng = begins, Hashes(), np.random.default_rng(0)
    top = batch.machine.clutch.voltage_max
    actions = held_volts(rng, np.zeros((WORLDS, 4)), top)
    with (folder / f"{name}.actions").open("wb") as file:
        for step in range(steps):
            actions = held_volts(rng, actions, top)
            for world, (law, memory) in enumerate(zip(laws, memories, strict=True)):
                actions[world] = law.act(obs[world : world + 1], memory)[0]
            actions.tofile(file)
            obs, final_obs, rewards, flags, telemetry = batch.step(actions, SAME_STEP)
            for world in range(WORLDS):
                if flags[:2, world].any():
                    hashes.add(world, final_obs[world], telemetry[1, world])
                state = arrays["worlds"][0, :, world]
                hashes.add(
                    world, obs[world], rewards[world], flags[:, world], state, telemetry[0, world]
                )
            if (step + 1) % CHUNK == 0:
                hashes.close_chunk()
    assert len(arrays["worlds"]) == 1
    assert FLAGS == 3
    return {
        "name": name,
        "steps": steps,
        "worlds": WORLDS,
        "chunk": CHUNK,
        "rows": rows,
        "guides": rows > BASIC_ROWS,
        "draws": len(batch.pairs),
        "entries": len(batch.layout),
        "scales": batch.layout.scales.tolist(),
        "config": arrays["config"].tolist(),
        "gains": [numbered_gains(law) for law in laws],
        "hashes": hashes.done,
        "episodes": int(arrays["words"][:, 1].sum()),
    }


def run_scenarios(folder: Path, steps: int) -> None:
    """Step worlds of every scenario."""
    from pter_gym.scenarios import SCENARIOS

    runs = [run_scenario(name, steps, folder) for name in SCENARIOS]
    (folder / "runs.json").write_text(json.dumps(runs))


def record(file: Path, name: str, count: int, steps: int, hand: str, hysteresis: float) -> None:
    """Write telemetry, observations in their units, and the forces (x, y) of a recording."""
    from pter_gym.benchmark import find_policy
    from pter_gym.benchmark.episodes import find_episodes
    from pter_gym.benchmark.rollout import record_episodes
    from pter_gym.hands import RecordedForces
    from pter_gym.params import BASELINE
    from pter_gym.tasks.path_following import observation_layout

    machine = with_hysteresis(BASELINE, hysteresis)
    episodes = find_episodes("standard", "medium", machine=machine).first(count)
    episodes = replace(episodes, time_limits=(steps,) * count)
    forces = np.random.default_rng(1).uniform((10.0, -8.0), (40.0, 8.0), (steps, 2))
    if hand == "recorded":
        _, _, cos, sin, *_ = episodes.tasks[0].path.arcs.table[0].tolist()
        x, y = np.vstack([np.zeros(2), forces]).T
        along, across = x * cos + y * sin, y * cos - x * sin
        recording = RecordedForces(
            times=tuple(0.01 * np.arange(steps + 1)), along=tuple(along), across=tuple(across)
        )
        tasks = tuple(replace(task, hand=recording) for task in episodes.tasks)
        episodes = replace(episodes, tasks=tasks)
    run = record_episodes(find_policy(name), episodes, sensors="force")
    scales = observation_layout(episodes.machines[0], "force").scales
    np.savez(file, telemetry=run.telemetry, observations=run.obs * scales, forces=forces)


def differences(trial: dict[str, Any], csv: Path) -> list[int]:
    """Repeat a trial from its CSV file, seed and voltages; return the steps at which it differs."""
    from pter_gym._engine.batch import Batch
    from pter_gym.hands import read_forces
    from pter_gym.params import BASELINE
    from pter_gym.scenarios.variations import CURVED_WIDTH
    from pter_gym.tasks.path_following import PathFollowing
    from pter_gym.tools.web.tables import PATHS

    task = PathFollowing(
        path=PATHS["sine"],
        hand=read_forces(csv),
        pace=trial["settings"]["pace"],
        error_max=CURVED_WIDTH,
    )
    batch = Batch(BASELINE, task, 1, sensors="force")
    batch.reset([3])
    found: list[int] = []
    for step, row in enumerate(trial["rows"]):
        obs, telemetry, reward, *_ = batch.step_alone(row["volts"])
        same = (
            obs.tolist() == row["observation"]
            and reward == row["reward"]
            and telemetry.tolist() == row["telemetry"]
        )
        found += [] if same else [step]
    return found


if __name__ == "__main__":
    _, functions, what, file, *rest = sys.argv
    link(functions)
    if what == "worlds":
        run_scenarios(Path(file), int(rest[0]))
    elif what == "episodes":
        record(Path(file), rest[0], int(rest[1]), int(rest[2]), rest[3], float(rest[4]))
    else:
        told = json.loads(Path(file).read_text())
        csv = Path(file).with_suffix(".csv")
        csv.write_text(told["csv"])
        sys.stdout.write(json.dumps(differences(told, csv)))
