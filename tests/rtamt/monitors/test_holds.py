"""`rtamt.holds`: the sign bit of a robustness, from numbers and arrays of all kinds."""

import math

import numpy as np
import pytest

from rtamt import InputError, InputTypeError, Monitor, evaluate, holds

INF = math.inf
NAN = (
    " is no robustness; a monitor gives it as long as the value is unknown: for the first "
    "`latency` samples, or before the first"
)


@pytest.mark.parametrize(
    ("robustness", "expected"),
    [(1.5, True), (-2, False), (0.0, True), (-0.0, False), (0, True), (INF, True), (-INF, False)],
)
def test_a_number_is_read_as_a_bool(robustness: float, *, expected: bool) -> None:
    for number in (robustness, np.float64(robustness)):
        assert holds(number) is expected


def test_an_array_of_any_shape_is_read_as_booleans_of_that_shape() -> None:
    table = np.array([[1.0, -0.0, 0.0], [-INF, 2.0, -1.0]])
    expected = [[True, False, True], [False, True, False]]
    for given in (table, table.tolist(), table.astype(np.float32), table[::1, ::1]):
        found = holds(given)
        assert found.dtype == np.bool_
        assert found.tolist() == expected
    assert holds(table.T).tolist() == np.array(expected).T.tolist()
    assert holds([]).tolist() == []
    assert holds(np.array([0, -1])).tolist() == [True, False]


def test_it_reads_what_evaluate_gives() -> None:
    trace = {"x": [2, 3, 4], "y": [3, 3, 3]}
    assert holds(evaluate("x >= y", trace)).tolist() == [False, True, True]
    assert holds(evaluate("x > y", trace)).tolist() == [False, False, True]
    assert holds(evaluate("always(x == 3 or y == 3)", trace)).tolist() == [True] * 3


def test_nan_is_refused_with_its_place() -> None:
    with pytest.raises(InputError) as refused:
        holds(math.nan)
    assert str(refused.value) == "nan" + NAN
    robustness = Monitor("always[0:1](x > 0)").update_many({"x": [1, 2, 3]})
    with pytest.raises(InputError) as refused:
        holds(robustness)
    assert str(refused.value) == "nan at index 0" + NAN
    with pytest.raises(InputError) as refused:
        holds(np.array([[1.0, 1.0], [1.0, math.nan]]))
    assert str(refused.value) == "nan at index (1, 1)" + NAN


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("1.0", "expected an array of numbers for the robustness, got str '1.0'"),
        (None, "expected an array of numbers for the robustness, got NoneType None"),
        (1j, "expected an array of numbers for the robustness, got complex 1j"),
        ([1, "x"], "expected an array of numbers for the robustness, got <U21"),
        ([[1], [1, 2]], "expected an array of numbers for the robustness, got list [[1], [1, 2]]"),
        (True, "expected a robustness, got bool True"),
        ([True, False], "expected a robustness, got list [True, False]"),
    ],
)
def test_what_is_no_robustness_is_refused(given: float, message: str) -> None:
    with pytest.raises(InputTypeError) as refused:
        holds(given)
    assert str(refused.value) == message
