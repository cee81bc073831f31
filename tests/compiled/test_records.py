"""Records: rows and names; compiled code reads and writes them as plain Python does."""

import traceback
from typing import Annotated, Any, NamedTuple

import numba
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.layout import Field
from pter_gym._compiled.records import (
    Entry,
    entrywise,
    flat,
    layout_of,
    lerp,
    load,
    read,
    rows,
    store,
    width,
    write,
)
from pter_gym._compiled.source import compile_source
from pter_gym.errors import ParameterError

DETERMINISTIC = settings(derandomize=True, deadline=None, database=None, max_examples=100)


class Bare(NamedTuple):
    x: float
    y: float


class Side(NamedTuple):
    left: Annotated[float, Entry("", "{} on the left", name="l")]
    right: Annotated[float, Entry("", "{} on the right")]


class Sides(NamedTuple):
    now: Annotated[Side, Entry("V", "voltage now")]
    before: Annotated[Side, Entry("V", "voltage before")]
    first: Annotated[Side, Entry("V", "voltage at first", name="start")]


class Whole(NamedTuple):
    length: Annotated[float, Entry("m", "length", 2.0)]
    force: Annotated[Side, Entry("N", "force", lambda machine: 10.0 * machine)]
    bare: Bare
    volts: Sides
    last: float


WIDTH = 12
AT = rows(Whole)
LANES = 3

NUMBERS = st.lists(st.floats(), min_size=WIDTH, max_size=WIDTH)


def whole(n: list[float]) -> Whole:
    """Return a record with its numbers, put in by hand."""
    volts = Sides(Side(n[5], n[6]), Side(n[7], n[8]), Side(n[9], n[10]))
    return Whole(n[0], Side(n[1], n[2]), Bare(n[3], n[4]), volts, n[11])


@numba.njit
def stored_and_loaded(w, i, value):
    store(w, AT, i, value)
    return load(w, AT, i)


@numba.njit
def written_and_read(array, first, value):
    write(array[first:], AT, value)
    return read(array, AT, first)


@numba.njit
def between(low, high, part):
    return lerp(low, high, part)


@entrywise
@inlined
def weighted(array: Any, side: Side, x: float, y: float) -> float:
    return array[0] * x - side.left * y


@numba.njit
def weighted_twice(array, side, value, y):
    return weighted(array, side, value, y), weighted(array, side, y, value)


@numba.njit
def moved(w, i, k):
    """Copy one of three equal records to the next, where k is known only when the code runs."""
    store(w, AT.volts[k + 1], i, load(w, AT.volts[k], i))
    return load(w, AT.volts[k + 1], i)


def plain(function: Any) -> Any:
    """Return the Python function that was compiled."""
    return getattr(function, "py_func", function)


def same(a: tuple[Any, ...], b: tuple[Any, ...]) -> bool:
    return type(a) is type(b) and np.array_equal(flat(a), flat(b), equal_nan=True)


def test_rows_are_numbered_in_their_order() -> None:
    assert whole(list(range(WIDTH))) == AT
    assert flat(AT) == tuple(range(WIDTH))
    assert flat(rows(Whole, 7)) == tuple(range(7, 7 + WIDTH))
    assert AT.volts.first == Side(9, 10)
    assert (width(Whole), width(Sides), width(Side)) == (WIDTH, 6, 2)


def test_an_entry_names_what_is_within_it() -> None:
    names = "length force_l force_right x y "
    names += "now_l now_right before_l before_right start_l start_right last"
    assert list(layout_of(Whole, 1.0).names) == names.split()


def test_layout_says_unit_meaning_and_scale() -> None:
    layout = layout_of(Whole, 3.0)
    assert len(layout) == WIDTH
    assert layout.fields[AT.length] == Field("length", "m", "length", 2.0)
    assert layout.fields[AT.force.left] == Field("force_l", "N", "force on the left", 30.0)
    assert layout.fields[AT.volts.first.right] == Field(
        "start_right", "V", "voltage at first on the right", 1.0
    )
    assert layout.fields[AT.bare.y] == Field("y", "", "", 1.0)


def test_an_unknown_field_of_a_layout_is_refused() -> None:
    with pytest.raises(KeyError, match="z"):
        layout_of(Bare).index("z")


def test_two_entries_of_one_name_are_refused() -> None:
    class Twice(NamedTuple):
        here: Bare
        there: Bare

    with pytest.raises(ParameterError, match="x, y"):
        layout_of(Twice)


@DETERMINISTIC
@given(NUMBERS, st.integers(0, LANES - 1))
def test_load_inverts_store(numbers: list[float], lane: int) -> None:
    value = whole(numbers)
    found = {}
    for function in (stored_and_loaded, plain(stored_and_loaded)):
        w = np.full((WIDTH + 1, LANES), -1.0)
        assert same(function(w, lane, value), value)
        assert (np.delete(w, lane, axis=1) == -1.0).all()
        assert (w[WIDTH] == -1.0).all()
        found[function] = w.tobytes()
    assert len(set(found.values())) == 1


@DETERMINISTIC
@given(NUMBERS, st.integers(0, 4))
def test_read_inverts_write(numbers: list[float], first: int) -> None:
    value = whole(numbers)
    found = set()
    for function in (written_and_read, plain(written_and_read)):
        array = np.full(WIDTH + 5, -1.0)
        assert same(function(array, first, value), value)
        assert np.array_equal(array[first : first + WIDTH], numbers, equal_nan=True)
        assert (np.delete(array, slice(first, first + WIDTH)) == -1.0).all()
        found.add(array.tobytes())
    assert len(found) == 1


@DETERMINISTIC
@given(NUMBERS, NUMBERS, st.floats(0.0, 1.0))
def test_compiled_blends_are_those_of_python(
    low: list[float], high: list[float], part: float
) -> None:
    expected = [a + part * (b - a) for a, b in zip(low, high, strict=True)]
    for function in (between, plain(between)):
        assert same(function(whole(low), whole(high), part), whole(expected))


@DETERMINISTIC
@given(NUMBERS)
def test_entrywise_functions_take_records_numbers_and_other_arguments(numbers: list[float]) -> None:
    array, value = np.array([3.0]), whole(numbers)
    with np.errstate(all="ignore"):
        expected = [[3.0 * x - 0.5 * 2.0 for x in numbers], [3.0 * 2.0 - 0.5 * x for x in numbers]]
        for function in (weighted_twice, plain(weighted_twice)):
            for found, wanted in zip(
                function(array, Side(0.5, 0.0), value, 2.0), expected, strict=True
            ):
                assert same(found, whole(wanted))


@DETERMINISTIC
@given(NUMBERS, st.integers(0, 1))
def test_records_of_one_kind_may_be_chosen_by_an_index(numbers: list[float], k: int) -> None:
    value = whole(numbers)
    for function in (moved, plain(moved)):
        w = np.zeros((WIDTH, LANES))
        store(w, AT, 1, value)
        assert same(function(w, 1, k), value.volts[k])
        assert same(load(w, AT.volts[k + 1], 1), value.volts[k])
        assert same(load(w, AT.volts[k], 1), value.volts[k])


def test_a_traceback_shows_generated_lines() -> None:
    inverse = compile_source("def inverse(x):\n    return 1.0 / x\n", "inverse", {})
    assert inverse(2.0) == 0.5
    with pytest.raises(ZeroDivisionError) as raised:
        inverse(0.0)
    assert "return 1.0 / x" in "".join(traceback.format_exception(raised.value))
