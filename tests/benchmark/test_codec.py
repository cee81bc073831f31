"""Parameters as plain data and back, bit for bit, and nothing else."""

import json
import math
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given, strategies as st

from pter_gym import params
from pter_gym._internal.codec import dataclasses_in
from pter_gym._internal.fields import MAX_NUMBER
from pter_gym.controllers import Impedance
from pter_gym.errors import ParameterError
from pter_gym.hands import MultiSineHand
from pter_gym.params import (
    BASELINE,
    MACHINES,
    Arm,
    Clutch,
    Connection,
    Hand,
    Machine,
    MachineSpread,
    TorqueCurve,
)
from pter_gym.tasks._codec import codec
from pter_gym.tasks.path_following import PathFollowing, _specification as specification


def through_json(value: object) -> Any:
    return codec().from_plain(json.loads(json.dumps(codec().to_plain(value), allow_nan=False)))


@pytest.mark.parametrize(
    "value", [*MACHINES.values(), PathFollowing(), MultiSineHand(random_phases=True)]
)
def test_round_trip(value: object) -> None:
    assert through_json(value) == value
    assert repr(through_json(value)) == repr(value)


def test_dataclasses_are_those_that_a_module_or_package_defines() -> None:
    assert set(dataclasses_in(params)) == {
        Arm,
        Clutch,
        Connection,
        Hand,
        Machine,
        MachineSpread,
        TorqueCurve,
    }
    assert Machine not in dataclasses_in(specification), "it is only named there"


@given(st.floats(1e-9, 4.0), st.tuples(*5 * [st.floats(-MAX_NUMBER, MAX_NUMBER)]), st.booleans())
def test_every_bit_comes_back(pace: float, phases: tuple[float, ...], random_phases: bool) -> None:
    task = PathFollowing(pace=pace, hand=MultiSineHand(phases=phases, random_phases=random_phases))
    assert repr(through_json(task)) == repr(task)


@dataclass(frozen=True)
class Imposter:
    """A dataclass of somebody else that takes a known name."""


Imposter.__name__ = "Machine"


@pytest.mark.parametrize(
    "value", [Imposter(), Impedance(), [1.0], {"a": 1}, Machine, (1.0, math.nan), -math.inf]
)
def test_unknown_types_and_infinite_numbers_are_not_stored(value: object) -> None:
    with pytest.raises(ParameterError, match="stored"):
        codec().to_plain(value)


def test_bad_plain_data_is_refused_and_defaults_fill_gaps() -> None:
    plain: Any = codec().to_plain(BASELINE)
    for bad, named in (
        ({**plain, "type": "Machin"}, "Machine"),
        ({**plain, "substeps": 1}, "substeps"),
        ({**plain, "substep": -1.0}, "substep"),
        ({**plain, "arm": {**plain["arm"], "mass": 1.0}}, "mass"),
        ({name: part for name, part in plain.items() if name != "clutch"}, "clutch"),
        ({}, "type"),
        ({"type": 3}, "type"),
        ({"type": "os.system"}, "type"),
        (object(), "object"),
    ):
        with pytest.raises(ParameterError, match=named):
            codec().from_plain(bad)
    task: Any = codec().to_plain(PathFollowing(arrival=0.1, pace=0.3))
    del task["arrival"]
    assert codec().from_plain(task) == PathFollowing(pace=0.3)
