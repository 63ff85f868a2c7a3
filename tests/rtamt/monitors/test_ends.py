"""The end of a trace: `finish(end=)` of the episode monitors in the three end modes."""

import math

import pytest
from bits import identical
from choices import ENDS, Backend
from end_oracle import cut, ended
from episode_monitors import feed, offered
from golden_cases import cases
from hypothesis import given
from hypothesis import strategies as st
from strategies import Trace, formulas, length, sample, traces

from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    InputTypeError,
    StateError,
    VectorEpisodeMonitor,
    Verdict,
    judge,
    parse,
)

INF = math.inf
CUT = [case for case in cases("verdict.json") if "cut" in case]


def fed(formula: Formula | str, trace: Trace, backend: Backend) -> EpisodeMonitor:
    """Return a monitor after the trace."""
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(length(trace)):
        feed(monitor, trace, i)
    return monitor


def agrees_with_its_definition(formula: Formula, trace: Trace, backend: Backend) -> None:
    for end in ENDS:
        expected = ended(formula, trace, length(trace), end)
        monitor = fed(formula, trace, backend)
        assert identical([monitor.finish(end)], [expected[0]])
        assert identical(offered(monitor), expected), end


@given(formula=formulas(depth=2, endless=True), trace=traces(most=10))
def test_every_reading_agrees_with_its_definition(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    agrees_with_its_definition(formula, trace, backend)


@given(formula=formulas(depth=1, endless=True), data=st.data(), trace=traces(most=8))
def test_endless_operators_inside_others_agree_with_the_definition(
    formula: Formula, data: st.DataObject, trace: Trace, backend: Backend
) -> None:
    inner = data.draw(st.sampled_from([formula.always(), formula.eventually(2), formula.once()]))
    outer = [inner.eventually(), inner.always(1, 3), inner.always(2), inner.historically(1, 2)]
    outer += [(inner.next() & formula).always(0, 2), inner.once(0, 4).eventually(0, 3)]
    agrees_with_its_definition(data.draw(st.sampled_from(outer)), trace, backend)


# Bounds that depend on samples far from their time: a window of the past before the first sample,
# the whole past of unseen times, and values that are not read before a cut.
SELDOM_READ = [
    ("eventually[0:1](always(historically[3:3](eventually[4:4](a > 0 and 1 > 0))))", [3.0] * 4),
    ("eventually[5:9](always(once(a > 0 and 1 > 0)))", [3.0, 2.0]),
    ("eventually((a > 0) xor (eventually[2:9](a < 0)))", [-1.0, -4.0, 1.0, 2.0]),
]


@pytest.mark.parametrize(("text", "a"), SELDOM_READ)
def test_a_reading_of_what_is_seldom_read_agrees_with_its_definition(
    text: str, a: list[float], backend: Backend
) -> None:
    nothing = [0.0] * len(a)
    trace = {"a": a, "b": nothing, "c": nothing}
    agrees_with_its_definition(parse(text).formula, trace, backend)


def test_the_golden_file_of_ends_is_whole() -> None:
    assert len(CUT) == 400


def test_a_vector_monitor_takes_the_reading_by_name(backend: Backend) -> None:
    monitor = VectorEpisodeMonitor("always(x > 0)", 2, backend=backend)
    monitor.update([[1.0], [2.0]])
    words = (
        "expected a mask of 2 booleans, got str 'cut'; pass the end mode by name, as in end='cut'"
    )
    with pytest.raises(InputTypeError, match=f"^{words}$"):
        monitor.finish("cut")
    assert monitor.finish(end="cut").tolist() == [1.0, 2.0]


def test_a_cut_trace_agrees_with_golden(backend: Backend) -> None:
    for case in CUT:
        expected = float(case["cut"]["lower"]), float(case["cut"]["upper"])
        formula, trace = parse(case["formula"]), case["trace"]
        monitor = EpisodeMonitor(formula, backend=backend)
        n = len(next(iter(trace.values())))
        for i in range(n):
            monitor.update(sample(trace, i, monitor.variables))
        monitor.finish("cut")
        assert (monitor.lower, monitor.upper) == expected, case
        assert monitor.verdict.name == case["cut"]["verdict"], case
        told = ended(formula.formula, trace, n, "cut")
        assert told[1:] == expected, case
        assert identical(offered(monitor), told), case


V, U, S = Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.SATISFIED

MEANINGS = [
    # The formula, x, then the verdict on the complete, the cut and the open trace.
    ("always[20:30](x > 5)", [1] * 10, (S, U, U)),
    ("always[2:4](x > 5)", [9] * 4, (S, U, U)),
    ("always[2:4](x > 5)", [9] * 5, (S, S, S)),
    ("always(x > 0)", [1] * 10, (S, S, U)),
    ("eventually(x > 5)", [1] * 10, (V, V, U)),
    ("always[5:inf](x > 0)", [1, 1], (S, U, U)),
    ("always[5:inf](x > 0)", [1] * 6, (S, S, U)),
    ("always(x > 5 implies eventually[0:2](x < 2))", [9, 1, 3, 3], (S, S, U)),
    ("always(x > 5 implies eventually[0:2](x < 2))", [9, 1, 3, 9], (V, U, U)),
    ("always(x > 5 implies eventually[0:2](x < 2))", [9, 1, 9, 1], (S, S, U)),
    ("always(x > 5 implies eventually(x < 2))", [9, 1, 9, 3], (V, V, U)),
    ("always(eventually(x < 2))", [9, 1, 9], (V, V, U)),
    ("always(always[0:2](x > 0))", [1] * 10, (S, U, U)),
    ("always(historically[3:3](x > 0))", [1, -1], (S, S, U)),
    ("always[0:4](historically[3:3](x > 0))", [1, -1], (S, V, U)),
    ("eventually(once[1:2](x > 0))", [-1, -1, 5], (V, V, U)),
    ("eventually[2:2](true)", [1], (V, S, U)),
    ("next(prev(x > 0))", [-4], (S, V, U)),
    ("always[5:inf](false)", [1, 1], (S, U, U)),
    ("next(always(false))", [1], (S, V, U)),
    ("next(eventually(once[1:3](x > 0)))", [1], (S, S, S)),
    ("s_next(eventually(once[1:3](x > 0)))", [1], (V, S, U)),
    ("(eventually(x > 0)) until[2:inf] (x > 3)", [-1, -1], (V, U, U)),
    ("next(false) until[1:inf] (x > 3)", [-1], (V, U, U)),
    ("next(false) until[1:1] (x > 3)", [-1], (V, V, U)),
    ("next(x > 0)", [1], (S, U, U)),
    ("s_next(x > 0)", [1], (V, U, U)),
    ("always[0:3](true)", [1], (S, S, S)),
    ("x > 0 until[4:inf] x > 5", [1, 1], (V, U, U)),
    ("x > 0 until x > 5", [1, 1], (V, V, U)),
    ("eventually[2:3](always(x > 0))", [1, 1], (V, U, U)),
    ("eventually[1:2](always(x > 0))", [1, 1, 1], (S, S, U)),
]


@pytest.mark.parametrize(("text", "xs", "verdicts"), MEANINGS)
def test_each_reading_decides_what_it_may(
    text: str, xs: list[float], verdicts: tuple[Verdict, ...], backend: Backend
) -> None:
    found = []
    for end in ENDS:
        monitor = EpisodeMonitor(text, backend=backend)
        for x in xs:
            monitor.update(dict.fromkeys(monitor.variables, x))
        monitor.finish(end)
        found.append(monitor.verdict)
    assert tuple(found) == verdicts


@given(formula=formulas(depth=2, endless=True), trace=traces(most=8))
def test_an_end_keeps_the_verdict_and_stays_inside_the_bounds(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    before = fed(formula, trace, backend)
    for end in ENDS:
        monitor = fed(formula, trace, backend)
        monitor.finish(end)
        assert before.lower <= monitor.lower <= monitor.robustness <= monitor.upper <= before.upper
        assert before.verdict in {U, monitor.verdict}
        if end == "open":
            assert identical(offered(monitor), offered(before))


@given(formula=formulas(depth=2, endless=True), trace=traces(most=6), later=traces(least=6, most=6))
def test_a_cut_trace_is_decided_only_if_each_way_to_go_on_agrees(
    formula: Formula, trace: Trace, later: Trace, backend: Backend
) -> None:
    n = length(trace)
    monitor = fed(formula, trace, backend)
    if monitor.verdict is not U:
        return
    monitor.finish("cut")
    longer = {name: values + later[name] for name, values in trace.items()}
    low, high = cut(formula, longer, n, 0, seen=n + 6)
    assert monitor.lower <= low <= high <= monitor.upper


@pytest.mark.parametrize(("a", "bounds"), [([1.0, 2.0], (-INF, 1.0)), ([-1.0, 2.0], (-INF, -1.0))])
def test_an_until_without_end_of_which_nothing_was_recorded_is_as_open_as_a_beginning(
    a: list[float], bounds: tuple[float, float], backend: Backend
) -> None:
    trace = {"a": a, "b": [1.0, 1.0], "c": [0.0, 0.0]}
    for text in ("a > 0 until[2:inf] b > 0", "a > 0 until[5:inf] b > 0"):
        monitor = fed(text, trace, backend)
        assert monitor.bounds() == bounds
        monitor.finish("cut")
        assert monitor.bounds() == bounds
        assert judge(text, trace, end="cut", backend=backend).lower == bounds[0]
        assert judge(text, trace, end="cut", backend=backend).upper == bounds[1]
    # Its first instant was recorded, without a witness.
    monitor = fed("a > 0 until[1:inf] b > 3", trace, backend)
    monitor.finish("cut")
    assert monitor.lower == monitor.upper < 0


def test_a_finished_episode_stays_as_it_is_whatever_the_next_reading(backend: Backend) -> None:
    for first in ENDS:
        monitor = fed("always[0:5](a > 0)", {"a": [2.0, 1.0]}, backend)
        monitor.finish(first)
        values, state = offered(monitor), monitor.verdict
        for end in ENDS:
            assert monitor.finish(end) == 1.0
            assert (offered(monitor), monitor.verdict, monitor.finished) == (values, state, True)
        with pytest.raises(StateError):
            monitor.update(a=1.0)


def test_another_reading_is_refused_before_anything_changes(backend: Backend) -> None:
    text = "expected end='complete', 'cut' or 'open', got 'cute'; did you mean 'cut'?"
    monitor = EpisodeMonitor("always(x > 0)", backend=backend)
    with pytest.raises(InputError) as caught:
        monitor.finish("cute")  # type: ignore[arg-type]
    assert str(caught.value) == text
    with pytest.raises(StateError):
        monitor.finish("cut")


def test_another_reading_is_refused_before_an_entry_changes(backend: Backend) -> None:
    text = "expected end='complete', 'cut' or 'open', got 'cute'; did you mean 'cut'?"
    vector = VectorEpisodeMonitor("always(x > 0)", 2, backend=backend)
    with pytest.raises(InputError) as caught:
        vector.finish(end="cute")  # type: ignore[arg-type]
    assert str(caught.value) == text
    vector.update([[1.0], [1.0]])
    with pytest.raises(InputError):
        vector.finish(end=["cut"])  # type: ignore[arg-type]
    assert not vector.finished.any()


@given(formula=formulas(depth=2, endless=True), trace=traces(least=3, most=6), data=st.data())
def test_entries_end_as_monitors_of_their_own(
    formula: Formula, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    vector = VectorEpisodeMonitor(formula, 3, backend=backend)
    singles = [EpisodeMonitor(formula, backend=backend) for _ in range(3)]
    for i in range(length(trace)):
        row = sample(trace, i, vector.variables)
        vector.update([[x + entry for x in row.values()] for entry in range(3)])
        for entry, single in enumerate(singles):
            single.update({name: x + entry for name, x in row.items()})
    for end in ENDS:
        mask = data.draw(st.lists(st.booleans(), min_size=3, max_size=3))
        vector.finish(mask, end=end)
        for single, chosen in zip(singles, mask, strict=True):
            if chosen:
                single.finish(end)
        for name in ("robustness", "lower", "upper", "verdict", "finished"):
            found = [getattr(single, name) for single in singles]
            assert identical(getattr(vector, name), found), name
