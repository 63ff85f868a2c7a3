"""Specifications: horizon, variables, text, other results, scales and requirements."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import formulas

import rtamt
from rtamt import EpisodeMonitor, Formula, Specification, parse, variable
from rtamt.errors import ParseError, SpecificationError
from rtamt.language.formula import make
from rtamt.language.operators import OPERATORS

x, y = variable("x"), variable("y")
p, q = x > 0, y > 0


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
        ("G rate(x) <= 1", math.inf),
        ("G[0:3] rate(x) <= 1", 3),
        ("abs(rate(x)) <= 1 implies F[0:4] x", 4),
        ("p = G x\ny > 0", 0),
        ("not G[0:5] x -> F[0:6] y xor next z iff z", 6),
    ],
)
def test_horizon(text: str, horizon: float) -> None:
    assert rtamt.parse(text).horizon == horizon


@pytest.mark.parametrize("name", OPERATORS)
def test_every_operator_has_a_horizon(name: str) -> None:
    row = OPERATORS[name]
    operand = x if row.operands == "term" else x > 0
    node = make(name, (operand,) * row.arity[0])
    formula = node if isinstance(node, Formula) else node > 0
    ahead = math.inf if row.timed else 1  # without an interval, to the end
    assert rtamt.parse(str(formula)).horizon == (ahead if row.future else 0)


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


def test_a_loaded_specification_keeps_its_path(tmp_path: Path) -> None:
    text = "const float K = 1\na = x > K\nb = y > K"
    path = tmp_path / "two.stl"
    path.write_text(text, encoding="utf-8")
    spec = rtamt.load(path)
    assert spec == rtamt.parse(text)
    assert rtamt.parse(text).path is None
    filled = rtamt.language.SpecificationTemplate(spec).at({"K": 2})
    parts = spec.requirements.values()
    for known in (spec, filled, *parts, *(pickle.loads(pickle.dumps(part)) for part in parts)):
        assert known.path == str(path)
    assert spec.always().path is None  # its text is canonical


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


TEXTS = (
    "always(x > 0) and always(x < 9)",
    "input float x; output float y; always(x > 0 implies eventually[0:2](y > 0))",
    "a = x > 0; b = always(a) and eventually(y > 1)",
    "a = x > 0; always(a) and a",
    "specification s; const float c = 3; a = x > c; b = not a",
    "a = always(x > 0); a",
)


def parts(spec: Specification) -> list[Formula]:
    return [node for node in spec.formula.nodes() if isinstance(node, Formula)]


@pytest.mark.parametrize("text", TEXTS)
def test_text_and_pickle_are_equal(text: str) -> None:
    spec = parse(text)
    for part in parts(spec):
        for other in (
            spec.with_result(part),
            spec.with_result(~part),
            spec.with_result(part).always(),
        ):
            assert parse(other.text) == other
            assert pickle.loads(pickle.dumps(other)) == other
            assert other.declarations == spec.declarations
        assert spec.with_result(part).formula is part


def test_with_result_clears_requirement() -> None:
    spec = parse("a = always(x > 0); b = always(y > 0)").requirements["a"]
    (part,) = spec.formula.args
    assert isinstance(part, Formula)
    other = spec.with_result(part)
    assert other.variables == ("x",)
    assert pickle.loads(pickle.dumps(other)) == other


@given(formulas(3), st.sampled_from(["s", "ms", "us", "ns"]))
def test_standalone_text_needs_no_unit(formula: rtamt.Formula, unit: str) -> None:
    spec = rtamt.parse(str(formula), unit=unit)
    read = rtamt.parse(str(spec.standalone()))
    period = Fraction(1, {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit])

    def latency(spec: Specification) -> int | None:
        return EpisodeMonitor(spec, period=period).program.latency

    assert latency(read) == latency(spec)
    assert read.in_words() == formula.in_words(unit=unit)


def test_seconds_stay_unsaid_and_what_is_said_stays() -> None:
    text = "always[0:2](x < 1 implies once[0:5ms](y > 2))"
    assert str(rtamt.parse(text).standalone()) == text
    text = str(rtamt.parse(text, unit="us").standalone())
    assert text == "always[0:2us](x < 1 implies once[0:5ms](y > 2))"


FORMULAS = [
    "always(x < 3) implies eventually[0:4](y > x + 2)",
    "(x >= 1 and y == 2) until[0:3] (x != y or not (y <= 1))",
    "historically[0:2](x > 0) xor (x since y < 4)",
    "always(x * y >= 2 and abs(x) < 3 and true)",
    "rise(x > 0) iff prev(x > 0)",
]
NUMBERS = st.integers(-4, 4).map(float)


@given(
    text=st.sampled_from(FORMULAS),
    rows=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=9),
    data=st.data(),
)
def test_it_holds_where_the_formula_holds(
    text: str, rows: list[tuple[float, float]], data: st.DataObject
) -> None:
    spec = rtamt.parse(text)
    drawn = st.sampled_from([0.001, 0.3, 1.0, 7.0, 1000.0])
    scales = {predicate: data.draw(drawn) for predicate in spec.predicates()}
    first, second = np.array(rows).T
    plain = rtamt.evaluate(spec, {"x": first, "y": second})
    scaled = rtamt.evaluate(spec.scaled(scales), {"x": first, "y": second})
    np.testing.assert_array_equal(np.signbit(scaled), np.signbit(plain))


def test_each_predicate_counts_in_its_scale() -> None:
    spec = rtamt.parse("always(x < 30 and y > 1)")
    low, high = spec.predicates()
    trace = {"x": [0.0, 20.0], "y": [3.0, 4.0]}
    scaled = spec.scaled({low: 10.0})
    assert rtamt.evaluate(spec, trace)[0] == 2.0
    assert rtamt.evaluate(scaled, trace)[0] == 1.0
    assert rtamt.evaluate(spec.scaled({low: 10.0, high: 4.0}), trace)[0] == 0.5
    assert spec.scaled({}).formula is spec.formula
    assert scaled.predicates()[1] is high


def test_a_term_that_is_a_formula_is_divided() -> None:
    spec = rtamt.parse("always(x) and y")
    scales = dict.fromkeys(spec.predicates(), 2.0)
    assert str(spec.scaled(scales)) == "always(x / 2) and y / 2"


def test_predicates_are_listed_once_in_order() -> None:
    spec = rtamt.parse("always(b > 1) and eventually(a < 2 or b > 1) and true")
    assert list(map(str, spec.predicates())) == ["b > 1", "a < 2"]
    assert rtamt.parse("true").predicates() == ()


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (0, "expected a positive scale of x > 1, got 0"),
        (-2.5, "expected a positive scale of x > 1, got -2.5"),
        (math.inf, "expected a finite number in a term, got inf; write true or false for +-inf"),
        (math.nan, "expected a finite number in a term, got nan; write true or false for +-inf"),
    ],
)
def test_a_scale_is_positive_and_finite(scale: float, message: str) -> None:
    spec = rtamt.parse("always(x > 1)")
    with pytest.raises(rtamt.SpecificationError) as caught:
        spec.scaled({spec.predicates()[0]: scale})
    assert str(caught.value) == message


def test_a_scale_belongs_to_a_predicate_of_the_formula() -> None:
    spec = rtamt.parse("always(x > 1)")
    with pytest.raises(rtamt.SpecificationError) as caught:
        spec.scaled({spec.formula: 2.0})
    assert str(caught.value) == "expected scales of predicates of always(x > 1), got always(x > 1)"


HEADER = "const float LIMIT = 0.5\ninput float x = 1\noutput float y\n"

_SHAPES = (
    ("{p}", 1),
    ("always(x > LIMIT)", 0),
    ("x - y", 0),
    ("always[0:2]({p})", 1),
    ("{p} and {q}", 2),
    ("(x > 0 and {p}) and y > LIMIT", 1),
    ("{p} until[0:3] (abs({q}) < 1)", 2),
)


@st.composite
def statements(draw: st.DrawFn) -> dict[str, tuple[str, set[str]]]:
    """Formulas by name, ``""`` without a name: their text, and the names in it."""
    drawn: dict[str, tuple[str, set[str]]] = {}
    # "t0" and so on are values of terms, so that abs() accepts them.
    values = ["t0"]
    drawn["t0"] = ("x + 2 * y", set())
    for count in range(draw(st.integers(1, 5))):
        shape, operands = draw(st.sampled_from(_SHAPES))
        used = {
            "p": draw(st.sampled_from([*drawn])) if operands else "",
            "q": draw(st.sampled_from(values)) if operands > 1 else "",
        }
        drawn[f"f{count}"] = (shape.format(**used), set(filter(None, used.values())))
        if shape == "x - y":
            values.append(f"f{count}")
    if draw(st.booleans()):
        drawn[""] = drawn.popitem()[1]
    return drawn


def written(drawn: Mapping[str, tuple[str, set[str]]]) -> str:
    lines = [f"{name} = {text}" if name else text for name, (text, _) in drawn.items()]
    return HEADER + "\n".join(lines)


@given(statements())
def test_requirements_match_separate_texts(
    drawn: dict[str, tuple[str, set[str]]],
) -> None:
    spec = rtamt.parse(written(drawn))
    formulas = {name: rtamt.parse(written(_with(drawn, name))).formula for name in drawn}
    roots = [name for name in drawn if not any(name in used for _, used in drawn.values())]
    if any(formulas[root] is formulas.get("") for root in roots[:-1]):
        roots.remove("")  # the last formula is a requirement that has a name
    results = spec.requirements
    assert [requirement.formula for requirement in results.values()] == [formulas[r] for r in roots]
    for root, (name, requirement) in zip(roots, results.items(), strict=True):
        separate = rtamt.parse(written(_with(drawn, root)))
        if requirement is not spec:  # one alone has all formulas
            assert requirement.formulas == separate.formulas
        assert requirement.variables == separate.variables
        assert requirement.constants == spec.constants
        assert requirement.declarations == spec.declarations
        assert name == root or not root
        assert list(requirement.requirements) == [name]


def _with(drawn: Mapping[str, tuple[str, set[str]]], root: str) -> dict[str, tuple[str, set[str]]]:
    """The statements that a formula needs; the formula comes last."""
    needed, todo = {root}, [root]
    while todo:
        todo += drawn[todo.pop()][1] - needed
        needed.update(todo)
    return {name: each for name, each in drawn.items() if name in needed}


@given(statements())
def test_text_and_pickles_keep_requirements(
    drawn: dict[str, tuple[str, set[str]]],
) -> None:
    spec = rtamt.parse(written(drawn))
    again = rtamt.parse(str(spec))
    assert again == spec
    assert list(again.requirements) == list(spec.requirements)
    for name, requirement in spec.requirements.items():
        assert rtamt.parse(str(requirement)) == requirement
        assert list(rtamt.parse(str(requirement)).requirements) == [name]
        for copied in (pickle.loads(pickle.dumps(requirement)), copy.deepcopy(requirement)):
            assert copied == requirement
            assert copied.formula is requirement.formula
            assert copied.requirement == requirement.requirement


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # A single requirement has the name of the text, of the result, or "spec", in this order.
        ("always(x > 0)", {"spec": "always(x > 0)"}),
        ("a = always(x > 0)", {"a": "always(x > 0)"}),
        ("specification s; a = always(x > 0)", {"s": "always(x > 0)"}),
        ("a = x > 0; always(a)", {"spec": "always(x > 0)"}),
        # A formula uses the formulas that it names.
        ("a = x > 0; b = a", {"b": "x > 0"}),
        ("a = x > 0; a", {"a": "x > 0"}),
        ("a = x > 0; b = always(x > 0)", {"a": "x > 0", "b": "always(x > 0)"}),
        ("a = always(x > 0); b = always(x > 0)", {"a": "always(x > 0)", "b": "always(x > 0)"}),
        (
            "a = x > 0 and y > 0; b = always(a and z > 0)",
            {"b": "always(x > 0 and y > 0 and z > 0)"},
        ),
        ("d = x - y; b = always(abs(d) < 1)", {"b": "always(abs(x - y) < 1)"}),
        # A last formula without a name has the name of the text, or "spec" if that is free.
        ("a = always(x > 0); always(y > 0)", {"a": "always(x > 0)", "spec": "always(y > 0)"}),
        (
            "specification s; a = always(x > 0); always(y > 0)",
            {"a": "always(x > 0)", "s": "always(y > 0)"},
        ),
        (
            "specification a; a = always(x > 0); spec = always(z > 0); always(y > 0)",
            {"a": "always(x > 0)", "spec": "always(z > 0)", "spec2": "always(y > 0)"},
        ),
        # It is not a second requirement if it equals a named one.
        ("a = always(x > 0); always(x > 0)", {"a": "always(x > 0)"}),
        ("a = x > 0; b = y > 0; a", {"b": "y > 0", "a": "x > 0"}),
    ],
)
def test_names_of_requirements(text: str, expected: dict[str, str]) -> None:
    results = rtamt.parse(text).requirements
    assert {name: str(requirement.formula) for name, requirement in results.items()} == expected
    assert list(results) == list(expected)


def test_a_requirement_alone_is_the_specification_itself() -> None:
    spec = rtamt.parse("near = abs(x) < 1; always(near)")
    assert spec.requirements["spec"] is spec
    from_python = Specification.of(rtamt.variable("x") > 0)
    assert dict(from_python.requirements) == {"spec": from_python}
    assert dict(spec.always().requirements) == {"spec": spec.always()}


def test_requirements_are_read_only() -> None:
    spec = rtamt.parse("a = always(x > 0); b = always(y > 0)")
    with pytest.raises(TypeError, match="does not support item assignment"):
        spec.requirements["c"] = spec  # type: ignore[index]  # this is what is refused


def test_requirement_error_place() -> None:
    spec = rtamt.parse("a = always(x > 0)\nb = always[0:0.25](y > 0)\nc = always(b)")
    assert list(spec.requirements) == ["a", "c"]
    with pytest.raises(rtamt.ParseError) as caught:
        rtamt.EpisodeMonitor(spec.requirements["c"], period=0.1)
    assert (caught.value.line, caught.value.column) == (2, 11)


def test_always_changes_one_requirement() -> None:
    spec = rtamt.parse("a = x > 0; b = y > 0; c = z > 0")
    lasting = spec.requirements["b"].always()
    assert {n: str(r.formula) for n, r in lasting.requirements.items()} == {"spec": "always(y > 0)"}
    assert pickle.loads(pickle.dumps(lasting)).formula is lasting.formula
