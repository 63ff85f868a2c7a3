"""A batch of traces in one call of `evaluate`."""

import math
from typing import Any

import numpy as np
import pytest
from bits import identical
from hypothesis import given
from hypothesis import strategies as st
from strategies import INFINITIES, INTEGERS, QUARTERS, VARIABLES, formulas

from rtamt import Formula, InputError, evaluate
from rtamt.machines.backend import Backend

NAN = math.nan


def test_a_nan_is_told_by_its_sample_however_many_variables_there_are(backend: Backend) -> None:
    text, short = "always(x > y or z > 0)", {"x": [[1.0]], "y": [[1.0]], "z": [[NAN]]}
    with pytest.raises(InputError, match=r"variable 'z' is nan at sample 0; "):
        evaluate(text, short, backend=backend)
    alone = {name: values[0] for name, values in short.items()}
    with pytest.raises(InputError, match=r"^variable 'z' is nan at sample 0; "):
        evaluate(text, alone, backend=backend)


@st.composite
def tables(draw: st.DrawFn, values: tuple[float, ...]) -> dict[str, np.ndarray[Any, Any]]:
    """Values of every variable, of shape (traces, samples)."""
    traces, samples = draw(st.integers(0, 4)), draw(st.integers(1, 9))
    size = traces * samples * len(VARIABLES)
    drawn = draw(st.binary(min_size=size, max_size=size))
    array = np.array([values[byte % len(values)] for byte in drawn])
    return dict(zip(VARIABLES, array.reshape(len(VARIABLES), traces, samples), strict=True))


@given(formula=formulas(endless=True), data=tables(QUARTERS + INTEGERS), drawn=st.data())
def test_each_trace_has_the_values_of_its_own(
    formula: Formula, data: dict[str, np.ndarray[Any, Any]], drawn: st.DataObject, backend: Backend
) -> None:
    traces, samples = data["a"].shape
    drawing = st.lists(st.integers(1, samples), min_size=traces, max_size=traces)
    optional = st.none() if samples > 1 else st.nothing()
    lengths = drawn.draw(optional | drawing.map(lambda counts: np.array(counts, dtype=int)))
    names = sorted(formula.variables)
    chosen: Any = data if names else np.empty((traces, samples, 0))
    if lengths is not None and names:
        for i, n in enumerate(lengths):
            data[names[0]][i, n:] = NAN
    found = evaluate(formula, chosen, lengths=lengths, backend=backend)
    assert found.shape == (traces, samples)
    for i in range(traces):
        n = samples if lengths is None else int(lengths[i])
        alone = {name: data[name][i, :n] for name in names}
        expected = evaluate(formula, alone, n=n, backend=backend)
        assert identical(found[i, :n], expected)
        assert np.isnan(found[i, n:]).all()


@given(formula=formulas(depth=2, total=False, endless=True), data=tables((*INFINITIES, NAN)))
def test_nan_is_held_within_its_trace(
    formula: Formula, data: dict[str, np.ndarray[Any, Any]], backend: Backend
) -> None:
    if not formula.variables:
        return
    for values in data.values():
        values[:, 0] = np.nan_to_num(values[:, 0])
    lengths = np.full(len(data["a"]), data["a"].shape[1])
    found = evaluate(formula, data, lengths=lengths, nan="hold", backend=backend)
    for i, row in enumerate(found):
        alone = {name: values[i] for name, values in data.items()}
        assert row.tolist() == evaluate(formula, alone, nan="hold", backend=backend).tolist()


def test_an_array_has_its_columns_in_the_order_of_the_variables(backend: Backend) -> None:
    rng = np.random.default_rng(0)
    data = rng.normal(size=(3, 20, 2))
    found = evaluate("always[0:1s](x > y)", data, "500ms", backend=backend)
    expected = [evaluate("always[0:1s](x > y)", each, "500ms") for each in data]
    assert np.array_equal(found, expected)
    for same in (np.asfortranarray(data), data[:, ::-1][:, ::-1], data.tolist()):
        assert np.array_equal(evaluate("always[0:1s](x > y)", same, "500ms"), found)


def test_interface_aware_semantics_are_those_of_evaluate(backend: Backend) -> None:
    text = "always(req >= 3 implies eventually[0:5](gnt >= 3))"
    data = {"req": [[4, 0, 0], [2, 0, 0]], "gnt": [[0, 1, 1], [0, 0, 0]]}
    arguments: dict[str, Any] = {"inputs": ["req"], "outputs": ["gnt"], "backend": backend}
    for semantics in ("output-robustness", "input-vacuity"):
        found = evaluate(text, data, semantics=semantics, **arguments)
        for i in range(2):
            alone = {name: values[i] for name, values in data.items()}
            expected = evaluate(text, alone, semantics=semantics, **arguments)
            assert found[i].tolist() == expected.tolist()
