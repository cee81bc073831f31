"""Preset files: what must be there, and the border of each range."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.errors import DataError, ParameterError
from pter_gym.params import (
    ARRANGEMENTS,
    BASELINE,
    MACHINES,
    PAPER_CLUTCHES,
    Connection,
    Hand,
    Machine,
    find_machine,
    machine_of,
    save_preset,
)
from pter_gym.params._preset import PRESET, SECTIONS, format_preset, load_preset, parse_preset, preset

TEXT = format_preset(PRESET, "for tests")


def without(section: str, name: str | None = None) -> str:
    """The text without a section, or without one of its numbers."""
    head, body = TEXT.split(f"[{section}]\n")
    if name is None:
        return head + body.partition("\n\n")[2]
    return f"{head}[{section}]\n" + re.sub(rf"(?m)^{name} = .*\n", "", body, count=1)


def with_value(section: str, name: str, value: str) -> str:
    head, body = TEXT.split(f"[{section}]\n")
    return f"{head}[{section}]\n" + re.sub(
        rf"(?m)^{name} = {{ value = [^u]*,", f"{name} = {{ value = {value},", body, count=1
    )


@pytest.mark.parametrize("section", SECTIONS)
def test_every_section_has_to_be_there(section: str):
    with pytest.raises(ParameterError, match=f"section '{section}' is missing"):
        parse_preset(without(section))


def test_a_number_alone_says_neither_unit_nor_origin():
    with pytest.raises(ParameterError, match=r"arm\.coupling must be a table with value, unit and from"):
        parse_preset(re.sub(r"(?m)^coupling = .*", "coupling = 0.1", TEXT))


@pytest.mark.parametrize(
    ("section", "name", "unit"), [("arm", "coupling", "kg·m²"), ("clutch", "knee", "V"), ("hand", "push", "N")]
)
def test_a_parameter_has_value_unit_and_origin_of_the_file(section: str, name: str, unit: str):
    found = preset(section, name)
    assert found.default == getattr(getattr(PRESET, section), name)
    assert dict(found.metadata) == {
        "unit": unit,
        "provenance": PRESET.provenance[f"{section}.{name}"],
        "later": False,
    }


def test_every_number_has_to_be_there():
    with pytest.raises(ParameterError, match="field of clutch 'knee' is missing"):
        parse_preset(without("clutch", "knee"))


ZERO = {
    "arm": ("coupling", "dry_a", "dry_b", "viscous_a", "viscous_b"),
    "clutch": ("knee", "curvature", "scale"),
    "path": ("x", "y", "direction"),
    "hand": ("push", "force_max"),
    "controller": ("stiffness", "damping_normal", "damping_tangential", "slip_threshold", "feedback"),
    "sensing": ("delay",),
}
"""What may be 0."""


@pytest.mark.parametrize(
    ("section", "name"),
    [(section, name) for section, kind in SECTIONS.items() for name in kind.__dataclass_fields__],
)
def test_numbers_that_may_be_zero_and_others(section: str, name: str):
    value = "[0.0, 0.0, 0.0, 0.0]" if name in ("scale", "table_volts") else "0.0"
    if name in (*ZERO.get(section, ()), "table_volts"):
        found = getattr(getattr(parse_preset(with_value(section, name, value)), section), name)
        assert set(found if isinstance(found, tuple) else [found]) == {0.0}
    else:
        with pytest.raises(ParameterError, match=rf"{section}\.{name} must be a finite number and > 0"):
            parse_preset(with_value(section, name, value))


@pytest.mark.parametrize("name", ["knee", "force_max", "stiffness", "delay"])
def test_nothing_of_these_is_below_zero(name: str):
    section = next(section for section, kind in SECTIONS.items() if name in kind.__dataclass_fields__)
    with pytest.raises(ParameterError, match=rf"{section}\.{name} must be a finite number and ≥ 0"):
        parse_preset(with_value(section, name, "-0.001"))


def test_a_missing_clutch_generates_no_torque():
    machine = machine_of(parse_preset(with_value("clutch", "scale", "[1.0, 1.0, 1.0, 0.0]")))
    volts, push = np.array([0.0, 0.0, 0.0, 24.0]), np.array([5.0, 3.0])
    found = simulate(machine, initial_state(machine, (0.5, 2.0)), volts, push, duration=0.3)
    expected = simulate(machine, initial_state(machine, (0.5, 2.0)), np.zeros(4), push, duration=0.3)
    assert not found.torque.any()
    assert np.abs(found.omega[-1]).max() > 0.1
    np.testing.assert_array_equal(found.theta, expected.theta)
    with pytest.raises(ParameterError, match=r"Machine\.clutch_scale must be a tuple of 4 finite numbers ≥ 0"):
        replace(machine, clutch_scale=(1.0, 1.0, 1.0, -0.1))


def test_a_file_from_before_friction_of_the_axes_has_none():
    text = format_preset(PRESET, "title")
    older = "\n".join(line for line in text.splitlines() if not line.startswith(("dry_", "viscous_")))
    found = parse_preset(older)
    assert found.arm == PRESET.arm
    assert found.provenance["arm.dry_a"] == "chosen: not in the file"
    assert parse_preset(format_preset(found, "title")) == found


TWO_ROWS = """
[clutches]
"A to ground" = { value = [1.0, 0.0], unit = "1", from = "chosen: a brake" }
"gear \\"1:2\\"" = { value = [1.0, -0.5], unit = "1", from = "chosen: a coupling" }
"""


def with_clutches(section: str, scale: str = "[1.0, 0.5]") -> str:
    return with_value("clutch", "scale", scale) + section


def test_a_file_declares_clutches_by_name_and_row():
    found = parse_preset(with_clutches(TWO_ROWS))
    assert found.clutches == (Connection("A to ground", (1.0, 0.0)), Connection('gear "1:2"', (1.0, -0.5)))
    assert found.provenance["clutches.A to ground"] == "chosen: a brake"
    assert parse_preset(format_preset(found, "title")) == found
    machine = machine_of(found)
    assert machine.clutches == found.clutches
    assert machine.slot_scale == (1.0, 0.5, 0.0, 0.0)


def test_a_file_without_the_section_has_the_papers_clutches():
    assert PRESET.clutches == PAPER_CLUTCHES
    assert machine_of(PRESET) == BASELINE
    assert "[clutches]" not in TEXT


@pytest.mark.parametrize(
    ("section", "scale", "message"),
    [
        ("[clutches]\n", "[]", "clutches must be a table of 1 to 4 clutches"),
        (TWO_ROWS, "[1.0, 1.0, 1.0, 1.0]", r"clutch\.scale must be 2 numbers, one for each clutch"),
        (TWO_ROWS.replace("-0.5", '"x"'), "[1.0, 1.0]", 'clutches.gear "1:2" must be a finite number'),
        (TWO_ROWS.replace("-0.5", "-200.0"), "[1.0, 1.0]", r"Connection\.row must be .* 0\.01 ≤ r ≤ 100"),
        (TWO_ROWS.replace("[1.0, -0.5]", "[1.0]"), "[1.0, 1.0]", r"Connection\.row must be"),
        (TWO_ROWS.replace("[1.0, -0.5]", "1.0"), "[1.0, 1.0]", 'clutches.gear "1:2" must be a list of numbers'),
        (TWO_ROWS.replace("chosen: a brake", "a brake"), "[1.0, 1.0]", r"clutches\.A to ground\.from must begin with"),
        (TWO_ROWS.replace('"A to ground"', '""'), "[1.0, 1.0]", r"Connection\.name must be 1 to 40 characters"),
        (TWO_ROWS.replace('unit = "1"', 'unit = "m"'), "[1.0, 1.0]", r"clutches\.A to ground\.unit must be '1'"),
    ],
)
def test_clutches_that_a_file_cannot_declare(section: str, scale: str, message: str, tmp_path: Path):
    with pytest.raises(ParameterError, match=message):
        parse_preset(with_clutches(section, scale))
    file = tmp_path / "own.toml"
    file.write_text(with_clutches(section, scale), "utf-8")
    with pytest.raises(DataError, match=message):
        find_machine(str(file))


def test_a_fifth_clutch_and_clutches_of_one_row_are_refused():
    five = "".join(f'\n"{k}" = {{ value = [1.0, {k}.0], unit = "1", from = "chosen: x" }}' for k in range(1, 6))
    with pytest.raises(ParameterError, match="clutches must be a table of 1 to 4 clutches"):
        parse_preset(with_clutches(f"[clutches]{five}\n", "[1.0, 1.0, 1.0, 1.0, 1.0]"))
    same = "".join(f'\n"{k}" = {{ value = [1.0, 1.0], unit = "1", from = "chosen: x" }}' for k in range(4))
    with pytest.raises(ParameterError, match=r"Machine\.clutches must be of at least two different rows"):
        machine_of(parse_preset(with_clutches(f"[clutches]{same}\n", "[1.0, 1.0, 1.0, 1.0]")))


@pytest.mark.parametrize("name", [*ARRANGEMENTS, "delrin_theoretical"])
def test_a_machine_is_saved_as_a_preset(name: str, tmp_path: Path):
    own = replace(
        MACHINES[name], arm=replace(BASELINE.arm, length_a=0.5, viscous_b=0.1), clutch_scale=(0.5, 1.0, 1.0, 1.0)
    )
    file = tmp_path / "own.toml"
    save_preset(own, file, origin="chosen: for tests", title="A machine")
    found = find_machine(str(file))
    breakaway = vars(found.clutch.breakaway)
    assert breakaway == pytest.approx(vars(own.clutch.breakaway), rel=1e-15)
    assert replace(found, clutch=replace(found.clutch, breakaway=own.clutch.breakaway)) == own


OTHER_CURVE = replace(BASELINE.clutch.breakaway, curvature=1.0)


@pytest.mark.parametrize(
    ("machine", "message"),
    [
        (replace(BASELINE, hand=Hand(mass=1.0)), r"Machine\.hand must be"),
        (replace(BASELINE, substep=1e-3), r"Machine\.substep must be"),
        (replace(BASELINE, clutch=replace(BASELINE.clutch, lag="voltage")), r"Clutch\.lag must be 'normal_force'"),
        (
            replace(BASELINE, clutch=replace(BASELINE.clutch, breakaway=OTHER_CURVE)),
            r"Clutch\.breakaway must be a mult",
        ),
    ],
)
def test_what_a_preset_cannot_hold_is_not_saved(machine: Machine, message: str, tmp_path: Path):
    file = tmp_path / "own.toml"
    with pytest.raises(ParameterError, match=message):
        save_preset(machine, file, origin="chosen: for tests")
    assert not file.exists()


SHORT = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.5))


def test_numbers_that_are_not_changed_keep_their_origin(tmp_path: Path):
    save_preset(SHORT, tmp_path / "own.toml", origin="chosen: shorter")
    found = load_preset(tmp_path / "own.toml")
    changed = {name for name, origin in found.provenance.items() if origin != PRESET.provenance.get(name)}
    assert changed == {"arm.length_a"}
    assert found.provenance["arm.length_a"] == "chosen: shorter"


def test_a_preset_needs_an_origin_and_a_name_that_commands_take(tmp_path: Path):
    with pytest.raises(ParameterError, match=r"arm\.length_a\.from must begin with one of"):
        save_preset(SHORT, tmp_path / "own.toml", origin="a guess")
    with pytest.raises(ParameterError, match=r"path must end in \.toml"):
        save_preset(BASELINE, tmp_path / "own.txt", origin="chosen: for tests")
