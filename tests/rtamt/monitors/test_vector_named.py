"""Vector monitors take an array for each variable by name, as `Monitor` takes a number."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pandas as pd
import pytest
from bits import bits
from message_classes import MODULES, Twist, Vector

from rtamt import (
    Between,
    EpisodeMonitor,
    InputError,
    InputTypeError,
    Monitor,
    VectorEpisodeMonitor,
    VectorMonitor,
    parse,
)

Backend = Literal["native", "python"]
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
        (lambda m: m.update(x=[1, np.nan], y=[1, 2]), InputError, "'x' is nan at .* of lane 1"),
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
def test_a_lane_that_is_left_out_may_be_nan(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    monitor = kind("x > 0", 2, backend=backend)
    monitor.update(x=[1, np.nan], mask=[True, False])
    assert monitor.samples.tolist() == [1, 0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_default_is_held_as_by_a_single_monitor(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    text = DECLARED if kind is VectorEpisodeMonitor else DECLARED.replace("always", "")
    monitor = kind(text, 2, backend=backend)
    single = [SINGLE[kind](text, backend=backend) for _ in range(2)]
    samples = [({"x": 1.0}, [0, 1]), ({"x": 1.0, "limit": 5.0}, [1]), ({"x": 0.5}, [0, 1])]
    for sample, lanes in samples:
        mask = [lane in lanes for lane in range(2)]
        found = monitor.update(**{name: [value] * 2 for name, value in sample.items()}, mask=mask)
        for lane in lanes:
            assert bits([found[lane]]) == bits([single[lane].update(**sample)])


def test_uncertain_columns_are_between(backend: Backend) -> None:
    named, rows = (VectorEpisodeMonitor("always(x + y > 1)", 2, backend=backend) for _ in range(2))
    named.update(x=Between([3, 0], [5, 4]), y=[0, 0])
    rows.update([[3, 0], [0, 0]], upper=[[5, 0], [4, 0]])
    for name in ("robustness", "lower", "upper", "unknown", "verdict"):
        assert getattr(named, name).tolist() == getattr(rows, name).tolist()
    with pytest.raises(InputError, match="Between"):
        named.update(x=[1, 2], y=[1, 2], upper=[[1, 1], [2, 2]])
    with pytest.raises(InputError, match="known for 'x'"):
        VectorMonitor("x > 0", 2, backend=backend).update(x=Between([3, 0], [5, 4]))  # type: ignore[arg-type]


def test_a_default_whose_last_value_is_unknown_is_refused(backend: Backend) -> None:
    monitor = VectorEpisodeMonitor(DECLARED, 2, backend=backend)
    monitor.update(x=[1, 1], limit=Between([2, 2], [2, 3]))
    with pytest.raises(InputError, match="'limit', whose last value is not known in lane 1"):
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
def test_messages_are_one_for_each_lane_or_nested_columns(kind: Any, backend: Backend) -> None:  # noqa: ANN401
    text = "from geometry import Twist\ninput Twist cmd\nresult = cmd.linear.x > 1"
    monitor = kind(parse(text, modules=MODULES), 2, backend=backend)
    messages = [Twist(Vector(x=3.0)), {"linear": {"x": 1.5}}]
    assert monitor.update(cmd=messages).tolist() == [2.0, 0.5]
    monitor.reset()
    assert monitor.update(cmd={"linear": {"x": [3.0, 1.5]}}).tolist() == [2.0, 0.5]
    monitor.reset()
    assert monitor.update(**{"cmd.linear.x": [3.0, 1.5]}).tolist() == [2.0, 0.5]
