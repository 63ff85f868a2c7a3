"""The inputs of monitors: every form of arguments, IEEE doubles, and nan with nan="hold"."""

import math
import types
from decimal import Decimal
from fractions import Fraction
from typing import Any, Literal

import numpy as np
import pytest

from rtamt import (
    EpisodeMonitor,
    InputError,
    Monitor,
    evaluate,
)

Backend = Literal["native", "python"]
TEXT = "once[0:2](req - gnt > 1)"
NAN = math.nan


@pytest.fixture
def monitor(backend: Backend) -> Monitor:
    """Return a monitor of two variables after one sample."""
    made = Monitor(TEXT, backend=backend)
    made.update(req=4.0, gnt=1.0)
    return made


# Argument forms. ---------------------------------------------------------------------------------


class Row:
    """A row of a data frame: names, and a value for each."""

    def keys(self) -> list[str]:
        return ["gnt", "req"]

    def __getitem__(self, name: str) -> float:
        return {"req": 9.0, "gnt": 2.0}[name]


def strided() -> np.ndarray[Any, Any]:
    return np.array([9.0, NAN, 2.0, NAN])[::2]


def read_only() -> np.ndarray[Any, Any]:
    array = np.array([9.0, 2.0])
    array.flags.writeable = False
    return array


SAMPLES: dict[str, tuple[tuple[Any, ...], dict[str, Any]]] = {
    "keywords": ((), {"req": 9.0, "gnt": 2.0}),
    "keywords in another order": ((), {"gnt": 2.0, "req": 9.0}),
    "positions": ((9.0, 2.0), {}),
    "mapping": (({"gnt": 2.0, "req": 9.0},), {}),
    "mapping proxy": ((types.MappingProxyType({"req": 9.0, "gnt": 2.0}),), {}),
    "row of a data frame": ((Row(),), {}),
    "array": ((np.array([9.0, 2.0]),), {}),
    "float32 array": ((np.array([9, 2], dtype=np.float32),), {}),
    "integer array": ((np.array([9, 2]),), {}),
    "strided array": ((strided(),), {}),
    "read-only array": ((read_only(),), {}),
    "list": (([9.0, 2.0],), {}),
    "tuple": (((9.0, 2.0),), {}),
    "integers": ((9, 2), {}),
    "numpy scalars": ((np.float32(9), np.int8(2)), {}),
    "exact numbers": ((Decimal(9), Fraction(2)), {}),
    "arrays of no dimension": ((np.array(9.0), np.array(2)), {}),
}


@pytest.mark.parametrize("form", SAMPLES)
def test_argument_forms_are_equal(form: str, monitor: Monitor) -> None:
    args, named = SAMPLES[form]
    assert monitor.update(*args, **named) == 6.0
    assert monitor.update(0.0, 0.0) == 6.0
    assert monitor.samples == 3


def test_booleans_are_numbers(monitor: Monitor) -> None:
    monitor.reset()
    assert monitor.update(True, np.False_) == 0.0  # noqa: FBT003


BLOCKS: dict[str, Any] = {
    "mapping of lists": {"req": [9, 0, 0], "gnt": [2, 0, 0]},
    "mapping of arrays": {"gnt": np.array([2.0, 0, 0]), "req": np.array([9.0, 0, 0])},
    "integers and float32": {"gnt": np.array([2, 0, 0]), "req": np.array([9, 0, 0], np.float32)},
    "booleans": {"gnt": np.array([True, False, False]) + 1, "req": [9, 1, 1]},
    "strided": {"req": np.array([9.0, 5, 0, 5, 0])[::2], "gnt": np.array([0.0, 0, 2])[::-1]},
    "table": np.array([[9.0, 2], [0, 0], [0, 0]]),
    "table in Fortran order": np.asfortranarray([[9.0, 2], [0, 0], [0, 0]]),
    "list of rows": [[9, 2], [0, 0], [0, 0]],
}


@pytest.mark.parametrize("form", BLOCKS)
def test_block_forms_are_equal(form: str, monitor: Monitor) -> None:
    assert monitor.update_many(BLOCKS[form]).tolist() == [6.0, 6.0, 6.0]
    assert evaluate(TEXT, BLOCKS[form], backend=monitor.backend).tolist() == [6.0, 6.0, 6.0]


def test_empty_block_changes_nothing(monitor: Monitor) -> None:
    assert monitor.update_many({"req": [], "gnt": []}).tolist() == []
    assert monitor.update_many(np.empty((0, 2))).tolist() == []
    assert monitor.samples == 1


def test_results_are_float64_arrays_of_their_own(monitor: Monitor) -> None:
    req = np.array([1.0, 2.0])
    result = monitor.update_many({"req": req, "gnt": req})
    assert result.dtype == np.float64
    assert result.flags.owndata
    whole = evaluate("req", {"req": req}, backend=monitor.backend)
    whole[0] = 7.0
    assert req.tolist() == [1.0, 2.0]


def test_evaluate_ignores_columns_that_the_formula_does_not_name(backend: Backend) -> None:
    assert evaluate("x > 1", {"x": [3], "note": ["late"]}, backend=backend).tolist() == [2.0]


def test_a_formula_without_variables_is_evaluated_over_n_samples(backend: Backend) -> None:
    assert evaluate("next true", {}, n=2, backend=backend).tolist() == [math.inf, math.inf]
    assert evaluate("s_next true", {}, n=2, backend=backend).tolist() == [math.inf, -math.inf]
    constant = Monitor("3 > 2", backend=backend)
    assert (constant.variables, constant.update(), constant.update({})) == ((), 1.0, 1.0)


# Values: IEEE doubles. ---------------------------------------------------------------------------

TERMS = [
    ("x / 0", 2.0, math.inf),
    ("-x / 0", 2.0, -math.inf),
    ("x / -0.0", 2.0, -math.inf),
    ("exp(x)", 1e3, math.inf),
    ("exp(-x)", 1e3, 0.0),
    ("ln(x)", 0.0, -math.inf),
    ("pow(x, 2)", 1e200, math.inf),
    ("pow(x, 3)", -1e200, -math.inf),
    ("pow(x, -1)", 0.0, math.inf),
    ("pow(x, 0.5)", math.inf, math.inf),
    ("log(x, 2)", 8.0, 3.0),
    ("log(x, 10)", math.inf, math.inf),
    ("sqrt(x)", math.inf, math.inf),
    ("abs(x)", -math.inf, math.inf),
    ("min(x, 1, 2)", -math.inf, -math.inf),
    ("max(x, 1, 2)", -math.inf, 2.0),
    ("x * 1e308 * 10", 1.0, math.inf),
    ("x + 0.2 + 0.3", 0.1, 0.1 + 0.2 + 0.3),
    ("x + (0.2 + 0.3)", 0.1, 0.1 + (0.2 + 0.3)),
    ("x - 1 - 2", 9.0, 6.0),
    ("x / 4 / 2", 8.0, 1.0),
]


@pytest.mark.parametrize(("term", "x", "value"), TERMS)
def test_terms_are_ieee_doubles(term: str, x: float, value: float, backend: Backend) -> None:
    assert Monitor(term, backend=backend).update(x=x) == value
    assert evaluate(term, {"x": [x]}, backend=backend).tolist() == [value]


# nan="hold". -------------------------------------------------------------------------------------


def test_hold_keeps_the_last_value(backend: Backend) -> None:
    held = Monitor("x - y > 0", backend=backend, nan="hold")
    assert held.update(5.0, 1.0) == 4.0
    assert held.update(NAN, 2.0) == 3.0
    assert held.update(x=7.0, y=NAN) == 5.0
    assert held.update_many({"x": [NAN, 1.0, NAN], "y": [0.0, NAN, NAN]}).tolist() == [
        7.0,
        1.0,
        1.0,
    ]
    assert held.update(NAN, NAN) == 1.0
    data = {"x": [5, NAN, 7], "y": [1, 2, NAN]}
    assert evaluate("x - y > 0", data, backend=backend, nan="hold").tolist() == [4.0, 3.0, 5.0]


def test_hold_has_nothing_to_hold_at_the_first_sample(backend: Backend) -> None:
    held = Monitor("x > 0", backend=backend, nan="hold")
    with pytest.raises(InputError, match="and the first sample has none"):
        held.update(NAN)
    held.update(3.0)
    held.reset()
    with pytest.raises(InputError, match="variable 'x' is nan at sample 0"):
        held.update(NAN)
    assert EpisodeMonitor("x > 0", nan="hold").update(2.0) == 2.0


def test_a_subclass_whose_update_nobody_would_call_is_refused() -> None:
    with pytest.raises(TypeError) as caught:
        type("Logged", (Monitor,), {"update": lambda _, **values: values})
    assert str(caught.value) == (
        "Logged.update would never be called: a monitor's update is the method of its machine; "
        "hold a monitor instead of inheriting from it"
    )
