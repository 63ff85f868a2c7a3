"""Arguments of vector monitors: arrays by name, and errors."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from bits import bits
from catalogue import check, entries
from choices import Backend
from message_classes import MODULES, Twist
from message_classes import Vector as VectorMessage

from rtamt import (
    EpisodeMonitor,
    InputError,
    InputTypeError,
    Monitor,
    StateError,
    UncertainValue,
    VectorEpisodeMonitor,
    VectorMonitor,
    parse,
)

Vector = VectorMonitor | VectorEpisodeMonitor


CLASSES = (VectorMonitor, VectorEpisodeMonitor)


NAN = math.nan


def same(found: object, expected: object) -> bool:
    return np.array_equal(np.asarray(found), np.asarray(expected), equal_nan=True)


MASK = np.array([True, True, False])


ERRORS = entries(Path(__file__).with_name("vector_errors.txt"))


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize(("call", "said"), [e for e in ERRORS if e[0].startswith("v.")])
def test_refused_input_says_why_and_changes_no_entry(
    kind: type[Vector], call: str, said: str, backend: Backend
) -> None:
    text = "historically[0:3](sqrt(x + y) > 1) and once[0:2](x > y)"
    vector, twin = (kind(text, 3, backend=backend) for _ in range(2))
    for monitor in (vector, twin):
        monitor.update([[1, 2], [3, 4], [5, 6]])
        monitor.update([[5.0, 0.0], [7.0, 2.0], [NAN, 6.0]], MASK)
    check(call, said, v=vector, MASK=MASK, NAN=NAN)
    assert vector.samples.tolist() == [2, 2, 1]
    for rows in ([[9, 0], [8, 0], [7, 0]], [[1, 0], [2, 0], [3, 0]], [[1, 4], [2, 4], [3, 4]]):
        assert same(vector.update(rows), twin.update(rows))


def test_a_nan_that_cannot_be_held_is_refused(backend: Backend) -> None:
    vector = VectorMonitor("x + y > 0", 2, backend=backend, nan="hold")
    vector.update([[1, 2], [3, 4]], [True, False])
    with pytest.raises(InputError) as caught:
        vector.update([[NAN, 1.0], [NAN, 1.0]])
    assert str(caught.value) == (
        "variable 'x' is nan at sample 0 of batch entry 1; "
        "nan='hold' keeps the last value, and the first sample has none"
    )
    assert vector.update([[NAN, 1.0], [1.0, 1.0]]).tolist() == [2.0, 2.0]
    vector.reset([True, False])
    with pytest.raises(InputError, match="variable 'y' is nan at sample 0 of batch entry 0; "):
        vector.update([[1.0, NAN], [NAN, 1.0]])
    with pytest.raises(InputError) as caught:
        vector.update([[1.0, 1.0], [math.inf, -math.inf]])
    assert str(caught.value).startswith(
        "'x + y' is not a number at sample 1 of batch entry 1, where "
    )


def test_a_finished_entry_takes_no_sample(backend: Backend) -> None:
    vector = VectorEpisodeMonitor("always(x > 0)", 3, backend=backend)
    vector.update(np.ones((3, 1)))
    vector.finish([False, True, False])
    with pytest.raises(StateError) as caught:
        vector.update(np.full((3, 1), NAN))
    assert str(caught.value) == (
        "the episode of batch entry 1 is finished; reset it before its next update, or exclude it "
        "with a mask"
    )
    assert vector.samples.tolist() == [1, 1, 1]
    assert vector.update([[2.0], [NAN], [-1.0]], [True, False, True]).tolist() == [1.0, 1.0, -1.0]
    vector.reset([False, True, False])
    assert vector.update([[3], [3], [3]]).tolist() == [1.0, 3.0, -1.0]
    assert vector.finished.tolist() == [False, False, False]


def test_finish_needs_a_sample_in_every_entry_and_finishes_all_or_none(backend: Backend) -> None:
    vector = VectorEpisodeMonitor("always(x > 0)", 3, backend=backend)
    vector.update(np.ones((3, 1)), [True, True, False])
    with pytest.raises(StateError) as caught:
        vector.finish()
    assert str(caught.value) == (
        "finish() needs at least one sample, batch entry 2 got 0 since its reset; exclude it with "
        "a mask"
    )
    assert vector.finished.tolist() == [False, False, False]
    for _ in range(2):
        assert same(vector.finish([True, True, False]), [1.0, 1.0, NAN])
        assert vector.finished.tolist() == [True, True, False]
        assert vector.verdict.tolist() == [1, 1, 0]
    with pytest.raises(InputTypeError, match=r"^expected a mask of 3 booleans, got dtype int64; "):
        vector.finish([0, 1, 1])


@pytest.mark.parametrize("kind", CLASSES)
@pytest.mark.parametrize(("call", "said"), [e for e in ERRORS if e[0].startswith("kind")])
def test_the_number_of_entries_is_checked(
    kind: type[Vector], call: str, said: str, backend: Backend
) -> None:
    check(call, said, kind=partial(kind, backend=backend))


TEXT = "once[0:1](x - y > 0)"


KINDS = [VectorMonitor, VectorEpisodeMonitor]


SINGLE = {VectorMonitor: Monitor, VectorEpisodeMonitor: EpisodeMonitor}


DECLARED = "input float x\ninput float limit = 2\nresult = always(x < limit)"


@pytest.mark.parametrize("kind", KINDS)
def test_columns_by_name_are_rows_by_position(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    named, rows = (kind(TEXT, 3, backend=backend) for _ in range(2))
    random = np.random.default_rng(1)
    for _ in range(6):
        table, mask = random.integers(-3, 4, (3, 2)).astype(float), random.random(3) < 0.7
        found = named.update(y=table[:, 1].tolist(), x=table[:, 0], mask=mask)
        assert bits(found) == bits(rows.update(table, mask))
    assert named.samples.tolist() == rows.samples.tolist()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "named", [{}, {"x": 1.0}, {"z": 1.0, "x": 1.0}, {"x": 1.0, "y": 1.0, "vel": 1.0}]
)
def test_names_have_the_errors_of_a_single_monitor(
    kind: Any,  # noqa: ANN401
    named: dict[str, float],
    backend: Backend,
) -> None:
    monitor = kind(TEXT, 2, backend=backend)
    monitor.update([[1, 0], [2, 0]])
    with pytest.raises(InputError) as single:
        SINGLE[kind](TEXT, backend=backend).update(**named)
    with pytest.raises(InputError) as many:
        monitor.update(**{name: [value] * 2 for name, value in named.items()})
    assert str(many.value) == str(single.value)
    assert monitor.samples.tolist() == [1, 1]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (
            lambda m: m.update([[1, 0]] * 2, x=[1, 2]),
            InputError,
            "by position or by keyword, got b",
        ),
        (lambda m: m.update([[1, 0]] * 2, masks=[True] * 2), InputError, "got both.*masks"),
        (lambda m: m.update(x=[1, 2, 3], y=[1, 2]), InputError, "expected 2 values of 'x'.*got 3"),
        (lambda m: m.update(x=[1], y=[1, 2]), InputError, "expected 2 values of 'x'.*got 1"),
        (lambda m: m.update(x=1.0, y=[1, 2]), InputError, r"1-D array for 'x', got shape \(\)"),
        (lambda m: m.update(x=[[1], [2]], y=[1, 2]), InputError, "1-D array for 'x'"),
        (lambda m: m.update(x=["1", "2"], y=[1, 2]), InputTypeError, "array of numbers for 'x'"),
        (
            lambda m: m.update(x=[1, np.nan], y=[1, 2]),
            InputError,
            "'x' is nan .* batch entry 1",
        ),
        (lambda m: m.update(x=[1, 2], y=[1, 2], mask=[1, 0]), InputTypeError, "mask of 2 bool"),
        (lambda m: m.update(x=[1, 2], y=[1, 2], mask=[True]), InputError, "mask of 2 booleans"),
        (lambda m: m.update({"x": [1, 2], "y": [1, 2]}), InputTypeError, r"update\(\*\*columns\)"),
        (lambda m: m.update(pd.DataFrame({"y": [1, 2], "x": [0, 0]})), InputTypeError, "by name"),
    ],
)
def test_bad_columns_are_refused_and_change_nothing(
    kind: Any,  # noqa: ANN401
    call: Any,  # noqa: ANN401
    error: type[Exception],
    text: str,
    backend: Backend,
) -> None:
    monitor = kind(TEXT, 2, backend=backend)
    monitor.update([[1, 0], [2, 0]])
    with pytest.raises(error, match=text):
        call(monitor)
    assert monitor.samples.tolist() == [1, 1]
    assert bits(monitor.update([[0, 0], [0, 0]])) == bits([1.0, 2.0])


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_columns_by_name(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    frame = pd.DataFrame({"y": [1.0, 2.0], "x": [4.0, 3.0]})
    monitor = kind(TEXT, 2, backend=backend)
    assert monitor.update(**frame).tolist() == [3.0, 1.0]
    assert monitor.update(frame[["x", "y"]]).tolist() == [3.0, 1.0]


@pytest.mark.parametrize("kind", KINDS)
def test_an_entry_that_is_left_out_may_be_nan(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    monitor = kind("x > 0", 2, backend=backend)
    monitor.update(x=[1, np.nan], mask=[True, False])
    assert monitor.samples.tolist() == [1, 0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_default_is_held_as_by_a_single_monitor(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    text = DECLARED if kind is VectorEpisodeMonitor else DECLARED.replace("always", "")
    monitor = kind(text, 2, backend=backend)
    single = [SINGLE[kind](text, backend=backend) for _ in range(2)]
    samples = [({"x": 1.0}, [0, 1]), ({"x": 1.0, "limit": 5.0}, [1]), ({"x": 0.5}, [0, 1])]
    for sample, chosen in samples:
        mask = [entry in chosen for entry in range(2)]
        found = monitor.update(**{name: [value] * 2 for name, value in sample.items()}, mask=mask)
        for entry in chosen:
            assert bits([found[entry]]) == bits([single[entry].update(**sample)])


def test_uncertain_columns_are_between(backend: Backend) -> None:
    named, rows = (VectorEpisodeMonitor("always(x + y > 1)", 2, backend=backend) for _ in range(2))
    named.update(x=UncertainValue([3, 0], [5, 4]), y=[0, 0])
    rows.update([[3, 0], [0, 0]], upper=[[5, 0], [4, 0]])
    for name in ("robustness", "lower", "upper", "unknown", "verdict"):
        assert getattr(named, name).tolist() == getattr(rows, name).tolist()
    with pytest.raises(InputError, match="UncertainValue"):
        named.update(x=[1, 2], y=[1, 2], upper=[[1, 1], [2, 2]])
    with pytest.raises(InputError, match="known for 'x'"):
        VectorMonitor("x > 0", 2, backend=backend).update(x=UncertainValue([3, 0], [5, 4]))


def test_a_default_whose_last_value_is_unknown_is_refused(backend: Backend) -> None:
    monitor = VectorEpisodeMonitor(DECLARED, 2, backend=backend)
    monitor.update(x=[1, 1], limit=UncertainValue([2, 2], [2, 3]))
    with pytest.raises(InputError, match="'limit': batch entry 1 has no known last value"):
        monitor.update(x=[1, 1])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["mask", "values"])
def test_a_variable_with_the_name_of_an_argument(
    kind: Any,  # noqa: ANN401
    name: str,
    backend: Backend,
) -> None:
    monitor = kind(f"x + {name} > 0", 2, backend=backend)
    with pytest.raises(InputError, match=f"'{name}' has the name of an argument"):
        monitor.update(x=[1, 2])
    assert monitor.update([[1, 1], [2, 2]]).tolist() == [2.0, 4.0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_formula_without_variables_needs_no_values(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    assert kind("true", 2, backend=backend).update().tolist() == [np.inf, np.inf]


@pytest.mark.parametrize("kind", KINDS)
def test_messages_are_one_for_each_entry_or_nested_columns(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    text = "from geometry import Twist\ninput Twist cmd\nresult = cmd.linear.x > 1"
    monitor = kind(parse(text, modules=MODULES), 2, backend=backend)
    messages = [Twist(VectorMessage(x=3.0)), {"linear": {"x": 1.5}}]
    assert monitor.update(cmd=messages).tolist() == [2.0, 0.5]
    monitor.reset()
    assert monitor.update(cmd={"linear": {"x": [3.0, 1.5]}}).tolist() == [2.0, 0.5]
    monitor.reset()
    assert monitor.update(**{"cmd.linear.x": [3.0, 1.5]}).tolist() == [2.0, 0.5]


@pytest.mark.parametrize("kind", KINDS)
def test_own_update_error(kind: Any) -> None:  # noqa: ANN401
    with pytest.raises(TypeError, match=r"^Doubled\.update would never be called"):
        type("Doubled", (kind,), {"update": lambda _, values: values})


@pytest.mark.parametrize("kind", KINDS)
def test_too_many_arguments_error(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    monitor, table = kind(TEXT, 1, backend=backend), [[1.0, 0.0]]
    with pytest.raises(TypeError):
        monitor.update(table, None, None, None)
    with pytest.raises(TypeError):
        monitor.update(None, None, x=[1.0], mask=None)
    assert monitor.samples.tolist() == [0]
