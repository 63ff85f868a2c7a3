"""Truths of programs in all worlds, against `judge` and against traces that are long enough."""

from hypothesis import given
from hypothesis import strategies as st
from strategies import Trace, formulas, length, traces

from rtamt import Formula, holds, judge, parse
from rtamt.checking.graph import FALSE, TRUE, Graph
from rtamt.checking.samples import known_samples
from rtamt.checking.truths import World, truth
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
