"""Truths of programs in all worlds, against `judge` and against traces that are long enough."""

from hypothesis import given
from hypothesis import strategies as st
from strategies import Trace, formulas, length, traces

from rtamt import Formula, holds, judge, parse
from rtamt.checking.answers import ExampleTrace
from rtamt.checking.encoding import World, truth
from rtamt.checking.graph import FALSE, TRUE, Graph, function_of, known_samples, unknown_samples
from rtamt.checking.search import Goal, KnownTrace, TracePool, reaches
from rtamt.checking.simplify import Plainness, simplified
from rtamt.language.specification import Specification
from rtamt.machines.protocols import End
from rtamt.program.lowering import compile_program

ENDS: dict[End, tuple[World, World]] = {
    "complete": (World.COMPLETE, World.COMPLETE),
    "cut": (World.CUT_LOWER, World.CUT_UPPER),
    "open": (World.LOWER, World.UPPER),
}


def found(formula: Formula, trace: Trace, world: World, loop: int = 1) -> bool:
    program = compile_program(Specification.of(formula))
    samples, n = known_samples(trace), length(trace)
    answer = truth(Graph(), samples, program, n, world, loop)
    assert answer in {TRUE, FALSE}  # nothing is left open
    return answer == TRUE


@given(formula=formulas(depth=3, endless=True), trace=traces(most=6))
def test_truths_are_the_signs_of_the_bounds(formula: Formula, trace: Trace) -> None:
    for end, (lower, upper) in ENDS.items():
        judged = judge(formula, trace, end=end, n=length(trace))
        assert found(formula, trace, lower) == holds(judged.lower), end
        assert found(formula, trace, upper) == holds(judged.upper), end


@given(formula=formulas(depth=2), trace=traces(most=5), data=st.data())
def test_a_trace_that_repeats_is_as_one_that_is_long_enough(
    formula: Formula, trace: Trace, data: st.DataObject
) -> None:
    n = length(trace)
    loop = data.draw(st.integers(1, n))
    # Windows of these formulas reach 6 samples at most, four deep.
    longer = {name: v + v[n - loop :] * (40 // loop + 1) for name, v in trace.items()}
    judged = judge(formula, longer, end="complete", n=length(longer))
    assert found(formula, trace, World.ENDLESS, loop) == holds(judged.robustness)


def test_an_endless_trace_goes_on_where_one_that_ends_does_not() -> None:
    trace = {"a": [1.0, -1.0]}
    both = parse("always(eventually[1:2](a > 0) and eventually[1:2](a < 0))").formula
    assert found(both, trace, World.ENDLESS, 2)
    assert not found(both, trace, World.ENDLESS, 1)
    assert not found(both, trace, World.COMPLETE)
    again = parse("always(eventually(a > 0)) and not eventually(always(a < 0))").formula
    assert found(again, trace, World.ENDLESS, 2)
    assert not found(again, trace, World.ENDLESS, 1)


def test_folds_without_bounds_are_those_of_a_longer_trace() -> None:
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
            assert found(negated, trace, World.ENDLESS, 2) == holds(judged.robustness), text


def test_on_a_trace_on_which_a_term_is_no_number_nobody_knows() -> None:
    graph = Graph()
    program = compile_program(parse("sqrt(x) > 2"))
    asked = truth(graph, unknown_samples(graph), program, 1, World.COMPLETE)
    for value, above, below in ((9.0, True, False), (1.0, False, True), (-1.0, False, False)):
        known = KnownTrace(graph, {"x": (value,)}, lambda _: 0.0)
        assert known.fulfils([asked]) is above
        assert known.fulfils([graph.no(asked)]) is below
    assert function_of("sqrt")(-1.0) != function_of("sqrt")(-1.0)  # nan


def test_the_newest_200_traces_are_known() -> None:
    pool = TracePool(Graph(), lambda _: 0.0)
    for value in range(203):
        pool.add({"x": (float(value),)})
    assert [columns["x"] for columns, _ in pool.of_length(1)] == [
        (float(value),) for value in range(202, 2, -1)
    ]


def test_a_trace_on_which_a_term_is_no_number_is_no_witness() -> None:
    program = compile_program(parse("sqrt(x) > 2"))
    for value, expected in ((9.0, (True, False)), (1.0, (False, True)), (-1.0, (False, False))):
        for loop in (0, 1):
            trace = ExampleTrace({"x": (value,)}, 1, loop)
            said = tuple(
                reaches(trace, [Goal(program, holds)], None, "complete") for holds in (True, False)
            )
            assert said == expected, (value, loop)


def test_a_plainer_trace_is_one_on_which_truths_hold() -> None:
    graph = Graph()
    spec = parse("sqrt(x) < 2")
    asked = truth(graph, unknown_samples(graph), compile_program(spec), 2, World.ENDLESS, loop=1)
    plainness = Plainness([spec.formula], frozenset(), {})
    assert -2.0 in plainness.of("x")  # at which sqrt(x) is no number
    trace = ExampleTrace({"x": (3.25, 3.25)}, 2, 1)
    assert simplified(trace, graph, [asked], plainness).columns["x"][0] in {0.0, 1.0, 2.0}
    assert simplified(trace, graph, [graph.no(asked)], plainness) == trace


def test_long_traces_that_change_often_become_plainer_too() -> None:
    graph = Graph()
    spec = parse("always[0:38](x > 3 iff next(x <= 3))")
    program = compile_program(spec)
    asked = truth(graph, unknown_samples(graph), program, 40, World.COMPLETE)
    before = ExampleTrace({"x": (7.625, -2.375) * 20}, 40, 0)
    found = simplified(before, graph, [asked], Plainness([spec.formula], frozenset(), {}))
    assert judge(spec, found.columns).robustness > 0
    assert {*found.columns["x"]} == {0.0, 4.0}
