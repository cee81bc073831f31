"""Machines and sensors that are not as assumed: numbers are inside intervals, or not identified."""

import pytest

from oracle.mismatched import CASES, IN_THE_MODEL, Mismatch
from oracle.recorded import RecordedMachine
from pter_gym.params import BASELINE
from pter_gym.tools.identification import Identification, identify
from pter_gym.tools.identification.verdict import EXACT

STIFF = 0.02
"""Of a number's scale: what the stiff springs of the oracle may change."""

TERMS = ("off_state", "stribeck", "fall_ratio")


def wrong(case: Mismatch, found: Identification) -> dict[str, str]:
    """Numbers that are called identified and outside their intervals."""
    true, said = case.true_values(found.fit.shape.top), dict[str, str]()
    for finding in found.findings:
        q = finding.quantity
        slack = STIFF if isinstance(case.machine, RecordedMachine) else case.slack
        off = abs(q.value - true.get(q.name, q.value))
        if finding.status == "identified" and off > finding.half_width + slack * q.scale:
            said[q.name] = f"{off:.3g} > {finding.half_width:.3g} {q.unit}"
    return said


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_wrong_values_are_never_called_identified(name: str):
    case = CASES[name]
    found = identify(case.log(), BASELINE)
    assert wrong(case, found) == {}
    told = {finding.quantity.name: finding for finding in found.findings}
    if name in IN_THE_MODEL:
        assert found.verdict.grade == EXACT
        true, before = case.true_values(found.fit.shape.top), {"fall_ratio": 1.0}
        for term in TERMS:
            assert bool(told[term].reason) == (told[term].status == "kept")
            if true[term] != before.get(term, 0.0):
                assert told[term].status != "kept"
                assert abs(told[term].quantity.value - true[term]) <= told[term].half_width
            elif told[term].status == "kept":
                assert told[term].quantity.value == true[term]
    assert any("gain" in each for each in found.assumptions)
