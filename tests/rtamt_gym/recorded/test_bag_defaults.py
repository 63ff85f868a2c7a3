"""Variables of bags that have a value before the first message of their topic."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import pytest
from bags import START, Said, twist, write_bag

import rtamt
from rtamt_gym import Reading
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.ruled import read_ruled
from rtamt_gym.recorded.trace import EventTrace, Trace

TEXT = """
    from geometry_msgs.msg import Twist
    input Twist cmd
    input float64 limit = 0.5
    @ topic(cmd, robot0/cmd_vel)
    @ topic(limit, robot0/limit)
    slow = always(cmd.linear.x < limit)
"""
SPEC = rtamt.parse(TEXT)
RULES = Reading(period=Fraction(1))


def bag(folder: Path, limits: dict[int, float], name: str = "run.mcap") -> str:
    """Speeds of 0.25 for 5 s, and limits at some seconds."""
    said = [twist(START + i * 10**9, 0.25) for i in range(5)]
    said += [
        Said(START + second * 10**9, "/robot0/limit", "std_msgs/Float64", {"data": limit})
        for second, limit in limits.items()
    ]
    return str(write_bag(folder / name, sorted(said, key=lambda each: each.time)))


@pytest.mark.parametrize(
    ("limits", "values", "note"),
    [
        ({}, [0.5] * 5, "'limit' is 0.5, its default: no message is there"),
        (
            {2: 2.0, 4: 3.0},
            [0.5, 0.5, 2.0, 2.0, 3.0],
            "'limit' of /robot0/limit is 0.5, its default: its first message comes at 2 s",
        ),
        ({0: 2.0}, [2.0] * 5, "/robot0/limit: the message at 0 s is held for 4 s, to the end"),
    ],
)
def test_a_default_counts_before_the_first_message(
    tmp_path: Path, limits: dict[int, float], values: list[float], note: str
) -> None:
    path = bag(tmp_path, limits)
    trace, _ = read_ruled(path, {"": SPEC}, RULES, Columns())
    assert isinstance(trace, Trace)
    assert trace.columns["limit"].tolist() == values
    assert (trace.notes, trace.known_from) == ([note], {})
    dense, _ = read_ruled(path, {"": SPEC}, Reading(dense=True), Columns())
    assert isinstance(dense, EventTrace)
    times = [0, *(second for second in limits if second), *([4] * (4 not in limits))]
    held = [values[second] for second in times]
    assert dense.tables["limit"].tolist() == [list(row) for row in zip(times, held, strict=True)]


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("topic", ["/robot0/Limit", "/robot0/limti"])
@pytest.mark.parametrize("reading", [RULES, Reading(dense=True)])
def test_a_topic_of_nearly_the_same_name_is_refused(
    topic: str, whole: object, reading: Reading, tmp_path: Path
) -> None:
    said = [twist(START + i * 10**9, 0.25) for i in range(5)]
    said.append(Said(START + 10**9, topic, "std_msgs/Float64", {"data": 0.125}))
    path = str(write_bag(tmp_path / "run.mcap", sorted(said, key=lambda each: each.time)))
    spec = SPEC if whole else rtamt.parse(TEXT.replace("@ topic(limit, robot0/limit)", ""))
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, {"": spec}, reading, Columns())
    where = "robot0/limit" if whole else "limit"
    assert str(caught.value) == (
        f"{path}: no topic '{where}', which 'limit' has a default for, but '{topic}'; give "
        f"--signal limit={topic}.FIELD to read it, or --default limit to take the default"
    )
    found, _ = read_ruled(path, {"": spec}, reading, Columns({"limit": f"{topic}.data"}))
    assert found.defaults == {"limit": 0.5}  # up to its first message
    found, _ = read_ruled(path, {"": spec}, reading, Columns(defaults=["limit"]))
    assert found.defaults == {"limit": 0.5}


@pytest.mark.parametrize("limits", [{}, {2: 2.0}])
def test_defaults_of_topics_are_refused_where_that_is_asked_for(
    limits: dict[int, float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bag(tmp_path, limits)
    words = ["monitor", TEXT, path, "--period", "1", "--no-defaults"]
    assert main(words) == 2
    assert "expected records of 'limit'" in capsys.readouterr().err
    assert main([*words, "--default", "limit", "--json"]) in (0, 1)
    (trial,) = json.loads(capsys.readouterr().out)["trials"]
    assert trial["outcomes"]["slow"]["defaults"] == {"limit": 0.5}
    assert main(["monitor", TEXT, bag(tmp_path, {0: 2.0}, "whole.mcap"), *words[3:]]) == 0


def test_a_topic_that_was_asked_for_has_to_be_there(tmp_path: Path) -> None:
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(bag(tmp_path, {}), {"": SPEC}, RULES, Columns({"limit": "/robot0/limt"}))
    assert "no topic '/robot0/limt', which 'limit' reads" in str(caught.value)


def test_defaults_alone_pass_no_gate(tmp_path: Path) -> None:
    path = bag(tmp_path, {})
    spec = rtamt.parse("input float64 limit = 0.5; always(limit > 0)")
    for rules in (RULES, Reading(dense=True)):
        with pytest.raises(rtamt.InputError) as caught:
            read_ruled(path, {"one": SPEC, "alone": spec}, rules, Columns())
        assert str(caught.value) == (
            f"{path}: expected messages with 'limit', got none: defaults alone say nothing of a "
            "trace; the topics are /robot0/cmd_vel"
        )


def test_the_field_data_has_the_default_of_its_message(tmp_path: Path) -> None:
    declared = "from std_msgs.msg import Float64\ninput Float64 limit = 0.5"
    text = TEXT.replace("input float64 limit = 0.5", declared).replace("< limit", "< limit.data")
    for limits, values in (({}, [0.5] * 5), ({2: 2.0}, [0.5, 0.5, 2.0, 2.0, 2.0])):
        path = bag(tmp_path, limits)
        trace, _ = read_ruled(path, {"": rtamt.parse(text)}, RULES, Columns())
        assert isinstance(trace, Trace)
        assert trace.columns["limit.data"].tolist() == values


def test_two_defaults_of_one_variable_are_refused(tmp_path: Path) -> None:
    other = rtamt.parse(TEXT.replace("= 0.5", "= 0.75"))
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(bag(tmp_path, {}), {"one": SPEC, "two": other}, RULES, Columns())
    assert str(caught.value) == (
        "expected one default for 'limit', which two specifications read, got 0.5 and 0.75; give "
        "one of them another name, or judge them one at a time"
    )


def test_a_default_is_kept_with_the_outcomes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bag(tmp_path, {3: 0.125})
    assert main(["monitor", TEXT, path, "--period", "1", "--json"]) == 1
    outcomes = json.loads(capsys.readouterr().out)
    assert outcomes["reading"]["columns"]["starts"] == {"limit": 0.5}
    # The formula of the outcomes has lost its declarations.
    again = rtamt.parse(outcomes["requirements"]["slow"])
    trace, _ = read_ruled(path, {"": again}, RULES, Columns(**outcomes["reading"]["columns"]))
    assert isinstance(trace, Trace)
    assert trace.columns["limit"].tolist() == [0.5, 0.5, 0.5, 0.125, 0.125]
    absent = bag(tmp_path, {}, "absent.mcap")
    trace, _ = read_ruled(absent, {"": again}, RULES, Columns(**outcomes["reading"]["columns"]))
    assert isinstance(trace, Trace)
    assert trace.columns["limit"].tolist() == [0.5] * 5
