"""Data sets of LeRobot: a trace per episode, errors for damage, a list for the editing tool."""

import json
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lerobot_sets import write_data_set
from numpy.typing import NDArray

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import part_name, part_of
from rtamt_gym.recorded.readers import traces_in
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled

QUALITY = Path(__file__).parents[3] / "examples/lerobot_quality.stl"
X = "observation.state.pan.pos"


def states(seed: int, lengths: tuple[int, ...]) -> list[NDArray[np.float64]]:
    generator = np.random.default_rng(seed)
    return [generator.normal(size=(length, 2)) for length in lengths]


def read(path: Path | str, columns: Columns | None = None) -> Trace:
    spec = rtamt.parse(f"always({X} < 1)")
    trace, _ = read_ruled(str(path), {"": spec}, EvaluationOptions(), columns or Columns())
    assert isinstance(trace, Trace)
    return trace


@pytest.mark.parametrize("files", [1, 3])
def test_verdicts_match_pandas(
    files: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_data_set(tmp_path / "set", states(files, (20, 1, 35, 7, 20)), files=files)
    main(
        ["monitor", f"r = always[0:0.2]({X} < 1.2)", "--json", "--end=complete", "--", str(folder)]
    )
    rows = json.loads(capsys.readouterr().out)["trials"]
    frame = pd.concat(pd.read_parquet(file) for file in sorted(folder.glob("data/*/*.parquet")))
    frame["x"] = [state[0] for state in frame["observation.state"]]
    expected = {
        f"{folder}[episode_index={index}]": 1.2 - rows_.x.head(7).max()
        for index, rows_ in frame.groupby("episode_index")
    }
    measured = {row["name"]: row["outcomes"]["r"]["robustness"] for row in rows}
    assert measured == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("fps", [30, 15, 29.97, 59.94, 1])
def test_period_is_exact(fps: float, tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "set", states(1, (400, 1)), fps=fps)
    for index in (0, 1):
        spec = rtamt.parse(f"always[0:inf]({X} < 1)")
        name = f"{folder}[episode_index={index}]"
        _, period = read_ruled(name, {"": spec}, EvaluationOptions(), Columns())
        assert period == 1 / Fraction(str(fps))


def test_dense_times_lie_on_frames(tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "set", states(1, (31,)), fps=10)
    spec, reading = rtamt.parse(f"always({X} < 1)"), EvaluationOptions(dense=True)
    trace, _ = read_ruled(f"{folder}[episode_index=0]", {"": spec}, reading, Columns())
    assert isinstance(trace, EventTrace)
    assert trace.signals[X][0].tolist() == [k / 10 for k in range(31)]


def test_elements_have_names_and_places(tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "set", states(2, (9,)))
    by_name = read(f"{folder}[episode_index=0]")
    by_place = read(f"{folder}[episode_index=0]", Columns(signals={X: "observation.state[0]"}))
    assert by_name.columns[X].tolist() == by_place.columns[X].tolist()


@pytest.mark.parametrize(
    ("where", "indices"),
    [
        ({}, [0, 1, 2]),
        ({"task": "stack"}, [1]),
        ({"episode_index": "2"}, [2]),
        ({"episode_index": "2", "task": "pick"}, [2]),
    ],
)
def test_where_selects_episodes(where: dict[str, str], indices: list[int], tmp_path: Path) -> None:
    folder = str(write_data_set(tmp_path / "set", states(2, (9, 9, 9)), tasks=["pick", "stack"]))
    assert traces_in(folder, where) == [f"{folder}[episode_index={i}]" for i in indices]
    for name in traces_in(folder, where):
        assert read(name, Columns(where=where)).samples == 9


def test_unknown_episode_error(tmp_path: Path) -> None:
    folder = str(write_data_set(tmp_path / "set", states(2, (9, 9))))
    with pytest.raises(rtamt.InputError, match=r"no trace with episode_index=7.*are 0, 1$"):
        traces_in(folder, {"episode_index": "7"})
    with pytest.raises(rtamt.InputError, match=r"got episode_index=7; it has 2 episodes"):
        read(f"{folder}[episode_index=7]")
    with pytest.raises(rtamt.InputError, match=r"got 2 episodes; give --where episode_index=0"):
        read(folder)


def test_wrong_rate_error(tmp_path: Path) -> None:
    times = {0: np.arange(9) / 10}
    folder = write_data_set(tmp_path / "set", states(2, (9, 9)), times=times)
    name = f"{folder}[episode_index=0]"
    with pytest.raises(
        rtamt.InputError, match=r"frames 0\.0333333 s apart.*rows 0\.1 s apart.*--time"
    ):
        read(name)
    assert read(name, Columns(time="timestamp")).period() == Fraction(1, 10)
    assert read(f"{folder}[episode_index=1]").period() == Fraction(1, 30)


def test_dropped_frame_error(tmp_path: Path) -> None:
    dropped = np.delete(np.arange(31), 11) / 30
    folder = write_data_set(tmp_path / "set", states(2, (30,)), times={0: dropped})
    with pytest.raises(rtamt.InputError, match=r"row 12: expected samples at even distances"):
        read(f"{folder}[episode_index=0]").period()


@pytest.mark.parametrize(
    ("info", "error"),
    [
        ({"codebase_version": "v2.1"}, "expected codebase_version v3.0, got 'v2.1'"),
        ({"fps": None}, "expected frames per second as fps, got None"),
        ({"fps": 0}, "expected frames per second as fps, got 0"),
        ({"features": 3}, "expected the features of a LeRobot data set"),
        ({"features": {}}, "'observation.state': expected a feature with a shape of one number"),
        (
            {"data_path": "../a-{file_index}"},
            "expected data_path below the folder",
        ),
        ({"data_path": "data/{nothing}"}, "expected the path of a data file as data_path"),
    ],
)
def test_description_errors(info: dict[str, object], error: str, tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "set", states(2, (9,)))
    path = folder / "meta/info.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **info}))
    with pytest.raises(rtamt.InputError) as caught:
        read(f"{folder}[episode_index=0]")
    assert error in str(caught.value)


def test_list_of_other_length_error(tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "set", states(2, (9,)))
    path = folder / "data/chunk-000/file-000.parquet"
    frame = pd.read_parquet(path)
    frame["observation.state"] = [[1.0] * (3 if row == 4 else 2) for row in range(9)]
    frame.to_parquet(path)
    with pytest.raises(rtamt.InputError, match=r"row 5, .*expected a list of 2, .*got 3"):
        read(f"{folder}[episode_index=0]")


@pytest.mark.parametrize("order", [[*range(17)], [*range(9, 18), *range(9)][:17]])
def test_missing_rows_error(order: list[int], tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "set", states(2, (9, 9)))
    path = folder / "data/chunk-000/file-000.parquet"
    pd.read_parquet(path).iloc[order].to_parquet(path)
    errors = []
    for index in (0, 1):
        with suppress(rtamt.InputError):
            assert read(f"{folder}[episode_index={index}]").samples == 9
            continue
        with pytest.raises(rtamt.InputError, match="expected 9 rows in one piece"):
            read(f"{folder}[episode_index={index}]")
        errors.append(index)
    assert len(errors) == 1


def test_damaged_file_affects_its_episodes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_data_set(tmp_path / "set", states(3, (9, 9, 9, 9)), files=2)
    path = folder / "data/chunk-000/file-001.parquet"
    whole = path.read_bytes()
    for part in range(20):
        path.write_bytes(whole[: len(whole) * part // 20])
        code = main(["monitor", f"always({X} < 9)", "--json", "--", str(folder)])
        rows = json.loads(capsys.readouterr().out)["trials"]
        verdicts = [row["outcomes"]["spec"]["verdict"] for row in rows]
        assert (code, verdicts) == (2, ["SATISFIED", "SATISFIED", "ERROR", "ERROR"])


@pytest.mark.parametrize("name", ["info.json", "episodes/chunk-000/file-000.parquet"])
def test_damaged_description_is_one_error(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_data_set(tmp_path / "set", states(3, (9, 9)))
    path = folder / "meta" / name
    path.write_bytes(path.read_bytes()[:-20])
    assert main(["monitor", f"always({X} < 9)", str(folder)]) == 2
    assert f"{path}: expected" in capsys.readouterr().err


def test_error_of_all_episodes_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_data_set(tmp_path / "set", states(3, (9, 9, 9)))
    assert main(["monitor", "always(x < 9)", "--", str(folder)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"rtamt: error: {folder}[episode_index=0]: no column 'x'")
    assert line.endswith(" (and 2 more)")


def test_as_files_reads_a_plain_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_data_set(tmp_path / "set", states(3, (9, 9)))
    (folder / "trace.csv").write_text("time,x\n0,1\n1,2\n")
    assert main(["monitor", "always(x < 3)", "--as", "files", "--", str(folder)]) == 0
    assert "not read: data/, meta/" in capsys.readouterr().out
    assert main(["monitor", f"always({X} < 9)", "--", str(folder)]) == 0


def test_outcomes_and_report_of_an_episode(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_data_set(tmp_path / "set", states(3, (9, 9)))
    main(["monitor", f"always({X} < 0)", "--json", "--", "set"])
    outcomes = tmp_path / "outcomes.json"
    outcomes.write_text(capsys.readouterr().out)
    trials = json.loads(outcomes.read_text())["trials"]
    assert [trial["group"] for trial in trials] == [{"episode_index": 0}, {"episode_index": 1}]
    assert main(["report", str(outcomes), "-o", "page.html"]) == 0
    assert "is not shown in full" not in (tmp_path / "page.html").read_text()
    (folder / "videos").symlink_to(tmp_path.parent)
    assert main(["report", str(outcomes), "-o", "page.html"]) == 0
    assert "no regular file of this name" in (tmp_path / "page.html").read_text()


def test_violated_episodes_are_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad, good = np.full((9, 2), 2.0), np.zeros((9, 2))
    folder = write_data_set(tmp_path / "set", [good, bad, good, bad, bad])
    output = tmp_path / "violated.json"
    command = ["monitor", f"always({X} < 1)", "--violated-episodes", str(output), "--"]
    assert main([*command, str(folder)]) == 1
    assert json.loads(output.read_text()) == [1, 3, 4]
    assert f"violated episodes: {output}, 3 of 5 episodes\n" in capsys.readouterr().out
    other = write_data_set(tmp_path / "other", [good])
    assert main([*command, str(folder), str(other)]) == 2
    assert "expected one LeRobot data set, got" in capsys.readouterr().err
    (tmp_path / "trace.csv").write_text(f"time,{X}\n0,1\n1,2\n")
    assert main([*command, str(tmp_path / "trace.csv")]) == 2
    assert "expected episodes of a LeRobot data set, got" in capsys.readouterr().err


def test_undecided_and_failed_episodes_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short, long = np.zeros((9, 2)), np.zeros((90, 2))
    folder = write_data_set(
        tmp_path / "set", [short, long, short + 2, short], times={3: np.arange(9) / 7}
    )
    output = tmp_path / "violated.json"
    command = ["monitor", f"always[0:1]({X} < 1)", f"--violated-episodes={output}", "--"]
    assert main([*command, str(folder)]) == 2
    assert json.loads(output.read_text()) == [2]
    assert "1 of 4 episodes; not in it: 1 undecided and 1 with errors" in capsys.readouterr().out


JOINTS = [f"{j}.pos" for j in ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex")]
JOINTS += ["wrist_roll.pos", "gripper.pos"]


def demonstration() -> NDArray[np.float64]:
    """Five seconds in motion, and the last two at rest."""
    t = np.minimum(np.arange(150), 85)[:, None] / 30
    waves = [40 * np.sin(t), 20 * np.cos(t), 20 * np.sin(t / 2), 10 * np.cos(t / 3), 5 * np.sin(t)]
    return np.hstack([*waves, 50 + 40 * np.cos(1.5 * t)])


def test_quality_finds_each_flaw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    episodes = {"": demonstration()}
    still, jump, jerk, late, chatter = (demonstration() for _ in range(5))
    still[20:50] = still[20] + np.linspace(0, 1e-3, 30)[:, None]
    still[50:] += still[49] - still[50]
    jump[33, 0] += 25
    jerk[30:36:2, 2] += 3
    late[:, 0] += 20 * np.sin(np.arange(150) / 20)
    chatter[30:50, 5] = 45 + 10 * (np.arange(20) % 4 < 2)
    episodes |= {"no_hesitation": still, "no_jump": jump, "no_jerk": jerk, "end_pose": late}
    episodes |= {"no_chatter": chatter}
    folder = write_data_set(tmp_path / "set", [*episodes.values()], names=JOINTS)
    assert main(["monitor", str(QUALITY), "--end=complete", "--json", "--", str(folder)]) == 1
    rows = json.loads(capsys.readouterr().out)["trials"]
    violated = [
        {name for name, outcome in row["outcomes"].items() if outcome["verdict"] == "VIOLATED"}
        for row in rows
    ]
    jumps = {"no_jump", "no_jerk"}  # a jump for one frame turns round
    expected = [{name} if name else set() for name in episodes]
    assert violated == [jumps if names == {"no_jump"} else names for names in expected]


@given(st.text(min_size=1).filter(lambda text: "\0" not in text))
def test_part_names_round_trip(value: str) -> None:
    file = str(Path(__file__))
    part = part_of(part_name(file, "demo", value))
    assert part is not None
    assert (part.file, part.key, part.value) == (file, "demo", value)


def test_files_with_brackets_are_files(tmp_path: Path) -> None:
    path = tmp_path / "a.csv[x=1]"
    (tmp_path / "a.csv").touch()
    assert part_of(str(path)) == (str(tmp_path / "a.csv"), {"x": "1"})
    path.touch()
    assert part_of(str(path)) is None
    assert part_of(str(tmp_path / "b.csv[x=1]")) is None
