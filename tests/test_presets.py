"""Preset files: what must be there, and the border of each range."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pter_gym._physics.open_loop import initial_state, simulate
from pter_gym.errors import ParameterError
from pter_gym.params import machine_of
from pter_gym.params._preset import PRESET, SECTIONS, format_preset, parse_preset, preset

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
    assert dict(found.metadata) == {"unit": unit, "provenance": PRESET.provenance[f"{section}.{name}"]}


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
