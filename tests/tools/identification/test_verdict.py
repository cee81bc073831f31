"""What ``identify`` says where it cannot know: machines that break its model, and logs that are not
what they seem.

The logs of real machines come from an integrator of the tests' own, tests/oracle/recorded.py.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from oracle.experiment import Experiment, Recorder, record_log
from oracle.mismatched import late
from oracle.recorded import RecordedMachine, record
from pter_gym.params import BASELINE
from pter_gym.tools.identification import Identification, Log, identify
from pter_gym.tools.identification.verdict import EXACT, NEITHER, SIMULATION, Verdict, share_left
from pter_gym.tools.identification.windows import comes_again, has_one_way, smooth, smooth_force

RISING = (4.0, 8.0, 12.0, 16.0)
WARMING = RecordedMachine(fade=2e-3)
TORQUES = tuple(f"torque_{share}" for share in (25, 50, 75, 100))
RUBBING = RecordedMachine(dry=(0.4, 0.3), viscous=(0.2, 0.1))

BROKEN = {
    "torque that grows with the slip": RecordedMachine(growth=0.15),
    "hysteresis": RecordedMachine(hysteresis=1.0),
}


def states(found: Identification) -> set[str]:
    return {finding.status for finding in found.findings}


def true_values(machine: RecordedMachine) -> dict[str, float]:
    return {
        "inertia_a": machine.inertias[0],
        "inertia_b": machine.inertias[1],
        "coupling": machine.coupling,
        "slope": machine.slope,
        "time_constant": machine.time_constant,
        "delay": 0.0,
        **{f"scale_{x}": 1.0 for x in range(1, 5)},
        **dict(zip(("dry_a", "dry_b"), machine.dry, strict=True)),
        **dict(zip(("viscous_a", "viscous_b"), machine.viscous, strict=True)),
    }


# --- machines ---


@pytest.mark.long
@pytest.mark.parametrize(
    "machine", [RecordedMachine(), RUBBING], ids=["no friction of the axes", "friction of the axes"]
)
def test_a_machine_of_the_models_kind_is_explained(machine: RecordedMachine):
    """Numbers are within 2 % of their scale: the generator's springs are stiff, not rigid."""
    found = identify(record(machine), BASELINE)
    assert found.verdict.grade == EXACT
    assert found.verdict.sentence.startswith("The model is exact")
    assert found.verdict.hints == ()
    told = {finding.quantity.name: finding for finding in found.findings}
    for name, true in true_values(machine).items():
        assert abs(told[name].quantity.value - true) <= 0.02 * told[name].quantity.scale, name
        assert told[name].status == "identified" or name == "delay"


@pytest.mark.long
@pytest.mark.parametrize("machine", BROKEN.values(), ids=BROKEN)
def test_a_machine_outside_the_model_is_not_explained(machine: RecordedMachine):
    """What surely is left is below 3 % of the force, and what may be left widens all intervals."""
    found = identify(record(machine), BASELINE)
    assert found.verdict.grade == SIMULATION
    assert "identified" not in states(found)
    assert "of the force is unexplained" in found.verdict.hints[-1]


@pytest.mark.long
def test_numbers_that_hold_are_given_where_others_suffer():
    """Residual magnetism of 3 % makes dry friction of the axes grow; the inertias are right."""
    machine = replace(RUBBING, remanence=0.03)
    found = identify(record(machine, RISING), BASELINE)
    assert found.verdict.grade == SIMULATION
    assert "dry_a differs between the halves of the log" in found.verdict.hints[0]
    told = {finding.quantity.name: finding for finding in found.findings}
    assert told["inertia_a"].status == told["inertia_b"].status == "identified"
    for name, true in true_values(machine).items():
        assert told[name].low <= true <= told[name].high, name


@pytest.mark.long
def test_heat_is_told_where_a_voltage_comes_again():
    """A clutch that loses 0.2 % of its torque per joule: 5 to 9 % of it in this log."""
    found = identify(record(WARMING, (12.0, 4.0, 16.0, 12.0)), BASELINE)
    assert "differs where a voltage comes again" in found.verdict.hints[0]
    told = {finding.quantity.name: finding for finding in found.findings}
    for name in ("slope", *TORQUES):
        assert told[name].status == "uncertain"


@pytest.mark.long
def test_heat_that_hides_in_the_torque_curve_is_not_called_its_torque():
    found = identify(record(WARMING, RISING), BASELINE)
    assert "heat may hide" in found.verdict.hints[-1]
    told = {finding.quantity.name: finding for finding in found.findings}
    assert told["inertia_a"].status == "identified"
    for name in ("slope", *TORQUES):
        assert told[name].status == "uncertain"


@pytest.mark.parametrize(
    ("levels", "one_way", "again"),
    [
        ((4.0, 8.0, 12.0), True, 0),
        ((12.0, 8.0, 4.0), True, 0),
        ((8.0, 8.0, 8.0), False, 0),
        ((8.0, 4.0, 12.0), False, 0),
        ((8.0, 4.0, 12.0, 8.0), False, 4),
        ((4.0, 8.0, 12.0, 4.0), False, 4),
    ],
)
def test_the_order_of_voltages(levels: tuple[float, ...], one_way: bool, again: int):
    """With noise of 10 mV, as measured ones have."""
    experiment = Experiment(levels=levels, on=0.9, off=0.25, free=1.0)
    times = 2e-3 * np.arange(round(experiment.duration(4) / 2e-3))
    volts = experiment.voltages(times + 1e-3, 4)
    volts += 0.01 * np.random.default_rng(0).standard_normal(volts.shape)
    pair = np.zeros((len(times), 2))
    log = Log(interval=2e-3, volts=np.maximum(volts, 0.0), theta=pair, force=pair)
    assert has_one_way(log) == one_way
    assert comes_again(log).sum() * 2e-3 == pytest.approx(0.9 * again, abs=0.01)


def test_what_may_be_left_has_an_error_of_its_own():
    """A log with ten times the noise in the same windows shows less, and never a better model."""
    rng = np.random.default_rng(0)
    whole, left = np.ones(400), np.full(400, 4e-4)
    low, rho, high = share_left(left, whole)
    assert (low, rho, high) == pytest.approx((0.02, 0.02, 0.02))
    noisy = share_left(left + 4e-3 * rng.standard_normal(400), whole)
    assert noisy[0] < 0.02 < noisy[2]
    nothing = share_left(-left, whole)
    assert nothing[:2] == (0.0, 0.0)


@pytest.mark.long
def test_breakaways_are_judged_by_themselves():
    """Where one clutch has a ratio of its own, the clutch is named, and the ratio is uncertain."""
    found = identify(record(RecordedMachine(ratios=(1.1, 1.0, 1.0, 1.0)), RISING), BASELINE)
    (ratio,) = [each for each in found.findings if each.quantity.name == "breakaway_ratio"]
    assert found.verdict.grade == EXACT
    assert ratio.status == "uncertain"
    assert "breakaway_ratio differs where clutch 1 is on" in found.verdict.hints[0]


@pytest.mark.long
def test_a_log_in_pounds_is_a_warning():
    found = identify(
        replace(record(RecordedMachine()), force=record(RecordedMachine()).force / 4.448), BASELINE
    )
    assert found.verdict.grade == EXACT
    (hint,) = found.verdict.hints
    assert "lbf" in hint


class LateRelease(Experiment):
    """Clutches fall 15 ms later than their recorded voltages."""

    def voltages(self, times: np.ndarray, clutches: int) -> np.ndarray:
        applied = super().voltages(times, clutches)
        late = [np.roll(applied, k, axis=0) for k in range(1 + round(0.015 / self.interval))]
        return np.max(late, axis=0)


@pytest.mark.long
def test_clutches_that_release_late_have_no_one_delay():
    short = {"levels": (6.0, 14.0, 10.0, 6.0), "on": 0.7, "off": 0.3, "free": 3.0}
    log = record_log(BASELINE, LateRelease(**short), Recorder(delay=0.007))
    commanded = Experiment(**short).voltages(log.times + 0.5 * log.interval, 4)
    found = identify(replace(log, volts=commanded), BASELINE)
    (delay,) = [each for each in found.findings if each.quantity.name == "delay"]
    assert delay.status == "uncertain"
    assert delay.low <= 0.007 < 0.022 <= delay.high
    assert "delay differs between rising and falling voltages" in found.verdict.hints[0]


def test_a_grade_is_of_what_may_be_left_and_surely_is():
    verdict = Verdict(
        windows=100,
        gaps=0,
        far=0.0,
        far_breakaways=0.0,
        enough=True,
        differences=(),
        one_way=False,
        left=np.zeros(100),
        rho=0.008,
        rho_low=0.005,
        rho_high=0.0099,
    )
    assert verdict.grade == EXACT
    assert replace(verdict, rho_high=0.0101).grade == SIMULATION
    assert replace(verdict, rho=0.04, rho_low=0.029, rho_high=0.05).grade == SIMULATION
    assert replace(verdict, rho=0.04, rho_low=0.031, rho_high=0.05).grade == NEITHER


def test_forces_are_filtered_at_the_cut_off():
    """There and back, a Butterworth filter of second order leaves half of a sine of its cut-off."""
    times = 1e-3 * np.arange(4000)
    still = np.zeros((4000, 2))
    log = Log(interval=1e-3, volts=np.zeros((4000, 4)), theta=still, force=still)
    for frequency in (200.0, 50.0):
        force = np.sin(2.0 * np.pi * frequency * times)[:, None] * [1.0, 2.0]
        left = smooth_force(log, force)[1000:3000].std(axis=0) / force[1000:3000].std(axis=0)
        ratio = np.tan(np.pi * 1e-3 * frequency) / np.tan(np.pi * 0.2)  # as the filter warps them
        assert left == pytest.approx(1.0 / (1.0 + ratio**4), rel=1e-3)


# --- logs ---

SHORT = Experiment(levels=(6.0, 14.0), on=0.7, off=0.2, free=3.0)


@cache
def good() -> Log:
    arm = replace(BASELINE.arm, inertia_a=0.7, inertia_b=0.6, coupling=0.1)
    return record_log(replace(BASELINE, arm=arm), SHORT, Recorder(delay=0.006))


def rows_of(log: Log, rows: slice) -> Log:
    return replace(log, volts=log.volts[rows], theta=log.theta[rows], force=log.force[rows])


def forces(change: Callable[[np.ndarray], np.ndarray]) -> Log:
    return replace(good(), force=change(good().force))


@pytest.mark.slow
def test_forces_that_are_recorded_late_are_told():
    found = identify(late(7e-4)(good()), BASELINE)
    told = {finding.quantity.name: finding for finding in found.findings}
    assert found.verdict.grade == EXACT
    for name, true in (("force_delay", 7e-4), ("coupling", 0.1)):
        assert told[name].low <= true <= told[name].high
        assert told[name].half_width <= 0.1 * told[name].quantity.scale


def sines() -> Log:
    times = good().times[:, None]
    theta = np.array([0.7, 2.2]) + 0.3 * np.sin(times * [3.0, 4.1])
    return replace(
        forces(lambda f: np.random.default_rng(0).normal(0.0, 20.0, f.shape)), theta=theta
    )


def wandering() -> Log:
    steps = np.random.default_rng(1).normal(0.0, 2e-3, good().theta.shape)
    return replace(sines(), theta=np.array([0.7, 2.2]) + np.cumsum(steps, axis=0))


def relative() -> Log:
    return replace(good(), theta=good().theta @ [[1.0, -1.0], [0.0, 1.0]])


@pytest.mark.long
@pytest.mark.parametrize("make", [sines, wandering, relative])
def test_a_nonsense_log_ends_in_a_verdict(make: Callable[[], Log]):
    found = identify(make(), BASELINE)
    assert found.verdict.grade == NEITHER
    assert "--relative-b" in found.verdict.hints[-1]
    assert "identified" not in states(found)


@pytest.mark.slow
def test_unmoved_numbers_are_kept_and_too_few_rows_refused():
    """Four seconds without clutches show inertias at best, and not enough for them."""
    found = identify(rows_of(good(), slice(0, 1450)), BASELINE)
    for finding in found.findings:
        assert (finding.low == finding.high == finding.quantity.value) == (finding.status == "kept")
        assert bool(finding.reason) == (finding.status == "kept")
        if finding.quantity.name.startswith("torque_"):
            assert finding.status == "kept"
            assert finding.quantity.value == pytest.approx(finding.before)
    few = identify(rows_of(good(), slice(0, 600)), BASELINE)
    assert not few.verdict.enough
    assert "identified" not in states(few)


# --- noise ---


def test_white_noise_is_measured():
    """With that of the encoders; the median of 4,000 numbers tells it to 2 %."""
    noise = 1e-4
    theta = good().theta + noise * np.random.default_rng(2).standard_normal(good().theta.shape)
    expected = np.hypot(noise, Recorder().angle_resolution / np.sqrt(12.0))
    assert smooth(replace(good(), theta=theta)).noise == pytest.approx(expected, rel=0.05)


def test_an_encoder_at_rest_has_its_steps_noise_and_wandering_is_none():
    step = 1e-3
    theta = step * np.round(np.tile([[0.7, 2.2]], (3000, 1)) / step)
    theta[2900:] += step
    still = replace(good(), theta=theta, volts=np.zeros((3000, 4)), force=np.zeros((3000, 2)))
    assert smooth(still).noise == pytest.approx(step / np.sqrt(12.0))
    assert smooth(wandering()).noise < 1.2 * 2e-3 * np.sqrt(6.0 / 20.0)
