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
    ARRANGEMENTS,
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
from pter_gym.tasks._codec import codec

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


def test_a_file_that_is_not_there_or_that_commands_do_not_take_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="machine"):
        find_machine(str(tmp_path / "none.toml"))
    with pytest.raises(ParameterError, match="path"):
        save_machine(BASELINE, tmp_path / "own.txt", origin="chosen: for tests")
    for origin in ("a guess", "chosen: two\nlines"):
        with pytest.raises(ParameterError, match="origin"):
            save_machine(BASELINE, tmp_path / "own.toml", origin=origin)
    assert not list(tmp_path.iterdir())


OLD = """
[arm]
length_a = { value = 0.5, unit = "m", from = "chosen: shorter" }
[clutch]
slope = { value = 0.8869, unit = "N·m/V", from = "fitted: …" }
knee = { value = 19.4, unit = "V", from = "fitted: …" }
curvature = { value = 1.557, unit = "N·m/V²", from = "fitted: …" }
breakaway_ratio = { value = 1.12, unit = "1", from = "fitted: …" }
stribeck = { value = 0.1, unit = "rad/s", from = "chosen: …" }
scale = { value = [1.0, 0.5], unit = "1", from = "chosen: …" }
[path]
x = { value = -0.6, unit = "m", from = "chosen: …" }
[sensing]
delay = { value = 0.012, unit = "s", from = "identified: …" }
[clutches]
"A to ground" = { value = [1.0, 0.0], unit = "1", from = "chosen: a brake" }
"B to ground" = { value = [0.0, 1.0], unit = "1", from = "chosen: a brake" }
"""


def test_a_file_of_the_form_before_is_read_with_a_warning(tmp_path: Path) -> None:
    (tmp_path / "old.toml").write_text(OLD, "utf-8")
    with pytest.warns(DeprecationWarning, match="save_machine"):
        machine = find_machine(str(tmp_path / "old.toml"))
    assert machine == replace(
        BASELINE,
        arm=replace(BASELINE.arm, length_a=0.5),
        clutch=replace(BASELINE.clutch, stribeck=0.1),
        clutch_scale=(1.0, 0.5, 1.0, 1.0),
        clutches=ARRANGEMENTS["two-brakes"],
        delay=0.012,
    )
    for old, new in (("1.12", '"x"'), ("[1.0, 0.5]", "[1.0]"), ("slope", "slop"), ("0.5,", "0.0,")):
        (tmp_path / "old.toml").write_text(OLD.replace(old, new), "utf-8")
        with pytest.warns(DeprecationWarning, match="save_machine"), pytest.raises(DataError):
            find_machine(str(tmp_path / "old.toml"))


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


def test_places_that_count_from_0_are_read_with_a_warning(tmp_path: Path) -> None:
    """An earlier version called clutch 1's strength ``clutch_scale.0``, and clutch 2's what is
    clutch 1's now."""
    save_machine(spread(), path := tmp_path / "m.toml", origin="chosen: by hand")
    stored: Any = codec().to_plain(spread())
    path.write_text(re.sub("first = .*", "", path.read_text("utf-8")), "utf-8")
    del stored["first"]
    for read in (lambda: find_machines(path), lambda: codec().from_plain(stored)):
        with pytest.warns(DeprecationWarning, match="from 0"):
            assert read() == spread(places=("arm.inertia_a", "clutch_scale.2", "arm.dry_a"))


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
