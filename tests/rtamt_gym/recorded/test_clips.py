"""`rtamt monitor --clip`: a cut of the recording around each violation."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from bags import START, Said, twist, write_bag
from rosbags.highlevel import AnyReader

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
ROWS = [(i / 2, 9 if i in (6, 7, 20) else 1, f"row {i}") for i in range(30)]
SPEC = "always(x < 5)"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory with a trace of 15 s and two violations, from 3 s and from 10 s."""
    monkeypatch.chdir(tmp_path)
    frame().to_csv("drive.csv", index=False)
    return tmp_path


def frame() -> pd.DataFrame:
    return pd.DataFrame(ROWS, columns=["time", "x", "note"])


def clipped(trace: str, *words: str) -> list[Path]:
    main(["monitor", SPEC, trace, "--clip", "clips", *words])
    return sorted(Path("clips").iterdir()) if Path("clips").exists() else []


def expected(begin: float, end: float) -> pd.DataFrame:
    whole = frame()
    inside = (whole["time"] >= begin) & (whole["time"] <= end)
    return whole[inside].reset_index(drop=True)


def test_csv_clips_keep_all_columns(capsys: Output) -> None:
    first, second = clipped("drive.csv", "--clip-around", "1s")
    assert [first.name, second.name] == ["0001_spec_3s.csv", "0002_spec_10s.csv"]
    pd.testing.assert_frame_equal(pd.read_csv(first), expected(2, 5))
    pd.testing.assert_frame_equal(pd.read_csv(second), expected(9, 11.5))
    assert "2 clips: clips\n" in capsys.readouterr().out


def test_parquet_keeps_its_types_and_columns() -> None:
    frame().to_parquet("drive.parquet")
    first, second = clipped("drive.parquet")
    assert second.suffix == ".parquet"
    pd.testing.assert_frame_equal(pd.read_parquet(first).reset_index(drop=True), expected(1, 6))


def test_a_clip_is_violated_itself(capsys: Output) -> None:
    for clip in clipped("drive.csv"):
        assert main(["monitor", SPEC, str(clip)]) == 1
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
    main(["monitor", SPEC, trace, "--clip", "more", *words])
    return [*Path("more").iterdir()]


def test_gzip_stays_gzip(folder: Path) -> None:
    with gzip.open(folder / "drive.csv.gz", "wt") as file:
        file.write((folder / "drive.csv").read_text())
    first, _ = clipped("drive.csv.gz", "--clip-around", "1s")
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
    assert len(clipped("drive.csv", "--clip-limit", "1")) == 1
    assert "1 clip: clips; --clip-limit leaves out 1 violation\n" in capsys.readouterr().out


def test_no_violation_leaves_an_empty_folder(capsys: Output) -> None:
    assert main(["monitor", "always(x < 99)", "drive.csv", "--clip", "clips"]) == 0
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
    assert main(["monitor", SPEC, *words]) == 2
    return capsys.readouterr().err


def test_refusals(folder: Path, capsys: Output) -> None:
    (folder / "full").mkdir()
    (folder / "full" / "own.txt").write_text("mine")
    assert refused(capsys, "drive.csv", "--clip", "full") == (
        "rtamt: error: --clip: expected an empty folder or a new one, got full\n"
    )
    frame().drop(columns="note").to_feather("drive.feather")
    assert "expected a CSV or Parquet file or a bag, got drive.feather" in refused(
        capsys, "drive.feather", "--clip", "clips"
    )
    assert "expected the times of the recording, got --period" in refused(
        capsys, "drive.csv", "--clip", "clips", "--period", "1"
    )
    assert "--clip-around sets how clips are cut; add --clip FOLDER" in refused(
        capsys, "drive.csv", "--clip-around", "1s"
    )
    (folder / "plain.csv").write_text("x\n1\n9\n")
    assert "which clips need. If a column holds times, name it with --time COLUMN." in refused(
        capsys, "plain.csv", "--clip", "clips"
    )
    assert "--clip-around: expected" in refused(
        capsys, "drive.csv", "--clip", "clips", "--clip-around", "soon"
    )
