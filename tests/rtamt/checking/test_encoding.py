"""Truths of programs on unknown samples, against `judge` and longer traces."""

import itertools
import math
from typing import cast, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import Trace, formulas, length, traces

import rtamt
from rtamt import Formula, holds, judge, parse
from rtamt.checking.answers import ExampleTrace
from rtamt.checking.encoding import change_times, truth, truth_of_runs
from rtamt.checking.graph import (
    FALSE,
    TRUE,
    Graph,
    KnownTrace,
    TermKey,
    exact_sides,
    function_of,
    known_samples,
    unknown_samples,
)
from rtamt.checking.search import Goal, TracePool, reaches
from rtamt.checking.simplify import Plainness, simplified
from rtamt.language.specification import Specification
from rtamt.machines.protocols import End, World, worlds_of
from rtamt.program.algebra import FUNCTIONS
from rtamt.program.lowering import compile_program


def actual(formula: Formula, trace: Trace, world: World, loop: int = 0) -> bool:
    program = compile_program(Specification.of(formula))
    samples, n = known_samples(trace), length(trace)
    answer = truth(Graph(), samples, program, n, world, loop)
    assert answer in {TRUE, FALSE}  # nothing is undecided
    return answer == TRUE


@given(formula=formulas(depth=3, endless=True), trace=traces(most=6))
def test_truths_are_the_signs_of_the_bounds(formula: Formula, trace: Trace) -> None:
    for end in get_args(End):
        lower, upper = worlds_of(end)
        judged = judge(formula, trace, end=end, n=length(trace))
        assert actual(formula, trace, lower) == holds(judged.lower), end
        assert actual(formula, trace, upper) == holds(judged.upper), end


@given(formula=formulas(depth=2), trace=traces(most=5), data=st.data())
def test_repeating_trace_matches_a_long_trace(
    formula: Formula, trace: Trace, data: st.DataObject
) -> None:
    n = length(trace)
    loop = data.draw(st.integers(1, n))
    # The windows of these formulas reach at most 6 samples and are nested four deep.
    longer = {name: v + v[n - loop :] * (40 // loop + 1) for name, v in trace.items()}
    judged = judge(formula, longer, end="complete", n=length(longer))
    assert actual(formula, trace, World.NOW, loop) == holds(judged.robustness)


def test_endless_and_complete_traces_differ() -> None:
    trace = {"a": [1.0, -1.0]}
    both = parse("always(eventually[1:2](a > 0) and eventually[1:2](a < 0))").formula
    assert actual(both, trace, World.NOW, 2)
    assert not actual(both, trace, World.NOW, 1)
    assert not actual(both, trace, World.NOW)
    again = parse("always(eventually(a > 0)) and not eventually(always(a < 0))").formula
    assert actual(again, trace, World.NOW, 2)
    assert not actual(again, trace, World.NOW, 1)


def test_unbounded_folds_match_a_longer_trace() -> None:
    trace = {"a": [1.0, -1.0, 2.0, -1.0, -1.0, 3.0]}
    longer = {"a": trace["a"] + trace["a"][4:] * 20}
    for text in (
        "eventually[12:13](historically(a > -2))",
        "always[9:14](once(a > 2) and historically(a < 3))",
        "always[3:4](eventually(a > 2)) and eventually(a > 2)",
        "always[4:9](a since[3:inf] a > 1) or next(eventually[2:inf](a > 2))",
    ):
        formula = parse(text).formula
        for negated in (formula, ~formula):
            judged = judge(negated, longer, end="complete")
            assert actual(negated, trace, World.NOW, 2) == holds(judged.robustness), text


def test_nan_terms_are_unknown_on_known_traces() -> None:
    graph = Graph()
    program = compile_program(parse("sqrt(x) > 2"))
    goal = truth(graph, unknown_samples(graph), program, 1, World.NOW)
    for value, above, below in ((9.0, True, False), (1.0, False, True), (-1.0, False, False)):
        known = KnownTrace(graph, lambda *_, value=value: value)
        assert known.fulfils([goal]) is above
        assert known.fulfils([graph.no(goal)]) is below
    assert function_of("sqrt")(-1.0) != function_of("sqrt")(-1.0)  # nan


def test_the_newest_200_traces_are_known() -> None:
    pool = TracePool(Graph(), lambda _: 0.0)
    for value in range(203):
        pool.add({"x": (float(value),)})
    assert [columns["x"] for columns, _ in pool.of_length(1)] == [
        (float(value),) for value in range(202, 2, -1)
    ]


def test_trace_with_nan_term_reaches_no_goal() -> None:
    program = compile_program(parse("sqrt(x) > 2"))
    for value, expected in ((9.0, (True, False)), (1.0, (False, True)), (-1.0, (False, False))):
        for loop in (0, 1):
            trace = ExampleTrace({"x": (value,)}, 1, loop)
            actual_values = tuple(
                reaches(trace, [Goal(program, holds)], None, "complete") for holds in (True, False)
            )
            assert actual_values == expected, (value, loop)


def test_simplified_trace_keeps_truths() -> None:
    graph = Graph()
    spec = parse("sqrt(x) < 2")
    goal = truth(graph, unknown_samples(graph), compile_program(spec), 2, World.NOW, loop=1)
    plainness = Plainness([spec.formula], frozenset(), {})
    assert -2.0 in plainness.of("x")  # sqrt(x) is undefined there
    trace = ExampleTrace({"x": (3.25, 3.25)}, 2, 1)
    assert simplified(trace, graph, [goal], plainness).columns["x"][0] in {0.0, 1.0, 2.0}
    assert simplified(trace, graph, [graph.no(goal)], plainness) == trace


def test_long_traces_are_simplified() -> None:
    graph = Graph()
    spec = parse("always[0:38](x > 3 iff next(x <= 3))")
    program = compile_program(spec)
    goal = truth(graph, unknown_samples(graph), program, 40, World.NOW)
    before = ExampleTrace({"x": (7.625, -2.375) * 20}, 40, 0)
    actual = simplified(before, graph, [goal], Plainness([spec.formula], frozenset(), {}))
    assert judge(spec, actual.columns).robustness > 0
    assert {*actual.columns["x"]} == {0.0, 4.0}


VALUES = st.sampled_from([-1.0, -0.0, 0.0, 1.0, 2.5])


@given(formula=formulas(depth=3, endless=True), data=st.data())
def test_truths_of_runs_are_those_of_all_samples(formula: Formula, data: st.DataObject) -> None:
    lengths = data.draw(st.lists(st.integers(1, 5), min_size=1, max_size=4))
    times = [0, *itertools.accumulate(lengths[:-1])]
    columns: dict[str, list[float]] = {}
    for name in formula.variables:
        runs = [data.draw(VALUES) for _ in lengths]
        columns[name] = [value for value, n in zip(runs, lengths, strict=True) for _ in range(n)]
    program = compile_program(Specification.of(formula))
    actual = truth_of_runs(Graph(), known_samples(columns), program, times)
    expected = truth(Graph(), known_samples(columns), program, sum(lengths), World.NOW, loop=1)
    assert actual in {TRUE, FALSE}
    assert actual == expected


@pytest.mark.parametrize(
    ("text", "times"),
    [
        ("x > 0", [[0], [0, 1]]),
        ("always[0:100](x > 0)", [[0], [0, 1, 100, 101], [0, 1, 50, 100, 101]]),
        ("eventually[10:40](always[0:100](x > 0))", [[0], [0, 1, 10, 11, 40, 41, 110, 111, 140]]),
    ],
)
def test_traces_change_where_windows_begin_and_end(text: str, times: list[list[int]]) -> None:
    program = compile_program(parse(text))
    actual = [*map(list, change_times([program], 141))]
    assert actual[: len(times)] == times
    assert all(row == sorted({*row}) and row[-1] < 141 for row in actual)


def test_a_trace_of_one_sample_does_not_change() -> None:
    assert [*change_times([compile_program(parse("always[0:100](x > 0)"))], 1)] == [(0,)]


def test_of_many_corners_some_are_tried() -> None:
    text = "x > 0"
    for power in range(9):
        text = f"eventually[{2**power}:{3**power + 2**power}]({text})"
    program = compile_program(parse(text))
    most = 1 + sum(3**power + 2**power for power in range(9))
    actual = [*map(list, change_times([program], most))]
    assert actual[0] == [0]
    assert all(row == sorted({*row}) and row[-1] < most for row in actual)
    assert 64 <= len(actual[1]) <= 129
    assert actual[1][-1] > most // 2


X: TermKey = ("load", "x", 0)
Y: TermKey = ("load", "y", 0)
DOUBLES = [
    *(0.0, -0.0, 5e-324, -5e-324, 2.0**-1022 - 5e-324, 2.0**-1022, 2.0**-1021),
    *(0.5, -0.5, 1.0, 3.0, math.nextafter(0.5, 0), 1.7976931348623157e308, -1.7976931348623157e308),
]
TERMS: list[TermKey] = [
    *(("sub", X, Y), ("add", X, Y), ("neg", X)),
    *((f, X, ("const", k)) for f in ("mul", "div") for k in (2.0, 0.5, -4.0, 3.0, 2.0**-1000)),
    *(("mul", ("const", 2.0), ("sub", X, Y)), ("neg", ("mul", ("const", -2.0), X))),
]


def value(term: TermKey, x: float, y: float) -> float:
    function, *parts = term
    if function == "load":
        return x if parts[0] == "x" else y
    if function == "const":
        return cast("float", parts[0])
    operands = (value(cast("TermKey", part), x, y) for part in parts)
    return FUNCTIONS[cast("str", function)].apply(*operands)


@pytest.mark.parametrize("term", TERMS, ids=str)
def test_exact_sides_compare_as_before(term: TermKey) -> None:
    for number, turned in itertools.product(DOUBLES, (False, True)):
        sides = (("const", number), term) if turned else (term, ("const", number))
        exact = exact_sides(*sides)
        for x, y in itertools.product(DOUBLES, DOUBLES):
            a, b = (value(side, x, y) for side in sides)
            c, d = (value(side, x, y) for side in exact)
            assert (a >= b, a == b) == (c >= d, c == d), (number, x, y, exact)


@pytest.mark.parametrize(
    ("one", "other", "answer"),
    [
        ("2 * x > 1", "x > 0.5", "yes"),
        ("x - y > 0", "x > y", "yes"),
        ("0 <= x - y", "not (x < y)", "yes"),
        ("-4 * x == 2", "x == -0.5", "yes"),
        ("always(2 * (x - y) > 0)", "always(x > y)", "yes"),
        ("x + y > 0", "x > -y", "yes"),
        ("x / 4 > 1", "x > 4", "yes"),
        # Half of the smallest double above 0 is 0; 3 * x and x - y are rounded.
        ("0.5 * x > 0", "x > 0", "unknown"),
        ("3 * x > 1.5", "x > 0.5", "unknown"),
        ("x - y > 1", "x > y + 1", "unknown"),
        ("2 * x > 1", "x > 0.6", "no"),
    ],
)
def test_equivalence_of_exact_terms(one: str, other: str, answer: str) -> None:
    pytest.importorskip("z3")
    assert rtamt.equivalent(one, other).answer == answer
