"""Preset files: what must be there, and machines as presets."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from pter_gym.errors import DataError, ParameterError
from pter_gym.params import (
    ARRANGEMENTS,
    BASELINE,
    MACHINES,
    Connection,
    Hand,
    Machine,
    find_machine,
    machine_of,
    save_preset,
)
from pter_gym.params._fields import SHIPPED
from pter_gym.params._preset import (
    OPTIONAL_SECTIONS,
    PRESET,
    SECTIONS,
    format_preset,
    load_preset,
    parse_preset,
)

TEXT = format_preset(PRESET, "for tests")


def with_value(section: str, name: str, value: str) -> str:
    head, body = TEXT.split(f"[{section}]\n")
    return f"{head}[{section}]\n" + re.sub(
        rf"(?m)^{name} = {{ value = [^u]*,", f"{name} = {{ value = {value},", body, count=1
    )


@pytest.mark.parametrize("section", SECTIONS)
def test_every_number_of_a_section_has_to_be_there_and_every_section_of_a_machine(section: str):
    head, body = TEXT.split(f"[{section}]\n")
    without = head + body.partition("\n\n")[2]
    if section in OPTIONAL_SECTIONS:
        found = parse_preset(without)
        assert getattr(found, section) == getattr(PRESET, section)
        assert {found.provenance[f"{section}.{name}"] for name in SHIPPED[section]} == {
            "chosen: not in the file"
        }
        assert f"[{section}]" not in format_preset(found, "title")
        assert parse_preset(format_preset(found, "title")) == found
    else:
        with pytest.raises(ParameterError, match=section):
            parse_preset(without)
    with pytest.raises(ParameterError, match=section):
        parse_preset(f"{head}[{section}]\n{body.partition(chr(10))[2]}")


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        (r"^coupling = .*", "coupling = 0.1", r"arm\.coupling"),
        (r"^(knee = .*)unit = \"V\"", r'\1unit = "kV"', r"clutch\.knee\.unit"),
        (r"^(knee = .*)from = \"fitted", r'\1from = "guess', r"clutch\.knee\.from"),
        (r"^knee = ", "knees = ", "knees"),
        (r"^length_a = { value = [^,]*", "length_a = { value = 0.0", r"Arm\.length_a"),
        (r"^push = { value = [^,]*", "push = { value = [1.0]", r"hand\.push"),
        (
            r"^table_volts = { value = [^\]]*\]",
            "table_volts = { value = 4.0",
            r"controller\.table_volts",
        ),
    ],
)
def test_a_wrong_entry_is_refused(old: str, new: str, named: str, tmp_path: Path):
    text, count = re.subn(old, new, TEXT, count=1, flags=re.MULTILINE)
    assert count == 1
    with pytest.raises(ParameterError, match=named):
        parse_preset(text)
    (tmp_path / "own.toml").write_text(text, "utf-8")
    with pytest.raises(DataError, match=named):
        load_preset(tmp_path / "own.toml")


def test_a_file_without_friction_of_the_axes_means_none():
    older = "\n".join(
        line for line in TEXT.splitlines() if not line.startswith(("dry_", "viscous_"))
    )
    found = parse_preset(older)
    assert found.arm == PRESET.arm
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
    assert found.clutches == (
        Connection("A to ground", (1.0, 0.0)),
        Connection('gear "1:2"', (1.0, -0.5)),
    )
    assert found.provenance["clutches.A to ground"] == "chosen: a brake"
    assert parse_preset(format_preset(found, "title")) == found
    assert machine_of(found).slot_scale == (1.0, 0.5, 0.0, 0.0)


FIVE = "".join(
    f'\n"{k}" = {{ value = [1.0, {k}.0], unit = "1", from = "chosen: x" }}' for k in range(1, 6)
)
SAME = "".join(
    f'\n"{k}" = {{ value = [1.0, 1.0], unit = "1", from = "chosen: x" }}' for k in range(4)
)


@pytest.mark.parametrize(
    ("section", "scale", "named"),
    [
        ("[clutches]\n", "[]", "clutches"),
        (f"[clutches]{FIVE}\n", "[1.0, 1.0, 1.0, 1.0, 1.0]", "clutches"),
        (f"[clutches]{SAME}\n", "[1.0, 1.0, 1.0, 1.0]", r"Machine\.clutches"),
        (TWO_ROWS, "[1.0, 1.0, 1.0, 1.0]", r"clutch\.scale"),
        (TWO_ROWS.replace("-0.5", '"x"'), "[1.0, 1.0]", 'clutches.gear "1:2"'),
        (TWO_ROWS.replace("-0.5", "-200.0"), "[1.0, 1.0]", r"Connection\.row"),
        (TWO_ROWS.replace('"A to ground"', '""'), "[1.0, 1.0]", r"Connection\.name"),
    ],
)
def test_invalid_clutches_of_a_file_are_refused(section: str, scale: str, named: str):
    with pytest.raises(ParameterError, match=named):
        parse_preset(with_clutches(section, scale))


@pytest.mark.smoke
@pytest.mark.parametrize("name", [*ARRANGEMENTS, "delrin_theoretical"])
def test_a_machine_is_saved_as_a_preset(name: str, tmp_path: Path):
    own = replace(
        MACHINES[name],
        arm=replace(BASELINE.arm, length_a=0.5, viscous_b=0.1),
        clutch_scale=(0.5, 1.0, 1.0, 1.0),
    )
    file = tmp_path / "own.toml"
    save_preset(own, file, origin="chosen: for tests", title="A machine")
    found = find_machine(str(file))
    assert vars(found.clutch.breakaway) == pytest.approx(vars(own.clutch.breakaway), rel=1e-15)
    assert replace(found, clutch=replace(found.clutch, breakaway=own.clutch.breakaway)) == own


def test_a_preset_holds_what_the_papers_clutches_do_not_have(tmp_path: Path):
    dynamic = replace(BASELINE.clutch.dynamic, off_state=0.3)
    terms = {"stribeck": 0.1, "viscous": 0.02, "fall_ratio": 2.0, "fade": 1e-3, "cooling": 30.0}
    clutch = replace(BASELINE.clutch, dynamic=dynamic, breakaway=dynamic.scaled(1.12), **terms)
    save_preset(
        replace(BASELINE, clutch=clutch), tmp_path / "own.toml", origin="chosen: a fluid brake"
    )
    found = load_preset(tmp_path / "own.toml")
    assert machine_of(found).clutch == clutch
    changed = {
        where for where, origin in found.provenance.items() if origin == "chosen: a fluid brake"
    }
    assert changed == {f"clutch.{name}" for name in ("off_state", *terms)}
    assert load_preset(tmp_path / "own.toml") == parse_preset(format_preset(found, "title"))
    assert "stribeck" not in TEXT
    with pytest.raises(ParameterError, match=r"Clutch\.stribeck"):
        parse_preset(
            format_preset(found, "title").replace(
                "stribeck = { value = 0.1", "stribeck = { value = -0.1"
            )
        )


OTHER_CURVE = replace(BASELINE.clutch.breakaway, curvature=1.0)


@pytest.mark.parametrize(
    ("machine", "named"),
    [
        (replace(BASELINE, hand=Hand(mass=1.0)), r"Machine\.hand"),
        (replace(BASELINE, substep=1e-3), r"Machine\.substep"),
        (replace(BASELINE, clutch=replace(BASELINE.clutch, lag="voltage")), r"Clutch\.lag"),
        (
            replace(BASELINE, clutch=replace(BASELINE.clutch, breakaway=OTHER_CURVE)),
            r"Clutch\.breakaway",
        ),
    ],
)
def test_a_machine_that_a_preset_cannot_hold_is_not_saved(
    machine: Machine, named: str, tmp_path: Path
):
    file = tmp_path / "own.toml"
    with pytest.raises(ParameterError, match=named):
        save_preset(machine, file, origin="chosen: for tests")
    assert not file.exists()


SHORT = replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.5))


def test_numbers_that_are_not_changed_keep_their_origin(tmp_path: Path):
    save_preset(SHORT, tmp_path / "own.toml", origin="chosen: shorter")
    found = load_preset(tmp_path / "own.toml")
    changed = {
        name: origin
        for name, origin in found.provenance.items()
        if origin != PRESET.provenance.get(name)
    }
    assert changed == {"arm.length_a": "chosen: shorter"}


def test_a_preset_needs_an_origin_and_a_name_that_commands_take(tmp_path: Path):
    with pytest.raises(ParameterError, match=r"arm\.length_a\.from"):
        save_preset(SHORT, tmp_path / "own.toml", origin="a guess")
    with pytest.raises(ParameterError, match="path"):
        save_preset(BASELINE, tmp_path / "own.txt", origin="chosen: for tests")
