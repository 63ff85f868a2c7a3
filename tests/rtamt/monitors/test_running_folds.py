"""Only a formula that is itself `always p` or `eventually p` is folded over the samples so far."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from strategies import Trace, formulas, length, traces

import rtamt
from rtamt import Formula, SpecificationError

HIDDEN = [
    ("F[0:0](eventually(x > 0))", "eventually"),
    ("x > 0 until[0:0] (eventually(x > 0))", "eventually"),
    ("historically[0:0](always(x > 0))", "always"),
    ("once[0:0](eventually(x > 0))", "eventually"),
    ("x > 0 since[0:0] (always(x > 0))", "always"),
    ("p = always(x > 0)\nG[0:0] p", "always"),
    ("p = F[0:0](eventually(x > 0))\neventually(x > 0)", "eventually"),
    ("p = eventually(0 < x)\neventually(x > 0)", "eventually"),
    ("always[0:0](historically[0:0](eventually(x > 0)))", "eventually"),
]
MAKERS: dict[str, Callable[[str], object]] = {
    "Monitor": rtamt.Monitor,
    "VectorMonitor": lambda text: rtamt.VectorMonitor(text, 2),
    "DenseMonitor": rtamt.DenseMonitor,
}


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize(("text", "symbol"), HIDDEN)
def test_one_below_a_window_of_one_sample_is_refused(name: str, text: str, symbol: str) -> None:
    with pytest.raises(SpecificationError) as caught:
        MAKERS[name](text)
    reason, *_, hint = str(caught.value).splitlines()
    monitor, instead = "Monitor", "EpisodeMonitor or evaluate()"
    if name == "DenseMonitor":
        monitor, instead = "DenseMonitor", "evaluate_dense()"
    assert reason.partition(": ")[2] == (
        f"'{symbol}' without an end needs the whole future, for which {monitor} cannot wait"
    )
    assert hint == f"  hint: write an end, as in {symbol}[0:10], or use {instead}"


@pytest.mark.parametrize(
    "text",
    [
        "always(x > 0)",
        "always[0:inf](x > 0)",
        "p = always(x > 0)\np",
    ],
)
def test_one_at_the_root_is_folded(text: str) -> None:
    fold = max if "eventually" in text else min
    monitor = rtamt.Monitor(text)
    values = [3.0, -1.0, 5.0]
    expected = [fold(values[: i + 1]) for i in range(3)]
    assert [monitor.update(x) for x in values] == expected
    assert all(value == expected[-1] for value in monitor.values.values())


@given(formulas(2, endless=True), traces())
def test_no_formula_below_a_window_of_one_sample_is_folded(formula: Formula, trace: Trace) -> None:
    wrapped = formula.always().eventually(0, 0)
    with pytest.raises(SpecificationError, match="without an end needs the whole future"):
        rtamt.Monitor(wrapped)
    n = length(trace)
    whole = rtamt.evaluate(wrapped, trace, n=n)
    np.testing.assert_array_equal(whole, rtamt.evaluate(formula.always(), trace, n=n))
    assert not np.isnan(whole).any()
    assert whole[0] <= math.inf
