"""Bad recordings that passed, because their times or their gaps were read as something else."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rtamt_gym.__main__ import main

SPEC = "always[0:1](x < 30)"
"""Read with a sample every 10 ms, it is violated at sample 50; two samples alone satisfy it."""

X = [10.0] * 50 + [31.0] * 150
MS = [10 * i for i in range(200)]
EPOCH = 1_700_000_000_000


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def write(name: str, times: Sequence[object]) -> None:
    pd.DataFrame({name: times, "x": X}).to_csv("trace.csv", index=False)


DATES = pd.to_datetime(np.array(MS) + EPOCH, unit="ms")


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("time", [ms / 1000 for ms in MS]),
        ("timestamp", [ms / 1000 for ms in MS]),
        ("timestamp", [(ms + EPOCH) / 1000 for ms in MS]),
        ("Time [ms]", MS),
        ("t", [ms / 1000 for ms in MS]),
        ("time_ns", [(ms + EPOCH) * 10**6 for ms in MS]),
        ("timestamp", DATES.strftime("%Y-%m-%dT%H:%M:%S.%fZ").tolist()),
        ("recorded at", DATES.strftime("%Y-%m-%d %H:%M:%S.%f").tolist()),
    ],
)
def test_times_are_not_taken_for_an_index(
    name: str, times: Sequence[object], capsys: pytest.CaptureFixture[str]
) -> None:
    write(name, times)
    assert main(["monitor", SPEC, "trace.csv"]) == 1
    out = capsys.readouterr().out
    assert out.startswith("VIOLATED, robustness -1, certain from ")
    assert "200 samples, one every 0.01 s, " in out


@pytest.mark.parametrize("unit", ["ns", "us", "ms"])
def test_other_units_are_not_taken_for_seconds(
    unit: str, capsys: pytest.CaptureFixture[str]
) -> None:
    factor = {"ms": 1, "us": 10**3, "ns": 10**6}[unit]
    write("timestamp", [(ms + EPOCH) * factor for ms in MS])
    assert main(["monitor", SPEC, "trace.csv"]) == 2
    assert "expected times in seconds in the column 'timestamp', got " in capsys.readouterr().err
    assert main(["monitor", SPEC, "trace.csv", "--time-unit", unit]) == 1


def test_a_period_and_a_jitter_contradict_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    write("time", MS)
    assert main(["monitor", SPEC, "trace.csv", "--period", "10ms", "--jitter", "5%"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: expected --period, which leaves the times aside, or --jitter\n"
    )


def test_a_trace_that_is_resampled_says_so_with_its_verdict(
    capsys: pytest.CaptureFixture[str],
) -> None:
    # The rows from 0.4 s to 0.54 s were lost; what holds there was not recorded.
    kept = [i for i in range(60) if not 40 <= i < 55] + [*range(60, 90)]
    x = [10.0] * len(kept)
    pd.DataFrame({"time": [i / 100 for i in kept], "x": x}).to_csv("trace.csv", index=False)
    assert main(["monitor", SPEC, "trace.csv"]) == 2
    assert "trace.csv, line 42: expected samples at even distances" in capsys.readouterr().err
    main(["monitor", SPEC, "trace.csv", "--jitter", "5%"])
    out = " ".join(capsys.readouterr().out.split())
    assert "the longest gap, 0.16 s, follows trace.csv, line 41" in out
