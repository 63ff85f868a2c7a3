"""Formulas named after fields are written to messages; imports and annotations of texts."""

from __future__ import annotations

import math
import re
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import pytest
from message_classes import MODULES, Frozen, Slotted, Twist, Vector

import rtamt
from rtamt import InputError, InputTypeError, Monitor, ParseError

Backend = Literal["native", "python"]
NAN = math.nan

# Written back. -----------------------------------------------------------------------------------

RESULTS = """
from results import Slotted
input float x
output Slotted out
out.near = x > 0
out.value = always[0:1](out.near)
"""


def results(text: str = RESULTS, backend: Backend = "python") -> Monitor:
    return Monitor(rtamt.parse(text, modules=MODULES), backend=backend)


def test_formulas_are_written_to_the_fields_that_they_name(backend: Backend) -> None:
    monitor = results(backend=backend)
    assert monitor.variables == ("x",)
    message = Slotted()
    plain = {"kept": 7.0}
    assert monitor.write(out=message) is False
    assert math.isnan(message.value)
    assert math.isnan(message.near)
    for x, (near, value) in [(3.0, (3.0, NAN)), (1.0, (1.0, 1.0)), (5.0, (5.0, 1.0))]:
        monitor.update(x=x)
        assert monitor.write({"out": message}) is not math.isnan(value)
        assert monitor.write(out=plain) is not math.isnan(value)
        assert np.array_equal([message.near, message.value], [near, value], equal_nan=True)
        assert plain["near"] == near
        assert list(plain) == ["kept", "near", "value"]
    assert list(monitor.values) == ["out.near", "out.value"]


def test_inner_messages_are_written_to() -> None:
    monitor = Monitor("out.linear.x = always[0:1](x > 0)\nother.z = x > 0 and out.linear.x")
    monitor.update_many({"x": [3.0, 1.0]})
    whole, inner, mapping = Twist(), Vector(), {"linear": {"x": NAN}}
    assert monitor.write(out=whole)
    assert monitor.write({"out.linear": inner})
    assert monitor.write(out=mapping)
    assert (whole.linear.x, inner.x, mapping) == (1.0, 1.0, {"linear": {"x": 1.0}})


class Rigid:
    @property
    def value(self) -> float:
        return 0.0


UNWRITABLE: list[tuple[str, str, object, type[Exception], str]] = [
    (
        RESULTS,
        "out",
        Frozen(),
        InputTypeError,
        "expected a Slotted or a mapping for 'out', got Frozen",
    ),
    (
        RESULTS,
        "output",
        Slotted(),
        InputError,
        "no formula names a field of 'output'; they name fields of out",
    ),
    (
        "x > 0",
        "out",
        Slotted(),
        InputError,
        "no formula names a field of 'out'; write out.value = FORMULA",
    ),
    (
        "out.valeu = x > 0",
        "out",
        Slotted(),
        InputError,
        "'out' (Slotted) has no field 'valeu'; did you mean 'value'?",
    ),
    (
        "out.deep.value = x > 0",
        "out",
        {},
        InputError,
        "'out' (dict) has no field 'deep'",
    ),
    (
        "out.value = x > 0",
        "out",
        Frozen(),
        InputTypeError,
        "'out.value' cannot be set: cannot assign to field 'value'",
    ),
    (
        "out.value = x > 0",
        "out",
        Rigid(),
        InputTypeError,
        "'out.value' cannot be set: property 'value' of 'Rigid' object has no setter",
    ),
    (
        "out.value = x > 0",
        "out",
        MappingProxyType({}),
        InputError,
        "'out' (mappingproxy) has no field 'value'",
    ),
]


@pytest.mark.parametrize(("text", "name", "message", "error", "words"), UNWRITABLE)
def test_what_cannot_be_written_is_refused(
    text: str, name: str, message: object, error: type[Exception], words: str
) -> None:
    monitor = results(text)
    with pytest.raises(error, match=f"^{re.escape(words)}"):
        monitor.write({name: message})


def test_a_message_without_its_name_is_refused() -> None:
    monitor: Any = results("out.value = x > 0")
    with pytest.raises(InputTypeError) as refused:
        monitor.write(Slotted())
    assert str(refused.value) == (
        "expected messages by name, as in write(out=message), got Slotted"
    )


def test_nothing_is_written_if_one_message_is_refused() -> None:
    monitor = Monitor("a.value = x > 0\nb.value = x > 1")
    monitor.update(5.0)
    first, second = Slotted(), Vector()
    with pytest.raises(InputError, match="'b'"):
        monitor.write(a=first, b=second)
    assert first.value == 1.0
    assert monitor.write(a=first)
    assert first.value == 5.0


# Declared and imported. --------------------------------------------------------------------------


def test_declaring_a_message_for_results_declares_no_variable() -> None:
    declared = "from results import Slotted; output Slotted out"
    spec = rtamt.parse(f"{declared}; out.value = x > 0", modules=MODULES)
    assert (spec.variables, spec.inputs, spec.outputs) == (("x",), (), ())
    # A field that no formula computes is an input.
    spec = rtamt.parse(f"{declared}; float x; out.value = x > out.near", modules=MODULES)
    assert spec.variables == ("out.near", "x")
    with pytest.raises(ParseError, match="'y' is not declared"):
        rtamt.parse(f"{declared}; float x; out.value = x > y", modules=MODULES)


def test_types_that_are_no_classes_are_not_checked() -> None:
    text = "from results import Anything; input Anything cmd; cmd.x > 0"
    assert Monitor(rtamt.parse(text, modules=MODULES)).update(cmd=Vector(2)) == 2.0


def test_modules_are_imported_by_name_if_they_are_allowed_by_name() -> None:
    text = "from fractions import Fraction; input Fraction part; part.numerator > 1"
    spec = rtamt.parse(text, modules=["fractions"])
    assert spec.imports == {"Fraction": "fractions"}
    assert Monitor(spec).update(part=spec.types["Fraction"](3, 2)) == 2.0
    with pytest.raises(ModuleNotFoundError):
        rtamt.parse(text, modules=["fractoins"])
    with pytest.raises(InputTypeError, match=r"got 'fractions'; write \['fractions'\]$"):
        rtamt.parse(text, modules="fractions")


def test_topics_name_variables_messages_and_results() -> None:
    text = f"{RESULTS}\n@ topic(x, robot/x)\n@ topic(out, monitor/out)\n@ topic(out.near, near)"
    spec = rtamt.parse(text, modules=MODULES)
    assert spec.topics == {"x": "robot/x", "out": "monitor/out", "out.near": "near"}
    assert rtamt.parse(str(spec), modules=MODULES) == spec
