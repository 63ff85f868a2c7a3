"""Signatures: names of fields, and what the text declares; errors.txt has the errors."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

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
