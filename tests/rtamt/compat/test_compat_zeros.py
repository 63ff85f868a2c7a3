"""The released classes give 0.0, never -0.0: programs print what they get."""

import math

import pytest
from compat_specs import LANGUAGES, declared
from hypothesis import given
from strategies import INTEGERS, Trace, formulas, length, traces

from rtamt import Formula, StlDenseTimeSpecification


def negative_zeros(values: list[float]) -> int:
    """How many of the values are -0.0."""
    return sum(value == 0 and math.copysign(1, value) < 0 for value in values)


@given(formula=formulas(), trace=traces(values=INTEGERS))
def test_no_sample_gives_a_zero_with_a_sign(formula: Formula, trace: Trace, backend: str) -> None:
    n = length(trace)
    spec = declared(formula, language=LANGUAGES[backend])
    spec.set_sampling_period(1, "s")
    pairs = spec.evaluate({"time": list(range(n)), **trace})
    assert negative_zeros([value for _, value in pairs]) == 0
    online = declared(formula, language=LANGUAGES[backend])
    given = [online.update(i, [(name, trace[name][i]) for name in trace]) for i in range(n)]
    assert negative_zeros(given) == 0


def dense(formula: str) -> StlDenseTimeSpecification:
    spec = StlDenseTimeSpecification()
    spec.declare_var("x", "float")
    spec.spec = formula
    spec.parse()
    return spec


@pytest.mark.parametrize("formula", ["x > 0", "not (x >= 0)", "x >= 0 and x > 0"])
def test_no_breakpoint_has_a_zero_with_a_sign(formula: str) -> None:
    events = [[0, 0], [1, 1], [2, 0], [3, 0]]
    values = [value for _, value in dense(formula).evaluate(["x", events])]
    assert 0.0 in values
    assert negative_zeros(values) == 0
    online = dense(formula)
    told = [value for _, value in online.update(["x", events]) + online.final_update(["x", []])]
    assert 0.0 in told
    assert negative_zeros(told) == 0


def test_a_step_from_one_zero_to_the_other_is_none_to_these_classes() -> None:
    text = "(x >= 0 and x < 5) or (x - 5 > 0)"
    pairs = dense(text).evaluate(["x", [[0, 0], [1, 5], [2, 7], [3, 7]]])
    assert pairs[:2] == [[0.0, 0.0], [2.0, 2.0]]
