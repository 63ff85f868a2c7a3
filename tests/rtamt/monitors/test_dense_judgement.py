"""`rtamt.dense.judge`: the verdict on a trace in dense time, against its definition."""

import inspect
import itertools
import pickle
import random
from collections.abc import Callable

import golden_cases
import numpy as np
import pytest
from bits import identical
from choices import ENDS, Backend
from dense_oracle import STEP
from dense_signals import INTEGERS, Signals, relevant, signals
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from interface_cases import Case, cases, read
from interface_oracle import SEMANTICS
from profiles import examples
from region_oracle import Regions, inside
from strategies import VARIABLES, formulas

import rtamt
from rtamt import Formula, InputError, Judgement, RtamtError, Verdict, holds, judge
from rtamt.typing import End

Shape = Callable[[Formula], Formula]
V, U, S = Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.SATISFIED
NESTED: tuple[Shape, ...] = (
    lambda p: p.eventually(1).always(),
    lambda p: p.always(2).once(1, 3),
    lambda p: p.once(1, 2).eventually(2).always(0, 3),
    lambda p: (~p).until(p, 1).always(),
    lambda p: p.historically().eventually(1, 2),
    lambda p: p.historically(1, 3).always(),
)


def values(found: Judgement) -> tuple[float, float, float]:
    return found.robustness, found.lower, found.upper


def agrees(formula: Formula, whole: Signals, backend: Backend) -> None:
    """Compare every end mode with the definition."""
    assume(formula.variables)
    its = relevant(whole, formula.variables)
    definition = Regions(its, STEP)
    when = definition.first_decided(formula)
    for end in ENDS:
        found = rtamt.dense.judge(formula, its, end=end, backend=backend)
        assert identical(values(found), definition.ended(formula, end)), end
        assert bool(found.unrecorded) == (found.verdict is U)
        assert found.decided_at == when


@given(formula=formulas(depth=2, endless=True, dense=True), whole=signals())
def test_it_is_what_the_definition_says(formula: Formula, whole: Signals, backend: Backend) -> None:
    agrees(formula, whole, backend)


@pytest.mark.slow(backend="python")
@settings(max_examples=examples(80))
@given(
    formula=formulas(depth=1, endless=True, dense=True),
    nested=st.sampled_from(NESTED),
    whole=signals(INTEGERS),
)
def test_endless_operators_inside_others_and_zeros(
    formula: Formula, nested: Shape, whole: Signals, backend: Backend
) -> None:
    agrees(nested(formula), whole, backend)


@pytest.mark.slow(backend="python")
@settings(max_examples=examples(60))
@given(case=cases(st.sampled_from(SEMANTICS), endless=True, dense=True), whole=signals())
def test_every_semantics(case: Case, whole: Signals, backend: Backend) -> None:
    spec, semantics = case
    assume(spec.variables)
    its = relevant(whole, spec.variables)
    definition = Regions(its, STEP, read(case))
    for end in ENDS:
        found = rtamt.dense.judge(spec, its, end=end, semantics=semantics, backend=backend)
        assert identical(values(found), definition.ended(spec.formula, end)), end


@pytest.mark.slow(backend="python")
@settings(max_examples=examples(60))
@given(formula=formulas(depth=2, dense=True), whole=signals(INTEGERS), after=signals(INTEGERS))
def test_no_continuation_contradicts_what_was_decided(
    formula: Formula, whole: Signals, after: Signals, backend: Backend
) -> None:
    assume(formula.variables)
    its = relevant(whole, formula.variables)
    end = min(events[-1][0] for events in its.values())
    longer = {}
    for name, events in its.items():
        known = [event for event in events if event[0] <= end]
        new = [(end + STEP + time, value) for time, value in after[name]]
        longer[name] = [*known, *new, (end + 1000, new[-1][1])]
    later = rtamt.dense.judge(formula, longer, "complete", backend=backend).robustness
    for reading in ENDS[1:]:
        found = rtamt.dense.judge(formula, its, end=reading, backend=backend)
        assert found.lower <= later <= found.upper
        assert found.verdict is U or (found.verdict is S) == rtamt.holds(later)


@pytest.mark.slow
@settings(max_examples=examples(60))
@given(formula=formulas(depth=2, endless=True, dense=True), whole=signals(INTEGERS))
def test_resolution_unit_and_backend_do_not_matter(formula: Formula, whole: Signals) -> None:
    assume(formula.variables)
    its = relevant(whole, formula.variables)
    scaled = {name: [(time * 1000, x) for time, x in events] for name, events in its.items()}
    for end in ENDS:
        found = rtamt.dense.judge(formula, its, end=end)
        for resolution in (STEP, "1ms", "1ps"):
            other = rtamt.dense.judge(
                formula, its, end=end, resolution=resolution, backend="python"
            )
            assert identical(values(other), values(found))
            assert other.decided_at == found.decided_at
        if "inf" in str(formula):
            continue
        milli = rtamt.dense.judge(rtamt.parse(_in_seconds(formula), unit="ms"), scaled, end=end)
        assert identical(values(milli), values(found))
        if found.decided_at is not None:
            assert milli.decided_at == found.decided_at * 1000


def _in_seconds(formula: Formula) -> str:
    """Return the text of a formula with a unit at the end of every interval."""
    return str(formula).replace("]", " s]")


@pytest.mark.parametrize("period", [1, 0.5])
def test_on_uniform_samples_it_is_judge(period: float, backend: Backend) -> None:
    x = [1.0, 2.0, -1.0, 0.0, 3.0, 1.0]
    steps = {"x": rtamt.dense.Events(np.arange(6) * period, x)}
    for text in (
        "always(x >= -1)",
        "always[0:1](x > 0)",
        "eventually[0:10](x > 5)",
        "always(x < 0 implies eventually[0:2](x > 2))",
        "x > 0 until[0:2] x < 0",
        "historically[0:1](x > 0) or always(once[0:1](x > -3))",
    ):
        for end in ENDS:
            discrete = judge(text, {"x": x}, period, end, backend=backend)
            dense = rtamt.dense.judge(text, steps, end, backend=backend)
            assert dense.verdict is discrete.verdict
            assert identical(values(dense), values(discrete))
            place = discrete.decided_at
            assert dense.decided_at == (None if place is None else place * period)


def of_steps(rng: random.Random, depth: int, *, first: bool = True) -> str:
    """Formulas that are equal over samples and over the steps that start with them.

    A future window with a later start is the outermost window: it may lie after the last step.
    """
    if not depth or rng.random() < 0.15:
        return f"({rng.choice('xy')} {rng.choice(COMPARISONS)} {rng.randint(-1, 1)})"
    begin, end = rng.randint(0, 3), rng.randint(0, 3)
    if rng.random() < 0.4:
        p, q = (of_steps(rng, depth - 1, first=first) for _ in range(2))
        return f"({p} {rng.choice(['and', 'or', 'implies', 'iff', 'xor'])} {q})"
    p, q = (of_steps(rng, depth - 1, first=False) for _ in range(2))
    later = begin if first else 0
    ahead = f"[{later}:{rng.choice([later + end, 'inf'])}]"
    return rng.choice(
        [
            f"not({p})",
            f"(always{ahead} {p})",
            f"(eventually{ahead} {p})",
            f"(historically[{begin}:{begin + end}] {p})",
            f"(once[{begin}:{begin + end}] {p})",
            f"({p} until[0:{end}] {q})",
            f"({p} unless[0:{end}] {q})",
        ]
    )


COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")


@pytest.mark.slow(keep=30)
@pytest.mark.parametrize("seed", range(150))
def test_on_uniform_samples_robustness_is_that_of_samples(seed: int, backend: Backend) -> None:
    rng = random.Random(seed)
    formula, n = of_steps(rng, 3), rng.randint(1, 6)
    trace = {name: [float(rng.randint(-2, 2)) for _ in range(n)] for name in "xy"}
    steps = {name: list(enumerate(column)) for name, column in trace.items()}
    found = rtamt.dense.judge(formula, steps, "complete", backend=backend)
    expected = judge(formula, trace, 1, "complete", backend=backend)
    assert identical(values(found), values(expected))
    assert found.verdict is expected.verdict


UNLESS, LATER = "x > 5 unless[0:14] y > 2", "x > 5 unless[12:14] y > 2"


@pytest.mark.parametrize(
    ("text", "end", "lines"),
    [
        ("always[20:30](x > 5)", "cut", ["always[20:30](x > 5): not recorded: 20 s to 30 s"]),
        ("always[5:30](x > 5)", "cut", ["always[5:30](x > 5): not recorded: 10 s to 30 s"]),
        ("always(x > 5)", "open", ["always(x > 5): not recorded: 10 s and later"]),
        ("always[20:inf](x > 5)", "cut", ["always[20:inf](x > 5): not recorded: 20 s and later"]),
        ("always(x > 5)", "cut", []),
        (  # a past without a start reads the first instant
            "once(always[0:12](x > 5))",
            "cut",
            ["always[0:12](x > 5): not recorded: 10 s to 12 s"],
        ),
        (UNLESS, "cut", [f"{UNLESS}: not recorded: 10 s to 14 s"]),
        (LATER, "open", [f"{LATER}: not recorded: 10 s to 14 s"]),
        (
            "always(y > 0 implies eventually[0:4](x < 5))",
            "cut",
            ["eventually[0:4](x < 5) at 7.25 s: not recorded: 10 s to 11.25 s"],
        ),
        (
            "eventually[0:2] always[9:inf](x > 10)",
            "cut",
            ["always[9:inf](x > 10) at 1 s: not recorded: 10 s and later"],
        ),
    ],
)
def test_it_names_what_was_not_recorded(
    text: str, end: End, lines: list[str], backend: Backend
) -> None:
    whole: Signals = {"x": [(0, 9), (10, 9)], "y": [(0, -1), (7.25, 1), (8, -1), (12, 1)]}
    found = rtamt.dense.judge(text, whole, end, backend=backend)
    assert [str(part) for part in found.unrecorded] == lines


def test_it_prints_as_that_of_samples(backend: Backend) -> None:
    found = rtamt.dense.judge("always[0:8](x >= 0)", {"x": [(0, 5), (6, 5)]}, backend=backend)
    assert str(found) == inspect.cleandoc("""
        UNDECIDED: always[0:8](x >= 0)
        robustness 5, bounds -inf to 5 under end="cut"
        always[0:8](x >= 0): not recorded: 6 s to 8 s
        if nothing follows (end="complete"), the verdict is SATISFIED
    """)
    assert pickle.loads(pickle.dumps(found)) == found


def test_the_end_is_an_instant_that_is_known(backend: Backend) -> None:
    whole = {"x": [(0, 1), (2, -1)]}
    assert rtamt.dense.judge("always[0:2](x > 0)", whole, backend=backend).verdict is V
    assert rtamt.dense.judge("eventually[2:2](x > 0)", whole, backend=backend).verdict is V
    longer = rtamt.dense.judge("eventually[0:2.000000001](x > 1)", whole, backend=backend)
    assert (longer.verdict, longer.upper) == (U, np.inf)


INSTANTS = [
    ("eventually[2:2](x > 0)", {"x": [(0, -1), (2, 5)]}, 5.0),
    (
        "(idle > 0) until[1:2] (active > 0)",
        {"idle": [(0, 1), (1, -1), (3, -1)], "active": [(0, -1), (1, 1), (3, 1)]},
        1.0,
    ),
    ("eventually(x > 0 and once[1:1](x < 0))", {"x": [(0, -1), (1, 2), (2, 2)]}, 1.0),
    ("eventually[1:1](x < 0 since[1:1] x < 0)", {"x": [(0, -1), (1, 2), (2, 2)]}, -2.0),
]


@pytest.mark.parametrize(("text", "whole", "robustness"), INSTANTS)
def test_a_single_instant_counts(
    text: str, whole: Signals, robustness: float, backend: Backend
) -> None:
    found = rtamt.dense.judge(text, whole, "complete", backend=backend)
    assert identical(values(found), (robustness,) * 3)
    assert (found.verdict is S) == (robustness > 0)


@pytest.mark.slow(backend="python")
def test_golden_instants(backend: Backend) -> None:
    for case in golden_cases.cases("dense_instant.json"):
        found = rtamt.dense.judge(case["formula"], case["signals"], "complete", backend=backend)
        assert found.robustness == float(case["robustness"])
        assert found.lower == found.upper == found.robustness
        assert holds(found.robustness) == (found.verdict is S)


@settings(max_examples=examples(60))
@given(formula=formulas(depth=2, endless=True, dense=True), whole=signals(INTEGERS))
def test_what_is_open_holds_at_every_later_end(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    assume(formula.variables)
    its = relevant(whole, formula.variables)
    definition = Regions(its, STEP)
    ends = [definition.begin + k * STEP for k in range(definition.steps + 1)]
    ended = [rtamt.dense.judge(formula, until(its, end), "open", backend=backend) for end in ends]
    for before, after in itertools.pairwise(ended):
        assert inside(before.lower, after.lower, before.upper)
        assert inside(before.lower, after.upper, before.upper)
    for k, found in enumerate(ended):
        assert inside(found.lower, found.robustness, found.upper)
        cut = rtamt.dense.judge(formula, until(its, ends[k]), "cut", backend=backend)
        assert inside(found.lower, cut.lower, found.upper)
        assert inside(found.lower, cut.upper, found.upper)
        assert cut.verdict is U or (cut.verdict is S) == holds(cut.robustness)
        for later in range(k, len(ends)):
            low, high = definition.complete(formula, later)
            assert inside(found.lower, low, found.upper)
            assert inside(found.lower, high, found.upper)


def until(whole: Signals, end: float) -> Signals:
    """Return the signals up to a time, at which all have an event."""
    return {
        name: [*(event for event in events if event[0] < end), (end, _at(events, end))]
        for name, events in whole.items()
    }


def _at(events: list[tuple[float, float]], time: float) -> float:
    return [value for t, value in events if t <= time][-1]


def test_the_deciding_time_is_one_of_the_callers(backend: Backend) -> None:
    found = rtamt.dense.judge("always(x > 0)", {"x": [(3, 1), (4.7, -1), (9, 1)]}, backend=backend)
    assert (found.verdict, found.decided_at) == (V, 4.7)
    times = np.array(["2026-01-01T00:00:00", "2026-01-01T00:00:04"], "datetime64[s]")
    dated = rtamt.dense.judge(
        "always(x > 0)", {"x": rtamt.dense.Events(times, [1, -1])}, backend=backend
    )
    assert dated.decided_at == times[1]
    after = rtamt.dense.judge(
        "always[0:2](x > 0)", {"x": rtamt.dense.Events([0, 5], [1, 1])}, backend=backend
    )
    assert (after.verdict, after.decided_at) == (S, 2.0)
    assert rtamt.dense.judge("always(x > 0)", {"x": [(0, 1)]}, backend=backend).decided_at is None


@settings(max_examples=examples(20))
@given(whole=signals(), shift=st.sampled_from((-(2**61), 2**61)))
def test_times_far_from_0_lose_nothing(whole: Signals, shift: int, backend: Backend) -> None:
    text = f"always({VARIABLES[0]} < 0 implies eventually[2:3]({VARIABLES[0]} > 0))"
    events = whole[VARIABLES[0]]
    far = [(int(time / STEP) + shift, value) for time, value in events]
    near = [(int(time / STEP), value) for time, value in events]
    for end in ENDS:
        found, expected = (
            rtamt.dense.judge(text, {VARIABLES[0]: its}, end, resolution=1, backend=backend)
            for its in (far, near)
        )
        assert identical(values(found), values(expected))


@pytest.mark.parametrize(
    ("text", "given", "message"),
    [
        ("x > 0", {}, "expected events of every variable, got none of 'x'"),
        ("sqrt(x) > 0", {"x": [(0, 1), (2, -1)]}, "'sqrt(x)' is not a number at time 2.0"),
        ("x > y", {"x": [(0, 1)], "y": [(1, 1)]}, "expected signals that overlap in time"),
        ("next(x > 0)", {"x": [(0, 1)]}, "'next' reads the next or previous sample"),
        ("true", {}, "a formula without variables has no events"),
    ],
)
def test_it_refuses_what_evaluate_dense_refuses(
    text: str, given: Signals, message: str, backend: Backend
) -> None:
    with pytest.raises(RtamtError) as expected:
        rtamt.dense.evaluate(text, given, backend=backend)
    assert message in str(expected.value)
    with pytest.raises(type(expected.value)) as refused:
        rtamt.dense.judge(text, given, backend=backend)
    assert str(refused.value) == str(expected.value)


def test_other_errors() -> None:
    with pytest.raises(InputError) as wrong:
        rtamt.dense.judge("x > 0", {"x": [(0, 1)]}, "over")  # type: ignore[arg-type] # refused
    assert str(wrong.value) == "expected end='complete', 'cut' or 'open', got 'over'"
    with pytest.raises(InputError) as long:
        rtamt.dense.judge("always once[0:2e9](x > 0)", {"x": [(0, 1), (3e9, 1)]})
    assert str(long.value) == (
        "expected a trace that lasts less than 2**62 ticks of 1ns with the bounds of the formula, "
        "got 5000000000000000000; resolution='10ns' would do"
    )
    with pytest.raises(TypeError) as unknown:
        rtamt.dense.judge("x > 0", {"x": [(0, 1)]}, period=1)  # type: ignore[call-arg] # refused
    assert str(unknown.value) == (
        "judge_dense() got an unexpected keyword argument 'period'; its arguments are spec, "
        "signals, end, until, resolution, semantics, inputs, outputs, backend, nan, max_gap"
    )


def test_a_tick_is_told_from_its_neighbours_after_years(backend: Backend) -> None:
    for last in (3.1e7, 9e7 + 0.3, 1e9, 31536001.123456789, 31536001.123456785):
        whole = {"x": [(0, 1), (last, 1)]}
        for text in ("always(always[0:2](x > 0))", "always(x < 2) and always(once[0:1e-9](x > 0))"):
            found = rtamt.dense.judge(text, whole, backend=backend)
            assert bool(found.unrecorded) == (found.verdict is U)
        later = rtamt.dense.judge("eventually[0:2e9](x < 0 and always[0:2](x < 0))", whole, "open")
        assert [part.end for part in later.unrecorded] == [2_000_000_000]
