"""Formulas as values: equality, text and pickles."""

from __future__ import annotations

import copy
import functools
import math
import pickle
import sys
from fractions import Fraction
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import formulas

import rtamt
from rtamt import Formula, Interval, Term, conjunction, disjunction, number, variable
from rtamt.errors import SpecificationError
from rtamt.language.formula import make
from rtamt.language.interval import UNITS, exact
from rtamt.language.node import MAX_DEPTH, MAX_SIZE

x, y, z = (variable(name) for name in "xyz")
p, q, r = x > 0, y > 0, z > 0


def formula(text: str) -> Formula:
    return rtamt.parse(text).formula


# Trees. ------------------------------------------------------------------------------------------


def test_equal_trees_are_one_object() -> None:
    assert (x + 1 > y).always(0, 5) is (variable("x") + 1.0 > variable("y")).always("0", "5.0")
    assert hash(p & q) == hash(p & q)
    assert (p & q) is not (q & p)
    assert number(0.0) is not number(-0.0)


@pytest.mark.parametrize(
    ("example", "text"),
    [
        (p & q & r, "x > 0 and y > 0 and z > 0"),
        (p & (q & r), "x > 0 and y > 0 and z > 0"),
        (conjunction([p, q, r]), "x > 0 and y > 0 and z > 0"),
        (conjunction([p]), "x > 0"),
        (disjunction([p & q, r]), "x > 0 and y > 0 or z > 0"),
        ((p | q) & r, "(x > 0 or y > 0) and z > 0"),
        (~(p | q), "not (x > 0 or y > 0)"),
        (~~p, "not not (x > 0)"),
        (p.implies(q).implies(r), "(x > 0 implies y > 0) implies z > 0"),
        (p.implies(q.implies(r)), "x > 0 implies (y > 0 implies z > 0)"),
        (p.iff(q).iff(r), "x > 0 iff y > 0 iff z > 0"),
        (p.iff(q.iff(r)), "x > 0 iff (y > 0 iff z > 0)"),
        (p.xor(q).implies(r), "(x > 0 xor y > 0) implies z > 0"),
        (p.always(0, 5), "always[0:5](x > 0)"),
        (p.always(), "always(x > 0)"),
        (p.always(0, math.inf), "always(x > 0)"),
        (p.always(2), "always[2:inf](x > 0)"),
        (p.always(2, "inf ms"), "always[2:inf ms](x > 0)"),
        (p.eventually(0.1, "500ms"), "eventually[0.1:500ms](x > 0)"),
        (p.once(Fraction(1, 4), 1), "once[0.25:1](x > 0)"),
        (p.historically().always(), "always historically(x > 0)"),
        (p.until(q, 0, 3), "x > 0 until[0:3] y > 0"),
        (p.since(q).unless(r), "(x > 0 since y > 0) unless z > 0"),
        (p.next().prev(), "prev next(x > 0)"),
        (p.next(strong=True).prev(strong=True), "s_prev s_next(x > 0)"),
        (p.rise() | p.fall(), "rise(x > 0) or fall(x > 0)"),
        (x.formula(), "x"),
        (x.formula().always(), "always(x)"),
        ((-x).formula().always(), "always(-x)"),
        ((x + y - z) * 2 / x >= 1, "(x + y - z) * 2 / x >= 1"),
        (1 / (2 / x) >= y, "1 / (2 / x) >= y"),
        (x - (y - z) < 1 - x, "x - (y - z) < 1 - x"),
        (x + (y + z) <= -3, "x + (y + z) <= -3"),
        (2 * x > 3 + y, "2 * x > 3 + y"),
        (cast("Term", make("neg", (-x,))) > x - -3, "-(-x) > x - -3"),
        (-(x * y) > -abs(x), "-(x * y) > -abs(x)"),
        ((x**2).sqrt().exp() > x.ln(), "exp(sqrt(pow(x, 2))) > ln(x)"),
        (x.log(10).min(y, 1).equals(x.max(y)), "min(log(x, 10), y, 1) == max(x, y)"),
        (x.differs(1e-300), "x != 1e-300"),
        (cast("Formula", make("true", ())) & p, "true and x > 0"),
        (~cast("Formula", make("true", ())), "not true"),
    ],
)
def test_text_has_the_fewest_brackets(example: Formula, text: str) -> None:
    assert str(example) == text
    assert formula(text) is example


numbers = st.floats(allow_nan=False, allow_infinity=False)
names = st.sampled_from(["a.b", "min", "rise"])
bounds = st.decimals(0, 10**9, places=6) | st.integers(0, 10**30)


@st.composite
def decorated(draw: st.DrawFn) -> Formula:
    """Formulas of every operator, with numbers and intervals that are hard to write."""
    inner = draw(formulas(depth=3, endless=True))
    begin, end = sorted((exact(draw(bounds), ""), exact(draw(bounds), "")))
    interval = Interval(
        begin,
        end if draw(st.booleans()) or begin == 0 else None,
        draw(st.sampled_from([None, *UNITS])),
    )
    name = draw(st.sampled_from(["always", "once", "until", "unless"]))
    limit = variable(draw(names)) + number(draw(numbers)) > -variable(draw(names))
    args = (inner,) if name in ("always", "once") else (inner, limit)
    return cast("Formula", make(name, args, interval)) & limit


@given(decorated() | formulas(depth=4, endless=True))
def test_text_reads_back_as_the_same_formula(example: Formula) -> None:
    assert formula(str(example)) is example


@given(decorated())
def test_pickles_and_copies_are_the_same_formula(example: Formula) -> None:
    assert pickle.loads(pickle.dumps(example)) is example
    assert copy.copy(example) is copy.deepcopy(example) is example


def test_terms_are_pickled_too() -> None:
    term = (x + 1) * -y
    assert pickle.loads(pickle.dumps(term)) is term
    assert isinstance(pickle.loads(pickle.dumps(x)), Term)


def test_nodes_are_frozen() -> None:
    with pytest.raises(AttributeError, match="Formula is frozen: make a new one instead"):
        p.depth = 3


def test_deepest_formula_prints_and_pickles() -> None:
    deep = p
    while deep.depth < MAX_DEPTH:
        deep = deep.implies(q)

    def down(calls: int) -> Formula:
        return down(calls - 1) if calls else cast("Formula", pickle.loads(pickle.dumps(deep)))

    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(1000)
    try:
        assert down(300) is deep
    finally:
        sys.setrecursionlimit(limit)
    with pytest.raises(SpecificationError, match="nested 201 deep; the limit is 200"):
        deep.always()


def test_a_formula_too_large_to_write_out_is_refused() -> None:
    large = p
    while large.size < MAX_SIZE // 2:
        large = large.implies(large)
    with pytest.raises(SpecificationError, match=f"nodes written out; the limit is {MAX_SIZE}"):
        large.implies(large)


def test_a_formula_of_a_million_nodes_is_the_largest() -> None:
    @functools.cache
    def of_size(nodes: int) -> Formula:
        if nodes < 7:
            return p if nodes == 3 else of_size(nodes - 1).always()
        return of_size((nodes - 1) // 2).implies(of_size(nodes // 2))

    assert of_size(1_000_000).size == 1_000_000
    with pytest.raises(SpecificationError) as caught:
        of_size(1_000_001)
    assert str(caught.value) == ("the formula has 1000001 nodes written out; the limit is 1000000")


def bad(example: object) -> Any:  # noqa: ANN401 - what the checker would refuse is refused when run
    return example


@pytest.mark.parametrize(
    ("make_it", "message"),
    [
        (lambda: bad(p) + 1, "unsupported operand type"),
        (lambda: make("+", (x, p)), "expected a term as operand of '+', got the formula x > 0"),
        (lambda: make("abs", (x, y)), "expected 1 operand for 'abs', got 2"),
        (lambda: make("not", (p,), Interval.of(0, 1)), "'not' takes no interval, got [0:1]"),
        (lambda: p.always(0, Fraction(1, 3)), "expected a decimal number, got 1/3"),
    ],
)
def test_what_is_no_formula_is_refused_when_it_is_made(make_it: Any, message: str) -> None:  # noqa: ANN401
    with pytest.raises((SpecificationError, TypeError)) as caught:
        make_it()
    assert str(caught.value).startswith(message)


@given(st.lists(st.tuples(st.booleans(), decorated()), min_size=1, max_size=4), st.booleans())
def test_specification_text_reads_back(
    parts: list[tuple[bool, Formula]],
    named: bool,  # noqa: FBT001
) -> None:
    lines = []
    for i, (reuse, example) in enumerate(parts):
        last = i == len(parts) - 1
        name = f"p{i} = " if named or not last else ""
        used = f"(p{i - 1}) implies " if reuse and i else ""
        lines.append(f"{name}{used}({example})")
    spec = rtamt.parse("\n".join(lines))
    again = rtamt.parse(str(spec))
    assert again == spec
    assert again.variables == spec.variables
    assert again.horizon == spec.horizon
    assert str(again) == str(spec)
    assert pickle.loads(pickle.dumps(spec)) == spec
