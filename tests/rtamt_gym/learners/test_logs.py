"""Logs of training: reading CSV and event files, and drawing them."""

import csv
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtamt import InputError
from rtamt_gym.__main__ import main
from rtamt_gym.learners.curves import ALL, PANELS, band_of, columns_of, draw_training
from rtamt_gym.learners.logs import TrainingLog, training_logs

Output = pytest.CaptureFixture[str]
Points = Mapping[str, Sequence[tuple[int, float]]]

METRICS: Points = {
    "stl/satisfied": [(100, 0.25), (200, 0.5)],
    "stl/satisfied_low": [(100, 0.125), (200, 0.25)],
    "stl/satisfied_high": [(100, 0.5), (200, 0.75)],
    "stl/near/satisfied": [(100, 0.25), (200, 0.5)],
    "stl/near/robustness_median": [(100, -1.5), (200, 0.5)],
    "stl/near/robustness_p5": [(100, -2.0), (200, -1.0)],
    "stl/near/progress": [(200, 0.75)],
    "stl/cost": [(100, 8.0)],
    "eval_stl/rate": [(200, 1.0)],
}


def write_csv(path: Path, points: Points, counter: str = "time/total_timesteps") -> None:
    """Write a file like Stable-Baselines3: a row for each step, empty cells without a value."""
    steps = sorted({step for pairs in points.values() for step, _ in pairs})
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, [*points, counter, "train/loss"])
        writer.writeheader()
        for step in steps:
            row = {name: dict(pairs).get(step, "") for name, pairs in points.items()}
            writer.writerow({**row, counter: step, "train/loss": 0.5})


def varint(value: int) -> bytes:
    made = bytearray()
    while value > 127:
        made.append(value & 127 | 128)
        value >>= 7
    return bytes([*made, value])


def field(number: int, content: bytes) -> bytes:
    return varint(number << 3 | 2) + varint(len(content)) + content


def event(step: int, tag: str, value: float, *, tensor: bool) -> bytes:
    """Return a record of an event file, with unused checksums."""
    entry = field(1, tag.encode())
    number = struct.pack("<f", value)
    if tensor:
        entry += field(8, b"\x08\x01" + field(4, number))
    else:
        entry += b"\x15" + number
    message = b"\x09" + struct.pack("<d", 1.5) + b"\x10" + varint(step) + field(5, field(1, entry))
    return struct.pack("<Q", len(message)) + b"...." + message + b"...."


def write_events(path: Path, points: Points, *, tensor: bool = False, cut: int = 0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    version = b"\x09" + bytes(8) + field(3, b"brain.Event:2")
    data = struct.pack("<Q", len(version)) + b"...." + version + b"...."
    for tag, pairs in points.items():
        for step, value in pairs:
            data += event(step, tag, value, tensor=tensor)
    path.write_bytes(data[: len(data) - cut])


def read(folder: Path) -> dict[str, list[tuple[float, float]]]:
    (log,) = training_logs(folder)
    return {
        key: list(zip(steps.tolist(), values.tolist(), strict=True))
        for key, (steps, values) in log.curves.items()
    }


@pytest.mark.parametrize("counter", ["time/total_timesteps", "global_step", "step"])
def test_a_csv_file_is_read(counter: str, tmp_path: Path) -> None:
    write_csv(tmp_path / "run" / "progress.csv", METRICS, counter)
    assert read(tmp_path) == METRICS


@pytest.mark.parametrize("tensor", [False, True])
def test_an_event_file_is_read(tensor: bool, tmp_path: Path) -> None:  # noqa: FBT001
    write_events(tmp_path / "events.out.tfevents.1.host", METRICS, tensor=tensor)
    assert read(tmp_path) == METRICS


def test_a_record_that_is_cut_off_is_left_out(tmp_path: Path) -> None:
    write_events(tmp_path / "events.out.tfevents.1.host", METRICS, cut=3)
    assert read(tmp_path) == {k: v for k, v in METRICS.items() if k != "eval_stl/rate"}


def test_both_files_of_a_folder_are_one_log(tmp_path: Path) -> None:
    write_csv(tmp_path / "progress.csv", {"stl/satisfied": [(1, 0.5)]})
    more: Points = {"stl/satisfied": [(1, 0.75)], "stl/cost": [(1, 2.0)]}
    write_events(tmp_path / "events.out.tfevents.1.host", more)
    assert read(tmp_path) == {"stl/satisfied": [(1, 0.5)], "stl/cost": [(1, 2.0)]}


def test_links_within_a_folder_are_not_further_logs(tmp_path: Path) -> None:
    """W&B links to event files, and many scripts link to the newest run."""
    outside, runs = tmp_path / "outside", tmp_path / "runs"
    write_csv(outside / "progress.csv", {"stl/satisfied": [(1, 0.25)]})
    write_csv(runs / "seed1" / "progress.csv", {"stl/satisfied": [(1, 0.5)]})
    write_csv(runs / "seed2" / "progress.csv", {"stl/satisfied": [(1, 0.75)]})
    copy = runs / "a-wandb" / "files"
    copy.mkdir(parents=True)
    (copy / "progress.csv").symlink_to(runs / "seed1" / "progress.csv")
    (runs / "latest").symlink_to("seed2")
    (runs / "other").symlink_to(outside)
    (tmp_path / "link").symlink_to(runs)
    for folder in (runs, tmp_path / "link"):
        logs = training_logs(folder)
        assert [Path(log.name).name for log in logs] == ["other", "seed1", "seed2"]
        assert [log.curves["stl/satisfied"][1].tolist() for log in logs] == [[0.25], [0.5], [0.75]]


@pytest.mark.parametrize(
    ("points", "fault"), [({}, "found no"), ({"loss": [(1, 2.0)]}, "got 1 without them")]
)
def test_a_folder_without_metrics_is_refused(points: Points, fault: str, tmp_path: Path) -> None:
    if points:
        write_csv(tmp_path / "progress.csv", points)
    with pytest.raises(InputError, match=fault):
        training_logs(tmp_path)


curves = st.dictionaries(st.integers(0, 8), st.integers(0, 4), min_size=1).map(
    lambda points: sorted(points.items())
)


@given(st.lists(curves, min_size=2, max_size=4))
def test_the_band_of_several_logs_holds_every_line(drawn: list[list[tuple[int, int]]]) -> None:
    logs = [
        TrainingLog(str(i), {"stl/satisfied": (np.array(s, float), np.array(v, float))})
        for i, (s, v) in enumerate(zip(*points, strict=True) for points in drawn)
    ]
    band = band_of(logs, PANELS[0], ALL, "training")
    assert band is not None
    assert band.steps.tolist() == sorted({step for points in drawn for step, _ in points})
    for step, middle, low, high in zip(*map(list, (band.steps, band.middle, band.low, band.high))):  # noqa: B905
        values = []
        for points in drawn:
            before = [p for p in points if p[0] <= step]
            after = [p for p in points if p[0] >= step]
            if before and after:
                (a, left), (b, right) = before[-1], after[0]
                share = 0 if a == b else (step - a) / (b - a)
                values.append(left + share * (right - left))
        assert [middle, low, high] == pytest.approx(
            [sum(values) / len(values), min(values), max(values)]
        )


def test_the_band_of_one_log_is_its_interval(tmp_path: Path) -> None:
    write_csv(tmp_path / "progress.csv", METRICS)
    logs = training_logs(tmp_path)
    rate, robustness = PANELS[0], PANELS[1]
    band = band_of(logs, rate, ALL, "training")
    assert band is not None
    assert (band.low.tolist(), band.high.tolist()) == ([0.125, 0.25], [0.5, 0.75])
    band = band_of(logs, robustness, "near", "training")
    assert band is not None
    assert (band.low.tolist(), band.high.tolist()) == ([-2.0, -1.0], [-1.5, 0.5])
    assert band_of(logs, robustness, "near", "evaluation") is None


def test_a_panel_is_drawn_for_each_metric(tmp_path: Path) -> None:
    far = {key.replace("near", "far"): pairs for key, pairs in METRICS.items() if "near" in key}
    write_csv(tmp_path / "progress.csv", {**METRICS, **far})
    logs = training_logs(tmp_path)
    assert columns_of(logs) == [ALL, "near", "far"]
    figure = draw_training({"one": logs, "two": logs})
    shown = [ax for ax in figure.axes if ax.axison]
    assert [ax.get_ylabel() for ax in shown].count("satisfied") == 3
    assert {ax.get_ylabel() for ax in shown} == {"satisfied", "robustness", "progress", "cost"}
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["one", "two"]


def test_the_command_prints_the_last_rates(tmp_path: Path, capsys: Output) -> None:
    for seed, rate in ((1, 0.5), (2, 1.0)):
        write_csv(tmp_path / "a" / f"seed{seed}" / "progress.csv", {"stl/satisfied": [(9, rate)]})
    write_events(tmp_path / "b" / "events.out.tfevents.1.host", METRICS)
    picture = tmp_path / "training.svg"
    arguments = [f"a={tmp_path / 'a'}", f"b={tmp_path / 'b'}", "-o", str(picture)]
    assert main(["plot", *arguments]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].split() == ["a", "2", "all", "training", "9", "75.0%", "50", "to", "100"]
    assert lines[2].split()[:6] == ["b", "1", "all", "evaluation", "200", "100.0%"]
    assert lines[3].split() == ["b", "1", "near", "training", "200", "50.0%", "50", "to", "50"]
    assert picture.read_text().startswith("<?xml")
    assert main(["plot", *arguments, "--only", "nea"]) == 2


def test_runs_that_end_earlier_are_counted_apart(tmp_path: Path, capsys: Output) -> None:
    write_csv(tmp_path / "a" / "progress.csv", {"stl/satisfied": [(200, 0.4), (400, 0.8)]})
    write_csv(tmp_path / "b" / "progress.csv", {"stl/satisfied": [(100, 0.0), (200, 0.0)]})
    write_csv(tmp_path / "c" / "progress.csv", {"stl/cost": [(200, 1.0), (400, 1.0)]})
    band = band_of(training_logs(tmp_path), PANELS[0], ALL, "training")
    assert band is not None
    assert band.steps.tolist() == [100, 200, 400]
    assert band.counts.tolist() == [1, 2, 1]
    assert main(["plot", str(tmp_path), "-o", str(tmp_path / "t.svg")]) == 0
    text = capsys.readouterr().out
    assert " 1 of 3  all          training    400      80.0%  80 to 80" in text
    assert "runs: those with a value at this step" in text


@pytest.mark.parametrize(
    ("content", "note"),
    [
        ("step,stl/satisfied\n", "it has no rows below the names"),
        ("epoch,stl/satisfied\n1,0.5\n", "no column counts steps; name one"),
        ("step;stl/satisfied\n1;0,5\n", "its cells are separated by ';'"),
        ("step,stl/satisfied\n1,0.5\n2,abc\nx,1\n", "2 cells without a number left out"),
    ],
)
def test_what_is_left_out_has_a_note(
    content: str, note: str, tmp_path: Path, capsys: Output
) -> None:
    write_csv(tmp_path / "a" / "progress.csv", METRICS)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "progress.csv").write_text(content)
    (tmp_path / "b" / "other.csv").write_text("name;value\n1;abc\n")  # not a training log
    notes = list[str]()
    training_logs(tmp_path, notes)
    assert [str(tmp_path / "b" / "progress.csv") in n and note in n for n in notes] == [True]
    assert main(["plot", str(tmp_path), "-o", str(tmp_path / "t.svg")]) == 0
    assert "note:" in capsys.readouterr().out
    assert main(["plot", str(tmp_path / "a"), "-o", str(tmp_path / "t.svg")]) == 0
    assert "note:" not in capsys.readouterr().out
    if "cells" not in note:
        with pytest.raises(InputError, match=note[:20]):
            training_logs(tmp_path / "b")
