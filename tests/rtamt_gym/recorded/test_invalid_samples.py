"""Samples that an MDF file marks as not valid: refused, unknown, held or left out, as asked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal

import rtamt
from rtamt_gym import Reading
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns, Missing
from rtamt_gym.recorded.ruled import read_ruled
from rtamt_gym.recorded.trace import EventTrace, Trace

Output = pytest.CaptureFixture[str]
VALUES = [1.0, 2.0, -5.0, -6.0, 3.0, 4.0]
MARKED = [0, 0, 1, 1, 0, 0]


def write(
    path: Path, marked: Sequence[int] | None, values: Sequence[float] = VALUES, kind: str = "f8"
) -> str:
    """A measurement of x, some samples of which are marked, and of y, at other times too."""
    times = np.arange(6) / 10
    bits = None if marked is None else np.array(marked, bool)
    samples = np.array(values).astype(kind)
    with MDF(version="4.10") as file:
        file.append([Signal(samples, times, name="x", invalidation_bits=bits)])
        file.append([Signal(np.ones(6), times, name="y")])
        file.save(path, overwrite=True)
    return str(path)


@pytest.mark.parametrize("kind", ["f8", "f4", "i4"])
@pytest.mark.parametrize("time", [[], ["--dense"]])
def test_what_is_marked_as_not_valid_does_not_pass(
    time: list[str], kind: str, tmp_path: Path, capsys: Output
) -> None:
    path = write(tmp_path / "run.mf4", MARKED, kind=kind)
    words = ["monitor", "always(x > 0 and y > 0)", path, *time]
    assert main(words) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: {path}, at 0.2 s, channel 'x': expected a number, got a sample that is nan "
        "or marked as not valid (2 samples in all); give --missing unknown, --missing hold or "
        "--missing drop\n"
    )
    assert main([*words, "--missing", "unknown"]) == 3
    said = "empty cells" if not time else "events without a number"
    assert said in capsys.readouterr().out
    for missing in ("hold", *([] if not time else ["drop"])):
        assert main([*words, "--missing", missing]) == 0
    assert main(["monitor", "always(y > 0)", path, *time]) == 0
    plain = write(tmp_path / "plain.mf4", None, kind=kind)
    assert main(["monitor", "always(x > 0 and y > 0)", plain, *time]) == 1


def test_a_sample_that_is_nan_is_no_sample(tmp_path: Path, capsys: Output) -> None:
    path = write(tmp_path / "run.mf4", None, [1.0, 2.0, np.nan, 3.0, 3.0, 4.0])
    for time in ([], ["--dense"]):
        assert main(["monitor", "always(x > 0)", path, *time]) == 2
        assert "at 0.2 s, channel 'x': expected a number, got a sample" in capsys.readouterr().err
        assert main(["monitor", "always(x > 0)", path, *time, "--missing", "unknown"]) == 3


@pytest.mark.parametrize(
    ("missing", "values"),
    [("hold", [1, 2, 2, 2, 3, 4]), ("unknown", [1, 2, None, None, 3, 4])],
)
def test_a_marked_sample_is_an_empty_cell(
    missing: Missing, values: list[float | None], tmp_path: Path
) -> None:
    path, spec = write(tmp_path / "run.mf4", MARKED), rtamt.parse("always(x > 0)")
    trace, _ = read_ruled(path, {"": spec}, Reading(), Columns(missing=missing))
    assert isinstance(trace, Trace)
    found = [None if np.isnan(value) else value for value in trace.columns["x"]]
    assert found == values
    events, _ = read_ruled(path, {"": spec}, Reading(dense=True), Columns(missing=missing))
    assert isinstance(events, EventTrace)
    at, kept = events.signals["x"]
    if missing == "unknown":
        assert [None if np.isnan(value) else value for value in kept] == values
    else:
        assert np.round(at, 9).tolist() == [0.0, 0.1, 0.4, 0.5]


def test_channels_of_other_times_are_no_invalid_samples(tmp_path: Path) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(np.ones(3), np.array([0.0, 0.2, 0.4]), name="x")])
        file.append([Signal(np.ones(5), np.arange(5) / 10, name="y")])
        file.save(tmp_path / "run.mf4", overwrite=True)
    spec = rtamt.parse("always(x > y)")
    columns = Columns(missing="unknown")
    path = str(tmp_path / "run.mf4")
    trace, _ = read_ruled(path, {"": spec}, Reading(dense=True), columns)
    assert not trace.unknown
    trace, _ = read_ruled(path, {"": spec}, Reading(dense=True), Columns())
    assert isinstance(trace, EventTrace)
    assert [len(at) for at, _ in trace.signals.values()] == [3, 5]
    assert not any("milliseconds" in note for note in trace.notes)
