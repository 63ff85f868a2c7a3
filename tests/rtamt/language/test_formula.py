"""Formulas as values: equality, text, pickles; and what a specification says of itself."""

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
from rtamt import Formula, Interval, Specification, Term, conjunction, disjunction, number, variable
from rtamt.errors import InputTypeError, ParseError, SpecificationError
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
    ("made", "text"),
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
def test_text_has_the_fewest_brackets(made: Formula, text: str) -> None:
    assert str(made) == text
    assert formula(text) is made


numbers = st.floats(allow_nan=False, allow_infinity=False)
names = st.sampled_from(["a.b", "min", "rise"])
bounds = st.decimals(0, 10**9, places=6) | st.integers(0, 10**30)


@st.composite
def decorated(draw: st.DrawFn) -> Formula:
    """A formula of every operator, with numbers and intervals that are hard to write."""
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
def test_text_reads_back_as_the_same_formula(made: Formula) -> None:
    assert formula(str(made)) is made


@given(decorated())
def test_pickles_and_copies_are_the_same_formula(made: Formula) -> None:
    assert pickle.loads(pickle.dumps(made)) is made
    assert copy.copy(made) is copy.deepcopy(made) is made


def test_terms_are_pickled_too() -> None:
    term = (x + 1) * -y
    assert pickle.loads(pickle.dumps(term)) is term
    assert isinstance(pickle.loads(pickle.dumps(x)), Term)


def test_nodes_are_frozen() -> None:
    with pytest.raises(AttributeError, match="Formula is frozen: make a new one instead"):
        p.depth = 3


def test_deepest_formula_is_printed_and_pickled_deep_inside_a_program() -> None:
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


def bad(made: object) -> Any:  # noqa: ANN401 - what the checker would refuse is refused when run
    return made


@pytest.mark.parametrize(
    ("make_it", "message"),
    [
        (lambda: variable("a b"), "expected a name of letters, digits, '_' and dots, got 'a b'"),
        (lambda: variable("G"), "'G' is the operator 'always' and cannot name a variable"),
        (lambda: variable("a."), "expected a name of letters, digits, '_' and dots, got 'a.'"),
        (
            lambda: variable("größe"),
            "expected a name of letters, digits, '_' and dots, got 'größe'",
        ),
        (lambda: x > math.inf, "expected a finite number in a term, got inf; write true or false"),
        (lambda: x > bad("3"), "expected a real number, got str '3'"),
        (lambda: x > bad(3j), "expected a real number, got complex 3j"),
        (lambda: bool(p), "a formula has no truth value; use & | ~ instead of and, or, not"),
        (lambda: p & bad(3), "expected a formula as operand of 'and', got int 3"),
        (lambda: bad(p) + 1, None),
        (lambda: make("+", (x, p)), "expected a term as operand of '+', got the formula x > 0"),
        (lambda: make("abs", (x, y)), "expected 1 operand for 'abs', got 2"),
        (lambda: make("not", (p,), Interval.of(0, 1)), "'not' takes no interval, got [0:1]"),
        (lambda: p.always(2, 1), "expected a bound of at least 2, got 1"),
        (lambda: p.always(-1, 1), "expected a bound of at least 0, got -1"),
        (
            lambda: p.always(0, "5 d"),
            "expected one of the units s, ms, us, ns, ps, min, h, got 'd'",
        ),
        (lambda: p.always(0, math.nan), "expected a finite number for the end of an interval"),
        (lambda: p.always(0, Fraction(1, 3)), "expected a decimal number, got 1/3"),
        (lambda: p.always(0, bad([])), "expected a number for the end of an interval, got list []"),
    ],
)
def test_what_is_no_formula_is_refused_when_it_is_made(make_it: Any, message: str | None) -> None:  # noqa: ANN401
    with pytest.raises((SpecificationError, InputTypeError, TypeError)) as caught:
        make_it()
    assert message is None or str(caught.value).startswith(message)


# Specifications. ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "horizon"),
    [
        ("x > 0", 0),
        ("true", 0),
        ("G[0:5] x", 5),
        ("G[2:5] F[1:3] x", 8),
        ("G x", math.inf),
        ("F[3,) x", math.inf),
        ("H x", 0),
        ("O[1:3] G[0:5] x", 4),
        ("H[6:7] G[0:5] x", 0),
        ("x until[2:5] y", 5),
        ("(G[0:3] x) until[0:5] F[0:1] y", 8),
        ("(G[0:3] x) until[0:0] F[0:1] y", 1),
        ("(G[0:3] x) since[2:5] F[0:7] y", 5),
        ("(G[0:3] x) since[0:0] F[0:7] y", 7),
        ("x unless[0:5] y", 5),
        ("x until y", math.inf),
        ("next next x", 2),
        ("prev next x", 0),
        ("prev x", 0),
        ("rise(G[0:2] x) and fall(y)", 2),
        ("G[0:1ms] F[0:1us] x", 0.001001),
        ("p = G x\ny > 0", 0),
        ("not G[0:5] x -> F[0:6] y xor next z iff z", 6),
    ],
)
def test_horizon(text: str, horizon: float) -> None:
    assert rtamt.parse(text).horizon == horizon


def test_horizon_is_in_the_unit_of_the_specification() -> None:
    text = "G[0:1] F[0:500us] x"
    assert rtamt.parse(text).horizon == 1.0005
    assert rtamt.parse(text, unit="ms").horizon == 1.5
    assert rtamt.parse(text, unit="us").horizon == 501


@pytest.mark.parametrize(
    ("text", "looks_ahead", "timed"),
    [
        ("x > 0", False, False),
        ("once(x > 0)", False, False),
        ("once[0:5](x > 0)", False, True),
        ("always(x > 0)", True, False),
        ("next x", True, False),
        ("p = always[0:5](x > 0)\nx > 0", False, True),
        ("x until[0:inf] y", True, False),
    ],
)
def test_what_a_specification_needs(text: str, looks_ahead: bool, timed: bool) -> None:  # noqa: FBT001
    spec = rtamt.parse(text)
    assert (spec.looks_ahead, spec.timed) == (looks_ahead, timed)


def test_specifications_are_equal_if_they_say_the_same() -> None:
    spec = rtamt.parse("p = x>0;always  p")
    same = rtamt.parse("p = (x) > 0.0\n// so\nG(p)")
    assert spec == same
    assert hash(spec) == hash(same)
    for other in ("q = x > 0\nG q", "G(x > 0)", "float x; p = x > 0; G p", "p = x > 0\nF p"):
        assert spec != rtamt.parse(other)
    assert rtamt.parse("G[0:5] x") != rtamt.parse("G[0:5] x", unit="ms")
    assert spec != "p = x > 0"


def test_specification_of_a_formula() -> None:
    spec = Specification.of(p.until(q, 0, "5ms"))
    assert spec.text == str(spec) == "x > 0 until[0:5ms] y > 0"
    assert spec == rtamt.parse(spec.text) == pickle.loads(pickle.dumps(spec))
    assert spec.variables == ("x", "y")
    assert repr(spec) == "<Specification x > 0 until[0:5ms] y > 0>"


def test_text_of_a_specification_uses_its_names() -> None:
    text = """
        specification demo
        const float K = 0.5
        input float x = 1
        float y
        @ topic(x, a/b)
        near = x > K; also = always near; far = not near or y
        -x > 0
    """
    spec = rtamt.parse(text.replace("\n        -", ";-"))
    assert str(spec) == (
        "specification demo\nconst float K = 0.5\ninput float x = 1\nfloat y\n@ topic(x, a/b)\n"
        "near = x > 0.5\nalso = always(near)\nfar = not (near) or y;\n-x > 0"
    )
    assert rtamt.parse(str(spec)) == spec


def test_text_of_a_specification_calls_no_variable() -> None:
    spec = rtamt.parse("p = x > min; (x or p) and x")
    assert str(spec) == "p = x > min;\n(x or p) and x"
    assert rtamt.parse(str(spec)) == spec


@given(st.lists(st.tuples(st.booleans(), decorated()), min_size=1, max_size=4), st.booleans())
def test_text_of_a_specification_reads_back_as_an_equal_one(
    parts: list[tuple[bool, Formula]],
    named: bool,  # noqa: FBT001
) -> None:
    lines = []
    for i, (reuse, made) in enumerate(parts):
        last = i == len(parts) - 1
        name = f"p{i} = " if named or not last else ""
        used = f"(p{i - 1}) implies " if reuse and i else ""
        lines.append(f"{name}{used}({made})")
    spec = rtamt.parse("\n".join(lines))
    again = rtamt.parse(str(spec))
    assert again == spec
    assert again.variables == spec.variables
    assert again.horizon == spec.horizon
    assert str(again) == str(spec)
    assert pickle.loads(pickle.dumps(spec)) == spec


def test_pickles_keep_text_and_arguments() -> None:
    class Module:
        Twist = object

    text = "from m import Twist\nTwist cmd\nG[0:T] cmd.x > K"
    spec = rtamt.parse(text, unit="ms", constants={"T": "0.1", "K": 3}, modules={"m": Module})
    twin = pickle.loads(pickle.dumps(spec))
    assert twin == spec
    assert (twin.text, twin.unit, twin.imports) == (text, "ms", {"Twist": "m"})
    assert twin.overrides == {"T": Fraction(1, 10), "K": 3}
    assert twin.positions == spec.positions


def test_specifications_are_frozen() -> None:
    spec = rtamt.parse("p = x\np > 3")
    with pytest.raises(AttributeError):
        spec.text = ""  # type: ignore[misc]
    with pytest.raises(TypeError):
        cast("dict[str, Formula]", spec.formulas)["p"] = p


def test_error_about_a_node_has_its_place_in_the_text() -> None:
    spec = rtamt.parse("p = x > 0\nq = always[0:5] p\np and once q")
    (timed,) = (n for n in spec.formula.nodes() if n.interval is not None)
    error = spec.error(timed, "too long", "use less")
    assert isinstance(error, ParseError)
    assert str(error).splitlines() == [
        "STL:2:11: too long",
        "  q = always[0:5] p",
        "            ^",
        "  hint: use less",
    ]
    assert spec.positions[spec.formula] == (3, 3)
    assert spec.positions[x] == (1, 5)


def test_error_about_a_node_without_text_shows_the_node() -> None:
    spec = Specification.of(p.always(0, 5) & q)
    error = spec.error(p.always(0, 5), "too long", "use less")
    assert type(error) is SpecificationError
    assert str(error) == "too long\n  in always[0:5](x > 0)\n  hint: use less"
    assert str(spec.error(q, "so")) == "so\n  in y > 0"


def test_formulas_are_made_of_formulas_and_named_variables() -> None:
    with pytest.raises(rtamt.SpecificationError) as caught:
        rtamt.conjunction(["x > 0"])  # type: ignore[list-item]
    assert str(caught.value) == "expected a formula as operand of 'and', got str 'x > 0'"
    with pytest.raises(rtamt.InputTypeError) as unnamed:
        rtamt.variable(3)  # type: ignore[arg-type]
    assert str(unnamed.value) == "expected the name of a variable as text, got int 3"
    with pytest.raises(rtamt.SpecificationError) as unbounded:
        (rtamt.variable("x") > 0).always(0, "abc")
    assert str(unbounded.value) == "expected a finite number for the end of an interval, got 'abc'"
