"""Every form of argument has the same meaning for the machines in C++ and in Python."""

from __future__ import annotations

import collections
import fractions
import math
import types
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
import pytest

from rtamt import Monitor

if TYPE_CHECKING:
    from rtamt._native import DiscreteMachine

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

SPEC = "always[0:3](speed + 2 * gap > 1)"


def machine(spec: str) -> DiscreteMachine:
    return cast("DiscreteMachine", Monitor(spec, backend="native")._machine)


class Half(float):
    """A float whose value is half of its own."""

    def __float__(self) -> float:
        return float.__float__(self) / 2


class Reading:
    def __float__(self) -> float:
        return 2.5


class Broken:
    def __float__(self) -> float:
        msg = "the sensor is off"
        raise OSError(msg)


def other(text: str) -> str:
    """Return an equal text that is another object."""
    return text.encode().decode()


def unaligned() -> np.ndarray[Any, Any]:
    return np.frombuffer(b"\0" + np.array([1.5, 2.5]).tobytes(), np.uint8)[1:].view(np.float64)


def read_only() -> np.ndarray[Any, Any]:
    array = np.array([1.5, 2.5])
    array.flags.writeable = False
    return array


Call = Callable[[Callable[..., float]], float]
FORMS: Mapping[str, Call] = {
    "floats": lambda u: u(1.5, 2.5),
    "ints": lambda u: u(1, -2),
    "a great int": lambda u: u(10**300, 1),
    "an int that no double holds": lambda u: u(10**400, 1),
    "bools": lambda u: u(True, False),  # noqa: FBT003
    "numpy scalars": lambda u: u(np.float64(1.5), np.float32(2.1)),
    "numpy integers": lambda u: u(np.int8(-1), np.uint64(2)),
    "numpy bool and half": lambda u: u(np.bool_(1), np.float16(0.1)),
    "0-d arrays": lambda u: u(np.array(1.5), np.array(2.5)),
    "a subclass of float": lambda u: u(Half(3.0), 1.0),
    "fractions": lambda u: u(fractions.Fraction(1, 3), 1.0),
    "something with a value": lambda u: u(Reading(), 1.0),
    "something whose value fails": lambda u: u(1.0, Broken()),
    "infinities": lambda u: u(math.inf, 1.0),
    "inf - inf": lambda u: u(math.inf, -math.inf),
    "nan": lambda u: u(1.0, math.nan),
    "nan in numpy": lambda u: u(np.float32("nan"), 1.0),
    "text": lambda u: u("1.5", 1.0),
    "bytes": lambda u: u(1.0, b"1"),
    "complex": lambda u: u(1.0, 1j),
    "None": lambda u: u(None, 1.0),
    "nothing": lambda u: u(),
    "one too few": lambda u: u(1.0),
    "one too many": lambda u: u(1.0, 2.0, 3.0),
    "keywords": lambda u: u(speed=1.5, gap=2.5),
    "keywords in another order": lambda u: u(gap=2.5, speed=1.5),
    "keywords from a dict": lambda u: u(**{other("gap"): 2.5, other("speed"): 1.5}),
    "ints by keyword": lambda u: u(gap=2, speed=True),
    "nan by keyword": lambda u: u(gap=math.nan, speed=1.5),
    "text by keyword": lambda u: u(gap="2.5", speed=1.5),
    "a keyword missing": lambda u: u(gap=2.5),
    "an unknown keyword": lambda u: u(gap=2.5, sped=1.5),
    "a keyword too many": lambda u: u(gap=2.5, speed=1.5, x=1.0),
    "position and keyword": lambda u: u(1.5, gap=2.5),
    "dict": lambda u: u({"speed": 1.5, "gap": 2.5}),
    "dict in another order": lambda u: u({"gap": 2.5, "speed": 1.5}),
    "dict of other texts": lambda u: u({other("gap"): 2.5, other("speed"): 1.5}),
    "dict of numpy scalars": lambda u: u({"gap": np.float32(2.1), "speed": 1}),
    "dict with a nan": lambda u: u({"gap": 2.5, "speed": math.nan}),
    "dict with text": lambda u: u({"gap": 2.5, "speed": "fast"}),
    "dict with a name missing": lambda u: u({"gap": 2.5}),
    "dict with an unknown name": lambda u: u({"speed": 1.5, "gop": 2.5}),
    "dict with a name too many": lambda u: u({"speed": 1.5, "gap": 2.5, "x": 1.0}),
    "dict with names of other types": lambda u: u({"speed": 1.5, 3: 2.5}),
    "empty dict": lambda u: u({}),
    "dict twice": lambda u: u({"speed": 1.5, "gap": 2.5}, {}),
    "ordered dict": lambda u: u(collections.OrderedDict(gap=2.5, speed=1.5)),
    "mapping": lambda u: u(types.MappingProxyType({"gap": 2.5, "speed": 1.5})),
    "user dict": lambda u: u(collections.UserDict(gap=2.5, speed=1.5)),
    "list": lambda u: u([1.5, 2.5]),
    "tuple": lambda u: u((1, 2.5)),
    "list of text": lambda u: u(["1", "2"]),
    "list too long": lambda u: u([1.0, 2.0, 3.0]),
    "set": lambda u: u({1.0, 2.0}),
    "array": lambda u: u(np.array([1.5, 2.5])),
    "array with steps": lambda u: u(np.arange(8.0)[::4]),
    "array backwards": lambda u: u(np.arange(3.0)[::-2]),
    "array of one repeated": lambda u: u(np.broadcast_to(np.float64(1.5), 2)),
    "column of a matrix": lambda u: u(np.arange(6.0).reshape(2, 3)[:, 1]),
    "unaligned array": lambda u: u(unaligned()),
    "read-only array": lambda u: u(read_only()),
    "float32": lambda u: u(np.array([1.5, 2.1], np.float32)),
    "float32 with steps": lambda u: u(np.arange(8, dtype=np.float32)[1::4]),
    "float16": lambda u: u(np.array([1.5, 2.1], np.float16)),
    "longdouble": lambda u: u(np.array([1.5, 2.1], np.longdouble)),
    "other byte order": lambda u: u(np.array([1.5, 2.5]).astype(">f8")),
    "int64": lambda u: u(np.array([1, 2])),
    "bool array": lambda u: u(np.array([True, False])),
    "complex array": lambda u: u(np.array([1j, 2])),
    "text array": lambda u: u(np.array(["1", "2"])),
    "object array": lambda u: u(np.array([1, 2.5], dtype=object)),
    "a subclass of array": lambda u: u(np.array([1.5, 2.5]).view(np.recarray)),
    "array too short": lambda u: u(np.array([1.5])),
    "array too long": lambda u: u(np.arange(3.0)),
    "matrix": lambda u: u(np.array([[1.5, 2.5]])),
    "0-d array": lambda u: u(np.array(1.5)),
    "nan in an array": lambda u: u(np.array([1.5, math.nan])),
}


def outcome(call: Call, update: Callable[..., float]) -> object:
    try:
        return repr(call(update))
    except Exception as error:  # noqa: BLE001 - whatever it is, it must be the same
        return type(error), str(error)


@pytest.mark.parametrize("nan", ["raise", "hold"])
@pytest.mark.parametrize("before", [0, 5])
@pytest.mark.parametrize("form", FORMS)
def test_every_argument_form_means_what_it_means_in_python(
    form: str, before: int, nan: Literal["raise", "hold"]
) -> None:
    mine, definition = (Monitor(SPEC, backend=b, nan=nan) for b in ("native", "python"))
    for both in (mine, definition):
        for i in range(before):
            both.update(float(i), 1.0)
    state = mine._machine.state()
    expected = outcome(FORMS[form], definition.update)
    got = outcome(FORMS[form], mine.update)
    assert got == expected
    if isinstance(expected, tuple):
        assert mine._machine.state() == state
    for both in (mine, definition):
        assert both.samples == before + (not isinstance(expected, tuple))
    assert mine._machine.inputs == definition._machine.inputs
    assert mine._machine.registers == definition._machine.registers


def test_the_order_of_keywords_may_change_from_call_to_call() -> None:
    update, calls = machine("a - b + 10 * c > 0").update, []
    orders: list[dict[str, float]] = [
        {"a": 1.0, "b": 2.0, "c": 3.0},
        {"c": 3.0, "a": 1.0, "b": 2.0},
        {"b": 2.0, "c": 3.0, "a": 1.0},
    ]
    for _ in range(3):
        calls += [update(**order) for order in orders]
        calls += [update(a=1.0, b=2.0, c=3.0), update(c=3.0, b=2.0, a=1.0)]
        with pytest.raises(ValueError, match="unknown variable 'd'"):
            update(a=1.0, b=2.0, d=3.0)
        calls += [update(a=1.0, b=2.0, c=3.0), update(b=2.0, a=1.0, c=3.0)]
    assert set(calls) == {29.0}


def test_one_variable_and_none() -> None:
    assert machine("x > 1").update(3.0) == 2.0
    assert machine("x > 1").update(np.array([3.0])) == 2.0
    assert machine("x > 1").update({"x": 3}) == 2.0
    constant = machine("true")
    for got in (constant.update(), constant.update({}), constant.update([])):
        assert got == math.inf
    (values,) = constant.run([], 3)
    assert values.tolist() == [math.inf] * 3
    assert constant.samples == 6


def test_a_value_whose_code_updates_the_machine_itself() -> None:
    made = machine("x + y > 0")

    class Nested:
        def __float__(self) -> float:
            return made.update(10.0, 20.0)

    assert made.update(1.0, Nested()) == 31.0
    assert made.samples == 2
    assert made.inputs == [1.0, 30.0]
