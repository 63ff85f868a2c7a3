"""Episode monitors: robustness, bounds and verdict at every sample."""

import copy
import gc
import inspect
import math
import pickle
import weakref
from collections.abc import Callable
from types import MemberDescriptorType
from typing import Any, cast

import pytest
from bits import identical
from choices import Backend
from episode_monitors import feed, offered, verdict
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import episode, horizon
from profiles import examples
from strategies import (
    FORMULAS,
    INFINITIES,
    TERMS,
    Trace,
    formulas,
    intervals,
    length,
    rooted,
    traces,
)

from rtamt import EpisodeMonitor, Formula, InputError, Interval, Verdict, evaluate
from rtamt.language.formula import make
from rtamt.language.operators import OPERATORS
from rtamt.machines import state
from rtamt.machines.backend import read_only

INF = math.inf


def agrees_with_its_definition(formula: Formula, trace: Trace, backend: Backend) -> None:
    """Compare with the oracle before the first sample and after every one."""
    monitor = EpisodeMonitor(formula, backend=backend)
    for n in range(length(trace) + 1):
        if n:
            assert feed(monitor, trace, n - 1) == monitor.robustness
        expected = episode(formula, trace, n)
        assert identical(offered(monitor), expected), n
        assert identical(monitor.bounds(), expected[1:])
        assert monitor.verdict is verdict(*expected[1:])
        assert (monitor.samples, monitor.finished) == (n, False)


# The definition. ---------------------------------------------------------------------------------
@pytest.mark.parametrize("name", [name for name in OPERATORS if name not in TERMS])
@settings(max_examples=examples(25))
@given(data=st.data(), trace=traces(most=10))
def test_every_operator_is_bounded_as_its_definition_says(
    name: str, data: st.DataObject, trace: Trace, backend: Backend
) -> None:
    formula = data.draw(rooted(name, depth=1, endless=True))
    agrees_with_its_definition(formula, trace, backend)


@st.composite
def endless(draw: st.DrawFn) -> Formula:
    """Unbounded windows over atoms."""
    name = draw(
        st.sampled_from([n for n in FORMULAS if OPERATORS[n].timed and OPERATORS[n].future])
    )
    arity, _ = OPERATORS[name].arity
    atoms = tuple(draw(formulas(depth=0)) for _ in range(arity))
    return cast("Formula", make(name, atoms, Interval.of(draw(st.integers(0, 2)), None)))


@pytest.mark.parametrize("name", FORMULAS)
@settings(max_examples=examples(30))
@given(data=st.data(), trace=traces(most=10))
def test_endless_windows_inside_every_operator_inside_windows(
    name: str, data: st.DataObject, trace: Trace, backend: Backend
) -> None:
    row = OPERATORS[name]
    arity, _ = row.arity
    first, *rest = (data.draw(formulas(1) if i else endless()) for i in range(arity))
    args = data.draw(st.permutations((first, *rest)))
    interval = data.draw(intervals(endless=True)) if row.timed else None
    inner = cast("Formula", make(name, tuple(args), interval))
    windows = [inner.always(), inner.eventually(1, 3).always(), inner.once().eventually(0, 4)]
    agrees_with_its_definition(data.draw(st.sampled_from(windows)), trace, backend)


@given(formula=formulas(depth=3), trace=traces(most=14))
def test_bounded_formulas_agree_with_the_definition(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    agrees_with_its_definition(formula, trace, backend)


@given(formula=formulas(depth=2, endless=True), trace=traces(most=12))
def test_endless_formulas_agree_with_the_definition(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    agrees_with_its_definition(formula, trace, backend)


@given(formula=formulas(depth=2, endless=True, total=False), trace=traces(values=INFINITIES))
def test_infinite_samples_agree_with_the_definition(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    agrees_with_its_definition(formula, trace, backend)


@settings(max_examples=examples(25))
@given(
    inner=formulas(depth=1),
    begin=st.integers(0, 9),
    width=st.integers(0, 9),
    outer=st.integers(0, 9),
    trace=traces(least=20, most=40),
)
def test_nested_windows_longer_than_the_strategies_draw_agree_with_the_definition(
    inner: Formula, begin: int, width: int, outer: int, trace: Trace, backend: Backend
) -> None:
    formula = inner.eventually(begin, begin + width).always(0, outer)
    agrees_with_its_definition(formula, trace, backend)


# What follows from it. ---------------------------------------------------------------------------
@given(formula=formulas(endless=True, depth=2), trace=traces(most=14))
def test_upper_never_rises_lower_never_falls_and_a_verdict_stays(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    lower, upper, before = monitor.lower, monitor.upper, monitor.verdict
    for i in range(length(trace)):
        feed(monitor, trace, i)
        assert lower <= monitor.lower <= monitor.upper <= upper
        assert before in {Verdict.UNDECIDED, monitor.verdict}
        lower, upper, before = monitor.lower, monitor.upper, monitor.verdict


@given(formula=formulas(depth=2), trace=traces(least=18, most=18))
def test_bounds_hold_for_what_comes(formula: Formula, trace: Trace, backend: Backend) -> None:
    assert horizon(formula) < length(trace)
    whole = evaluate(formula, trace, n=length(trace), backend=backend)[0]
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(length(trace)):
        assert monitor.lower <= whole <= monitor.upper
        feed(monitor, trace, i)
    assert offered(monitor) == (whole, whole, whole)


@given(formula=formulas(endless=True, depth=2), trace=traces(most=12))
def test_robustness_is_the_offline_robustness_at_the_first_sample(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(length(trace)):
        seen = {name: values[: i + 1] for name, values in trace.items()}
        now = feed(monitor, trace, i)
        assert identical([now], evaluate(formula, seen, n=i + 1, backend=backend)[:1])


# The moment of the verdict. ----------------------------------------------------------------------
V, U, S = Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.SATISFIED


MOMENTS = [
    ("always[0:100](x > 0)", [1, 1, -1, 1], [U, U, V, V]),
    ("always(x > 0)", [1, 1, -1, 1], [U, U, V, V]),
    ("eventually[0:3](x > 0)", [-1] * 5, [U, U, U, V, V]),
    ("eventually[0:3](x > 0)", [-1, 1, -1], [U, S, S]),
    ("eventually(x > 0)", [-1, -1, 1, -1], [U, U, S, S]),
    ("not always(x > 0)", [1, -1, 1], [U, S, S]),
    ("always[2:4](x > 0)", [-1, -1, 1, 1, 1, -1], [U, U, U, U, S, S]),
    ("always[1:2](x > 0) and eventually[0:5](x > 9)", [9, 9, -1], [U, U, V]),
    ("(x > 0) until[0:3] (x > 5)", [1, 1, -1], [U, U, V]),
    ("(x > 0) until[0:3] (x > 5)", [1, 6, -1], [U, S, S]),
    ("(x > 0) until[2:3] (x > 5)", [1, 6, 6], [U, U, S]),
    ("(x > 0) until (x > 5)", [1, 1, 1, 0.5, -1], [U, U, U, U, V]),
    ("always(eventually[0:2](x > 0))", [-1, -1, -1, 5], [U, U, V, V]),
    ("always((x > 3) implies eventually[0:2](x < 1))", [4, 2, 2, 0], [U, U, V, V]),
    ("always((x > 3) implies eventually(x < 1))", [4, 2, 2, 2], [U, U, U, U]),
    ("eventually(always[0:2](x > 0))", [1, 1, -1, 1, 1, 1], [U, U, U, U, U, S]),
    ("always(x > 0 or true)", [-1, -1], [S, S]),
    ("next(x > 0)", [-1, -1], [U, V]),
    ("next(next(x > 0))", [-1, -1, 1], [U, U, S]),
    ("x > 0", [-1, 1], [V, V]),
    ("x > 0", [0, 1], [V, V]),
    ("x >= 0", [0, -1], [S, S]),
    ("always(x >= 0)", [0, 1, -1], [U, U, V]),
    ("eventually[0:1](x == 0)", [1, 0], [U, S]),
    ("eventually[0:1](x != 0)", [0, 0], [U, V]),
    ("x", [0], [S]),
    ("not x", [0], [V]),
    ("x >= 0 until[0:1] x > 0", [0, 0], [U, V]),
    ("eventually[0:2](prev(x > 0))", [-1, 1, -1], [S, S, S]),
    ("eventually[1:2](s_prev(x > 0))", [-1, 1, -1], [U, U, S]),
    ("eventually(once[1:2](x > 0))", [-1, -1, 5], [U, U, U]),
    ("eventually(once[1:2](x > 0))", [-1, -1, 5, -1], [U, U, U, S]),
    ("eventually[2:2](true)", [0, 0, 0], [U, U, S]),
    ("next(prev(x > 0))", [-4, 0], [U, V]),
    ("always(prev(x > 0))", [-4, 0], [U, V]),
    ("(x < 0) until[2:3] true", [1], [V]),
    ("(x < 0) until[2:3] true", [-1, -1, 1], [U, U, S]),
    ("always(once(x > 0))", [1, -1], [S, S]),
    ("eventually(historically(x > 0))", [-1, 1], [V, V]),
    ("always[0:2](historically(x > 0))", [1, 1, -1, -1], [U, U, V, V]),
    ("eventually[0:3](false)", [0], [V]),
    ("always[0:3](3 > 2)", [], []),
]


@pytest.mark.parametrize(("text", "xs", "verdicts"), MOMENTS)
def test_the_verdict_comes_at_the_first_sample_that_decides_it(
    text: str, xs: list[float], verdicts: list[Verdict], backend: Backend
) -> None:
    monitor = EpisodeMonitor(text, backend=backend)
    found = []
    for x in xs:
        monitor.update(dict.fromkeys(monitor.variables, x))
        found.append(monitor.verdict)
    assert found == verdicts


def test_an_empty_cut_window_leaves_robustness_inside_the_bounds(backend: Backend) -> None:
    monitor = EpisodeMonitor("eventually[2:3](x > 0) or x > 5", backend=backend)
    monitor.update(x=7.0)
    assert offered(monitor) == (2.0, 2.0, INF)
    monitor = EpisodeMonitor("not eventually[2:3](true)", backend=backend)
    monitor.update()
    assert offered(monitor) == (INF, -INF, INF)


SHOWN = ("robustness", "lower", "upper", "verdict")


def agrees_with_its_machine(monitor: EpisodeMonitor) -> None:
    machine = monitor._machine
    found = machine.robustness, machine.lower, machine.upper
    assert identical((monitor.robustness, monitor.lower, monitor.upper), found)
    assert monitor.verdict is verdict(*found[1:])


def refused(monitor: EpisodeMonitor) -> None:
    with pytest.raises(InputError):
        monitor.update(math.nan)


def restored_badly(monitor: EpisodeMonitor) -> None:
    state = monitor._machine.state()
    for damaged in (state[:-1], None):
        with pytest.raises((ValueError, TypeError)):
            monitor._machine.restore(damaged)
        agrees_with_its_machine(monitor)
    monitor._machine.restore(state)


CALLS: dict[str, Callable[[EpisodeMonitor], object]] = {
    "reset": EpisodeMonitor.reset,
    "finish": lambda monitor: monitor.finish() if monitor.samples else None,
    "refused": refused,
    "restored badly": restored_badly,
    "restored": lambda monitor: monitor.__setstate__(monitor.__reduce__()[2]),
}


TWINS: dict[str, Callable[[EpisodeMonitor], EpisodeMonitor]] = {
    "itself": lambda monitor: monitor,
    "copy": copy.copy,
    "pickle": lambda monitor: pickle.loads(pickle.dumps(monitor)),
}


@settings(max_examples=examples(60))
@given(
    formula=formulas(endless=True, depth=2).filter(lambda f: bool(f.variables)),
    trace=traces(),
    data=st.data(),
)
def test_attributes_are_those_of_the_machine_after_every_call(
    formula: Formula, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    agrees_with_its_machine(monitor)
    for i in range(length(trace)):
        if monitor.finished:
            monitor.reset()
        feed(monitor, trace, i)
        agrees_with_its_machine(monitor)
        name = data.draw(st.sampled_from(list(CALLS)))
        if name == "restored badly" and backend == "python":
            continue
        CALLS[name](monitor)
        agrees_with_its_machine(monitor)
        monitor = TWINS[data.draw(st.sampled_from(list(TWINS)))](monitor)
        agrees_with_its_machine(monitor)


@pytest.mark.parametrize("name", SHOWN)
def test_attributes_cannot_be_set_or_deleted(name: str, backend: Backend) -> None:
    monitor = EpisodeMonitor("always(x > 0)", backend=backend)
    monitor.update(2.0)
    with pytest.raises(AttributeError):
        setattr(monitor, name, 1.0)
    with pytest.raises(AttributeError):
        delattr(monitor, name)
    agrees_with_its_machine(monitor)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("history", [False, True])
def test_an_update_kept_alone_outlives_its_monitor_which_needs_no_collector(
    backend: Backend, *, history: bool
) -> None:
    monitor = EpisodeMonitor("always(x > 0)", backend=backend, history=history)
    update, gone = monitor.update, weakref.ref(monitor)
    gc.collect()
    gc.disable()
    try:
        del monitor
        assert gone() is None
    finally:
        gc.enable()
    others = [EpisodeMonitor("always(x > 0)", backend=backend) for _ in range(9)]
    assert [update(x) for x in (3.0, -1.0, 2.0)] == [3.0, -1.0, -1.0]
    assert all(other.verdict is Verdict.UNDECIDED for other in others)


@pytest.mark.slow(keep=1)
def test_a_monitor_in_a_cycle_is_collected(backend: Backend) -> None:
    class Cyclic(EpisodeMonitor):
        me: object

    monitor = Cyclic("always(x > 0)", backend=backend)
    monitor.me = monitor
    update, gone = monitor.update, weakref.ref(monitor)
    del monitor
    gc.collect()
    assert gone() is None
    assert update(1.0) == 1.0


@pytest.mark.parametrize("slots", [None, ("extra",)])
def test_a_subclass_has_the_same_attributes(slots: tuple[str] | None, backend: Backend) -> None:
    kind: Any = type("Sub", (EpisodeMonitor,), {} if slots is None else {"__slots__": slots})
    monitor = kind("always(x > 0)", backend=backend)
    monitor.extra = "kept"
    monitor.update(-1.0)
    agrees_with_its_machine(monitor)
    assert (monitor.verdict, monitor.extra) == (Verdict.VIOLATED, "kept")


@pytest.mark.parametrize("name", [*SHOWN, "update", "samples"])
def test_a_half_made_monitor_has_no_values(name: str) -> None:
    with pytest.raises(AttributeError):
        getattr(EpisodeMonitor.__new__(EpisodeMonitor), name)


def test_a_monitor_that_is_made_again_shows_its_new_machine(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(x > 0)", backend=backend)
    monitor.update(-1.0)
    monitor.__init__("always(x > 0)", backend=backend)  # type: ignore[misc] # the attack
    agrees_with_its_machine(monitor)
    monitor.update(5.0)
    agrees_with_its_machine(monitor)


@pytest.mark.parametrize("name", SHOWN)
def test_attributes_are_documented(name: str) -> None:
    assert inspect.getdoc(vars(EpisodeMonitor)[name])


@pytest.mark.parametrize("reader", [read_only, state.read_only])
def test_a_slot_that_is_read_only_is_read(reader: Callable[[MemberDescriptorType], Any]) -> None:
    class Holder:
        __slots__ = {"value": "What it holds."}
        value: object

    holder, empty = Holder(), Holder()
    holder.value = "held"
    setattr(Holder, "value", reader(vars(Holder)["value"]))  # noqa: B010 - mypy knows no such slot
    assert inspect.getdoc(vars(Holder)["value"]) == "What it holds."
    assert holder.value == "held"
    with pytest.raises(AttributeError):
        holder.value = "other"
    with pytest.raises(AttributeError):
        empty.value  # noqa: B018 - reading it is what is tested
