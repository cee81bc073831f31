"""Files of others: read within bounds, each name once, finite numbers, and nothing executed."""

import gzip
import json
import os
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pter_gym._internal.checks import is_finite
from pter_gym._internal.reading import (
    MOST_DOTS,
    MOST_JSON,
    MOST_PARTS,
    MOST_TOML,
    inflate,
    parse_json,
    parse_toml,
    read_bytes,
    reading,
)
from pter_gym._internal.tables import read_columns
from pter_gym.errors import DataError, ParameterError


@pytest.fixture
def peak() -> Any:
    """Checks that less memory than a bound [B] is taken."""

    @contextmanager
    def measure(below: int) -> Iterator[None]:
        tracemalloc.start()
        try:
            yield
            assert tracemalloc.get_traced_memory()[1] < below
        finally:
            tracemalloc.stop()

    return measure


PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**120), 2**120)
    | st.floats(allow_nan=False, allow_infinity=False)
    # st.text has no half characters
    | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)


@given(PLAIN)
def test_json_is_read_as_it_was_written(content: Any) -> None:
    assert parse_json(json.dumps(content).encode()) == content
    assert parse_json(json.dumps(content, ensure_ascii=False).encode()) == content


JSON: dict[str, tuple[bytes, str]] = {
    "a name twice": (b'[{"b": {"a": 1, "a": 2}}]', "occurs twice"),
    "NaN": (b"[NaN]", "numbers must be finite, got NaN"),
    "too large a number": (b"[1e999]", "numbers must be finite, got 1e999"),
    "too many digits": (b"9" * 5000, "digits"),
    "half a character": (b'["\\ud800"]', "surrogates"),
    "half a character in a name": (b'{"\\udfff": 1}', "surrogates"),
    "half a character, raw": (b'["\xed\xa0\x80"]', "utf-8"),
    "deep": (b"[" * 100_000, "nested too deeply"),
    "large": (b" " * (MOST_JSON + 1), f"larger than {MOST_JSON}"),
    "more behind it": (b"[] []", "Extra data"),
    "another encoding": ("[]".encode("utf-16"), "utf-8"),
}


@pytest.mark.parametrize("kind", JSON)
def test_json_that_is_not_strict_is_refused(kind: str) -> None:
    data, told = JSON[kind]
    with pytest.raises(ValueError, match=told):
        parse_json(data)


TOML: dict[str, tuple[str, str]] = {
    "a name twice": ("a = 1\na = 1\n", "overwrite"),
    "not a number": ("a = nan", "numbers must be finite, got nan"),
    "infinite": ("a = [1.0, -inf]", "numbers must be finite, got -inf"),
    "too large a number": ("a = 1e999", "numbers must be finite, got 1e999"),
    "deep": ("a = " + "[" * 100_000, "nested too deeply"),
    "large": ("#" * (MOST_TOML + 1), f"larger than {MOST_TOML}"),
    "half a character": ('a = "\\ud800"', "scalar"),
}


@pytest.mark.parametrize("kind", TOML)
def test_toml_that_is_not_strict_is_refused(kind: str) -> None:
    text, told = TOML[kind]
    with pytest.raises(ValueError, match=told):
        parse_toml(text)
    assert parse_toml("a = 1.5\n[b]\nc = [1, 2]\n") == {"a": 1.5, "b": {"c": [1, 2]}}


@given(st.binary(max_size=100), st.integers(0, 120))
def test_what_is_packed_is_unpacked_within_its_bound(content: bytes, most: int) -> None:
    packed = gzip.compress(content)
    if len(content) <= most:
        assert inflate(packed, most) == content
    else:
        with pytest.raises(ValueError, match=f"larger than {most} bytes"):
            inflate(packed, most)
    with pytest.raises(ValueError, match="not one complete gzip file"):
        inflate(packed[:-1], 120)
    with pytest.raises(ValueError, match="not one complete gzip file"):
        inflate(packed + packed, 120)


def test_a_bomb_is_not_unpacked(peak: Any) -> None:
    bomb = gzip.compress(bytes(1 << 26))
    with peak(below=1 << 21), pytest.raises(ValueError, match="larger than 1000 bytes"):
        inflate(bomb, 1000)


def test_files_are_regular_and_within_their_bound(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"12345")
    assert read_bytes(file, 5) == b"12345"
    with pytest.raises(ValueError, match="larger than 4 bytes"):
        read_bytes(file, 4)
    with pytest.raises(ValueError, match="there is no such file"):
        read_bytes(tmp_path / "none", 5)
    with pytest.raises(ValueError, match="not a regular file"):
        read_bytes(tmp_path, 5)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(ValueError, match="not a regular file"):
            read_bytes(tmp_path / "pipe", 5)


def test_a_complaint_gets_the_name_of_what_is_read() -> None:
    with pytest.raises(DataError, match=r"^the file: 'a' is missing$"), reading("the file"):
        raise KeyError("a")
    with pytest.raises(DataError, match=r"^the file: too large$"), reading("the file"):
        raise OverflowError("too large")
    with pytest.raises(ZeroDivisionError, match="mine"):
        raise ZeroDivisionError("mine")


TABLES: dict[str, tuple[str, str]] = {
    "a column twice": ("x,y,x\n1,2,3\n", "more than one column x"),
    "commas in numbers": ("x,y\n0,5,0,6\n", "line 2 has 4 entries, the first has 2"),
    "underscores": ("x,y\n1_0,2\n", "line 2: x must be a finite number, got '1_0'"),
    "other digits": ("x,y\n\uff11,2\n", "line 2: x must be a finite number"),
    "an open quote": ('x,y\n"' + "1\n" * 100_000, "field larger than field limit"),
}


@pytest.mark.parametrize("kind", TABLES)
def test_tables_that_could_be_misread_are_refused(kind: str, tmp_path: Path) -> None:
    text, told = TABLES[kind]
    (tmp_path / "table.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError, match=told):
        read_columns(tmp_path / "table.csv", ("x", "y"))


def test_blank_lines_and_short_ones_without_a_named_column_are_no_mistake(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("\ufeffx, y ,note\n\n1,2\n3,4,five\n", encoding="utf-8")
    found = read_columns(tmp_path / "table.csv", ("y", "x"))
    assert {name: values.tolist() for name, values in found.items()} == {"y": [2.0, 4.0], "x": [1.0, 3.0]}


@pytest.mark.parametrize("value", [True, None, "1", float("nan"), float("inf"), -(10**400), [1.0], np.int64(1)])
def test_what_no_float64_holds_is_no_number(value: object) -> None:
    assert not is_finite(value)
    assert all(map(is_finite, (3, -1.5e308, np.float64(2.0))))


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        (lambda text: parse_json(text.encode()), "[" + "[]," * MOST_PARTS + "[]]"),
        (parse_toml, "a" + ".a" * (MOST_DOTS + 1) + " = 1"),
    ],
)
def test_what_would_take_seconds_is_refused_before_it_is_parsed(parse: Callable[[str], object], text: str) -> None:
    with pytest.raises(ValueError, match=r"lists and objects|dots"):
        parse(text)


def test_blanks_before_quotes_do_not_count(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text('time, "x"\n0, "1"\n')
    assert read_columns(tmp_path / "a.csv", ("x",))["x"].tolist() == [1.0]
