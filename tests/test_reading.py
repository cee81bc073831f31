"""Files of others: read within bounds, finite numbers, and nothing executed."""

import gzip
import json
import os
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pter_gym._internal.reading import (
    MAX_JSON_SIZE,
    MAX_TOML_SIZE,
    inflate,
    parse_json,
    parse_toml,
    read_bytes,
    reading,
)
from pter_gym._internal.tables import read_table
from pter_gym.errors import DataError, ParameterError

PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)


@given(PLAIN)
def test_json_is_read_as_it_was_written(content: Any) -> None:
    assert parse_json(json.dumps(content).encode()) == content


@pytest.mark.parametrize(
    "data",
    [
        b"[NaN]",
        b"[1e999]",
        b"9" * 5000,
        b"[" * 100_000,
        b" " * (MAX_JSON_SIZE + 1),
        b"[] []",
        "[]".encode("utf-16"),
    ],
    ids=["NaN", "infinite", "digits", "deep", "large", "more behind it", "another encoding"],
)
def test_json_is_refused(data: bytes) -> None:
    with pytest.raises((ValueError, RecursionError)):
        parse_json(data)


@pytest.mark.parametrize(
    "text",
    [
        "a = 1\na = 1\n",
        "a = nan",
        "a = [1.0, -inf]",
        "a = 1e999",
        "a = " + "[" * 100_000,
        "#" * (MAX_TOML_SIZE + 1),
    ],
    ids=["twice", "NaN", "infinite", "too large a number", "deep", "large"],
)
def test_toml_is_refused(text: str) -> None:
    with pytest.raises((ValueError, RecursionError)):
        parse_toml(text)
    assert parse_toml("a = 1.5\n[b]\nc = [1, 2]\n") == {"a": 1.5, "b": {"c": [1, 2]}}


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * 20_000) + " = 1",
        f"[{'.'.join('a' * 20_000)}]",
        "x = {" + " . ".join("a" * 9) + " = 1}",
        "[" + ".".join(["'a'", '"b.\\" c"', "d"] * 3) + "]",
    ],
)
def test_keys_of_many_parts_are_refused_before_they_are_parsed(text: str) -> None:
    """Reading the first took nine seconds and 1.6 GB."""
    with pytest.raises(ValueError, match="at most 8 parts"):
        parse_toml(text)


def test_a_byte_order_mark_is_no_part_of_a_file() -> None:
    assert parse_toml("\ufeffa = 1\r\n") == {"a": 1}


def test_dots_in_strings_comments_and_numbers_are_no_keys() -> None:
    text = "1.2.3.4.5.6.7.8.9"
    many = [1.5] * 20
    file = f'a.b.c.d.e.f.g.h = \'{text}\' # {text}\nb = """{text}\n{text}"""\nc = {many}\n'
    assert parse_toml(file)["b"] == f"{text}\n{text}"


@given(st.binary(max_size=100), st.integers(0, 120))
def test_inflate_is_bounded(content: bytes, most: int) -> None:
    packed = gzip.compress(content)
    if len(content) <= most:
        assert inflate(packed, most) == content
    else:
        with pytest.raises(ValueError, match=str(most)):
            inflate(packed, most)
    with pytest.raises(EOFError):
        inflate(packed[:-1], 120)


def test_a_bomb_is_not_unpacked() -> None:
    bomb = gzip.compress(bytes(1 << 26))
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="1000"):
            inflate(bomb, 1000)
        assert tracemalloc.get_traced_memory()[1] < 1 << 21
    finally:
        tracemalloc.stop()


def test_files_are_regular_and_within_their_bound(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"12345")
    assert read_bytes(file, 5) == b"12345"
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
    for path, most in ((file, 4), (tmp_path / "none", 5), (tmp_path, 5), (tmp_path / "pipe", 5)):
        with pytest.raises(ValueError):  # noqa: PT011
            read_bytes(path, most)


@pytest.mark.parametrize(
    "error", [KeyError("a"), OverflowError("a"), OSError("a"), RecursionError("a")]
)
def test_an_error_gets_the_name_of_what_is_read(error: Exception) -> None:
    with pytest.raises(DataError, match=r"^the file: .*a"), reading("the file"):
        raise error


@pytest.mark.parametrize(
    "text",
    [
        "x,y,x\n1,2,3\n",
        "x,z\n1,2\n",
        "x,y\n0,5,0,6\n",
        "x,y\n1_0,2\n",
        "x,y\n\uff11,2\n",
        "x,y\n1\n",
        "x,y\n1,inf\n",
    ],
    ids=[
        "a column twice",
        "no column",
        "commas in numbers",
        "underscores",
        "digits",
        "short",
        "infinite",
    ],
)
def test_tables_that_could_be_misread_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError, match=r"table\.csv"):
        read_table(tmp_path / "table.csv", ("x", "y"))


def test_columns_are_found_by_their_names(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("\ufeffy, note, x\n1,a,2\n\n3,b,4e-1\n", encoding="utf-8")
    found = read_table(tmp_path / "table.csv", ("x", "y")).columns
    np.testing.assert_array_equal(found["x"], [2.0, 0.4])
    np.testing.assert_array_equal(found["y"], [1.0, 3.0])


NAMED = "Angle A [deg],Speed [rpm],F [mN]\n180,60,1000\n"


@pytest.mark.parametrize(
    ("name", "unit", "value"),
    [
        ("Angle A [deg]", "rad", np.pi),
        ("angle a", "rad", np.pi),
        ("Speed [rpm]", "rad/s", 2.0 * np.pi),
        ("Speed", "rad/s", 2.0 * np.pi),
        ("F [mN]", "N", 1.0),
        ("F", "N", 1.0),
    ],
)
def test_a_columns_unit_is_read_whether_its_name_is_given_with_it_or_not(
    name: str, unit: str, value: float, tmp_path: Path
) -> None:
    (tmp_path / "u.csv").write_text(NAMED, encoding="utf-8")
    column = read_table(tmp_path / "u.csv", (name,), unit=unit).columns[name]
    assert column == pytest.approx([value])


SPELLINGS = {
    "N·m": {
        **dict.fromkeys(("M/Ncm", "M / Ncm", "M (Ncm)", "M_Ncm", "M, Ncm", "M in N·cm"), 1e-2),
        **dict.fromkeys(("M [N⋅m]", "M [N m]", "M [Nm]", "M/N*m", "torque_Nm", "M"), 1.0),
        "M (kNm)": 1e3,
        "M (mN m)": 1e-3,
        "M (lb-in)": 0.1129848,
        "M (ozf-in)": 7.0615518e-3,
    },
    "rad/s": {
        **dict.fromkeys(("n/rpm", "n/min^-1", "n / (1/min)", "n [min⁻¹]", "N [RPM]"), np.pi / 30),
        "omega/rad/s": 1.0,
        "omega_rad_s": 1.0,
        "w [rad·s⁻¹]": 1.0,
        "w (Deg/s)": np.pi / 180,
    },
    "s": {
        **dict.fromkeys(("t/ms", "t, ms", "Zeit in ms", "TIME_MS", "Time [msec]"), 1e-3),
        "t (min)": 60.0,
        "t_s": 1.0,
        "Time (sec)": 1.0,
        "t_us": 1e-6,
    },
    "rad": {
        **dict.fromkeys(("theta/deg", "theta (Degrees)", "theta_A_deg", "q[0] [°]"), np.pi / 180),
        **dict.fromkeys(("theta_A", "joint_states/position[0]", "/arm/position"), 1.0),
    },
    "V": {"V1/mV": 1e-3, "I (mA)": 1e-3, "I_A": 1.0, "V_in": 1.0, "V1 (volts)": 1.0},
    "N": {"F/kN": 1e3, "F (kgf)": 9.80665, "F_x": 1.0, "Fx, N": 1.0},
}


@pytest.mark.parametrize("unit", SPELLINGS)
def test_what_follows_a_name_is_its_unit(unit: str, tmp_path: Path) -> None:
    for name, size in SPELLINGS[unit].items():
        (tmp_path / "u.csv").write_text(f"k;{name}\n0;100\n1;200\n", "utf-8")
        column = read_table(tmp_path / "u.csv", (name,), unit=unit).columns[name]
        assert column == pytest.approx([100.0 * size, 200.0 * size]), name


@pytest.mark.parametrize(
    ("unit", "names"),
    [
        ("N·m", ("M/kpcm", "M (x)", "M [-]")),
        ("rad/s", ("n (Hz)", "n (krpm)", "n/U")),
        ("rad", ("theta (counts)", "theta/turns", "theta_mdeg", "theta, gon")),
        ("V", ("V1 (%)", "V1/%", "P_kW")),
        ("N", ("F (oz)", "F/g", "F [MN]", "F_mm")),
    ],
)
def test_a_unit_of_something_else_is_refused(
    unit: str, names: tuple[str, ...], tmp_path: Path
) -> None:
    for name in names:
        (tmp_path / "u.csv").write_text(f"k;{name}\n0;100\n1;200\n", "utf-8")
        with pytest.raises(ParameterError, match=r"must be in .*, not in"):
            read_table(tmp_path / "u.csv", (name,), unit=unit)


@pytest.mark.parametrize(
    "text",
    [
        "# x_mm,y_mm\n# made by a program\n1,2\n3,4\n",
        "# x,y\n# mm,mm\n1,2\n3,4\n",
        "# k,x_mm,y_mm\n0,1,2\n1,3,4\n",
        "// x_mm y_mm\n1 2\n3 4\n",
        "% y_mm, x_mm\n2,1\n4,3\n",
        "x_mm,y_mm,\n1,2\n3,4\n",
        "x,y\n[mm],[mm]\n1,2\n3,4\n",
    ],
)
def test_names_are_found_in_any_comment(text: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(text)
    columns = read_table(tmp_path / "t.csv", ("x", "y"), unit="m").columns
    assert columns["x"] == pytest.approx([1e-3, 3e-3])
    assert columns["y"] == pytest.approx([2e-3, 4e-3])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,1,2\n1,3,4\n", "must name the columns x, y"),
        ("# t,z\n1,2\n3,4\n", "the columns are t, z"),
        ("x position y\n1 2\n", "line 2"),
        ("note x y\na 1 2\nb 3\n", "line 3"),
        ("x,y,z\n1,2,3\n4,5\n", "line 3"),
        ("x_mm,y\ncm,cm\n1,2\n", "x_mm is in cm"),
    ],
)
def test_a_table_that_one_would_have_to_guess_is_refused(
    text: str, said: str, tmp_path: Path
) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(ParameterError, match=said):
        read_table(tmp_path / "t.csv", ("x", "y"), unit="m")


def test_one_colon_is_minutes_and_seconds(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("t_ms\n00:01.250\n10:02.500\n")
    assert list(read_table(tmp_path / "t.csv", ("t",), unit="s").columns["t"]) == [1.25, 602.5]
    (tmp_path / "t.csv").write_text("t\n20:59\n")
    with pytest.raises(ParameterError, match="line 2: times must be"):
        read_table(tmp_path / "t.csv", ("t",), unit="s")


def test_a_unit_that_is_not_known_is_refused(tmp_path: Path) -> None:
    (tmp_path / "u.csv").write_text(NAMED, encoding="utf-8")
    with pytest.raises(ParameterError, match=r"F \[mN\] must be in m, cm, mm, not in mN"):
        read_table(tmp_path / "u.csv", ("F [mN]",), unit="m")


@pytest.mark.parametrize(
    "entry",
    ["", "nan", "-nan", "-nan(ind)", "1.#QNAN", "-1.#IND00", "#N/A", "N/A", "<NA>", "?", "None"],
)
def test_what_says_no_number_is_a_blank(entry: str, tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text(f"x,y\n1,2\n{entry},3\n", encoding="utf-8")
    assert np.isnan(read_table(tmp_path / "b.csv", ("x", "y"), blanks=True).columns["x"][1])
    with pytest.raises(ParameterError, match="line 3"):
        read_table(tmp_path / "b.csv", ("x", "y"))


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("x,y\n1,2\n,\n-3,4\n,\n", "utf-8"),
        ("x,y\n1,2\n\N{MINUS SIGN}3,4\n", "utf-8"),
        ("# Länge 0,5 °\nx,y\n1,2\n-3,4\n", "cp1252"),
    ],
    ids=["rows of commas", "a minus of typesetters", "Windows-1252"],
)
def test_tables_of_office_programs_are_read(text: str, encoding: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(text.encode(encoding))
    columns = read_table(tmp_path / "t.csv", ("x", "y")).columns
    np.testing.assert_array_equal(columns["x"], [1.0, -3.0])
    np.testing.assert_array_equal(columns["y"], [2.0, 4.0])


@pytest.mark.parametrize(
    "stamps",
    [
        ("2026-11-28T20:59:01Z", "2026-11-28T20:59:02.5Z"),
        ("2026-11-28 20:59:01+01:00", "2026-11-28 20:59:02.500+01:00"),
        ("20:59:01.0", "20:59:02.5"),
    ],
)
def test_times_of_iso_8601_are_seconds(stamps: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("t,y\n" + "".join(f"{stamp},1\n" for stamp in stamps))
    times = read_table(tmp_path / "t.csv", ("t",), unit="s").columns["t"]
    assert np.diff(times) == pytest.approx([1.5])
    (tmp_path / "t.csv").write_text("t,y\n28.11.2026 20:59:01,1\n")
    with pytest.raises(ParameterError, match="times must be seconds, or as 2026"):
        read_table(tmp_path / "t.csv", ("t",), unit="s")


def test_reading_ends_at_the_first_line_that_is_wrong(tmp_path: Path) -> None:
    """With all lines in memory, 4 MB of them would take ten times as much as a megabyte."""
    path = tmp_path / "long.csv"
    path.write_text("x,y\n1,2\n1,zwei\n" + "1,2\n" * 1_000_000)
    tracemalloc.start()
    with pytest.raises(ParameterError, match="line 3"):
        read_table(path, ("x", "y"))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1_000_000
