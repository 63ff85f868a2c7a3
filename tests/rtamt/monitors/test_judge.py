"""`judge`: the verdict on a trace, against `EpisodeMonitor` and against its definition."""

import copy
import inspect
import pickle
import random

import numpy as np
import pytest
from bits import identical
from choices import ENDS, Backend
from end_oracle import cut, ended, holds
from episode_monitors import feed, offered
from hypothesis import given, settings
from hypothesis import strategies as st
from interface_cases import Case, cases
from interface_oracle import SEMANTICS
from profiles import examples
from strategies import INFINITIES, Trace, formulas, length, traces

from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    SpecificationError,
    Verdict,
    evaluate,
    judge,
    parse,
    variable,
)
from rtamt.language.node import Node
from rtamt.typing import End

V, U, S = Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.SATISFIED


def agrees(formula: Formula, trace: Trace, backend: Backend) -> None:
    """Compare with the definition and with the monitor of the same samples."""
    n = length(trace)
    now = evaluate(formula, trace, n=n, backend=backend)[0]
    seen = EpisodeMonitor(formula, backend=backend)
    decided = None
    for i in range(n):
        feed(seen, trace, i)
        if decided is None and seen.verdict is not U:
            decided = i
    for end in ENDS:
        found = judge(formula, trace, end=end, n=n, backend=backend)
        monitor = copy.copy(seen)
        monitor.finish(end)
        values = (found.robustness, found.lower, found.upper)
        assert identical(values, offered(monitor)), end
        assert identical(values, ended(formula, trace, n, end)), end
        assert (found.verdict, found.decided_at) == (monitor.verdict, decided)
        assert end != "complete" or identical([found.robustness], [now])
        assert bool(found.unrecorded) == (found.verdict is U)
        assert found != str(found)


@given(formula=formulas(depth=2, endless=True), trace=traces(most=10))
def test_it_says_what_the_monitor_says_of_the_same_samples(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    agrees(formula, trace, backend)


def undecided(formula: Formula, trace: Trace, n: int) -> set[tuple[str, int]]:
    """Return the formulas, and samples, that make the verdict on a cut trace undecided.

    They are undecided, and so is each formula on a path to them, at recorded times.
    """
    found: set[tuple[str, int]] = set()
    stack: list[tuple[Node, int]] = [(formula, 0)]
    while stack:
        node, i = stack.pop()
        low, high = cut(node, trace, n, i)
        if (str(node), i) in found or holds(low) == holds(high):
            continue
        found.add((str(node), i))
        assert node.op is not None
        if node.op.operands != "formula":
            continue
        places = range(i, i + 1)
        if node.op.timed:
            places = range(i, n) if node.op.future else range(i + 1)
        stack += [(arg, j) for arg in node.args for j in places]
    return found


def random_late_until(rng: random.Random) -> Formula:
    """An unbounded future over another one, and over a past of late operands."""
    a, b, c, d, e = (variable(rng.choice("ab")) > rng.choice((-1, 0, 1)) for _ in range(5))
    begin = rng.randint(1, 2)
    open_one = rng.choice((a.eventually(rng.randint(0, 3)), a.always(rng.randint(0, 3))))
    left = rng.choice((open_one | b, open_one & b))
    late = c.eventually(begin, begin + 2), c.always(begin, begin + 2)
    right = rng.choice(late).since(d.until(e, 1, rng.randint(1, 3)))
    k = rng.randint(0, 3)
    formula = rng.choice((left.unless(right, k), left.until(right, k)))
    return rng.choice((formula, ~formula))


@settings(max_examples=examples(150))
@given(seed=st.integers(0, 2**32))
def test_what_was_not_recorded_is_reached_through_what_is_undecided(
    seed: int, backend: Backend
) -> None:
    rng = random.Random(seed)
    formula, n = random_late_until(rng), rng.randint(1, 6)
    trace = {name: [float(rng.randint(-2, 3)) for _ in range(n)] for name in "ab"}
    found = judge(formula, trace, n=n, backend=backend)
    open_ones = undecided(formula, trace, n)
    assert {(part.formula, part.at) for part in found.unrecorded} <= open_ones


@settings(max_examples=examples(80))
@given(formula=formulas(depth=1, endless=True), data=st.data(), trace=traces(most=8))
def test_endless_operators_inside_others_and_late_operands(
    formula: Formula, data: st.DataObject, trace: Trace, backend: Backend
) -> None:
    inner = data.draw(st.sampled_from([formula.always(), formula.eventually(2), formula.once()]))
    outer = [inner.eventually(), inner.always(1, 3), inner.always(2), inner.historically(1, 2)]
    outer += [(inner.next() & formula).always(), inner.once(0, 4).eventually(0, 3)]
    agrees(data.draw(st.sampled_from(outer)), trace, backend)


@settings(max_examples=examples(15))
@given(
    inner=formulas(depth=1),
    begin=st.integers(0, 40),
    width=st.integers(0, 40),
    past=st.integers(0, 40),
    trace=traces(most=12),
)
def test_windows_longer_than_the_trace(
    inner: Formula, begin: int, width: int, past: int, trace: Trace, backend: Backend
) -> None:
    agrees(inner.once(0, past).eventually(begin, begin + width).always(0, 50), trace, backend)
    agrees(inner.eventually(begin, begin + width).always(), trace, backend)
    agrees(inner.historically(past, past + width).always(), trace, backend)


@settings(max_examples=examples(40))
@given(formula=formulas(depth=2, endless=True, total=False), trace=traces(values=INFINITIES))
def test_infinite_samples(formula: Formula, trace: Trace, backend: Backend) -> None:
    agrees(formula, trace, backend)


@pytest.mark.slow(backend="python")
def test_a_trace_of_many_blocks(backend: Backend, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rtamt.monitors.traces._MAX_SHORT", 0)
    monkeypatch.setattr("rtamt.machines.walk._BLOCK", 1000)
    n = 4_000
    for place in (0, 996, 997, 1999, 2000, n - 5):
        x = np.linspace(2.0, 1.0, n)
        x[place] = -1.0
        found = judge("always(eventually[0:3](x > 0))", {"x": x}, backend=backend)
        assert (found.verdict, found.robustness) == (S, x[-1])
        broken = judge("always[0:inf](x > 0)", {"x": x}, backend=backend)
        assert (broken.verdict, broken.robustness, broken.decided_at) == (V, -1.0, place)
        until = judge("x > 0 until x < 0", {"x": x}, backend=backend)
        assert (until.verdict, until.decided_at) == (S, place)
    x = np.ones(n)
    x[2_345] = -2.0
    found = judge("always(historically[0:2](x > 0))", {"x": x}, end="open", backend=backend)
    assert (found.verdict, found.upper, found.decided_at) == (V, -2.0, 2_345)


@pytest.mark.parametrize(
    ("text", "trace", "period", "end", "untested"),
    [
        (
            "always[20:30](x > 5)",
            {"x": [9] * 10},
            1,
            "cut",
            ["always[20:30](x > 5): not recorded: 20 s to 30 s"],
        ),
        (
            "always(req implies eventually[0:5] gnt)",
            {"req": [-1, 1, -1, -1, 1, -1], "gnt": [-1, -1, 1, -1, -1, -1]},
            "500ms",
            "cut",
            ["eventually[0:5](gnt) at 2 s: not recorded: 3 s to 7 s"],
        ),
        (
            "always(req implies eventually[0:5] gnt)",
            {"req": [-1, 1, -1, -1, 1, -1], "gnt": [-1, -1, 1, -1, -1, -1]},
            None,
            "open",
            [
                "always(req implies eventually[0:5](gnt)): not recorded: sample 6 and later",
                "eventually[0:5](gnt) at sample 4: not recorded: samples 6 to 9",
            ],
        ),
        (
            "always(always[0:2](x > 0))",
            {"x": [1] * 10},
            None,
            "cut",
            ["always[0:2](x > 0) at sample 8: not recorded: sample 10"],
        ),
        (
            "always[5:inf](x > 0) and next(x > 8)",
            {"x": [1]},
            0.1,
            "cut",
            [
                "next(x > 8): not recorded: 0.1 s",
                "always[5:inf](x > 0): not recorded: 5 s and later",
            ],
        ),
        (
            "x > 0 until[2:30] x > 5",
            {"x": [1] * 9},
            1,
            "cut",
            ["x > 0 until[2:30] x > 5: not recorded: 9 s to 30 s"],
        ),
        (
            "once(always[0:9](x > 0))",
            {"x": [1] * 3},
            None,
            "open",
            ["always[0:9](x > 0): not recorded: samples 3 to 9"],
        ),
        (  # a formula that is used twice is named once
            "(always[0:9](x > 0) or y > 0) and (always[0:9](x > 0) or y > 1)",
            {"x": [1] * 3, "y": [-1] * 3},
            None,
            "cut",
            ["always[0:9](x > 0): not recorded: samples 3 to 9"],
        ),
        (  # a window that starts later needs no earlier samples
            "eventually[5:10](always[0:20](x > 0))",
            {"x": [1] * 7},
            None,
            "cut",
            [
                "eventually[5:10] always[0:20](x > 0): not recorded: samples 7 to 10",
                "always[0:20](x > 0) at sample 5: not recorded: samples 7 to 25",
            ],
        ),
        ("always(x > 0)", {"x": [1]}, None, "cut", []),
        ("always[0:9](x > 0)", {"x": [1]}, None, "complete", []),
        ("always[0:9](x > 0)", {"x": [-1]}, None, "cut", []),
    ],
)
def test_what_was_not_recorded_is_said_in_words_and_numbers(
    text: str,
    trace: dict[str, list[float]],
    period: float | str | None,
    end: End,
    untested: list[str],
    backend: Backend,
) -> None:
    found = judge(text, trace, period, end, backend=backend)
    assert [str(part) for part in found.unrecorded] == untested
    for part in found.unrecorded:
        assert (part.unit == "samples") == (period is None)
        assert part.end is None or part.start <= part.end


@pytest.mark.parametrize(
    ("text", "trace"),
    [
        # After the trace a constant keeps its value, and decides what an operator may reach.
        ("(eventually 1 > 2) until a > b", {"a": [0.5], "b": [2.0]}),
        ("always(not (1 > 2) until a > b)", {"a": [0.0, -1.0], "b": [0.0, -1.0]}),
        ("always(eventually(a > 0 and 2 > 1))", {"a": [-3.0, -2.0]}),
        # Past operators read recorded samples there, so their values continue to change.
        (
            "eventually[0:2](always(always[1:1](b > 0 and 2 > 1) and once[0:1](a > 0)))",
            {"a": [2.0, 0.0], "b": [2.0, 0.0]},
        ),
        (
            "always[0:1](always[1:2](b > 0 and 2 > 1) until[1:inf] once[1:2](a > 0))",
            {"a": [-2.0], "b": [-1.0]},
        ),
        (
            (
                "not ((always[1:1](b > 0 and 2 > 1) or a > 0) until[2:inf] "
                "(always[1:2](a > 0) and historically[0:1](b > 0)))"
            ),
            {"a": [3.0, 2.0], "b": [0.0, 1.0]},
        ),
    ],
)
def test_operators_reach_what_goes_on_behind_the_trace(
    text: str, trace: Trace, backend: Backend
) -> None:
    agrees(parse(text).formula, trace, backend)


def test_the_text_names_what_is_missing_and_the_way_out() -> None:
    text = str(judge("always(always[0:2](x > 0))", {"x": [2] * 10}, 0.1))
    assert text == inspect.cleandoc("""
        UNDECIDED: always always[0:2](x > 0)
        robustness 2, bounds -inf to 2 under end="cut"
        always[0:2](x > 0): not recorded: 1 s to 2 s
        if nothing follows (end="complete"), the verdict is SATISFIED
        """)
    assert str(judge("x >= 0", {"x": [0]})) == inspect.cleandoc("""
        SATISFIED: x >= 0
        robustness 0, holds, bounds 0 to 0 under end="cut"
        """)
    assert str(judge("always(x > 0)", {"x": [0]})) == inspect.cleandoc("""
        VIOLATED: always(x > 0)
        robustness 0, violated, bounds 0 to 0 under end="cut"
        """)
    assert str(judge("x > 1.25e300", {"x": [-1e299]}, end="complete")) == inspect.cleandoc("""
        VIOLATED: x > 1.25e+300
        robustness -1.35e+300, bounds -1.35e+300 to -1.35e+300 under end="complete"
        """)
    far = str(judge("x > 1.234567e300", {"x": [0]}, end="complete"))
    assert far.splitlines()[1:] == [
        "robustness -1.23457e+300, bounds -1.23457e+300 to -1.23457e+300 under",
        '    end="complete"',
    ]
    long = " and ".join(f"eventually[0:{k}](signal_{k} > {k})" for k in range(1, 30))
    trace = {f"signal_{k}": [0] for k in range(1, 30)}
    lines = str(judge(f"always({long})", trace)).splitlines()
    assert max(map(len, lines)) <= 80


def test_a_formula_without_spaces_fills_its_lines_and_is_not_broken_at_a_minus() -> None:
    formula = f"{'abs(-' * 40}x{')' * 40}"
    first, second, *_ = str(judge(f"always({formula} > 5)", {"x": [1]})).splitlines()
    assert (len(first), len(second)) == (80, 80)
    assert f"VIOLATED: always({formula}".startswith(first + second.strip())


def test_a_judgement_is_a_value() -> None:
    trace = {"x": [2.0, 1.0, 0.5]}
    found = judge("always[0:5](x > 0)", trace)
    assert found == judge("always[0:5](x > 0)", trace) != judge("always[0:6](x > 0)", trace)
    for twin in (copy.copy(found), copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        assert twin == found
        assert (twin.unrecorded, twin.decided_at) == (found.unrecorded, found.decided_at)
        assert hash(twin) == hash(found)
    assert repr(found) == (
        "<Judgement UNDECIDED, robustness=0.5, lower=-inf, upper=0.5, end='cut'>"
    )
    with pytest.raises(AttributeError):
        found.lower = 1.0  # type: ignore[misc]


def test_what_is_found_late_does_not_read_the_callers_arrays(backend: Backend) -> None:
    x = np.array([2.0, -1.0, 1.0])
    violated = judge("always(x > 0)", {"x": x}, backend=backend)
    short = judge("always[1:5](x > -3)", {"x": x}, backend=backend)
    x[:] = np.nan
    assert violated.decided_at == 1
    assert [str(part) for part in short.unrecorded] == [
        "always[1:5](x > -3): not recorded: samples 3 to 5"
    ]


def test_errors_are_those_of_evaluate(backend: Backend) -> None:
    calls: list[tuple[str, dict[str, list[float]]]] = [
        ("always(x > 0)", {"y": [1.0]}),
        ("always(x > 0)", {"x": []}),
        ("always(x > 0)", {"x": [1.0, np.nan]}),
        ("always(sqrt(x) > 0)", {"x": [1.0, -1.0]}),
        ("next(sqrt(x) > 0)", {"x": [1.0, 1.0, 1.0, -1.0]}),
        ("always(x > )", {"x": [1.0]}),
    ]
    for text, trace in calls:
        errors = []
        for function in (evaluate, judge):
            with pytest.raises((InputError, SpecificationError)) as caught:
                function(text, trace, backend=backend)
            errors.append((type(caught.value), str(caught.value)))
        assert errors[0] == errors[1], text
    with pytest.raises(InputError) as other:
        judge("x > 0", {"x": [1.0]}, end="cute", backend=backend)  # type: ignore[arg-type]
    text = "expected end='complete', 'cut' or 'open', got 'cute'; did you mean 'cut'?"
    assert str(other.value) == text


def test_options_are_those_of_evaluate(backend: Backend) -> None:
    held = judge("always(x > 0)", {"x": [1, np.nan, 2]}, nan="hold", backend=backend)
    assert held.verdict is S
    spec = parse("input float req; output float gnt; always(req > 3 implies gnt > 3)")
    trace = {"req": [5.0, 5.0], "gnt": [9.0, 1.0]}
    found = judge(spec, trace, semantics="output-robustness", backend=backend)
    assert (found.verdict, found.robustness) == (V, -2.0)
    rounded = judge("always[0:0.25](x > 0)", {"x": [1.0]}, 0.1, align="outward", backend=backend)
    assert [str(part) for part in rounded.unrecorded] == [
        "always[0:0.25](x > 0): not recorded: 0.1 s to 0.3 s"
    ]
    assert judge("true", {}, n=3, backend=backend).verdict is S


def test_more_endless_operators_than_a_monitor_takes(backend: Backend) -> None:
    text = "x > 0"
    for _ in range(9):
        text = f"always eventually ({text})"
    found = judge(text, {"x": [1.0, 2.0]}, backend=backend)
    assert (found.verdict, found.robustness, found.decided_at) == (S, 2.0, None)


@settings(max_examples=examples(60))
@given(case=cases(st.sampled_from(SEMANTICS), endless=True), trace=traces(most=8))
def test_every_semantics_is_that_of_the_monitor(case: Case, trace: Trace, backend: Backend) -> None:
    spec, semantics = case
    seen = EpisodeMonitor(spec, semantics=semantics, backend=backend)
    for i in range(length(trace)):
        feed(seen, trace, i)
    for end in ENDS:
        monitor = copy.copy(seen)
        monitor.finish(end)
        n = length(trace)
        found = judge(spec, trace, end=end, n=n, semantics=semantics, backend=backend)
        assert identical((found.robustness, found.lower, found.upper), offered(monitor))
        assert found.verdict is monitor.verdict


def test_no_way_out_is_promised_for_a_predicate_that_counts_0(backend: Backend) -> None:
    found = judge(
        parse("input float req; output float gnt; always(req > 3)"),
        {"req": [5.0], "gnt": [5.0]},
        semantics="output-vacuity",
        backend=backend,
    )
    assert (found.verdict, found.unrecorded, found.decided_at) == (U, (), None)
    assert str(found) == inspect.cleandoc("""
        UNDECIDED: always(req > 3)
        robustness 0, bounds 0 to 0 under end="cut"
        undecided under every end mode: it depends on a predicate that counts 0
        """)


@pytest.mark.parametrize(
    ("text", "verdict"),
    [
        ("always[0:2e9](x > 0)", U),
        ("always(eventually[0:2e9](x > 0))", S),
        ("always[2e9:inf](x > 0)", U),
        ("historically[0:2e9](x > 0)", S),
        ("always[0:1](once[1e9:2e9](x > 0))", V),
    ],
)
def test_windows_of_years_cost_what_the_trace_costs(
    text: str, verdict: Verdict, backend: Backend
) -> None:
    assert judge(text, {"x": [1.0, 2.0, 3.0]}, backend=backend).verdict is verdict


def test_a_past_that_goes_on_for_years_behind_the_trace_is_refused(backend: Backend) -> None:
    with pytest.raises(SpecificationError) as caught:
        judge("always(once[0:1e8](x > 0))", {"x": [1.0, 2.0]}, backend=backend)
    first, *rest = str(caught.value).splitlines()
    assert first == (
        "STL:1:12: the windows need 4799999904 bytes, and this one is the longest; "
        "the limit is 1073741824"
    )
    way = "write shorter windows, take samples further apart, or raise rtamt.limits.window_bytes"
    assert rest == ["  always(once[0:1e8](x > 0))", "             ^", f"  hint: {way}"]
