"""The samples of a live view before they are sent, without Rerun."""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt import InputError, Verdict
from rtamt_gym.judging.vector_monitor_set import VectorMonitorSet
from rtamt_gym.live import RerunView, track
from rtamt_gym.live.track import Track
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions

values = st.floats(-2, 2)
NAMES = ("near", "soon")


def monitors() -> dict[str, rtamt.EpisodeMonitor]:
    specs = ("always(x < 1)", "eventually[0:2](x > 1)")
    return {
        name: rtamt.EpisodeMonitor(spec, period=1) for name, spec in zip(NAMES, specs, strict=True)
    }


def state(monitor: rtamt.EpisodeMonitor) -> dict[str, Any]:
    return {
        "robustness": monitor.robustness,
        "lower": monitor.lower,
        "upper": monitor.upper,
        "verdict": monitor.verdict.name,
    }


def curves(judges: dict[str, rtamt.EpisodeMonitor]) -> list[float]:
    return [
        value for judge in judges.values() for value in (judge.robustness, judge.lower, judge.upper)
    ]


@given(st.lists(st.lists(values, min_size=1, max_size=6), min_size=1, max_size=4), st.booleans())
def test_rows_are_monitors(episodes: list[list[float]], read: bool) -> None:  # noqa: FBT001
    """A track may read the monitors or get their values."""
    shown = Track("", ["x"], NAMES, 0.5, lambda: None)
    judges = monitors()
    expected: list[tuple[float, ...]] = []
    decisions: list[tuple[float, float, str, Verdict]] = []
    shown.follow({name: (judge, judge) for name, judge in judges.items()})
    for number, samples in enumerate(episodes, 1):
        open_names = set(NAMES)
        for judge in judges.values():
            judge.reset()
        for value in samples:
            for judge in judges.values():
                judge.update(value)
            verdicts = [judge.verdict for judge in judges.values()]
            if read:
                shown.sample([value])
            else:
                shown.add([value], curves(judges), verdicts)
            sample = len(expected)
            for name, verdict in zip(NAMES, verdicts, strict=True):
                if verdict and name in open_names:
                    open_names.remove(name)
                    decisions.append((sample, number, name, verdict))
            expected.append((sample, 0.5 * sample, number, value, *curves(judges)))
        for judge in judges.values():
            judge.finish("cut")
        shown.end({name: state(judge) for name, judge in judges.items()})
        expected[-1] = *expected[-1][:4], *curves(judges)
        decisions += [
            (len(expected) - 1, number, name, judges[name].verdict)
            for name in NAMES
            if name in open_names
        ]
    assert [*shown.rows] == expected
    assert [
        (line.place[0], line.place[2], line.requirement, line.verdict) for line in shown.lines
    ] == decisions


def test_newest_sample_waits_for_the_end() -> None:
    shown = Track("", ["x"], ["near"], None, lambda: None)
    for value in (1.0, 2.0):
        shown.add([value], [value] * 3, [Verdict.UNDECIDED])
    assert [row[3] for row in shown.rows] == [1.0]
    shown.finish([5.0, 6.0, 7.0], [Verdict.SATISFIED])
    assert [row[3:] for row in shown.rows] == [(1.0, 1.0, 1.0, 1.0), (2.0, 5.0, 6.0, 7.0)]
    assert all(math.isnan(row[1]) for row in shown.rows)
    shown.finish([0.0] * 3, [Verdict.VIOLATED])  # an episode ends once
    assert len(shown.lines) == 1


def test_many_rows_are_sent_by_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(track, "_MANY", 10)
    sent = []
    shown = Track("", ["x"], ["near"], None, lambda: sent.append(len(shown.rows)))
    for _ in range(12):
        shown.add([0.0], [0.0] * 3, [Verdict.UNDECIDED])
    assert sent == [10, 11]


def test_missing_package_names_its_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "rtamt_gym.live.outputs", raising=False)
    with pytest.raises(ModuleNotFoundError, match=r"needs rerun, .*pip install '\.\[rerun\]'"):
        RerunView(tmp_path / "run.rrd")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"path": "run.csv"}, r"writes \.rrd files, got 'run\.csv'"),
        ({"viewer": False}, "shows nothing"),
        ({"pictures": 0}, "1 or more, got 0"),
    ],
)
def test_wrong_arguments(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        RerunView(**arguments)


@pytest.mark.parametrize("end", ["failure", "cut", "complete"])
@given(st.lists(st.tuples(values, values), min_size=1, max_size=5))
def test_values_of_one_environment(end: AtTermination, rows: list[tuple[float, float]]) -> None:
    specs = {name: judge.specification for name, judge in monitors().items()}
    options = EvaluationOptions(period=1).complete("episodes")
    monitor_set = VectorMonitorSet(specs, 2, options, ["x"])
    monitor_set.reset()
    for row in rows:
        monitor_set.feed(np.array(row)[:, None])
    monitor_set.finish(np.array([False, True]), end)
    together = monitor_set.values()
    for index in (0, 1):
        curves, verdicts = monitor_set.values_at(index)
        expected = [
            column[index]
            for columns in zip(together.robustness, together.lower, together.upper, strict=True)
            for column in columns
        ]
        assert [*map(repr, curves)] == [repr(float(value)) for value in expected]
        assert verdicts == [column[index] for column in together.verdicts]
