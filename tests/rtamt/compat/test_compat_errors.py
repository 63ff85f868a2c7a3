"""Errors and warnings of the drop-in classes."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import pytest
from catalogue import check, entries
from compat_specs import declared, declared_dense

import rtamt
from rtamt import Language, StlDenseTimeSpecification, StlDiscreteTimeSpecification
from rtamt.compat.specification import AbstractSpecification


def test_every_error_is_the_released_exception() -> None:
    assert issubclass(rtamt.RtamtError, rtamt.RTAMTException)
    assert issubclass(rtamt.ParseError, rtamt.RTAMTException)


@pytest.mark.parametrize(("call", "said"), entries(Path(__file__).with_name("errors.txt")))
def test_errors_of_calls(call: str, said: str) -> None:
    new = StlDiscreteTimeSpecification()
    new.import_module("fractions", "Fractoin")
    new.declare_const("k", "float", "1")
    spec, fed = (declared("a > b", ("a", "b")) for _ in range(2))
    fed.update(0, [("a", 3.0), ("b", 1.0)])
    check(call, said, new=new, spec=spec, fed=fed)
    assert fed.update(1, [("b", 2.0)]) == 1.0


def test_hold_replaces_a_refused_nan() -> None:
    trace = {"a": [1.0, 1.0], "b": [0.0, math.nan]}
    assert list(rtamt.evaluate("a > b", trace, nan="hold")) == [1.0, 1.0]


def test_after_an_error_all_is_as_before() -> None:
    spec, twin = declared("historically[0:1](a > b)"), declared("historically[0:1](a > b)")
    for copy in (spec, twin):
        copy.update(0, [("a", 3.0), ("b", 1.0)])
    for bad in ([("a", float("nan"))], [("a", "3")], [("b", None)]):
        with pytest.raises(rtamt.RTAMTException):
            spec.update(5, bad)
    assert spec.update(1, [("b", 2.0)]) == twin.update(1, [("b", 2.0)]) == 1.0
    assert spec.sampling_violation_counter == 0
    assert spec.var_object_dict == twin.var_object_dict
    spec.spec = "a >"
    with pytest.raises(rtamt.ParseError):
        spec.parse()
    assert spec.update(2, [("a", 9.0)]) == twin.update(2, [("a", 9.0)])


def test_bound_error_names_set_sampling_period() -> None:
    text = (
        "STL:1:7: bound 1.5 s is not a multiple of the period 1 s (1.5 steps)\n"
        "  always[0:1.5](a > 1)\n"
        "        ^\n"
        "  hint: use 1 s or 2 s, or take samples 0.5 s apart and say so with set_sampling_period()"
    )
    spec = declared("always[0:1.5](a > 1)")
    calls: list[Callable[[], object]] = [
        lambda: spec.update(0, [("a", 3.0)]),
        lambda: spec.evaluate({"time": [0, 1], "a": [2.0, 0.0]}),
    ]
    for call in calls:
        with pytest.raises(rtamt.ParseError) as caught:
            call()
        assert str(caught.value) == text


@pytest.mark.parametrize(
    ("formula", "hint"),
    [
        (
            "a > 1 implies eventually(a > 2)",
            "write an end, as in eventually[0:10], or call evaluate() with all of it",
        ),
        ("prev(a > 1)", "look a time d away with once[0:d], or use StlDiscreteTimeSpecification"),
        ("out = 5", "use StlDiscreteTimeSpecification, or a formula of a variable"),
    ],
)
def test_hints_name_the_released_classes(formula: str, hint: str) -> None:
    spec = StlDenseTimeSpecification()
    spec.declare_var("a", "float")
    spec.spec = formula
    spec.parse()
    with pytest.raises(rtamt.STLParseException) as caught:
        spec.update(["a", [[0, 1]]])
    assert str(caught.value).endswith(f"\n  hint: {hint}")


def test_dense_resolution_errors_name_dense_monitor() -> None:
    spec = StlDenseTimeSpecification()
    spec.declare_var("a", "float")
    spec.spec = "once[0:0.0000000015](a > 1)"
    spec.parse()
    calls: list[Callable[[], object]] = [
        lambda: spec.update(["a", [[0, 1]]]),
        lambda: spec.evaluate(["a", [[0, 1]]]),
    ]
    for call in calls:
        with pytest.raises(rtamt.ParseError) as caught:
            call()
        assert caught.value.hint == (
            "write whole nanoseconds, or use rtamt.dense.Monitor with resolution='500ps'"
        )
    spec.spec = "a > 1"
    spec.parse()
    with pytest.raises(rtamt.RTAMTException) as caught_input:
        spec.evaluate(["a", [[0, 1], [1e20, 1]]])
    assert str(caught_input.value) == (
        "expected a time of less than 2**62 ticks of 1ns at event 1 of 'a', got 1e+20; "
        "rtamt.dense.Monitor takes it with resolution='100s'"
    )


def test_a_future_without_end_is_refused_online_alone() -> None:
    spec = declared("a > 1 implies eventually(b > 1)")
    assert spec.evaluate({"time": [0, 1], "a": [2.0, 0.0], "b": [0.0, 3.0]})[0] == [0, 2.0]
    with pytest.raises(rtamt.RTAMTException, match="'eventually' without an end"):
        spec.update(0, [])


def test_the_native_machines_are_asked_for_by_language() -> None:
    spec = declared("a > 1", language=Language.CPP)
    if rtamt.BACKEND == "native":
        assert spec.update(0, [("a", 3.0)]) == 2.0
    else:
        with pytest.raises(rtamt.RTAMTException, match="native"):
            spec.update(0, [("a", 3.0)])


@pytest.mark.parametrize("call", ["update", "evaluate", "final_update"])
@pytest.mark.parametrize(
    ("events", "expected_text"),
    [
        ([[0.0, 1], ["late", 2]], "expected a number as the time of event 1 of 'x', got str"),
        ([[None, 1], [1.0, 2]], "expected a number as the time of event 0 of 'x', got NoneType"),
        ([[0.0, 1], [math.nan, 2]], "expected a finite time at event 1 of 'x', got nan"),
        ([[0.0, 1], [math.inf, 2]], "expected a finite time at event 1 of 'x', got inf"),
    ],
)
def test_wrong_times_error_for_each_call(
    call: str, events: list[list[Any]], expected_text: str
) -> None:
    spec = declared_dense("x > 0 and y > 0", ("x", "y"))
    with pytest.raises(rtamt.RTAMTException) as error:
        getattr(spec, call)(["x", events], ["y", [[0.0, 1.0], [3.0, 1.0]]])
    assert str(error.value).startswith(expected_text)


_S = TypeVar("_S", bound=AbstractSpecification)
Kind = Callable[[], AbstractSpecification]

CLASSES: list[Kind] = [
    rtamt.StlDiscreteTimeOnlineSpecification,
    rtamt.StlDiscreteTimeOfflineSpecification,
    rtamt.StlDenseTimeOnlineSpecification,
    rtamt.StlDenseTimeOfflineSpecification,
]


def specified(kind: Callable[[], _S], text: str, *names: str) -> _S:
    """Return a specification of variables of type float, not yet parsed."""
    spec = kind()
    for name in names:
        spec.declare_var(name, "float")
    spec.spec = text
    return spec


@pytest.mark.parametrize("kind", CLASSES)
def test_a_name_that_nobody_declares_is_refused_at_parse(kind: Kind) -> None:
    spec = specified(kind, "always[0:1](sped < 30)", "speed")
    with pytest.raises(rtamt.ParseError) as caught:
        spec.parse()
    assert str(caught.value) == (
        "STL:1:13: 'sped' is not declared\n"
        "  always[0:1](sped < 30)\n"
        "              ^\n"
        "  hint: did you mean 'speed'? declare_var('sped', 'float') declares it"
    )
    spec.spec = "always[0:1](speed < 30)"
    spec.parse()
    spec.spec = "sped < 30"
    with pytest.raises(rtamt.ParseError, match="'sped' is not declared"):
        spec.parse()
    spec.add_var("sped")
    spec.parse()


UNDECLARED = [
    ("a > 3", [], "1:1: 'a'", "declare_var('a', 'float') declares it"),
    ("cmd.linear.x > 3", [], "1:1: 'cmd.linear.x'", "declare_var('cmd', 'float') declares it"),
    ("p and quiet", ["p = x > 1"], "2:7: 'quiet'", "declare_var('quiet', 'float') declares it"),
    ("p and x > 1", ["p = yy > 1"], "1:5: 'yy'", "declare_var('yy', 'float') declares it"),
    (
        "sped > x or spede > x",
        ["speed = x + 1"],
        "2:1: 'sped'",
        "did you mean 'speed'? declare_var('sped', 'float') declares it",
    ),
    ("float y; y > 1 and x > 1 and z > 1", [], "1:30: 'z'", "declare it: float z"),
]


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize(("text", "parts", "where", "hint"), UNDECLARED)
def test_undeclared_name_error_shows_its_place(
    kind: Kind, text: str, parts: list[str], where: str, hint: str
) -> None:
    spec = specified(kind, text, "x")
    for part in parts:
        spec.add_sub_spec(part)
    with pytest.raises(rtamt.ParseError) as caught:
        spec.parse()
    assert str(caught.value).startswith(f"STL:{where} is not declared\n")
    assert caught.value.hint == hint


@pytest.mark.parametrize("kind", CLASSES)
def test_calls_and_the_text_may_each_declare_a_part(kind: Kind) -> None:
    spec = specified(kind, "float y\nconst float k = 2\nout = p and y > k and x > c", "x")
    spec.declare_const("c", "float", "1")
    spec.add_sub_spec("p = x > 0")
    spec.parse()
    assert {"x", "y", "p", "out", "c"} <= spec.vars


@pytest.mark.parametrize("word", ["min", "max", "rise", "fall", "abs", "sqrt", "log", "s", "ms"])
def test_language_words_as_variables(word: str) -> None:
    for text in (f"{word} > 1 and a > 2", f"float b\nonce({word} - 1 > 0) and (a > 2 or b > 99)"):
        discrete = specified(rtamt.StlDiscreteTimeSpecification, text, word, "a")
        discrete.parse()
        assert discrete.update(0, [(word, 3.0), ("a", 7.0)]) == 2.0
        assert discrete.evaluate({"time": [0], word: [3.0], "a": [7.0], "b": [0.0]}) == [[0, 2.0]]
        dense = specified(rtamt.StlDenseTimeSpecification, text, word, "a")
        dense.parse()
        events = [word, [[0.0, 3.0]]], ["a", [[0.0, 7.0]]], ["b", [[0.0, 0.0]]]
        assert dense.update(*events) == dense.evaluate(*events) == [[0.0, 2.0]]
        assert discrete.get_value(word) == [3.0]


def test_ignored_similar_name_warns_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    expected_text = (
        "the data of 'sped' is ignored: no variable has that name; did you mean 'speed'?"
    )
    discrete = specified(
        rtamt.StlDiscreteTimeSpecification, "speed < 30 and gap > 1", "speed", "gap"
    )
    discrete.parse()
    sample: list[tuple[Any, float]] = [("sped", 50.0), ("gap", 5.0), ("other", 1.0), (7, 1.0)]
    for i in range(3):
        assert discrete.update(i, sample) == 4.0
    assert caplog.messages == [expected_text]
    dense = specified(rtamt.StlDenseTimeSpecification, "speed < 30 and gap > 1", "speed", "gap")
    dense.parse()
    for i in range(3):
        assert dense.update(["sped", [[i, 50.0]]], ["gap", [[i, 5.0]]], ["other", []]) == []
    assert caplog.messages == [expected_text, expected_text]


def test_extra_data_is_ignored_silently(
    caplog: pytest.LogCaptureFixture,
) -> None:
    discrete = specified(rtamt.StlDiscreteTimeSpecification, "speed1 < 30", "speed1")
    discrete.parse()
    assert discrete.update(0, [("speed1", 20.0), ("speed2", 50.0)]) == 10.0
    dense = specified(rtamt.StlDenseTimeSpecification, "speed1 < 30", "speed1")
    dense.parse()
    assert dense.update(["speed1", [[0, 20.0]]], ["speed2", [[0, 50.0]]]) == [[0.0, 10.0]]
    assert caplog.messages == []
