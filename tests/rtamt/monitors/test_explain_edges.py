"""Explanations of zeros, of very long formulas, of terms without a value, of very long times."""

import math
import sys

import pytest

from rtamt import evaluate, explain, holds


def test_of_a_zero_it_is_said_whether_the_formula_holds() -> None:
    assert str(explain("not (a > 3) and a >= -0.0", {"a": [3]})) == (
        "robustness 0, holds, at sample 0, decided by a > 3 at sample 0\n"
        "\n"
        "      at        value  formula\n"
        "sample 0     0, holds  not (a > 3) and a >= -0\n"
        "sample 0     0, holds  not (a > 3)\n"
        "sample 0  0, violated  a > 3\n"
        "sample 0            3  a"
    )
    assert "0, violated, at sample 0" in str(explain("a > 0", {"a": [0]}))


def test_the_zero_that_decides_is_the_one_with_the_sign_of_the_whole() -> None:
    trace = {"a": [0, 0, 1], "b": [1, 0, 0]}
    explanation = explain("always(a >= 0 and (a >= 0 until[0:1] b > 0))", trace)
    assert [(s.text, s.sample) for s in explanation.steps][-1] == ("b > 0", 1)
    explanation = explain("eventually(a > 0 or b == 0)", {"a": [0, 0], "b": [1, 0]})
    assert [(s.text, s.sample) for s in explanation.steps][-1] == ("b == 0", 1)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("junction", ["and", "or"])
def test_a_formula_of_many_operands_is_explained(junction: str) -> None:
    count = 2 * sys.getrecursionlimit()
    text = f" {junction} ".join(f"x > {i}" for i in range(count))
    explanation = explain(text, {"x": [5]})
    decided = f"x > {count - 1}" if junction == "and" else "x > 0"
    assert [str(step.formula) for step in explanation.steps[1:]] == [decided]
    assert f"decided by {decided} at sample 0" in str(explanation)


def test_what_decides_nothing_may_have_no_value() -> None:
    text, trace = "sqrt(x) > 0 until[0:0] y > 0", {"x": [-1], "y": [1]}
    assert evaluate(text, trace).tolist() == [1.0]
    assert str(explain(text, trace)) == (
        "robustness 1 at sample 0, decided by y > 0 at sample 0\n"
        "\n"
        "      at  value  formula\n"
        "sample 0      1  sqrt(x) > 0 until[0:0] y > 0\n"
        "                   witness: the right side at sample 0\n"
        "sample 0      1  y > 0\n"
        "sample 0      1  y"
    )
    assert explain(f"({text}) and x < 0", trace).robustness == 1.0


def test_times_without_end_are_shown_in_all_digits_that_doubles_have() -> None:
    explanation = explain("x > 0", {"x": [1]}, period="1e-300", start=1e300)
    assert "decided by x > 0 at 1e+300 s" in str(explanation)
    explanation = explain("x > 0", {"x": [1, 1]}, period="1e-300", sample=1)
    assert "at 1e-300 s" in str(explanation)
    explanation = explain("x > 0", {"x": [1, 1]}, period=1e-9, start=1.7e9, sample=1)
    assert "at 1700000000 s" in str(explanation)


def test_a_zero_that_hangs_on_a_predicate_of_no_concern_neither_holds_nor_fails() -> None:
    text = "input float req; output float gnt; always(req >= 3 implies gnt >= 3)"
    explanation = explain(text, {"req": [3], "gnt": [0]}, semantics="input-vacuity")
    assert "robustness 0 at sample 0" in str(explanation)
    assert "holds" not in str(explanation)
    given = explain("x > 3", {"x": [3]}, semantics="boolean")
    assert given.robustness == -math.inf
    assert not holds(given.robustness)
    assert "counts only whether it holds" in str(given)


def test_a_formula_without_spaces_fills_its_lines_and_is_not_broken_at_a_minus() -> None:
    formula = f"{'abs(-' * 40}x{')' * 40}"
    first, second, *_ = str(explain(f"{formula} > 5", {"x": [1]})).splitlines()
    assert (len(first), len(second)) == (80, 80)
    assert f"decided by {formula}".startswith(first[first.index("decided") :] + second.strip())
