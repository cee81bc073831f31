"""Arguments are checked and columns are read, each with the name of what is wrong."""

from pathlib import Path

import numpy as np
import pytest

from pter_gym._internal.checks import names_in, whole_number
from pter_gym._internal.tables import read_columns
from pter_gym.errors import ParameterError


@pytest.mark.parametrize("value", [3, np.int64(3), np.uint8(3)])
def test_whole_numbers_are_taken(value: object):
    found = whole_number("count", value, at_least=3)
    assert found == 3
    assert type(found) is int


@pytest.mark.parametrize("value", [2, -3, 3.0, "3", None, True, np.float64(3.0)])
def test_what_is_no_whole_number_is_refused(value: object):
    with pytest.raises(ParameterError, match="count must be a whole number ≥ 3, got"):
        whole_number("count", value, at_least=3)


def test_a_whole_number_is_at_least_one():
    assert whole_number("count", 1) == 1
    for value in (0, True, False):
        with pytest.raises(ParameterError, match="≥ 1"):
            whole_number("count", value)


@pytest.mark.parametrize("names", [["a", "b"], ("a", "b"), {"a": 1, "b": 2}, iter("ab")])
def test_names_are_listed(names: object):
    assert names_in("policies", names) == ["a", "b"]


@pytest.mark.parametrize("names", [[], "ab", b"ab", Path("ab"), None, 5, iter(())])
def test_what_is_no_list_of_names_is_refused(names: object):
    with pytest.raises(ParameterError, match="policies must hold at least one name, in a list, got"):
        names_in("policies", names)


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    file = folder / "table.csv"
    file.write_bytes(text.encode(encoding))
    return file


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_named_columns_are_read_in_the_order_of_the_names(tmp_path: Path, encoding: str):
    found = read_columns(written(tmp_path, "x, other ,y\r\n1, word,-2e3\r\n3,, 4\r\n", encoding), ["y", "x"])
    assert list(found) == ["y", "x"]
    np.testing.assert_array_equal(found["x"], [1.0, 3.0])
    np.testing.assert_array_equal(found["y"], [-2000.0, 4.0])


def test_a_header_alone_gives_empty_columns(tmp_path: Path):
    found = read_columns(written(tmp_path, "x,y\n"), ["x", "y"])
    assert found["x"].shape == found["y"].shape == (0,)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x,z\n1,2\n", "no column y; the columns are x, z"),
        ("", "no column x"),
        ("x,y\n1,2\n1,nan\n", "line 3: y must be a finite number, got 'nan'"),
        ("x,y\n-inf,2\n", "line 2: x must be a finite number, got '-inf'"),
        ("x,y\n1\n", "line 2: y must be a finite number, got ''"),
        ("x,y\n1,\n", "line 2: y must be a finite number, got ''"),
        ("x,y\n1,two\n", "line 2: y must be a finite number, got 'two'"),
    ],
)
def test_a_wrong_table_is_told_by_column_and_line(tmp_path: Path, text: str, told: str):
    with pytest.raises(ParameterError, match=told):
        read_columns(written(tmp_path, text), ["x", "y"])


def test_what_is_no_table_is_refused(tmp_path: Path):
    with pytest.raises(ParameterError, match="cannot be read as CSV"):
        read_columns(written(tmp_path, "x,y\nä,1\n", "latin-1"), ["x", "y"])
    with pytest.raises(ParameterError, match="cannot be read as CSV"):
        read_columns(tmp_path / "nowhere.csv", ["x", "y"])
