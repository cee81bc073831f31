"""Files of machines: they hold everything that a machine has, and say where it comes from."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pter_gym.errors import DataError, ParameterError
from pter_gym.params import (
    BASELINE,
    MACHINES,
    Connection,
    Hand,
    Machine,
    MachineSpread,
    find_machine,
    find_machines,
    load_machine,
    save_machine,
)
from pter_gym.params._files import format_machine
from pter_gym.scenarios import find_scenario

TEXT = format_machine(BASELINE, "chosen: for tests", {})

FLUID = replace(
    BASELINE.clutch,
    breakaway=replace(BASELINE.clutch.breakaway, curvature=1.0),
    dynamic=replace(BASELINE.clutch.dynamic, off_state=0.3),
    lag="voltage",
    stribeck=0.1,
    viscous=0.02,
    fall_ratio=2.0,
    fade=1e-3,
    cooling=30.0,
    hysteresis=0.7,
)
EVERYTHING = Machine(
    arm=replace(BASELINE.arm, length_a=0.5, viscous_b=0.1),
    clutch=FLUID,
    hand=Hand(mass=1.0, damping=3.0, damping_anisotropy=(0.1, 0.2)),
    clutch_scale=(0.5, 1.0, 1.0, 1.0),
    clutches=(Connection("A to ground", (1.0, 0.0)), Connection('gear "1:2"', (1.0, -0.5))),
    slip_threshold=2e-3,
    substep=1e-3,
    delay=0.012,
)


@pytest.mark.smoke
@pytest.mark.parametrize("machine", [EVERYTHING, *MACHINES.values()], ids=["everything", *MACHINES])
def test_a_file_holds_every_bit_of_a_machine(machine: Machine, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    save_machine(machine, file, origin="chosen: for tests", title="A machine\nof two lines")
    assert repr(find_machine(str(file))) == repr(machine)
    assert file.read_text("utf-8").startswith("# A machine\n# of two lines\n")


def test_each_number_has_its_unit_and_its_source() -> None:
    own = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.5, inertia_b=2.0), delay=0.01)
    text = format_machine(own, "chosen: larger", {"arm.inertia_b": "identified: from a log"})
    for line in (
        "length_a = 0.5  # m; chosen: larger",
        "length_b = 0.4454  # m; fitted: PTER's links were of the order of half a metre",
        "inertia_b = 2.0  # kg·m²; identified: from a log",
        "delay = 0.01  # s; chosen: larger",
    ):
        assert line in text
    assert "delay" not in TEXT
    assert "chosen: for tests" not in TEXT


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("^knee = ", "knees = ", "knees"),
        ("^length_a = 0.5645", "length_a = 0.0", r"Arm\.length_a"),
        ("^length_a = 0.5645", "length_a = 'x'", r"Arm\.length_a"),
        ("^length_a = 0.5645", "length_a = inf", "finite"),
        ("^slope = .*", "", "slope"),
        ('^type = "Arm"', 'type = "Leg"', "Leg"),
        ('^type = "Machine"', 'type = "Hand"', "arm"),
        (r"^clutch_scale = \[.*\]", "clutch_scale = [1.0]", r"Machine\.clutch_scale"),
        (r"^\[arm\]", "[arm", "own.toml"),
    ],
)
def test_a_damaged_file_is_refused(old: str, new: str, named: str, tmp_path: Path) -> None:
    text, count = re.subn(old, new, TEXT, count=1, flags=re.MULTILINE)
    assert count == 1
    (tmp_path / "own.toml").write_text(text, "utf-8")
    with pytest.raises(DataError, match=named):
        load_machine(tmp_path / "own.toml")


@pytest.mark.parametrize("value", ["3", "{covariance = 3}", "{places = []}"])
def test_an_uncertainty_that_is_no_table_is_refused(value: str, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(f"uncertainty = {value}\n{TEXT}", "utf-8")
    with pytest.raises(DataError, match="uncertainty must be a table"):
        find_machines(str(tmp_path / "own.toml"))


def test_a_file_in_utf_16_is_read(tmp_path: Path) -> None:
    """As PowerShell's > and Windows' Editor write it."""
    (tmp_path / "own.toml").write_bytes(TEXT.encode("utf-16"))
    assert find_machine(str(tmp_path / "own.toml")) == BASELINE


def test_a_file_that_is_not_there_or_that_commands_do_not_take_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="machine"):
        find_machine(str(tmp_path / "none.toml"))
    with pytest.raises(ParameterError, match="path"):
        save_machine(BASELINE, tmp_path / "own.txt", origin="chosen: for tests")
    for origin in ("a guess", "chosen: two\nlines"):
        with pytest.raises(ParameterError, match="origin"):
            save_machine(BASELINE, tmp_path / "own.toml", origin=origin)
    assert not list(tmp_path.iterdir())


def spread(**changes: Any) -> MachineSpread:
    fields = {
        "machine": BASELINE,
        "places": ("arm.inertia_a", "clutch_scale.1", "arm.dry_a"),
        "covariance": ((1e-3, 2.8e-3, 0.0), (2.8e-3, 1e-2, 0.0), (0.0, 0.0, 0.04)),
    }
    return MachineSpread(**fields | changes)


def test_machines_about_one_come_back_and_are_drawn_with_their_covariance(tmp_path: Path) -> None:
    """Standard errors of 4,000 draws are at most 2.4 % here; a number below 0 becomes 0."""
    save_machine(spread(), tmp_path / "m.toml", origin="chosen: by hand")
    assert find_machines(tmp_path / "m.toml") == spread()
    assert load_machine(tmp_path / "m.toml") == BASELINE
    rng, about = np.random.default_rng(0), spread()
    machines = [about.draw(rng) for _ in range(4000)]
    numbers = np.array([(m.arm.inertia_a, m.clutch_scale[0], m.arm.dry_a) for m in machines])
    found = np.cov(numbers[:, :2].T)
    np.testing.assert_allclose(found, np.array(spread().covariance)[:2, :2], rtol=0.1)
    assert 0.4 < (numbers[:, 2] == 0.0).mean() < 0.6
    assert {m.clutch_scale[1:] for m in machines} == {BASELINE.clutch_scale[1:]}
    pairs = find_scenario("standard", spread()).draws.pairs(3)
    assert len({machine.arm.inertia_a for machine, _ in pairs}) == 3


@pytest.mark.parametrize(
    "changes",
    [
        {"places": ("arm.inertia_a", "clutch_scale.0", "arm.dry_a")},
        {"places": ("arm.inertia_a", "arm.colour", "arm.dry_a")},
        {"covariance": ((1.0,),)},
        {"covariance": ((1.0, 2.0, 0.0), (2.0, 1.0, 0.0), (0.0, 0.0, 1.0))},
        {"covariance": ((math.nan, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))},
    ],
)
def test_a_covariance_that_is_none_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match="MachineSpread"):
        spread(**changes)
