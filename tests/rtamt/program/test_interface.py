"""Laws of the interface-aware semantics on generated formulas; names of fields and errors."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Literal

import boolean_oracle
import numpy as np
import pytest
from bits import identical
from hypothesis import given, settings
from hypothesis import strategies as st
from interface_cases import NEUTRAL, RELATIVE, VACUITY, Case, cases, read
from oracle import episode, horizon, robustness
from profiles import examples
from strategies import (
    INFINITIES,
    VARIABLES,
    Trace,
    chunkings,
    length,
    sample,
    traces,
)

import rtamt
from rtamt import (
    EpisodeMonitor,
    InputError,
    Monitor,
    RtamtError,
    VectorEpisodeMonitor,
    VectorMonitor,
    evaluate,
)
from rtamt.program.interface import STANDARD, Interface, as_interface
from rtamt.typing import SemanticsName

Backend = Literal["native", "python"]
INF = math.inf


def defined(case: Case, trace: Trace) -> list[float]:
    """Return the robustness by definition."""
    return robustness(case[0].formula, trace, length(trace), read(case))


def offline(case: Case, trace: Trace, backend: Backend) -> list[float]:
    values = evaluate(case[0], trace, n=length(trace), semantics=case[1], backend=backend)
    return [float(value) for value in values]


def same(x: object, y: object) -> bool:
    return np.array_equal(np.array(x, float), np.array(y, float), equal_nan=True)


# The definition. ---------------------------------------------------------------------------------


@given(case=cases(endless=True), trace=traces())
def test_evaluate_gives_the_definition_at_every_sample(
    case: Case, trace: Trace, backend: Backend
) -> None:
    assert same(offline(case, trace, backend), defined(case, trace))


@given(case=cases(endless=True, total=False), trace=traces(values=INFINITIES))
def test_infinite_samples_are_compared_like_others(
    case: Case, trace: Trace, backend: Backend
) -> None:
    assert same(offline(case, trace, backend), defined(case, trace))


@given(case=cases(), trace=traces(most=16), data=st.data())
def test_monitor_gives_the_definition_late_by_the_latency_of_the_standard_semantics(
    case: Case, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    spec, semantics = case
    monitor = Monitor(spec, semantics=semantics, backend=backend)
    assert monitor.latency == horizon(spec.formula)
    assert monitor.variables == spec.variables
    n = length(trace)
    expected = [*[math.nan] * monitor.latency, *defined(case, trace)][:n]
    assert same([monitor.update(sample(trace, i, spec.variables)) for i in range(n)], expected)
    if spec.variables:
        monitor.reset()
        columns = {name: np.array(trace[name]) for name in spec.variables}
        blocks = [
            monitor.update_many({name: column[part] for name, column in columns.items()})
            for part in data.draw(chunkings(n))
        ]
        assert same(np.concatenate(blocks), expected)


@given(case=cases(endless=True), trace=traces(most=8))
def test_episode_monitor_gives_the_definition_and_its_bounds(
    case: Case, trace: Trace, backend: Backend
) -> None:
    spec, semantics = case
    monitor = EpisodeMonitor(spec, semantics=semantics, backend=backend)
    for n in range(length(trace) + 1):
        if n:
            monitor.update(sample(trace, n - 1, spec.variables))
        found = (monitor.robustness, monitor.lower, monitor.upper)
        assert identical(found, episode(spec.formula, trace, n, read(case)))


@settings(max_examples=examples(40))
@given(case=cases(), rows=st.lists(traces(least=4, most=4), min_size=3, max_size=3))
def test_entries_in_batch_are_single_monitors(
    case: Case, rows: list[Trace], backend: Backend
) -> None:
    spec, semantics = case
    entries = VectorMonitor(spec, 3, semantics=semantics, backend=backend)
    episodes = VectorEpisodeMonitor(spec, 3, semantics=semantics, backend=backend)
    single = [Monitor(spec, semantics=semantics, backend=backend) for _ in rows]
    whole = [EpisodeMonitor(spec, semantics=semantics, backend=backend) for _ in rows]
    for i in range(4):
        block = np.array([[t[v][i] for v in spec.variables] for t in rows], float).reshape(3, -1)
        assert same(
            entries.update(block), [m.update(*row) for m, row in zip(single, block, strict=True)]
        )
        now = [m.update(*row) for m, row in zip(whole, block, strict=True)]
        assert identical(episodes.update(block), now)
        assert identical(episodes.lower, [m.lower for m in whole])
        assert identical(episodes.upper, [m.upper for m in whole])
        assert episodes.verdict.tolist() == [m.verdict for m in whole]


@pytest.mark.parametrize(
    "duplicate",
    [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))],
    ids=["copy", "deepcopy", "pickle"],
)
@settings(max_examples=examples(20))
@given(case=cases(), trace=traces(least=4, most=8))
def test_a_duplicate_keeps_the_semantics_and_goes_on(
    duplicate: Callable[[Monitor], Monitor], case: Case, trace: Trace, backend: Backend
) -> None:
    spec, semantics = case
    original = Monitor(spec, semantics=semantics, backend=backend)
    cut, n = 2, length(trace)
    for i in range(cut):
        original.update(sample(trace, i, spec.variables))
    twin = duplicate(original)
    assert twin.interface == original.interface
    expected = [*[math.nan] * twin.latency, *defined(case, trace)][cut:n]
    assert same(
        [twin.update(sample(trace, i, spec.variables)) for i in range(cut, n)],
        expected,
    )


# What the semantics are for. ---------------------------------------------------------------------


@given(case=cases(endless=True), trace=traces())
def test_the_sign_says_whether_the_formula_holds_where_no_predicate_counts_0(
    case: Case, trace: Trace, backend: Backend
) -> None:
    n = length(trace)
    for i, value in enumerate(offline(case, trace, backend)):
        if value != 0 or case[1] not in NEUTRAL:
            holds = boolean_oracle.holds(case[0].formula, trace, n, i)
            assert (math.copysign(1, value) > 0) == holds


@given(case=cases(RELATIVE, endless=True), trace=traces())
def test_what_is_given_takes_nothing_away_from_a_margin(
    case: Case, trace: Trace, backend: Backend
) -> None:
    standard = evaluate(case[0], trace, n=length(trace), backend=backend)
    for plain, relative in zip(standard, offline(case, trace, backend), strict=True):
        assert plain <= 0 or relative >= plain
        assert plain >= 0 or relative <= plain


@given(case=cases(VACUITY, endless=True), trace=traces(least=8, most=8), data=st.data())
def test_vacuity_does_not_change_with_the_other_side_and_its_sign_is_that_of_every_trace(
    case: Case, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    spec, semantics = case
    role = semantics.partition("-")[0]
    other = data.draw(traces(least=8, most=8))
    mixed = {v: (trace if spec.declarations[v].io == role else other)[v] for v in VARIABLES}
    vacuity = offline(case, trace, backend)
    assert same(offline(case, mixed, backend), vacuity)
    for i, value in enumerate(vacuity):
        if value != 0:
            holds = boolean_oracle.holds(spec.formula, mixed, 8, i)
            assert (value > 0) == holds


# The figures of the paper. -----------------------------------------------------------------------

GRANTED = "always((req >= 3) implies eventually[0:5](gnt >= 3))"
# (b): never a request. (d): one of height 4, and within its window no grant above 1.
SIGNALS = {
    "b": {"req": [0.0, 2, 2, 0, 1, 0, 0, 0, 0, 0], "gnt": [0.0] * 10},
    "d": {"req": [0.0, 4, 0, 0, 0, 0, 0, 0, 0, 0], "gnt": [0.0, 0, 0, 0, 1, 0, 0, 0, 4, 0]},
}
FIGURES: list[tuple[str, SemanticsName, float]] = [
    ("b", "standard", 1),
    ("b", "output-robustness", INF),
    ("b", "input-vacuity", 1),
    ("b", "input-robustness", 1),
    ("b", "output-vacuity", 0),
    ("d", "standard", -1),
    ("d", "output-robustness", -2),
    ("d", "input-robustness", -1),
    ("d", "input-vacuity", 0),
    ("d", "output-vacuity", 0),
]


@pytest.mark.parametrize(("signal", "semantics", "expected"), FIGURES)
def test_request_and_grant_of_the_paper(
    signal: str, semantics: SemanticsName, expected: float, backend: Backend
) -> None:
    trace = SIGNALS[signal]
    declared = f"input float req; output float gnt; {GRANTED}"
    whole = evaluate(declared, trace, semantics=semantics, backend=backend)
    assert whole[0] == expected
    req, gnt = ("req",), ("gnt",)
    monitor = Monitor(GRANTED, semantics=semantics, inputs=req, outputs=gnt, backend=backend)
    assert monitor.update_many(trace)[-1] == expected
    entries = VectorMonitor(declared, 1, semantics=semantics, backend=backend)
    episode = EpisodeMonitor(declared, semantics=semantics, backend=backend)
    rows = np.array([trace["req"], trace["gnt"]]).T
    for row in rows:
        last = entries.update([row])[0], episode.update(row)
    assert last == (expected, expected)
    assert episode.finish() == expected


PLAIN = "always(req >= 3 implies gnt >= 3)"
DECLARED = f"input float req; output float gnt; {PLAIN}"


@pytest.mark.parametrize(
    "arguments",
    [{"semantics": "input-vacuity"}, {"outputs": "gnt"}, {"inputs": ["gnt"], "outputs": ["gnt"]}],
)
def test_all_monitors_refuse_a_wrong_interface_alike(arguments: dict[str, Any]) -> None:
    makers = (
        lambda: Monitor(PLAIN, **arguments),
        lambda: EpisodeMonitor(PLAIN, **arguments),
        lambda: VectorMonitor(PLAIN, 2, **arguments),
        lambda: VectorEpisodeMonitor(PLAIN, 2, **arguments),
        lambda: evaluate(PLAIN, {"req": [1], "gnt": [1]}, **arguments),
    )
    messages = set()
    for make in makers:
        with pytest.raises(RtamtError) as caught:
            make()
        messages.add(str(caught.value))
    assert len(messages) == 1


def test_the_signature_is_that_of_the_text_unless_it_is_given() -> None:
    spec = rtamt.parse(DECLARED)
    declared = as_interface(spec, "output-vacuity")
    assert declared == Interface("output-vacuity", ("req",), ("gnt",))
    assert as_interface(spec) == STANDARD  # which asks for no signature
    turned = as_interface(spec, "input-vacuity", inputs=["gnt"], outputs={"req": 1})
    assert turned == Interface("input-vacuity", ("gnt",), ("req",))
    assert as_interface(spec, "input-vacuity", iter(["req"])).inputs == ("req",)


MESSAGES = """
from geometry import Twist
input Twist cmd
output Twist odom
output float cmd.ok
cmd.linear.x > 1 or cmd.linear.y > 1 or cmd.ok > 1 or odom.linear.x > 1
"""


def test_a_side_that_is_said_to_be_empty_leaves_every_predicate_to_the_other() -> None:
    spec, data = "req >= 3 or gnt >= 3", {"req": [4, 1], "gnt": [0, 1]}
    robustness = evaluate(spec, data, semantics="output-robustness", outputs=())
    assert robustness.tolist() == [math.inf, -math.inf]
    vacuity = evaluate(spec, data, semantics="input-vacuity", inputs=(), outputs=("req", "gnt"))
    assert vacuity.tolist() == [0.0, 0.0]


def test_a_message_stands_for_its_fields_and_the_innermost_name_decides() -> None:
    spec = rtamt.parse(MESSAGES, modules={"geometry": SimpleNamespace(Twist=object)})
    roles = {name: as_interface(spec, "input-vacuity").role(name) for name in spec.variables}
    inputs, outputs = {"cmd.linear.x", "cmd.linear.y"}, {"odom.linear.x", "cmd.ok"}
    assert roles == {**dict.fromkeys(inputs, "input"), **dict.fromkeys(outputs, "output")}
    assert set(spec.inputs) == inputs
    assert set(spec.outputs) == outputs
    plain = rtamt.parse("cmd.linear.x > 1 or cmd.linear.y > 1 or cmd.ok > 1")
    given = as_interface(plain, "input-vacuity", ["cmd.linear"], ["cmd", "cmd.linear.y"])
    assert [given.role(f"cmd.{name}") for name in ("linear.x", "linear.y", "ok")] == [
        "input",
        "output",
        "output",
    ]
    assert evaluate(
        plain, [[5.0, 9, 9]], semantics="input-vacuity", inputs=["cmd.linear.x"]
    ).tolist() == [4.0]


def test_comparisons_of_what_is_given_tell_strict_from_weak() -> None:
    expected = {"<": False, "<=": True, "==": True, "!=": False, ">=": True, ">": False}
    for comparison, holds in expected.items():
        text = f"input float x; output float y; x {comparison} 3"
        value = evaluate(text, {"x": [3.0]}, semantics="output-robustness")
        assert value == [float("inf") if holds else float("-inf")]


def test_a_predicate_of_no_concern_keeps_its_zero_and_its_variables() -> None:
    monitor = EpisodeMonitor(
        "always[0:9](req >= 3) and gnt + req > 0", semantics="output-vacuity", outputs=["gnt"]
    )
    assert (monitor.lower, monitor.upper) == (0.0, 0.0)
    assert monitor.variables == ("req", "gnt")
    assert monitor.update(req=1.0, gnt=5.0) == monitor.lower == monitor.upper == 0.0


def test_what_is_not_computed_cannot_fail_and_what_is_compared_can() -> None:
    text = "sqrt(x) > 1 or y > 1"
    monitor = Monitor(text, semantics="output-vacuity", outputs=["y"])
    assert monitor.update(x=-1.0, y=3.0) == 2.0
    compared = Monitor(text, semantics="output-robustness", outputs=["y"])
    message = r"^'sqrt\(x\)' is not a number at sample 0, where x = -1.0$"
    with pytest.raises(InputError, match=message):
        compared.update(x=-1.0, y=3.0)
    assert compared.update(x=1.5, y=3.0) == float("inf")
