"""A real machine: the records of EMPS, whose parameters are published, from its log and into it."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from oracle import emps
from pter_gym.tools.identification import Identification, Log, identify
from pter_gym.tools.identification.fit import Fit
from pter_gym.tools.identification.verdict import SIMULATION
from pter_gym.tools.identification.windows import cut, smooth

PUBLISHED = {
    "inertia_a": emps.MASS * emps.LENGTH**2,
    "viscous_a": emps.VISCOUS * emps.LENGTH**2,
    "dry_a": emps.DRY * emps.LENGTH,
    "offset_a": -emps.OFFSET * emps.LENGTH,
}

STANDARD_ERROR = 1.0 / 1.96
"""Over half of a 95 % interval: the published numbers are of the same record, so no nearer."""


@cache
def identified(name: str, bits: int | None) -> Identification:
    return identify(emps.log_of(name, bits), emps.start())


@pytest.mark.slow
def test_a_third_of_a_record_has_the_published_numbers_in_its_intervals():
    """Eight seconds at 500 Hz, by an encoder of 12 bits."""
    log = emps.log_of("plain", 12)
    rows = slice(0, 8000, 2)
    short = {name: getattr(log, name)[rows] for name in ("volts", "theta", "force")}
    found = identify(replace(log, interval=2.0 * log.interval, **short), emps.start())
    assert found.verdict.grade == SIMULATION
    findings = {each.quantity.name: each for each in found.findings}
    for number, published in PUBLISHED.items():
        assert findings[number].low <= published <= findings[number].high, number
    mass = findings["inertia_a"]
    assert mass.quantity.value == pytest.approx(PUBLISHED["inertia_a"], rel=0.04)
    assert mass.half_width < 0.1 * mass.quantity.value


@pytest.mark.long
@pytest.mark.parametrize("name", emps.RECORDS)
@pytest.mark.parametrize("bits", [None, 12, 14, 16, 20])
def test_a_real_axis_has_the_published_numbers_and_a_grade_that_no_encoder_changes(
    name: str, bits: int | None
):
    found = identified(name, bits)
    assert found.verdict.grade == SIMULATION
    findings = {each.quantity.name: each for each in found.findings}
    for number, published in PUBLISHED.items():
        finding = findings[number]
        assert abs(finding.quantity.value - published) <= STANDARD_ERROR * finding.half_width
    assert findings["inertia_a"].half_width <= 0.06 * PUBLISHED["inertia_a"]
    assert findings["inertia_b"].status == findings["viscous_b"].status == "kept"


def coarse(bits: int | None, every: int) -> Log:
    """The plain record by an encoder of so many bits, of every n-th row."""
    log, rows = emps.log_of("plain", bits), slice(None, None, every)
    fewer = {name: getattr(log, name)[rows] for name in ("volts", "theta", "force")}
    return replace(log, interval=every * log.interval, **fewer)


@pytest.mark.long
@pytest.mark.parametrize(("bits", "every"), [(10, 4), (9, 2), (10, 10)])
def test_a_coarse_record_is_still_described(bits: int, every: int):
    found = identify(coarse(bits, every), emps.start())
    assert found.verdict.grade == SIMULATION
    findings = {each.quantity.name: each for each in found.findings}
    for number, published in PUBLISHED.items():
        assert findings[number].low <= published <= findings[number].high, number


@pytest.mark.long
def test_a_verdict_does_not_hang_on_the_start():
    """None has friction; an inertia of three times, or a third, of the published one."""
    log, start = coarse(10, 4), emps.start()
    for inertia in (start.arm.inertia_a, 3.0 * emps.MASS * emps.LENGTH**2, 0.3):
        other = replace(start, arm=replace(start.arm, inertia_a=inertia, coupling=0.0))
        found = identify(log, other)
        assert found.verdict.grade == SIMULATION
        mass = found.findings[0]
        assert mass.low <= PUBLISHED["inertia_a"] <= mass.high


@pytest.mark.long
def test_less_information_is_never_a_narrower_interval():
    """Of encoders of 16, 12, 10 and 9 bits; one interval may be a tenth narrower by chance."""
    widths, highest = list[float](), list[float]()
    for bits in (None, 16, 12, 10, 9):
        found = identify(coarse(bits, 2), emps.start())
        widths.append(found.findings[0].half_width)
        highest.append(found.verdict.rho_high)
    assert all(b >= 0.9 * a for a, b in itertools.pairwise(widths)), widths
    assert all(b >= 0.9 * a for a, b in itertools.pairwise(highest)), highest


@pytest.mark.long
def test_the_machine_of_one_record_predicts_the_other():
    """Angles of all windows of 0.2 s, within 2 % of the distance travelled in them."""
    one, log = identified("plain", None), emps.log_of("pulses")
    windows = cut(log, smooth(log), emps.start(), 0.1)
    fit = Fit(windows, one.fit.shape, [], one.fit.p).search(2)
    travelled = windows.measured[:, :, 0] - windows.starts[:, :1]
    assert np.sqrt(np.mean(fit.sizes() ** 2)) <= 0.02 * np.sqrt(np.mean(travelled**2))


@pytest.mark.long
@pytest.mark.parametrize(("name", "apart"), [("plain", 2.5e-6), ("pulses", 3.5e-6)])
def test_the_simulator_follows_the_real_axis(name: str, apart: float):
    """With the published numbers and the recorded controller: position [m] rms, and volts."""

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2)))

    position, volts, reference = emps.record(name)
    followed, commanded = emps.follow(emps.published(), name)
    assert rms(followed - position) <= apart
    assert rms(reference - followed) == pytest.approx(rms(reference - position), rel=0.003)
    assert rms(commanded - volts) <= 0.07 * rms(volts)
