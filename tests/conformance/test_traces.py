"""Worlds do what they did when ``traces.npz`` was written: each number, whichever function has made
it.

    python tests/conformance/test_traces.py      writes it again, after a change that is meant

Entries have names in it, so what is added to observation, telemetry or world changes nothing of
what is compared. The worlds are chosen such that every way to begin, to sense and to end is among
them within 0.3 s: so few steps that they run as plain Python too, where each function can be looked
at. Other libraries round sines and exponentials otherwise in the last place, of which 24 control
steps do not make much."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym._compiled.records import leaves, record_fields
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import NEXT_STEP, SAME_STEP, SKIP, STORED_ROWS, World
from pter_gym.controllers import Impedance
from pter_gym.errors import ResetNeededError
from pter_gym.hands import HumanArm, MultiSineHand, RecordedForces, TremorArm
from pter_gym.params import BASELINE, DELRIN_THEORETICAL, Hand, Machine
from pter_gym.paths import Arc, Circle, Line, Sine
from pter_gym.tasks.path_following import (
    STARTS,
    PathFollowing,
    Reason,
    RewardWeights,
    Sensing,
    Starts,
)
from pter_gym.tasks.path_following._context import Context
from pter_gym.tasks.path_following._telemetry import TELEMETRY
from rollouts import Acting

FILE = Path(__file__).with_name("traces.npz")

Arrays = dict[str, NDArray[np.generic]]

ADDRESSES = {"context_at", "draws_from", "hand record_first", "task path_first"}
"""Entries of the truth that say where something is stored."""

MACHINE = replace(BASELINE, substep=2e-3)
MACHINES = (
    MACHINE,
    replace(MACHINE, clutch=replace(DELRIN_THEORETICAL.clutch, time_constant=0.02, lag="voltage")),
    replace(MACHINE, clutch_scale=(0.5, 1.5, 1.0, 0.8), hand=Hand(mass=1.5, damping=10.0)),
)
WEIGHTS = RewardWeights(
    tracking=300.0, precision=700.0, pace=50.0, acceleration=8.0, effort=12.0, failure=0.4
)
SHORT = Line(x=-0.1, y=0.55, direction=0.3, length=0.03)
TASKS = (
    PathFollowing(reward=WEIGHTS),
    PathFollowing(path=Circle(), hand=HumanArm(random_phases=True, rise=0.1), error_max=0.08),
    PathFollowing(
        path=Sine(x=-0.5, y=0.65, extent=0.8, amplitude=0.04),
        hand=RecordedForces(
            times=(0.0, 0.013, 0.3), along=(40.0, 60.0, 80.0), across=(0.0, 9.0, -9.0)
        ),
        error_max=0.1,
        friction_drift=0.3,
        start_offset=0.02,
        reward=WEIGHTS,
    ),
    PathFollowing(
        path=Arc(x=-0.3, y=0.6, radius=0.3, angle=-1.0),
        error_max=0.1,
        sensing=Sensing(
            angle_resolution=1e-3, velocity_noise=0.02, torque_noise=0.1, force_noise=0.5, delay=2
        ),
        starts=STARTS["path"],
    ),
    PathFollowing(hand=MultiSineHand(random_phases=True), starts=Starts(moving=1.0), pace=0.8),
    PathFollowing(path=SHORT, sensing=Sensing(delay=1), reward=WEIGHTS),
    PathFollowing(path=SHORT, arrival=1e-6, reward=WEIGHTS),
    PathFollowing(error_max=0.004, reward=WEIGHTS),
    PathFollowing(error_max=0.004, truncation_error=0.004, starts=Starts(gripped=1.0)),
    PathFollowing(truncation_error=0.003, singularity_margin=0.3),
    PathFollowing(
        hand=TremorArm(frequency=9.0, acceleration=5.0),
        path=Arc(x=-0.3, y=0.6, radius=0.4, angle=1.0),
        error_max=0.1,
    ),
    PathFollowing(
        path=Line(x=-0.1, y=0.9, direction=0.0, length=0.2),
        hand=RecordedForces(times=(0.0, 1.0), along=(20.0, 20.0), across=(30.0, 30.0)),
        singularity_margin=0.79,
        reward=WEIGHTS,
    ),
)


def voltages(rng: np.random.Generator, worlds: int) -> NDArray[np.float32]:
    """Voltages (worlds, 4) [V]: half of the worlds have them released now and then."""
    return (rng.uniform(0.0, 12.0, (worlds, 4)) * (rng.random((worlds, 1)) < 0.6)).astype(
        np.float32
    )


def entries(batch: Batch) -> Arrays:
    """Names of what the last axis of observations and of telemetry holds."""
    names = {"obs": batch.layout.names, "telemetry": TELEMETRY.names}
    return {f"entries of {kind}": np.array(each) for kind, each in names.items()}


def entries_of_truth() -> NDArray[np.str_]:
    """Names of all that is true of a world that stores all its rows; see ``Batch.truth``."""
    state = [leaf.name for leaf in leaves(World)][:STORED_ROWS]
    kinds = {name: kind for name, _, kind in record_fields(Context)}
    context = [f"{name} {leaf.name}" for name, kind in kinds.items() for leaf in leaves(kind)]
    context.remove("task energy_max")
    return np.array(state + context)


def of_all_kinds() -> Arrays:
    """Each task on each machine that can do it, with resets in the same step."""
    pairs: list[tuple[Machine, PathFollowing]] = [(MACHINE, task) for task in TASKS]
    pairs += [(machine, TASKS[k]) for machine in MACHINES[1:] for k in (0, 4)]
    machines, tasks = map(list, zip(*pairs, strict=True))
    batch = Batch(machines, tasks, sensors="force", observe_context=True, max_steps=14)
    rng = np.random.default_rng(1)
    obs, telemetry = batch.reset(range(len(pairs)))
    found = {"first obs": [obs], "first telemetry": [telemetry]}
    for _ in range(24):
        returns = batch.step(voltages(rng, len(pairs)), SAME_STEP)
        ended = returns.flags[:2].any(axis=0)
        final = np.where(ended[:, None], returns.final_obs, np.float32(0.0))
        last = np.where(ended[:, None], returns.telemetry[1], 0.0)
        seen = {
            "obs": returns.obs,
            "final obs": final,
            "telemetry": returns.telemetry[0],
            "last telemetry": last,
        }
        for name, part in {**seen, "rewards": returns.rewards, "flags": returns.flags}.items():
            found.setdefault(name, []).append(part)
    summed = {name: np.sum(found.pop(name), axis=0) for name in ("telemetry", "last telemetry")}
    arrays = {name: np.array(each) for name, each in found.items()}
    truth = {"truth": batch.truth().copy(), "entries of truth": entries_of_truth()}
    return {**arrays, **summed, **truth, **entries(batch)}


def of_draws(mode: int) -> Arrays:
    """Worlds that draw their pair at each reset, with normalised actions and another mode."""
    tasks = [TASKS[k] for k in (0, 5, 7)]
    batch = Batch([MACHINE] * 3, tasks, 5, draws=True, action_unit="normalised", max_steps=6)
    rng = np.random.default_rng(2)
    batch.reset([3, 1, 4, 1, 5])
    steps = [batch.step(rng.uniform(-1.0, 1.0, (5, 4)).astype(np.float32), mode) for _ in range(12)]
    rows = {
        "obs": [s.obs for s in steps],
        "rewards": [s.rewards for s in steps],
        "flags": [s.flags for s in steps],
        "telemetry": [np.nan_to_num(s.telemetry[0], nan=-1.0) for s in steps],
    }
    arrays = {
        name: np.array(each) if name != "telemetry" else np.sum(each, axis=0)
        for name, each in rows.items()
    }
    return {**arrays, **entries(batch)}


def without_telemetry() -> Arrays:
    """Worlds that end and go on, and tell nothing but what they return."""
    batch = Batch(MACHINE, [TASKS[k] for k in (5, 7)], max_steps=8, telemetry=False)
    batch.reset([1, 2])
    steps = [batch.step(np.zeros((2, 4)), SAME_STEP) for _ in range(10)]
    arrays = {
        "obs": np.array([step.obs for step in steps]),
        "flags": np.array([step.flags for step in steps]),
    }
    return {**arrays, **entries(batch)}


def of_a_law() -> Arrays:
    """Worlds that follow a compiled law."""
    batch = Batch(MACHINE, [TASKS[k] for k in (0, 1, 3)])
    law = Acting(Impedance().bind(MACHINE, batch.layout))
    obs, _ = batch.reset([7, 8, 9])
    rows = []
    for _ in range(8):
        returns = batch.step(law(obs), SKIP)
        obs = returns.obs
        rows.append(returns.telemetry[0])
    return {"obs": obs, "telemetry": np.nansum(rows, axis=0), **entries(batch)}


PARTS: dict[str, Callable[[], Arrays]] = {
    "all kinds": of_all_kinds,
    "draws, next step": lambda: of_draws(NEXT_STEP),
    "draws, skipped": lambda: of_draws(SKIP),
    "without telemetry": without_telemetry,
    "law": of_a_law,
}


def test_worlds_of_all_kinds_keep_their_traces():
    compare("all kinds")


@pytest.mark.parametrize("part", [part for part in PARTS if part != "all kinds"])
def test_worlds_keep_their_traces(part: str):
    compare(part)


def compare(part: str) -> None:
    """Compare what worlds do with what is stored."""
    with np.load(FILE) as stored:
        expected = {
            key.removeprefix(f"{part}: "): stored[key]
            for key in stored.files
            if key.startswith(f"{part}: ")
        }
    found = PARTS[part]()
    assert found.keys() == expected.keys()
    for name in [name for name in found if not name.startswith("entries of")]:
        array, kind = found[name], f"entries of {name.split()[-1]}"
        if kind in found:
            present = found[kind].tolist()
            places = [
                k for k, entry in enumerate(expected[kind].tolist()) if entry not in ADDRESSES
            ]
            array = array[..., [present.index(expected[kind][k]) for k in places]]
            expected[name] = expected[name][..., places]
        single = array.dtype == np.float32
        rtol, atol = (1e-5, 1e-5) if single else (1e-8, 1e-10)
        np.testing.assert_allclose(array, expected[name], rtol=rtol, atol=atol, err_msg=name)


def test_every_kind_of_ending_occurs():
    terminated, truncated, success = of_all_kinds()["flags"].any(axis=0)[:, : len(TASKS)]
    assert success[[3, 5]].all(), "arrived"
    assert (terminated & ~success)[[6, 7, 11]].all(), "missed, strayed, singular"
    assert (truncated & ~terminated)[[0, 8, 9]].all(), "by the time limit, and far from the path"


WHY = {5: Reason.ARRIVED, 6: Reason.MISSED, 7: Reason.STRAYED, 11: Reason.SINGULAR, 9: "truncated"}


def test_a_world_that_needs_a_reset_tells_why():
    batch = Batch(MACHINE, [TASKS[k] for k in WHY], max_steps=24)
    released = np.zeros((len(WHY), 4))
    with pytest.raises(ResetNeededError, match=r"world 0 .* never reset"):
        batch.step(released)
    batch.reset(range(len(WHY)))
    for _ in range(24):
        batch.step(released, SKIP)
    for world, why in enumerate(WHY.values()):
        with pytest.raises(ResetNeededError, match=rf"world {world} .* ended \({why}\)"):
            batch.step(released)
        batch.reset(None, np.arange(len(WHY)) == world)


def main() -> None:
    """Write the file."""
    found = {
        f"{part}: {name}": array for part, run in PARTS.items() for name, array in run().items()
    }
    np.savez_compressed(FILE, **found)  # pyright: ignore[reportArgumentType]


if __name__ == "__main__":
    main()
