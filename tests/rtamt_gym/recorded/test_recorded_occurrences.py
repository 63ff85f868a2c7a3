"""`rtamt monitor --occurrences`: all violations of recorded traces."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import rtamt
from rtamt.monitors import Occurrences
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.occurrences import states_of
from rtamt_gym.results.codec import trials_of

Output = pytest.CaptureFixture[str]
SPEC = "always(speed <= 10 and (req >= 3 implies eventually[0:1](gnt >= 3)))"
DRIVE = """\
time,speed,req,gnt
10,8,0,0
10.5,12,4,0
11,13,0,5
11.5,9,0,0
12,9,4,0
12.5,11,0,0
13,9,0,0
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory with a trace that starts at 10 s and one without a violation."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive.csv").write_text(DRIVE)
    (tmp_path / "calm.csv").write_text("time,speed,req,gnt\n0,8,0,0\n0.5,9,0,0\n1,9,0,0\n")
    return tmp_path


def judged(capsys: Output, *words: str) -> dict[str, Any]:
    main(["monitor", *words, "--occurrences", "--json"])
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_report_lists_bodies_with_file_times(capsys: Output) -> None:
    assert main(["monitor", SPEC, "drive.csv", "--occurrences"]) == 1
    assert capsys.readouterr().out.partition("\n\n")[2].partition("\n\n")[2] == (
        "speed <= 10: violated 2 times, 42.9 % of the time, 2057 an hour\n"
        "  10.5 s to 11.5 s: robustness -3 at 11 s\n"
        "  12.5 s to 13 s: robustness -1 at 12.5 s\n"
        "req >= 3 implies eventually[0:1](gnt >= 3): violated 1 time, 14.3 % of the time,\n"
        "  1029 an hour\n"
        "  12 s to 12.5 s: robustness -1 at 12 s\n"
        "  triggered 2 times: 1 satisfied, 1 violated; answer time 0.5 s\n"
    )


def test_first_five_rows_and_the_count_of_others(folder: Path, capsys: Output) -> None:
    rows = [f"{i},{9 if i % 2 else 1}" for i in range(20)]
    (folder / "many.csv").write_text("\n".join(["time,x", *rows]))
    main(["monitor", "always(x < 5)", "many.csv", "--occurrences"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2:] == ["  9 s to 10 s: robustness -4 at 9 s", "  and 5 more"]


def test_no_violation_in_any_trace(folder: Path, capsys: Output) -> None:
    (folder / "other.csv").write_text((folder / "calm.csv").read_text())
    assert main(["monitor", SPEC, "--occurrences", "--", "calm.csv", "other.csv"]) == 0
    assert "no violation in any trace\n" in capsys.readouterr().out


def test_other_root_points_to_view_step(capsys: Output) -> None:
    main(["monitor", "eventually(speed > 20)", "drive.csv", "--occurrences"])
    assert capsys.readouterr().out.endswith(
        "eventually(speed > 20): violated 1 time\n"
        "  10 s to 10.5 s: robustness -7 at 10 s\n"
        "evaluated at the first instant only; --view step covers the trace\n"
    )
    main(["monitor", "speed < 12", "drive.csv", "--occurrences", "--view", "step"])
    assert "speed < 12: violated 1 time, 28.6 % of the time" in capsys.readouterr().out


@pytest.mark.parametrize("end", ["cut", "complete", "open"])
def test_json_has_the_rows_of_the_library(end: str, capsys: Output) -> None:
    found = judged(capsys, SPEC, "drive.csv", "--end", end)
    frame = pd.read_csv("drive.csv")
    expected = rtamt.occurrences(SPEC, frame, 0.5, end=end)  # type: ignore[arg-type]
    (outcome,) = trials_of(found)[0].outcomes.values()
    assert outcome.occurrences == expected.shifted(10.0)
    its = found["trials"][0]["outcomes"]["spec"]["occurrences"]["bodies"][0]
    assert its["statistics"] == {"count": 2, "share": 3 / 7, "per_hour": 2 * 3600 / 3.5}
    assert its["violations"][0] == {
        "start": 10.5,
        "end": 11.5,
        "duration": 1.0,
        "to_end": False,
        "open_start": False,
        "closed_end": False,
        "robustness": -3.0,
        "worst_at": 11.0,
        "unseen": False,
    }


def test_dense_rows_of_the_library(capsys: Output) -> None:
    found = judged(capsys, SPEC, "drive.csv", "--dense")
    frame = pd.read_csv("drive.csv")
    events = {name: frame[["time", name]].to_numpy() for name in ("speed", "req", "gnt")}
    (outcome,) = trials_of(found)[0].outcomes.values()
    assert outcome.occurrences == rtamt.dense.occurrences(SPEC, events)


def test_without_times_rows_are_sample_numbers(folder: Path, capsys: Output) -> None:
    (folder / "plain.csv").write_text("x\n1\n9\n1\n")
    found = judged(capsys, "always(x < 5)", "plain.csv")
    (outcome,) = trials_of(found)[0].outcomes.values()
    assert isinstance(outcome.occurrences, Occurrences)
    assert outcome.occurrences == rtamt.occurrences("always(x < 5)", {"x": [1, 9, 1]})


def test_unknown_cells_are_unknown_rows(folder: Path, capsys: Output) -> None:
    (folder / "gap.csv").write_text("time,x\n0,1\n1,\n2,\n3,1\n")
    found = judged(capsys, "always(x < 5)", "gap.csv", "--missing", "unknown")
    (body,) = found["trials"][0]["outcomes"]["spec"]["occurrences"]["bodies"]
    assert body["violations"] == []
    (row,) = body["unknown"]
    assert (row["start"], row["end"], row["duration"], row["to_end"]) == (1.0, 3.0, 2.0, False)


def test_late_start_at_first_known_event(folder: Path, capsys: Output) -> None:
    (folder / "late.csv").write_text("time,x,y\n0,9,\n1,9,1\n2,1,1\n3,9,1\n4,9,1\n")
    found = judged(capsys, "always(x < 5 or y < 0)", "late.csv", "--dense", "--missing", "drop")
    rows = found["trials"][0]["outcomes"]["spec"]["occurrences"]["bodies"][0]["violations"]
    assert [(row["start"], row["end"]) for row in rows] == [(1.0, 2.0), (3.0, 4.0)]


@pytest.mark.parametrize("name", ["rows.csv", "rows.parquet", "rows.feather"])
def test_table_of_all_traces(name: str, capsys: Output) -> None:
    second = "always(req < 9)"
    words = ["monitor", f"both = {SPEC}", f"low = {second}", "--write-occurrences", name]
    assert main([*words, "--", "drive.csv", "calm.csv"]) == 1
    assert f"occurrences: {name}\n" in capsys.readouterr().out
    read = {"csv": pd.read_csv, "parquet": pd.read_parquet, "feather": pd.read_feather}
    table = read[name.partition(".")[2]](name)
    bodies = rtamt.occurrences(SPEC, pd.read_csv("drive.csv"), 0.5).shifted(10.0).bodies
    violated = table[table["kind"] == "violated"]
    assert violated["start"].tolist() == [r.start for b in bodies for r in b.violations]
    assert violated["robustness"].tolist() == [r.robustness for b in bodies for r in b.violations]
    triggered = table[table["kind"] == "triggered"]
    assert triggered["verdict"].tolist() == ["SATISFIED", "VIOLATED"]
    assert np.isnan(triggered["answer_time"]).tolist() == [False, True]
    assert {*table["trace"]} == {"drive.csv"}
    assert {*table["requirement"]} == {"both"}


def test_processes_find_the_same_rows(capsys: Output) -> None:
    words = [SPEC, "--", "drive.csv", "calm.csv", "drive.csv"]
    alone = judged(capsys, *words)
    assert judged(capsys, "-j", "2", *words) == alone


def test_each_group_of_a_table_has_its_own_rows(folder: Path, capsys: Output) -> None:
    rows = [f"{i},{name},{x}" for i in range(4) for name, x in (("a", 9 * (i == 1)), ("b", i))]
    (folder / "groups.csv").write_text("\n".join(["time,id,x", *rows]) + "\n")
    found = judged(capsys, "always(x < 3)", "groups.csv", "--by", "id")
    table = pd.read_csv("groups.csv")
    for trial, (_, group) in zip(trials_of(found), table.groupby("id"), strict=True):
        expected = rtamt.occurrences("always(x < 3)", {"x": group["x"].to_numpy()}, 1)
        assert len(expected) == 1
        assert trial.outcomes["spec"].occurrences == expected


def test_infinite_robustness_is_strict_json(capsys: Output) -> None:
    found = judged(capsys, "always[20:30](false)", "drive.csv", "--end", "cut")
    (row,) = found["trials"][0]["outcomes"]["spec"]["occurrences"]["bodies"][0]["violations"]
    assert (row["robustness"], row["start"], row["unseen"]) == ("-inf", 30.0, True)
    (outcome,) = trials_of(found)[0].outcomes.values()
    assert outcome.occurrences is not None
    assert next(iter(outcome.occurrences)).robustness == -math.inf


def test_unwritable_table_is_refused_first(capsys: Output) -> None:
    assert main(["monitor", SPEC, "drive.csv", "--write-occurrences", "rows.txt"]) == 2
    assert "cannot write rows.txt: expected a name that ends in" in capsys.readouterr().err


def test_states_at_instants_and_between_them() -> None:
    trace = {"x": [(0, -1), (1.5, 0), (2.5, 2), (5, 2)], "y": [(0, 1), (4, 0), (4.5, 1), (5, 1)]}
    found = rtamt.dense.occurrences("always(eventually[0:2](x < 1) and y > 0)", trace)
    times, words = states_of(found, 0.0)
    assert list(zip(times.tolist(), words.tolist(), strict=True)) == [
        (0.0, "satisfied"),
        (2.5, "violated"),
        (3.0, "unknown"),
        (4.0, "violated"),
        (4.5, "unknown"),
    ]
    found = rtamt.dense.occurrences("always(eventually[2:2](x < 1))", {"x": [(0, 2), (5, 0)]})
    times, words = states_of(found, 0.0)
    assert list(zip(times.tolist(), words.tolist(), strict=True)) == [
        (0.0, "violated"),
        (3.0, "satisfied"),  # at this instant alone
        (3.0, "unknown"),
    ]
