"""Laws and networks for any device: how they follow a machine."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pter_gym.benchmark import training_episodes
from pter_gym.benchmark.rollout import record_episode
from pter_gym.controllers import PaceSchedule, Powers, Scaled, SingleDof
from pter_gym.controllers._scaled import ratios_of
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE, Connection, Machine, TorqueCurve
from pter_gym.params._connection import BRAKE_A, COUPLED, INVERTED
from pter_gym.policies import Input, Interface, TrainedController
from pter_gym.policies._interface import Interval
from pter_gym.policies.tuned import SCALED, find_tuned
from pter_gym.tasks.path_following import observation_layout
from pter_gym.tools.deploy import source_of

PTER = PaceSchedule(((0.12, SingleDof()), (0.5, SingleDof(strength=20.0))))


def device(torque: float = 1.0, lag: float = 1.0, size: float = 1.0, top: float = 24.0) -> Machine:
    """PTER with other torques, time constants and lengths, driven by another largest voltage."""
    arm, clutch = BASELINE.arm, BASELINE.clutch
    ratio = clutch.voltage_max / top

    def curve(of: TorqueCurve) -> TorqueCurve:
        return TorqueCurve(
            slope=of.slope * torque * ratio,
            knee=of.knee / ratio,
            curvature=of.curvature * torque * ratio**2,
        )

    return replace(
        BASELINE,
        arm=replace(arm, length_a=arm.length_a * size, length_b=arm.length_b * size),
        clutch=replace(
            clutch,
            dynamic=curve(clutch.dynamic),
            breakaway=curve(clutch.breakaway),
            time_constant=clutch.time_constant * lag,
            voltage_max=top,
        ),
    )


def network(
    inputs: tuple[str, ...] = ("normal_error", "omega_a", "volts_1", "base_2"), **interface: Any
) -> TrainedController:
    """Random weights over a law for any device."""
    rng = np.random.default_rng(3)
    law = Scaled(schedule=PTER, powers=(Powers(gain="strength", lag=1.0),))
    usual = {"reach": 24.0, "base": law, "history": (2,)}
    known = Interface(tuple(Input(each, 2.0, 4.0) for each in inputs), **{**usual, **interface})
    sizes = known.size, 5, 4
    layers = tuple(
        (rng.normal(size=(n, m)).astype(np.float32), rng.normal(size=n).astype(np.float32))
        for m, n in pairwise(sizes)
    )
    return TrainedController(known, layers)


def test_the_papers_machine_has_the_gains_as_they_stand() -> None:
    law = Scaled(schedule=PTER, powers=(Powers(gain="strength", torque=2.0, lag=1.0),))
    assert law.for_machine(BASELINE) == PTER


@given(torque=st.floats(0.1, 9.0), lag=st.floats(0.1, 9.0), size=st.floats(0.5, 2.0))
def test_gains_follow_powers(torque: float, lag: float, size: float) -> None:
    powers = Powers(gain="strength", torque=0.5, lag=-1.0, mass=1.0, size=2.0)
    found = Scaled(schedule=PTER, powers=(powers,)).for_machine(device(torque, lag, size))
    factor = math.sqrt(torque) / lag  # the mass at the tip falls as the size squared
    assert found.at(0.5).strength == pytest.approx(20.0 * factor, rel=1e-5)
    assert found.at(0.5).approach == SingleDof().approach


def test_ratios_are_of_each_link_and_of_the_clutches_that_are_there() -> None:
    arm = replace(BASELINE.arm, length_a=0.5 * BASELINE.arm.length_a)
    brakes = replace(BASELINE, arm=arm, clutches=BASELINE.clutches[:2])
    size = (arm.length_a + arm.length_b) / (BASELINE.arm.length_a + arm.length_b)
    assert ratios_of(brakes) == pytest.approx((1.0, 1.0, 2.0, size))


def test_gains_stay_within_what_a_law_accepts() -> None:
    powers = (Powers(gain="pace_fraction", torque=1.0), Powers(gain="reluctance", torque=1.0))
    law = PaceSchedule(((0.5, SingleDof(pace_fraction=0.9, reluctance=0.9)),))
    found = Scaled(schedule=law, powers=powers).for_machine(device(3.0)).at(0.5)
    assert (found.pace_fraction, found.reluctance) == (1.0, 0.99)


def test_powers_are_of_gains() -> None:
    with pytest.raises(ParameterError, match="strenght"):
        Scaled(schedule=PTER, powers=(Powers(gain="strenght"),))


def test_damaged_numbers_are_refused() -> None:
    with pytest.raises(ParameterError, match="torque"):
        Powers(gain="strength", torque=1e3)
    with pytest.raises(ParameterError, match="schedule"):
        Scaled(schedule="single-dof")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ParameterError, match="volts_9"):
        network(("volts_9",)).bind(BASELINE, observation_layout(BASELINE, "torque"))


@pytest.mark.parametrize(
    "policy",
    [
        network(),
        network(base=PTER),
        network(("normal_error", "omega_a", "volts_1"), base=None, normalised=True),
        find_tuned(SCALED),
        *(find_tuned(f"{law}-tuned", "standard") for law in ("single-dof", "torque-feedback")),
    ],
    ids=["network", "of one machine", "without a law", "scaled", "single-dof", "torque-feedback"],
)
def test_a_voltage_is_a_fraction_of_the_largest(policy: Any) -> None:
    """The same clutches at half the voltages: powers of two, so the same bits but for them."""
    episodes = training_episodes("standard", "medium", 1, 0)
    task, seed = episodes.tasks[0], episodes.seeds[0]
    machines = device(top=24.0), device(top=12.0)
    high, low = (record_episode(policy, each, task, seed, nominal=each) for each in machines)
    assert len(high.volts) > 20
    np.testing.assert_allclose(low.volts, 0.5 * high.volts, atol=1e-6)


def test_other_policies_keep_to_their_clutches() -> None:
    policy = network(base=PTER)
    assert policy.for_machine(device(2.0)) is policy
    brakes = replace(BASELINE, clutches=(BRAKE_A, COUPLED))
    with pytest.raises(ParameterError, match=r"clutches must be .*, for which the policy is made"):
        policy.bind(brakes, observation_layout(brakes, "torque"))


def test_a_clutch_that_is_not_there_is_one_without_torque() -> None:
    """Declared away, or of scale 0: the same voltages of the others, if none sees its own."""
    inputs = ("normal_error", "volts_4", "torque_1", "base_4", "torque_2")
    policy, task = network(inputs, averages=(5,)), training_episodes("standard", "medium", 1, 0)
    without = replace(BASELINE, clutch_scale=(1.0, 0.0, 1.0, 1.0))
    declared = replace(BASELINE, clutches=(COUPLED, BRAKE_A, INVERTED))
    one, two = (
        record_episode(policy, machine, task.tasks[0], task.seeds[0], nominal=machine)
        for machine in (without, declared)
    )
    assert len(one.volts) > 20
    np.testing.assert_allclose(two.volts[:30, :3], one.volts[:30, [2, 0, 3]], atol=1e-3)


def test_a_machine_with_other_clutches_is_refused() -> None:
    clutches = (Connection("a", (1.0, 0.0)), Connection("c", (1.0, 2.0)))
    machine = replace(BASELINE, clutches=clutches)
    with pytest.raises(ParameterError, match="clutches must be some of"):
        network().bind(machine, observation_layout(machine, "torque"))


TRAINED = (Interval("lag", 0.005, 0.3), Interval("torque", 10.0, 200.0), Interval("brakes", 2, 2))


@pytest.mark.parametrize(
    ("machine", "beyond"),
    [
        (device(lag=1.0 / 0.105), "time constant of the clutches 1 s, not 0.005 to 0.3 s"),
        (device(torque=0.1), "largest voltage 5.42 N·m, not 10 to 200 N·m"),
        (replace(BASELINE, clutch_scale=(0.0, 1.0, 1.0, 1.0)), "axes with a brake 1, not 2"),
        (replace(BASELINE, clutches=(BRAKE_A, COUPLED)), "axes with a brake 1, not 2"),
    ],
)
def test_a_machine_beyond_the_training_is_told(machine: Machine, beyond: str) -> None:
    policy = network(trained=TRAINED)
    policy.for_machine(device(lag=2.0))
    with pytest.warns(UserWarning, match="policy was not trained on such a machine: ") as told:
        policy.bind(machine, observation_layout(machine, "torque"))
    (text,) = (str(each.message) for each in told)
    assert text.endswith(beyond)


@pytest.mark.parametrize("clutches", [BASELINE.clutches, (BRAKE_A, COUPLED)])
def test_a_machine_without_a_clutch_is_refused(clutches: tuple[Connection, ...]) -> None:
    scale = tuple(float(slot >= len(clutches)) for slot in range(4))
    machine = replace(BASELINE, clutches=clutches, clutch_scale=scale)
    for policy in (network(), find_tuned(SCALED)):
        with pytest.raises(ParameterError, match="clutch_scale must be above 0"):
            policy.bind(machine, observation_layout(machine, "torque"))


@pytest.mark.parametrize(("trait", "low", "high"), [("weight", 0.0, 1.0), ("lag", 1.0, 0.0)])
def test_an_interval_is_of_a_trait_and_in_order(trait: str, low: float, high: float) -> None:
    with pytest.raises(ParameterError, match=r"Interval\.(trait|high) must be"):
        Interval(trait, low, high)


def test_c_has_the_devices_numbers() -> None:
    one, two = (source_of(network(), machine=device(lag=lag)).files["pter.c"] for lag in (1, 2))
    assert one != two
