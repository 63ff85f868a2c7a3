"""Texts of explanations in dense time, ties, edges of the trace, and errors."""

import math
import pickle
from typing import Any

import numpy as np
import pytest

import rtamt
from rtamt import explain, variable

SPEC = """
granted = eventually[0:1s](gnt >= 3)
out = always(req >= 3 implies granted)
"""
TRACE: dict[str, Any] = {
    "req": [(100, 0), (101, 5), (101.25, 0), (104, 0)],
    "gnt": [(100, 0), (101.5, 2.5), (102.125, 1), (104, 1)],
    "note": [(0, 0)],
}


def test_an_explanation_is_a_table_with_names_times_and_the_values_that_decided() -> None:
    explanation = rtamt.dense.explain(SPEC, TRACE)
    assert str(explanation) == (
        "robustness -0.5 at 100 s, decided by gnt >= 3 at 101.5 s\n"
        "\n"
        "     at  value  formula\n"
        "  100 s   -0.5  out = always(req >= 3 implies granted)\n"
        "  101 s   -0.5  req >= 3 implies granted\n"
        "  101 s   -0.5  granted = eventually[0:1s](gnt >= 3)\n"
        "101.5 s   -0.5  gnt >= 3\n"
        "101.5 s    2.5  gnt\n"
        "  101 s      2  held: req >= 3\n"
        "101.5 s   -0.5  missing: gnt >= 3\n"
        "                  never from 101 s to 102 s; this is the nearest"
    )
    assert [step.name for step in explanation.steps] == ["out", None, "granted", None]
    assert [step.time for step in explanation.steps] == [100, 101, 101, 101.5]
    assert explanation.robustness == -0.5
    assert (explanation.time, explanation.end, explanation.unit) == (100.0, 104.0, "s")
    assert explanation.predicate is (variable("gnt") >= 3)
    assert explanation.causes == (("gnt", 101.5, 2.5),)
    assert pickle.loads(pickle.dumps(explanation)) == explanation


def test_times_are_shown_in_the_unit_of_the_specification_and_dates_as_dates() -> None:
    spec = rtamt.parse("always[0:2](x < 5)", unit="ms")
    assert str(rtamt.dense.explain(spec, {"x": [(0, 1), (0.3, 6), (4, 6)]})).splitlines()[2:] == [
        "    at  value  formula",
        "  0 ms     -1  always[0:2](x < 5)",
        "0.3 ms     -1  x < 5",
        "0.3 ms      6  x",
    ]
    times = np.array(["2026-01-01T00:00:00", "2026-01-01T00:00:03.5"], "datetime64[ms]")
    explanation = rtamt.dense.explain("eventually(x > 3)", {"x": rtamt.dense.Events(times, [1, 2])})
    assert str(explanation).splitlines()[2:6] == [
        "                   at  value  formula",
        "  2026-01-01T00:00:00     -1  eventually(x > 3)",
        "2026-01-01T00:00:03.5     -1  x > 3",
        "2026-01-01T00:00:03.5      2  x",
    ]
    assert explanation.end == times[1]


@pytest.mark.parametrize(
    ("formula", "time", "decided"),
    [
        ("always(a)", 0, ("a", 1)),
        ("eventually(not a)", 0, ("a", 1)),
        ("always[0.5:2](a)", 0, ("a", 1)),
        ("always[0.5:2](a)", 1, ("a", 1.5)),
        ("historically(a)", 3, ("a", 1)),
        ("once(not a)", 3, ("a", 1)),
        ("historically[0:1.75](a)", 3, ("a", 1.25)),
        ("a and b", 3, ("a", 3)),
        ("b and a", 3, ("b", 3)),
        ("not b implies a", 3, ("b", 3)),
        ("a until (c + 0)", 0, ("a", 1)),
        ("b since a", 3, ("b", 0)),
    ],
)
def test_of_equal_values_the_first_operand_and_the_first_time_decide(
    formula: str, time: float, decided: tuple[str, float]
) -> None:
    trace = {
        "a": [(0, 2), (1, 1), (2, 2), (3, 1)],
        "b": [(0, 1), (3, 1)],
        "c": [(0, 0), (2, 1), (3, 1)],
    }
    explanation = rtamt.dense.explain(formula, trace, time)
    assert abs(explanation.robustness) == 1
    assert [(c.variable, c.time) for c in explanation.causes] == [decided]


@pytest.mark.parametrize(
    ("formula", "decided"),
    [
        ("x >= 0 and y >= 0", "x"),  # both are 0.0
        ("x > 0 or y > 0", "x"),  # both are -0.0
        ("x > 0 and y >= 0", "x"),
        ("x >= 0 and y > 0", "y"),
        ("x > 0 or y >= 0", "y"),
        ("x < 0 unless y > 0", "x"),
    ],
)
def test_of_zeros_that_are_equal_the_first_operand_decides(formula: str, decided: str) -> None:
    events: dict[str, Any] = {"x": [(0, 0), (1, 0)], "y": [(0, 0), (1, 0)]}
    explanation = rtamt.dense.explain(formula, events, 1)
    assert [(c.variable, c.time) for c in explanation.causes] == [(decided, 1)]
    sampled = explain(formula, {"x": [0, 0], "y": [0, 0]}, sample=1)
    assert [(c.variable, c.sample) for c in sampled.causes] == [(decided, 1)]


def test_only_what_holds_has_a_witness() -> None:
    trace = {"a": [(0, 3), (2, 1), (4, 1)], "b": [(0, -3), (2, -1), (4, -1)]}
    said = "      nearest: the right side at 2 s\n"
    for formula in ("a > 0 since b > 0", "not (a > 0 since b > 0)"):
        text = str(rtamt.dense.explain(formula, trace, 3))
        assert (said in text, "witness" in text) == (True, False)
    text = str(rtamt.dense.explain("a > 0 since b >= -1", trace, 3))
    assert (said.replace("nearest", "witness") in text, "nearest: " in text) == (True, False)


def test_a_witness_and_a_stretch_without_a_first_instant_are_named() -> None:
    trace = {"a": [(0, 1), (2, 4), (6, 4)], "b": [(0, 0), (1, 5), (2, 0), (6, 0)]}
    # The right side holds from 1 s to 2 s, and right after every moment of it a is 1.
    explanation = rtamt.dense.explain("a since b", trace, 5)
    assert str(explanation) == (
        "robustness 1 at 5 s, decided by a after 1 s\n"
        "\n"
        "       at  value  formula\n"
        "      5 s      1  a since b\n"
        "                    witness: the right side at 1 s\n"
        "after 1 s      1  a\n"
        "      1 s      1  a"
    )
    assert [(step.time, step.after) for step in explanation.steps] == [(5, False), (1, True)]
    # At 1 s, b is reached at 2 s, and a is 1 up to there. Right after, a must hold at 2 s too.
    trace = {"a": [(0, 1), (2, -4), (6, 4)], "b": [(0, 0), (2, 5), (6, 0)]}
    explanation = rtamt.dense.explain("a until[1:2] b", trace, 1)
    assert (explanation.robustness, explanation.causes) == (1, (("a", 1.0, 1.0),))
    assert (explanation.steps[0].witness, explanation.steps[0].witness_after) == (2.0, False)
    explanation = rtamt.dense.explain("once[1:1](always[0:1](a until[1:2] b))", trace, 2)
    assert explanation.robustness == -4 == rtamt.dense.evaluate("a until[1:2] b", trace)[1][1]
    assert [(step.time, step.after) for step in explanation.steps[1:]] == [
        (1, False),
        (1, True),
        (2, False),
    ]
    assert explanation.causes == (("a", 2.0, -4.0),)


def test_single_instants_are_explained() -> None:
    landed: dict[str, Any] = {"x": [(0, -1), (2, 5)]}
    assert str(rtamt.dense.explain("eventually[2:2](x > 0)", landed)) == (
        "robustness 5 at 0 s, decided by x > 0 at 2 s\n"
        "\n"
        " at  value  formula\n"
        "0 s      5  eventually[2:2](x > 0)\n"
        "2 s      5  x > 0\n"
        "2 s      5  x"
    )
    handed: dict[str, Any] = {
        "idle": [(0, 2), (1, -1), (3, -1)],
        "active": [(0, -1), (1, 1), (3, 1)],
    }
    explanation = rtamt.dense.explain("idle > 0 until[1:2] active > 0", handed)
    assert (explanation.robustness, explanation.steps[0].witness) == (1, 1)
    assert explanation.causes == (("active", 1.0, 1.0),)
    both = rtamt.dense.explain(
        "eventually(x > 4 and once[1:1](x < 0))", {"x": [(0, -1), (1, 5), (2, 5)]}
    )
    assert [step.time for step in both.steps] == [0, 1, 1]
    assert both.robustness == 1


def test_a_window_outside_the_trace_is_named() -> None:
    trace = {"a": [(0, 3), (1.5, 3)], "b": [(0, 0), (1.5, 0)]}
    shown = {
        "not eventually[2.5:4.5](a)": "2.5 s to 4.5 s",
        "always[2:2](a)": "2 s",
        "eventually[2:inf](a)": "from 2 s on",
        "once[0.5:inf](a)": "up to -0.5 s",
        "a since[1:1.5] b": "-1.5 s to -1 s",
        "a until[2:3] b": "2 s to 3 s",
    }
    for formula, window in shown.items():
        explanation = rtamt.dense.explain(formula, trace)
        assert (explanation.causes, explanation.predicate) == ((), None)
        assert abs(explanation.robustness) == math.inf
        note = str(explanation).splitlines()[-1].strip()
        assert note == f"its window lies outside the trace: {window}"
    assert rtamt.dense.explain("always[1:2](a)", trace, 0.5).robustness == 3
    lines = str(rtamt.dense.explain("not always(eventually[1:2](a))", trace)).splitlines()
    assert lines[0] == "robustness inf at 0 s, decided by a window outside the trace after 0.5 s"
    assert " ".join(" ".join(lines[6:]).split()) == (
        "right after that time, its window lies outside the trace: 1.5 s to 2.5 s"
    )


def test_what_a_predicate_counts_under_interface_semantics_is_said() -> None:
    spec = "input float req; output float gnt; always(req >= 3 implies {})"
    given = rtamt.dense.explain(
        spec.format("false and gnt > 1"), TRACE, semantics="output-robustness"
    )
    assert str(given) == (
        "robustness -inf at 100 s, decided by req >= 3 at 101 s\n"
        "\n"
        "   at  value  formula\n"
        "100 s   -inf  always(req >= 3 implies false and gnt > 1)\n"
        "101 s   -inf  req >= 3 implies false and gnt > 1\n"
        "101 s    inf  req >= 3\n"
        "                counts only whether it holds\n"
        "101 s      5  req"
    )
    mixed = rtamt.dense.explain(spec.format("req > gnt"), TRACE, semantics="output-vacuity")
    assert str(mixed).splitlines()[5:7] == [
        "100 s      0  req > gnt",
        "                of no concern: counts 0",
    ]
    assert (
        mixed.robustness
        == rtamt.dense.evaluate(spec.format("req > gnt"), TRACE, semantics="output-vacuity")[0][1]
    )


def test_of_a_zero_it_is_said_whether_the_formula_holds() -> None:
    trace = {"gear": [(0, 1), (2, 2), (3, 2)]}
    assert "robustness 0, holds, at 0 s" in str(rtamt.dense.explain("gear == 1", trace))
    assert "0, violated" in str(rtamt.dense.explain("eventually[2:3] gear > 2", trace))


def test_what_decides_nothing_may_have_no_value() -> None:
    text, trace = "(sqrt(x) > 0 until[0:0] y > 0) and x < 0", {"x": [(0, -1)], "y": [(0, 1)]}
    explanation = rtamt.dense.explain(text, trace)
    assert explanation.robustness == 1.0
    assert explanation.causes == (("y", 0.0, 1.0),)


def test_a_message_is_explained_by_its_field() -> None:
    class Command:
        def __init__(self, speed: float) -> None:
            self.speed = speed

    trace = {"cmd": [(0, Command(1)), (2, Command(7)), (3, Command(0))]}
    explanation = rtamt.dense.explain("always(cmd.speed < 5)", trace)
    assert explanation.causes == (("cmd.speed", 2.0, 7.0),)


# Refused. ----------------------------------------------------------------------------------------


def test_what_evaluate_dense_refuses_is_refused_alike() -> None:
    cases: list[tuple[str, Any, dict[str, Any]]] = [
        ("always(a)", {"b": [(0, 1)]}, {}),
        ("always(a)", {"a": []}, {}),
        ("always(a)", [(0, 1)], {}),
        ("always(a and b)", {"a": [(0, 1), (1, 1)], "b": [(2, 1), (3, 1)]}, {}),
        ("always(sqrt(a) > 0)", {"a": [(0, 1), (2, -1), (3, 1)]}, {}),
        ("always(a)", {"a": [(0, 1), (0, 2)]}, {}),
        ("always(a)", {"a": [(0, math.nan)]}, {}),
        ("always[0:0.25](a)", {"a": [(0, 1)]}, {"resolution": "100ms"}),
        ("prev a", {"a": [(0, 1)]}, {}),
        ("always(true)", {}, {}),
        ("always(a)", {"a": [(0, 1)]}, {"semantics": "input-vacuity"}),
        ("always(a)", {"a": [(0, 1)]}, {"resolution": 0}),
        ("a = always(b\n", {"b": [(0, 1)]}, {}),
    ]
    for formula, signals, options in cases:
        messages = []
        for function in (rtamt.dense.evaluate, rtamt.dense.explain):
            with pytest.raises(rtamt.RtamtError) as caught:
                function(formula, signals, **options)
            messages.append(str(caught.value))
        assert messages[0] == messages[1]


def test_a_monitor_of_the_same_events_gives_the_robustness_that_is_explained() -> None:
    monitor = rtamt.dense.Monitor(SPEC.replace("always", "always[0:1]"))
    given = {name: TRACE[name] for name in monitor.variables}
    for time, robustness in monitor.update(given) + monitor.finish():
        explained = rtamt.dense.explain(monitor.specification, TRACE, time)
        assert explained.robustness == robustness
