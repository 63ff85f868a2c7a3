"""Robustness is written in the format of the extension, and is a trace like any other."""

from pathlib import Path

import numpy as np
import pytest

import rtamt
from rtamt_gym import Reading
from rtamt_gym.__main__ import main
from rtamt_gym.recorded import output
from rtamt_gym.recorded.judge import judge, judge_events
from rtamt_gym.recorded.output import WRITERS, save
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.recording import Wanted
from rtamt_gym.recorded.times import TimeAxis
from rtamt_gym.recorded.trace import EventTrace, Trace

SPECS = {
    "near": rtamt.parse("close = x < 1 \n near = always(close)"),
    "far, but": rtamt.parse("always[0:1](x > -1)"),
}
X = np.array([0.1, -0.0, 1 / 3, np.inf, -np.inf, 1e-300, -1.5, 2.0])


def trace(n: int = 800) -> Trace:
    x = np.resize(X, n)
    times = TimeAxis("time", np.arange(n) / 8, 0.5, 1e-12, certain=True)
    return Trace("made", {"x": x}, n, times, str)


@pytest.fixture(params=[*WRITERS])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / f"Robustness{request.param}"


@pytest.mark.parametrize("long", [1 << 30, 0])
def test_values_come_back_bit_by_bit(
    path: Path, long: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "_LONG", long)
    monkeypatch.setattr(output, "_PIECE", 7)
    samples = trace()
    period = samples.period()
    judgements = {name: judge(s, samples, period, Reading()) for name, s in SPECS.items()}
    save(judgements, path, dense=False)
    with open_recording(str(path)) as recording:
        assert [*recording.names] == ["time", "near.close", "near.near", "far, but"]
        read = recording.read(Wanted(recording.names, time="time"))
    assert read.numbers["time"].tolist() == (0.5 + np.arange(800) / 8).tolist()
    for name, series in {
        "near.close": judgements["near"].series["close"],
        "near.near": judgements["near"].series["near"],
        "far, but": judgements["far, but"].series["(result)"],
    }.items():
        assert read.numbers[name].tobytes() == series.values.tobytes()


@pytest.mark.parametrize("long", [1 << 30, 0])
def test_events_come_back_in_the_order_of_their_times(
    path: Path, long: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "_LONG", long)
    times = np.arange(8) / 8
    x = times, np.nan_to_num(X, posinf=9, neginf=-9)
    events = EventTrace("made", {"x": x}, (times[0], times[-1]), len(times))
    judgements = {name: judge_events(s, events, Reading(dense=True)) for name, s in SPECS.items()}
    save(judgements, path, dense=True)
    with open_recording(str(path)) as recording:
        assert [*recording.names] == ["time", "variable", "value"]
        read = recording.read(Wanted(["value"], ["variable"], time="time"))
    assert read.times is not None
    assert (np.diff(read.times) >= 0).all()
    series = judgements["near"].series["close"]
    rows = [i for i, name in enumerate(read.texts["variable"]) if name == "near.close"]
    assert read.times[rows].tolist() == series.times.tolist()
    assert read.numbers["value"][rows].tobytes() == series.values.tobytes()


def test_an_extension_that_is_not_written_is_refused_before_anything_is_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.csv").write_text("x\n1\n")
    out = tmp_path / "r.mat"
    arguments = ["monitor", "always(x > 0)", str(tmp_path / "x.csv"), "--out", str(out)]
    assert main(arguments) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: cannot write {out}: expected a name that ends in "
        ".csv, .csv.gz, .parquet, .feather or .arrow\n"
    )
    assert not out.exists()
