"""Parameters as plain data and back, bit for bit, and nothing else."""

import json
import math
from dataclasses import dataclass, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pter_gym import hands, params
from pter_gym._internal.codec import dataclasses_in
from pter_gym.benchmark.episodes import CODEC
from pter_gym.controllers import Impedance
from pter_gym.errors import ParameterError
from pter_gym.hands import HumanArm, MultiSineHand, RecordedForces
from pter_gym.params import (
    BASELINE,
    DELRIN_THEORETICAL,
    LARGEST,
    MACHINES,
    Arm,
    Clutch,
    Connection,
    Hand,
    Machine,
    TorqueCurve,
)
from pter_gym.tasks.path_following import PathFollowing
from pter_gym.tasks.path_following import _specification as specification


def through_json(value: object) -> object:
    return CODEC.from_plain(json.loads(json.dumps(CODEC.to_plain(value), allow_nan=False)))


@pytest.mark.parametrize("value", [*MACHINES.values(), PathFollowing(), MultiSineHand(random_phases=True)])
def test_round_trip(value: object) -> None:
    assert through_json(value) == value
    assert repr(through_json(value)) == repr(value)


def test_dataclasses_are_those_that_a_module_or_package_defines() -> None:
    found = sorted(dataclasses_in(params), key=lambda kind: kind.__name__)
    assert found == [Arm, Clutch, Connection, Hand, Machine, TorqueCurve]
    assert {HumanArm, MultiSineHand, RecordedForces} <= set(dataclasses_in(hands))
    assert Machine not in dataclasses_in(specification), "it is only named there"


@given(st.floats(1e-9, 4.0), st.tuples(*5 * [st.floats(-LARGEST, LARGEST)]), st.booleans())
def test_every_bit_comes_back(pace: float, phases: tuple[float, ...], random_phases: bool) -> None:
    task = PathFollowing(pace=pace, hand=MultiSineHand(phases=phases, random_phases=random_phases))
    assert repr(through_json(task)) == repr(task)


@dataclass(frozen=True)
class Imposter:
    """A dataclass of somebody else that takes a known name."""


Imposter.__name__ = "Machine"


@pytest.mark.parametrize("value", [Imposter(), Impedance(), [1.0], {"a": 1}, Machine])
def test_what_is_unknown_is_not_stored(value: object) -> None:
    with pytest.raises(ParameterError, match="stored type"):
        CODEC.to_plain(value)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_only_finite_numbers(number: float) -> None:
    with pytest.raises(ParameterError, match="finite"):
        CODEC.to_plain((1.0, number))


def test_unknown_names_are_refused_with_the_nearest() -> None:
    plain = CODEC.to_plain(BASELINE)
    assert isinstance(plain, dict)
    arm = plain["arm"]
    assert isinstance(arm, dict)
    for bad, named in (
        ({**plain, "type": "Machin"}, "'Machine'"),
        ({**plain, "substeps": 1}, "substeps"),
        ({**plain, "arm": {**arm, "mass": 1.0}}, r"mass.*\$\.arm"),
        ({name: part for name, part in plain.items() if name != "clutch"}, "clutch"),
        ({}, "type"),
        ({"type": 3}, "type"),
        ({"type": "os.system"}, "type"),
        (object(), "object"),
    ):
        with pytest.raises(ParameterError, match=named):
            CODEC.from_plain(bad)


def test_a_missing_field_takes_its_default() -> None:
    plain = CODEC.to_plain(PathFollowing(arrival=0.1, pace=0.3))
    assert isinstance(plain, dict)
    del plain["arrival"]
    assert CODEC.from_plain(plain) == PathFollowing(pace=0.3)


def test_dataclasses_check_what_was_stored() -> None:
    plain = CODEC.to_plain(replace(DELRIN_THEORETICAL, substep=0.005))
    assert isinstance(plain, dict)
    with pytest.raises(ParameterError, match="substep"):
        CODEC.from_plain({**plain, "substep": -1.0})
