"""`rtamt monitor --occurrences`: all violations of recorded traces."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from bags import START, Said, twist, write_bag
from rosbags.highlevel import AnyReader

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
def folder(folder: Path) -> Path:
    """The working directory with a trace that starts at 10 s and one without a violation."""
    (folder / "drive.csv").write_text(DRIVE)
    (folder / "calm.csv").write_text("time,speed,req,gnt\n0,8,0,0\n0.5,9,0,0\n1,9,0,0\n")
    return folder


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
        (3.0, "satisfied"),  # only at this instant
        (3.0, "unknown"),
    ]


# `rtamt monitor --clip`: a cut of the recording around each violation. ---------------------------


ROWS = [(i / 2, 9 if i in (6, 7, 20) else 1, f"row {i}") for i in range(30)]
CLIPPED = "always(x < 5)"


@pytest.fixture(autouse=True)
def trip(folder: Path) -> Path:
    """The working directory with a trace of 15 s and two violations, from 3 s and from 10 s."""
    frame().to_csv("trip.csv", index=False)
    return folder


def frame() -> pd.DataFrame:
    return pd.DataFrame(ROWS, columns=["time", "x", "note"])


def clipped(trace: str, *words: str) -> list[Path]:
    main(["monitor", CLIPPED, trace, "--clip", "clips", *words])
    return sorted(Path("clips").iterdir()) if Path("clips").exists() else []


def expected(begin: float, end: float) -> pd.DataFrame:
    whole = frame()
    inside = (whole["time"] >= begin) & (whole["time"] <= end)
    return whole[inside].reset_index(drop=True)


def test_csv_clips_keep_all_columns(capsys: Output) -> None:
    first, second = clipped("trip.csv", "--clip-around", "1s")
    assert [first.name, second.name] == ["0001_spec_3s.csv", "0002_spec_10s.csv"]
    pd.testing.assert_frame_equal(pd.read_csv(first), expected(2, 5))
    pd.testing.assert_frame_equal(pd.read_csv(second), expected(9, 11.5))
    assert "2 clips: clips\n" in capsys.readouterr().out


def test_parquet_keeps_its_types_and_columns() -> None:
    frame().to_parquet("trip.parquet")
    first, second = clipped("trip.parquet")
    assert second.suffix == ".parquet"
    pd.testing.assert_frame_equal(pd.read_parquet(first).reset_index(drop=True), expected(1, 6))


def test_a_clip_is_violated_itself(capsys: Output) -> None:
    for clip in clipped("trip.csv"):
        assert main(["monitor", CLIPPED, str(clip)]) == 1
        assert "VIOLATED, robustness -4" in capsys.readouterr().out


def test_lines_above_and_quoted_cells_stay(folder: Path) -> None:
    lines = ["# a comment", "time;x;note", "s;m;-", '0;1;"a;b"', '1;9;"two', 'lines"', "2;1;c"]
    (folder / "odd.csv").write_text("\n".join([*lines, *(f"{i};1;d" for i in range(3, 9))]) + "\n")
    (clip,) = clipped("odd.csv", "--clip-around", "0.5s")
    assert clip.read_text() == "\n".join(lines[:3] + lines[4:7]) + "\n"
    (folder / "cell.csv").write_text("\n".join([*lines[:6]]) + "\n")
    (clip,) = main_again("cell.csv", "--clip-around", "0.5s")
    assert clip.read_text() == "\n".join(lines[:3] + lines[4:6]) + "\n"


def main_again(trace: str, *words: str) -> list[Path]:
    main(["monitor", CLIPPED, trace, "--clip", "more", *words])
    return [*Path("more").iterdir()]


def test_gzip_stays_gzip(folder: Path) -> None:
    with gzip.open(folder / "trip.csv.gz", "wt") as file:
        file.write((folder / "trip.csv").read_text())
    first, _ = clipped("trip.csv.gz", "--clip-around", "1s")
    assert first.name.endswith(".csv.gz")
    pd.testing.assert_frame_equal(pd.read_csv(first), expected(2, 5))


def test_groups_of_a_table(folder: Path) -> None:
    rows = [f"{i},{name},{9 if (i, name) == (3, 'b') else 1}" for i in range(8) for name in "ab"]
    (folder / "groups.csv").write_text("\n".join(["time,id,x", *rows]) + "\n")
    (clip,) = clipped("groups.csv", "--by", "id", "--clip-around", "1s")
    table = pd.read_csv(clip)
    own = table[table["id"] == "b"]
    assert own["time"].tolist() == [2, 3, 4, 5]
    assert {*table["time"]} == {2, 3, 4, 5}


@pytest.mark.parametrize("by_object", [False, True])
@pytest.mark.parametrize("end", [".csv", ".parquet"])
def test_clip_of_wide_table_has_all_rows(end: str, *, by_object: bool, capsys: Output) -> None:
    """The clip has each row of its time, in a file sorted by time or by object."""
    rows = [(i, name, 9 if (i, name) == (3, "B") else 1) for i in range(8) for name in "ABC"]
    rows = sorted(rows, key=lambda row: row[1]) if by_object else rows
    whole = pd.DataFrame(rows, columns=["time", "name", "x"])
    trace = f"objects{end}"
    (whole.to_csv if end == ".csv" else whole.to_parquet)(trace, index=False)
    words = ["monitor", "always(x.B < 5 or x.C < 0)", "--wide", "name"]
    assert main([*words, trace, "--clip", "clips", "--clip-around", "1s"]) == 1
    (clip,) = Path("clips").iterdir()
    cut = pd.read_csv(clip) if end == ".csv" else pd.read_parquet(clip)
    near = whole[whole["time"].between(2, 5)]
    first, last = near.index.min(), near.index.max()
    pd.testing.assert_frame_equal(cut, whole.loc[first:last].reset_index(drop=True))
    capsys.readouterr()
    assert main([*words, str(clip)]) == 1
    assert "VIOLATED, robustness -1" in capsys.readouterr().out


def test_number_of_clips_is_limited(capsys: Output) -> None:
    assert len(clipped("trip.csv", "--clip-limit", "1")) == 1
    assert "1 clip: clips; --clip-limit leaves out 1 violation\n" in capsys.readouterr().out


def test_no_violation_leaves_an_empty_folder(capsys: Output) -> None:
    assert main(["monitor", "always(x < 99)", "trip.csv", "--clip", "clips"]) == 0
    assert "0 clips: clips\n" in capsys.readouterr().out
    assert not [*Path("clips").iterdir()]


def messages(path: Path) -> list[tuple[str, int, Any]]:
    with AnyReader([path]) as reader:
        return [
            (connection.topic, time, reader.deserialize(raw, connection.msgtype))
            for connection, time, raw in reader.messages()
        ]


@pytest.mark.parametrize("extension", [".mcap", ".bag"])
def test_bag_clips_are_mcap(extension: str, tmp_path: Path) -> None:
    step = 10**8
    said = [twist(START + i * step, 9.0 if i in (20, 21, 60) else 1.0) for i in range(80)]
    said += [
        Said(START + i * 10**9, "/name", "std_msgs/String", {"data": str(i)}) for i in range(8)
    ]
    bag = write_bag(tmp_path / f"run{extension}", sorted(said, key=lambda each: each.time))
    spec = "from geometry_msgs.msg import Twist\ninput Twist cmd\n@ topic(cmd, robot0/cmd_vel)\n"
    (tmp_path / "spec.stl").write_text(spec + "always(cmd.linear.x < 5)")
    words = ["spec.stl", str(bag), "--period", "100ms", "--clip", "clips", "--clip-around", "500ms"]
    assert main(["monitor", *words]) == 1
    first, second = sorted(Path("clips").iterdir())
    whole = messages(bag)
    for clip, (begin, end) in zip((first, second), ((1.5, 2.7), (5.5, 6.6)), strict=True):
        low, high = START + round(begin * 1e9), START + round(end * 1e9)
        inside = [(topic, time) for topic, time, _ in whole if low <= time <= high]
        assert [(topic, time) for topic, time, _ in messages(clip)] == inside
        speeds = [m.linear.x for topic, _, m in messages(clip) if topic == "/robot0/cmd_vel"]
        assert 9.0 in speeds


def refused(capsys: Output, *words: str) -> str:
    assert main(["monitor", CLIPPED, *words]) == 2
    return capsys.readouterr().err


def test_refusals(folder: Path, capsys: Output) -> None:
    (folder / "full").mkdir()
    (folder / "full" / "own.txt").write_text("mine")
    assert refused(capsys, "trip.csv", "--clip", "full") == (
        "rtamt: error: --clip: expected an empty folder or a new one, got full\n"
    )
    frame().drop(columns="note").to_feather("trip.feather")
    assert "expected a CSV or Parquet file or a bag, got trip.feather" in refused(
        capsys, "trip.feather", "--clip", "clips"
    )
    assert "expected the times of the recording, got --period" in refused(
        capsys, "trip.csv", "--clip", "clips", "--period", "1"
    )
    assert "--clip-around sets how clips are cut; add --clip FOLDER" in refused(
        capsys, "trip.csv", "--clip-around", "1s"
    )
    (folder / "plain.csv").write_text("x\n1\n9\n")
    assert "which clips need. If a column holds times, name it with --time COLUMN." in refused(
        capsys, "plain.csv", "--clip", "clips"
    )
    assert "--clip-around: expected" in refused(
        capsys, "trip.csv", "--clip", "clips", "--clip-around", "soon"
    )
