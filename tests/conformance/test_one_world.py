"""The functions of one world, which a web page calls, do what the block kernel does to many.

Here they run as plain Python; ``tests/tools/web`` runs what is made of them.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pter_gym._compiled.records import load
from pter_gym._engine import kernels
from pter_gym._engine.batch import Batch
from pter_gym._engine.episode import fetch_world, take_context
from pter_gym._engine.step import conclude_step, given_volts, move_worlds, take_command
from pter_gym._engine.world import BASIC_ROWS, CONFIG, LANES, REFUSE, ROW, ROWS
from pter_gym._physics.clutch import PerClutch
from pter_gym.hands import HumanArm, RecordedForces
from pter_gym.params import BASELINE, DELRIN_THEORETICAL
from pter_gym.paths import Circle
from pter_gym.tasks.path_following import PathFollowing, Sensing

MACHINE = replace(BASELINE, substep=2e-3)
LAGGING = replace(MACHINE, clutch=replace(DELRIN_THEORETICAL.clutch, time_constant=0.02, lag="voltage"))
WORLDS = {
    "a push alone": (MACHINE, PathFollowing()),
    "voltages that lag": (LAGGING, PathFollowing()),
    "an arm that plans": (MACHINE, PathFollowing(path=Circle(), hand=HumanArm(random_phases=True), error_max=0.08)),
    "recorded forces": (
        MACHINE,
        PathFollowing(hand=RecordedForces(times=(0.0, 0.3), along=(40.0, 80.0), across=(0.0, -9.0))),
    ),
    "noisy sensors": (MACHINE, PathFollowing(sensing=Sensing(velocity_noise=0.02, force_noise=0.5, delay=2))),
}


def moved_alone(batch: Batch, volts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the first world of a batch would store after a control step, (rows,), and its reward."""
    arrays = batch.device_arrays()
    worlds, words, config, constants = (arrays[name].copy() for name in ("worlds", "words", "config", "constants"))
    w = np.zeros((ROWS, 1))
    fetch_world(w, 0, worlds, 0)
    take_context(w, 0, constants)
    take_command(w, 0, given_volts(volts, 0, config[CONFIG.low], config[CONFIG.high], w[ROW.machine.voltage_max, 0]))
    with_extras = worlds.shape[1] > BASIC_ROWS
    move_worlds(w, 1, config, with_extras)
    conclude_step(w, 1, 1, words, 0, config, constants, with_extras)
    return np.append(w[: worlds.shape[1], 0], w[ROW.reward, 0])


@pytest.mark.parametrize("kind", WORLDS)
def test_a_world_alone_does_what_it_does_in_a_block(kind: str) -> None:
    machine, task = WORLDS[kind]
    batch = Batch(machine, task, sensors="force")
    batch.reset([5])
    rng = np.random.default_rng(3)
    for _ in range(6):
        volts = rng.uniform(0.0, 12.0, (1, 4))
        alone = moved_alone(batch, volts)
        rewards = batch.step(volts).rewards
        stored = batch.get_state()["worlds"][0, :, 0]
        np.testing.assert_allclose(alone, [*stored, *rewards], rtol=1e-9, atol=1e-12)


def test_a_control_step_keeps_the_voltages_of_the_one_before() -> None:
    w = np.zeros((ROWS, 1))
    w[ROW.machine.voltage_max] = 24.0
    take_command(w, 0, PerClutch(1.0, 2.0, 3.0, 4.0))
    assert load(w, ROW.last_command, 0) == (0.0, 0.0, 0.0, 0.0)
    take_command(w, 0, PerClutch(5.0, 6.0, 7.0, 8.0))
    assert load(w, ROW.last_command, 0) == (1.0, 2.0, 3.0, 4.0)
    assert load(w, ROW.command, 0) == (5.0, 6.0, 7.0, 8.0)


@pytest.mark.parametrize("kind", ["a push alone", "noisy sensors"])
def test_lanes_without_a_world_hold_finite_numbers(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the memory held before that a kernel works in."""
    machine, task = WORLDS[kind]
    batch = Batch(machine, task, 3)
    obs, _ = batch.reset([5, 6, 7])
    room = np.full((ROWS, LANES), np.nan)
    monkeypatch.setattr(kernels, "_scratch", lambda: room)
    arrays = batch.device_arrays()
    worlds, words, config, constants = (arrays[name].copy() for name in ("worlds", "words", "config", "constants"))
    rewards, flags, telemetry = np.zeros(3), np.zeros((3, 3), np.bool_), np.empty((0, 3, 0))
    advance = kernels._build_advance("")
    given = np.full((3, 4), 2.0)
    assert advance(worlds, words, given, obs, obs, rewards, flags, telemetry, config, constants, REFUSE, 2, 0, 1) == -1
    lanes = worlds.shape[2]
    assert lanes > 3
    read = room[: int(ROW.arrangement.a.x1), :lanes]  # what follows is for other clutches than the paper's
    assert np.isfinite(read).all(), np.flatnonzero(~np.isfinite(read).all(axis=1))
    assert np.isfinite(worlds).all()
