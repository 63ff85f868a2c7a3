"""Elements of lists in messages, ``scan.ranges[0]``, equal the elements of the list."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from message_classes import MODULES, Twist

import rtamt
from rtamt import EpisodeMonitor, InputError, Monitor, evaluate
from rtamt.language.declarations import joined, lineage, steps

SPEC = rtamt.parse("scan.ranges[0] > 1 and scan.rows[1].x[2] < scan.gain")
ROWS = st.lists(st.tuples(*(st.floats(-9, 9, width=16) for _ in range(3))), min_size=1, max_size=6)
WORDS = st.sampled_from(["a", "b_1", "Ranges", "min"])
NAMES = st.tuples(WORDS, st.lists(WORDS | st.integers(0, 300), max_size=4)).map(
    lambda parts: (parts[0], *parts[1])
)


def message(row: tuple[float, float, float], form: str = "object") -> Any:  # noqa: ANN401 - a message is anything
    """Return a message with a row's values in the read fields, and others in the rest."""
    first, second, gain = row
    inner = [0.0, 0.0, second]
    match form:
        case "object":
            rows = (SimpleNamespace(x=()), SimpleNamespace(x=inner))
            return SimpleNamespace(ranges=np.array([first, 99.0]), rows=rows, gain=gain)
        case "mapping":
            return {"ranges": (first,), "rows": [None, {"x": inner}], "gain": gain}
        case _:
            return {"ranges": [first, None], "rows": [0, SimpleNamespace(x=inner)], "gain": gain}


def expected(rows: list[tuple[float, float, float]]) -> list[float]:
    """Return the robustness of every row."""
    return [min(first - 1, gain - second) for first, second, gain in rows]


@given(ROWS, st.sampled_from(["object", "mapping", "mixed"]))
def test_messages_with_lists_are_samples(rows: list[Any], form: str) -> None:
    messages = [message(row, form) for row in rows]
    online = Monitor(SPEC)
    assert [online.update(scan=m) for m in messages] == expected(rows)
    episode = EpisodeMonitor(SPEC.always())
    assert [episode.update({"scan": m}) for m in messages][-1] == min(expected(rows))
    assert evaluate(SPEC, {"scan": messages}).tolist() == expected(rows)
    assert Monitor(SPEC).update_many({"scan": messages}).tolist() == expected(rows)


@given(ROWS)
def test_lists_alone_are_messages(rows: list[Any]) -> None:
    text = "x[0] > 1 and y.x[2] < y.gain"
    online = Monitor(text)
    for first, second, gain in rows:
        value = online.update({"x": [first], "y.x": (0, 0, second), "y.gain": gain})
        assert value == min(first - 1, gain - second)


@given(ROWS)
def test_columns_of_lists_have_a_list_for_every_sample(rows: list[Any]) -> None:
    table = np.array(rows)
    n = len(rows)
    columns = {
        "ranges": table[:, :1],
        "rows": [(None, {"x": [0, 0, row[1]]}) for row in rows],
        "gain": table[:, 2],
    }
    assert evaluate(SPEC, {"scan": columns}).tolist() == expected(rows)
    flat = {
        "scan.ranges": [[first] for first, _, _ in rows],
        "scan.rows[1].x": np.stack([np.zeros(n), np.zeros(n), table[:, 1]], axis=1),
        "scan.gain": table[:, 2],
    }
    assert evaluate(SPEC, flat).tolist() == expected(rows)


@given(ROWS)
def test_events_of_messages_with_lists_are_those_of_their_elements(rows: list[Any]) -> None:
    events = [(float(t), message(row)) for t, row in enumerate(rows)]
    names = ("scan.ranges[0]", "scan.rows[1].x[2]", "scan.gain")
    single = {
        name: [(float(t), row[at]) for t, row in enumerate(rows)] for at, name in enumerate(names)
    }
    assert rtamt.dense.evaluate(SPEC, {"scan": events}) == rtamt.dense.evaluate(SPEC, single)
    whole, parts = rtamt.dense.Monitor(SPEC), rtamt.dense.Monitor(SPEC)
    assert whole.update({"scan": events}) == parts.update(single)
    assert whole.finish() == parts.finish()


@given(NAMES)
def test_a_name_is_read_printed_and_taken_apart_alike(path: tuple[str | int, ...]) -> None:
    name = joined(path)
    assert steps(name) == path
    spec = rtamt.parse(f"always[0:2]({name} > 1) and abs({name}) / 2 < 3")
    assert spec.variables == (name,)
    assert rtamt.parse(str(spec)) == spec
    assert (rtamt.variable(name) > 1).always(0, 2) is spec.formula.args[0]
    assert [steps(each) for each in lineage(name)] == [
        path[:end] for end in range(len(path), 0, -1)
    ]


@pytest.mark.parametrize(
    ("given_", "text"),
    [
        ({"ranges": [1.0]}, "'scan.ranges' at sample 0 (list) has 1 element, none of them [2]"),
        ({"ranges": ()}, "'scan.ranges' at sample 0 (tuple) has 0 elements, none of them [2]"),
        (
            {"ranges": 3.0},
            "'scan.ranges' at sample 0 (float) has no elements, expected a list with [2]",
        ),
        (
            {"ranges": {"2": 1.0}},
            "'scan.ranges' at sample 0 (dict) has 1 element, none of them [2]",
        ),
        (
            {"range": [1.0]},
            "'scan' at sample 0 (dict) has no field 'ranges'; did you mean 'range'?",
        ),
    ],
)
def test_an_element_that_is_not_there_is_said(given_: dict[str, Any], text: str) -> None:
    monitor = Monitor("scan.ranges[2] > 0")
    with pytest.raises(InputError) as error:
        monitor.update(scan=given_)
    assert str(error.value) == text
    assert monitor.samples == 0
    with pytest.raises(InputError) as error:
        evaluate("scan.ranges[2] > 0", {"scan": [{"ranges": [0, 0, 0]}, given_]})
    assert str(error.value) == text.replace("sample 0", "sample 1")


def test_an_element_of_a_column_that_is_not_there_is_said() -> None:
    with pytest.raises(InputError) as error:
        evaluate("scan.ranges[2] > 0", {"scan": {"ranges": [[1, 2, 3], [1, 2]]}})
    assert str(error.value) == ("'scan.ranges' at sample 1 (list) has 2 elements, none of them [2]")
    with pytest.raises(InputError) as error:
        rtamt.dense.Monitor("scan.ranges[2] > 0").update({"scan": [(1.5, {"ranges": [1]})]})
    assert str(error.value) == ("'scan.ranges' at time 1.5 (list) has 1 element, none of them [2]")


def test_the_class_of_a_message_is_that_around_the_list() -> None:
    text = "from geometry import Twist; input Twist cmd; cmd.linear[0] > 0"
    monitor = Monitor(rtamt.parse(text, modules=MODULES))
    assert monitor.specification.inputs == ("cmd.linear[0]",)
    with pytest.raises(InputError) as error:
        monitor.update(cmd=Twist())
    assert str(error.value) == (
        "'cmd.linear' at sample 0 (Vector) has no elements, expected a list with [0]"
    )
    assert monitor.update(cmd={"linear": [2.0]}) == 2.0


def test_sides_of_an_interface_may_be_given_by_the_list() -> None:
    # y is an input: its predicate holds, so it is +inf.
    text, sample = "x.a[0] > 0 and y > 0", {"x.a": [2.0], "y": 1.0}
    options: dict[str, Any] = {"semantics": "output-robustness", "inputs": ("y",)}
    assert Monitor(text, outputs=("x.a",), **options).update(sample) == 2.0
    assert Monitor(text, outputs=("x",), **options).update(sample) == 2.0
    assert Monitor(text).update(sample) == 1.0
