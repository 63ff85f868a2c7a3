"""`rtamt watch --rerun`: the view contains the data of the lines, and the lines do not change."""

import json
import math
import os
import signal
import subprocess
import sys
from collections import defaultdict
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest
from rrd_files import read_rrd

from rtamt_gym.__main__ import main
from rtamt_gym.commands import watch as command
from rtamt_gym.live import RerunView

Output = pytest.CaptureFixture[str]

SPEC = """
calm = always(x < 3)
soon = eventually[0:2](y > 2)
answered = always((x > 2) implies eventually[0:2](y > 1))
"""
CURVES = ("robustness", "lower", "upper")
MODES = {
    "sampled": (),
    "period": ("--period", "0.5"),
    "dense": ("--dense",),
    "instants": ("--view", "step"),
    "stop": ("--stop", "violation"),
    "unknown": ("--missing", "unknown"),
    "groups": ("--by", "car"),
}


@pytest.fixture
def stream(tmp_path: Path) -> Path:
    random = np.random.default_rng(4)
    lines = ["time,x,y,car"]
    for at in range(60):
        x, y = random.uniform(-1, 3.05), random.uniform(-1, 2.5)
        lines += [f"{at / 2},{x:.4f},{y:.4f},{car}" for car in ("a",)]
    path = tmp_path / "stream.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def watched(capsys: Output, path: Path, *arguments: str) -> tuple[int, list[dict[str, Any]]]:
    code = main(["watch", SPEC, str(path), *arguments])
    return code, [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def number(value: Any) -> float:
    return math.nan if value is None else float(value)


@pytest.mark.parametrize("mode", MODES)
def test_view_equals_the_lines(mode: str, capsys: Output, stream: Path, tmp_path: Path) -> None:
    options, path = MODES[mode], tmp_path / "run.rrd"
    before = watched(capsys, stream, *options)
    code, lines = watched(capsys, stream, *options, "--rerun", str(path))
    assert (code, lines) == before
    rows = [line.split(",") for line in stream.read_text().splitlines()[1:]]
    entities, head = read_rrd(path), "/a" if mode == "groups" else ""
    count = len(entities[f"{head}/signals/x"])
    assert count == (60 if mode != "stop" else count)
    for place, name in enumerate(("x", "y"), 1):
        points = entities[f"{head}/signals/{name}"]
        assert [point.value for point in points] == [float(row[place]) for row in rows[:count]]
        assert [point.time for point in points] == [float(row[0]) for row in rows[:count]]
        assert [point.sample for point in points] == [*range(count)]
    if mode == "instants":  # the lines show some instants, the curves all
        options = ()
    _, every = watched(capsys, stream, *options, "--every")
    expected: defaultdict[str, list[tuple[float, ...]]] = defaultdict(list)
    for line in every:
        curves = expected[line["requirement"]]
        if line["final"]:
            curves.pop()
        curves.append(tuple(number(line[curve]) for curve in CURVES))
    for name, curves in expected.items():
        shown = [entities[f"{head}/requirements/{name}/{curve}"] for curve in CURVES]
        values = [[point.value for point in points] for points in shown]
        if mode != "instants":
            np.testing.assert_array_equal(np.transpose(values), curves)


@pytest.mark.parametrize("mode", MODES)
def test_log_equals_the_lines(mode: str, capsys: Output, stream: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    _, lines = watched(capsys, stream, *MODES[mode], "--every", "--rerun", str(path))
    last: dict[str, str] = {}
    expected = []
    for line in lines:
        name, verdict = line["requirement"], line["verdict"]
        changed = verdict != last.get(name, "UNDECIDED")
        if changed or (line["final"] and verdict == "UNDECIDED"):
            when = "the end" if line["final"] else f"{line['time']:.6g} s"
            head = "a: " if mode == "groups" else ""
            expected.append((name, line["time"], f"{head}{name} {verdict} at {when}"))
        last[name] = verdict
    shown = [
        (entity.split("/")[-2], point.time, point.value.partition(",")[0])
        for entity, points in read_rrd(path, "TextLog:text").items()
        for point in points
    ]
    assert sorted(shown) == sorted(expected)
    assert len(shown) >= 3


def test_first_groups_are_shown(
    capsys: Output, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "SHOWN_GROUPS", 2)
    path, stream = tmp_path / "run.rrd", tmp_path / "stream.csv"
    stream.write_text("time,x,y,car\n" + "".join(f"{t},1,1,{c}\n" for t in "01" for c in "abc"))
    main(["watch", SPEC, str(stream), "--by", "car", "--rerun", str(path)])
    assert "--rerun shows the first 2 groups" in capsys.readouterr().err
    assert {entity.split("/")[1] for entity in read_rrd(path)} == {"a", "b"}


def test_held_view_has_the_newest_row(
    capsys: Output, stream: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def look(view: RerunView) -> None:
        (track,) = view._tracks.values()
        view.send()
        seen.append((track.sample_count, track._newest, len(track.rows)))

    monkeypatch.setattr("rtamt_gym.commands.watch.hold", look)
    main(["watch", SPEC, str(stream), "--rerun", str(tmp_path / "run.rrd")])
    capsys.readouterr()
    assert seen == [(60, None, 0)]


def test_other_file_name(capsys: Output, stream: Path) -> None:
    assert main(["watch", SPEC, "--rerun", str(stream)]) == 2
    assert "put --rerun after all arguments" in capsys.readouterr().err


def write_until_it_fails(pipe: IO[str]) -> None:
    for _ in range(100_000):
        pipe.write("1\n")
        pipe.flush()


def test_view_stays_until_interrupted(tmp_path: Path) -> None:
    def command(*arguments: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "rtamt_gym", *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )  # fmt: skip

    with command("watch", "always(x < 3)", "--stop", "violation", "--rerun") as watch:
        assert watch.stdin is not None
        assert watch.stderr is not None
        assert watch.stdout is not None
        watch.stdin.write("x\n1\n5\n")
        watch.stdin.flush()
        assert watch.stderr.readline().startswith("live view: http://127.0.0.1:")
        assert "ended; the view stays until Ctrl-C" in watch.stderr.readline()
        assert watch.poll() is None
        with pytest.raises(BrokenPipeError):
            write_until_it_fails(watch.stdin)
        watch.send_signal(signal.SIGINT)
        output = watch.stdout.read()
        assert watch.wait() == 1
        with suppress(BrokenPipeError):
            watch.stdin.close()
    assert [json.loads(line)["verdict"] for line in output.splitlines()] == [
        "UNDECIDED",
        "VIOLATED",
        "VIOLATED",
    ]


def test_file_of_rtamt_run(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    arguments = ["run", "CartPole-v1", "--spec", "always(abs(a) < 0.1)", "--signal", "a=obs[2]"]
    arguments += ["--episodes", "3", "--env-kwarg", "render_mode=rgb_array"]
    main(arguments)
    before = capsys.readouterr()
    assert main([*arguments, "--rerun", str(path)]) == 0
    assert capsys.readouterr() == before
    points = read_rrd(path)["/requirements/spec/robustness"]
    assert {point.episode for point in points} == {1, 2, 3}
    assert len(read_rrd(path, "EncodedImage:blob")["/picture"]) == len(points)
    lines = [point.value for point in read_rrd(path, "TextLog:text")["/requirements/spec/verdict"]]
    assert [" VIOLATED " in line for line in lines] == [True] * 3
