"""What else a violation in dense time stands on, against the definition over regions."""

import math
import random
from typing import Literal

import pytest
from dense_signals import Signals, relevant, signals
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from implying import dense_requirements
from profiles import examples
from region_oracle import STEP, Regions
from strategies import QUARTERS, formulas, rooted

from rtamt import DenseExplanation, Formula, explain_dense

Backend = Literal["native", "python"]


def holds(value: float) -> bool:
    return math.copysign(1.0, value) > 0.0


def named(why: DenseExplanation, begin: float) -> list[tuple[Formula, range]]:
    """The formulas, and the regions, whose signs an explanation names."""

    def region(time: float) -> int:
        """The region in which a time is; a tick after an instant is in the interval after it."""
        place = (time - begin) / STEP
        return 2 * int(place) + (place != int(place))

    found = []
    for each in why.circumstances:
        if each.outside is not None:
            continue
        first, last = map(region, each.window)
        if first == last:
            span = range(first + each.after, first + each.after + 1)
            assert each.open_begin == each.open_end == each.after
        else:
            whole = last % 2 == 1 or not each.open_end
            span = range(first + each.open_begin, last + whole)
        assert span[0] <= region(each.time) + each.after <= span[-1]
        found.append((each.formula, span))
    step = why.steps[-1]
    if step.outside is None:
        its = region(step.time) + step.after
        found.append((step.formula, range(its, its + 1)))
    return found


def check(formula: Formula, whole: Signals, instant: int, seed: int, backend: Backend) -> None:
    """The formula, or its negation, is violated at an instant as long as what is named stays."""
    assume(formula.variables)
    its = relevant(whole, formula.variables)
    regions = Regions(its, STEP)
    place = 2 * min(instant, regions.steps)
    if holds(regions.at(formula, "complete")(place)[0]):
        formula = ~formula
    why = explain_dense(formula, its, float(regions.begin) + place // 2 * STEP, backend=backend)
    signs = []
    for f, span in named(why, float(regions.begin)):
        at = regions.at(f, "complete")
        signs += [(f, i, holds(at(i)[0])) for i in span]
    for each in why.circumstances:
        own = {sign for f, _, sign in signs if f is each.formula}
        assert each.outside is not None or (each.role == "held") in own
    assert all(len(line) <= 80 for line in str(why).splitlines())
    rng = random.Random(seed)
    for share in (0.1, 0.4, 0.9):
        other = {
            name: [(t, rng.choice(QUARTERS) if rng.random() < share else x) for t, x in events]
            for name, events in its.items()
        }
        after = Regions(other, STEP)
        if all(holds(after.at(f, "complete")(i)[0]) == sign for f, i, sign in signs):
            assert not holds(after.at(formula, "complete")(place)[0])


seeds = st.integers(0, 2**32)


@settings(max_examples=examples(30))
@given(
    formula=st.one_of(dense_requirements(), formulas(2, dense=True)), whole=signals(), seed=seeds
)
def test_a_violation_stays_as_long_as_what_is_named_keeps_its_sign(
    formula: Formula, whole: Signals, seed: int, backend: Backend
) -> None:
    check(formula, whole, 0, seed, backend)


@pytest.mark.parametrize("name", ["since", "until", "unless"])
@settings(max_examples=examples(50))
@given(data=st.data(), whole=signals(), instant=st.integers(0, 12), seed=seeds)
def test_so_does_one_of_two_operands_at_any_time(
    name: str, data: st.DataObject, whole: Signals, instant: int, seed: int, backend: Backend
) -> None:
    check(data.draw(rooted(name, 1, dense=True)), whole, instant, seed, backend)


def test_of_a_violated_response_the_request_and_the_grant_are_named(backend: Backend) -> None:
    trace: Signals = {
        "req": [(0.0, 0.0), (1.5, 9.0), (1.6, 0.0), (9.0, 0.0)],
        "gnt": [(0.0, 0.0), (4.0, 2.0), (9.0, 2.0)],
    }
    why = explain_dense(
        "always(req >= 3 implies eventually[0:3](gnt >= 3))", trace, backend=backend
    )
    assert str(why).splitlines()[3:] == [
        "  0 s     -1  always(req >= 3 implies eventually[0:3](gnt >= 3))",
        "1.5 s     -1  req >= 3 implies eventually[0:3](gnt >= 3)",
        "1.5 s     -1  eventually[0:3](gnt >= 3)",
        "  4 s     -1  gnt >= 3",
        "  4 s      2  gnt",
        "1.5 s      6  held: req >= 3",
        "  4 s     -1  missing: gnt >= 3",
        "                nowhere from 1.5 s to 4.5 s; this is the nearest",
    ]
    grant = why.circumstances[1]
    assert (grant.role, grant.window, grant.open_begin, grant.open_end) == (
        "missing",
        (1.5, 4.5),
        False,
        False,
    )


def test_a_broken_until_says_which_side_broke(backend: Backend) -> None:
    a = [(0.0, 1.0), (2.0, -1.0), (9.0, 1.0)]
    trace: Signals = {"a": a, "b": [(0.0, -3.0), (3.0, 5.0), (9.0, 5.0)]}
    why = explain_dense("a > 0 until[0:4] b > 0", trace, backend=backend)
    assert [(e.role, e.text, e.window) for e in why.circumstances] == [("missing", "b > 0", (0, 2))]
    assert (str(why.predicate), why.steps[-1].time) == ("a > 0", 2)
    trace = {"a": a, "b": [(0.0, -0.5), (9.0, 5.0)]}
    why = explain_dense("a > 0 until[0:4] b > 0", trace, backend=backend)
    assert [(e.role, e.text, e.window) for e in why.circumstances] == [
        ("broken", "a > 0", (2, 2)),
        ("missing", "b > 0", (0, 2)),
    ]


def test_a_window_from_right_after_a_time_does_not_have_its_begin(backend: Backend) -> None:
    trace: Signals = {  # the until holds at 0 s alone
        "p": [(0.0, 1.0), (1.0, -1.0), (9.0, -1.0)],
        "q": [(0.0, -1.0), (1.0, 1.0), (9.0, 1.0)],
        "r": [(0.0, -2.0), (9.0, -2.0)],
    }
    spec = "always[0:2](p > 0 until[1:2] q > 0 or eventually[3:4](r > 0))"
    why = explain_dense(spec, trace, resolution="1s", backend=backend)
    assert (why.steps[1].time, why.steps[1].after) == (0, True)
    (missing,) = [each for each in why.circumstances if each.text == "r > 0"]
    assert (missing.role, missing.window) == ("missing", (3, 5))
    assert (missing.open_begin, missing.open_end) == (True, True)
