"""Groups of a stream are checked and end as in `rtamt monitor --by` on the same rows."""

import json
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from played import play
from profiles import examples

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.watching.watch import WatchOptions

Output = pytest.CaptureFixture[str]
SPEC = "always(x > 0 implies eventually[0:2](x < 2))"
FINAL = ("verdict", "robustness", "lower", "upper")


def monitored(text: str, *arguments: str) -> tuple[int, dict[str, list[Any]]]:
    """Return the exit code of `rtamt monitor --by car`, and the outcomes of good groups."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rows.csv"
        path.write_text(text)
        output = StringIO()
        with redirect_stdout(output), redirect_stderr(StringIO()):
            code = main(["monitor", SPEC, str(path), "--by", "car", "--json", *arguments])
    groups = {}
    for trial in json.loads(output.getvalue())["trials"]:
        for outcome in trial["outcomes"].values():
            if outcome["verdict"] != "ERROR":
                name = trial["name"].rpartition("[car=")[2].removesuffix("]")
                groups[name] = [outcome[field] for field in FINAL]
    return code, groups


def streamed(text: str, places: Sequence[int], **options: Any) -> tuple[int, dict[str, list[Any]]]:  # noqa: ANN401
    """The exit code of a stream in pieces, and the final lines of its groups."""
    reading = EvaluationOptions(
        dense=options.pop("dense", False), period=options.pop("period", None)
    )
    specs = {"spec": rtamt.parse(SPEC)}
    stream = play(WatchOptions(specs, reading, Columns(), by=("car",), **options), text, places)
    finals = [json.loads(line.to_json()) for line in stream.finals]
    return stream.code, {line["group"]: [line[field] for field in FINAL] for line in finals}


@st.composite
def fleets(draw: st.DrawFn, *, timed: bool) -> str:
    """Rows of up to three cars, in any order of cars, with columns that may mark episodes."""
    rows: list[list[Any]] = []
    columns = draw(
        st.lists(st.sampled_from(("terminated", "is_first", "step", "run")), unique=True)
    )
    for car in range(draw(st.integers(1, 3))):
        count = draw(st.integers(3, 7))
        special = draw(st.one_of(st.none(), st.integers(0, count - 1)))
        for i in range(count):
            flags = {
                "terminated": int(i == (count - 1 if special is None else special)),
                "is_first": int(i in (0, special)),
                "step": i if special is None or i < special else i - special,
                "run": 0 if special is None or i < special else 1,
            }
            x = draw(st.sampled_from((-1.0, 1.0, 3.0)))
            rows.append([i, f"c{car}", x, *(flags[name] for name in columns)])
    order = draw(st.permutations(range(len(rows))))
    placed = sorted(range(len(rows)), key=lambda i: (rows[i][0], order[i]))
    names = ["time", "car", "x", *columns] if timed else ["car", "x", *columns]
    cells = [rows[i] if timed else rows[i][1:] for i in placed]
    return "".join(",".join(map(str, row)) + "\n" for row in [names, *cells])


cuts = st.lists(st.integers(0, 400), max_size=6)


@settings(max_examples=examples(60))
@given(fleets(timed=True), st.booleans(), cuts)
def test_groups_end_as_in_monitor(text: str, dense: bool, places: list[int]) -> None:  # noqa: FBT001
    code, groups = monitored(text, *["--dense"] * dense)
    own_code, finals = streamed(text, places, dense=dense)
    assert own_code == code
    if code != 2:
        assert finals == groups


@settings(max_examples=examples(40))
@given(fleets(timed=False), cuts)
def test_groups_without_times_end_as_in_monitor(text: str, places: list[int]) -> None:
    code, groups = monitored(text, "--period", "1")
    own_code, finals = streamed(text, places, period="1")
    assert own_code == code
    if code != 2:
        assert finals == groups


def watched(capsys: Output, path: Path, text: str, *arguments: str) -> tuple[int, list[Any], str]:
    """Return the exit code, final lines and messages of the command."""
    path.write_text(text)
    code = main(["watch", "always(x < 3)", str(path), "--by", "car", *arguments])
    captured = capsys.readouterr()
    lines = [json.loads(line) for line in captured.out.splitlines()]
    return code, [line for line in lines if line["final"]], captured.err


def test_the_group_of_another_episode_is_named(capsys: Output, tmp_path: Path) -> None:
    text = "time,car,x,terminated\n0,a,1,0\n0,b,9,0\n1,a,1,1\n2,a,1,0\n1,b,1,0\n"
    path = tmp_path / "rows.csv"
    code, finals, errors = watched(capsys, path, text)
    assert code == 2
    assert "line 5: group 'a': expected one trace, but 'terminated' shows" in errors
    assert [(line["group"], line["verdict"], line["end"]) for line in finals] == [
        ("a", "UNDECIDED", "open"),
        ("b", "VIOLATED", "open"),
    ]
    assert watched(capsys, path, text, "--one-trace")[0] == 1
    assert watched(capsys, path, text, "--skip-bad")[0] == 2


def test_a_group_may_come_back_after_its_end(capsys: Output, tmp_path: Path) -> None:
    """A group that ended by its idle time is not checked any more: its rows are bad lines."""
    rows = ["0,a,1,0", "1,a,1,1", *(f"{i},b,1,0" for i in range(9)), "9,a,1,0"]
    text = "\n".join(["time,car,x,terminated", *rows, ""])
    arguments = ["--group-idle", "2s", "--skip-bad"]
    code, finals, errors = watched(capsys, tmp_path / "rows.csv", text, *arguments)
    assert code in (0, 3)
    assert "group 'a' has already ended by --group-idle" in errors
    assert [line["group"] for line in finals] == ["a", "b"]


@pytest.mark.parametrize("kind", [[], ["--dense"]])
@pytest.mark.parametrize("cell", ["oops", ""])
def test_a_group_may_not_start_with_a_bad_line(
    cell: str, kind: list[str], capsys: Output, tmp_path: Path
) -> None:
    """Its first sample, to which the verdict belongs, may violate the requirement."""
    if kind and not cell:
        cell = "1.2.3"
    text = f"time,car,x\n0,a,1\n1,a,1\n1,b,{cell}\n2,b,1\n2,a,1\n3,b,1\n"
    path = tmp_path / "rows.csv"
    code, finals, errors = watched(capsys, path, text, "--skip-bad", *kind)
    assert code == 2
    assert "line 5: group 'b' starts with a bad line, " in errors
    assert "line 4: " in errors
    assert [line["group"] for line in finals] == ["a"]
    gone = text.replace("2,b,1\n", "").replace("3,b,1\n", "")
    code, finals, errors = watched(capsys, path, gone, "--skip-bad", *kind)
    assert code == 2
    assert "group 'b' has bad lines only, the first: " in errors
    assert [line["group"] for line in finals] == ["a"]


def test_a_line_without_a_group_may_be_the_first_of_later_groups(
    capsys: Output, tmp_path: Path
) -> None:
    text = "time,car,x\n0,a,1\n1,a,1\n1,b\n2,a,1\n2,b,1\n3,b,1\n3,c,1\n4,c,1\n"
    path = tmp_path / "rows.csv"
    code, finals, errors = watched(capsys, path, text, "--skip-bad")
    assert code == 3
    assert len(finals) == 3
    note = "2 groups start after a bad line that may have been their first row, the first: 'b'"
    assert note in errors
    code, _, errors = watched(capsys, path, text.replace("1,b\n", ""), "--skip-bad")
    assert code == 0
    assert "may have been" not in errors


@pytest.mark.parametrize("kind", [[], ["--dense"], ["--period", "1"]])
@pytest.mark.parametrize("names", [["lap", "car"], ["car", "lap"], ["car", "lap", "car"]])
@pytest.mark.parametrize("form", ["csv", "ndjson"])
def test_several_columns_name_groups_as_in_monitor(
    form: str, names: list[str], kind: list[str], capsys: Output, tmp_path: Path
) -> None:
    cells = [(time, car, lap) for lap in (1, 2) for time in range(3) for car in ("a", "b,=c")]
    rows = [
        {"time": time, "car": car, "lap": lap, "x": 9 if (time, car, lap) == (1, "a", 2) else 1}
        for time, car, lap in cells
    ]
    path = tmp_path / f"rows.{form}"
    if form == "csv":
        lines = ["time,car,lap,x", *(f'{t["time"]},"{t["car"]}",{t["lap"]},{t["x"]}' for t in rows)]
    else:
        lines = [*map(json.dumps, rows)]
    path.write_text("\n".join(lines) + "\n")
    options = [*(option for name in names for option in ("--by", name)), *kind]
    assert main(["monitor", "always(x < 3)", str(path), *options, "--json"]) == 1
    expected = {
        trial["name"].removeprefix(f"{path}[").removesuffix("]"): outcome["verdict"]
        for trial in json.loads(capsys.readouterr().out)["trials"]
        for outcome in trial["outcomes"].values()
    }
    assert main(["watch", "always(x < 3)", str(path), *options]) == 1
    finals = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {line["group"]: line["verdict"] for line in finals if line["final"]} == expected
    assert len(expected) == 4


def test_a_group_needs_all_its_columns(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text("time,car,lap,x\n0,a,1,1\n1,a,,1\n2,,1,1\n")
    options = ["--by", "car", "--by", "lap"]
    assert main(["watch", "always(x < 3)", str(path), *options]) == 2
    assert "line 3: column 'lap': expected a group, got none" in capsys.readouterr().err
    assert main(["watch", "always(x < 3)", str(path), "--by", "lab"]) == 2
    assert "no column 'lab', which --by names" in capsys.readouterr().err


@pytest.mark.parametrize("options", [[], ["--dense"]])
@pytest.mark.parametrize(("early", "code"), [(1, 3), (5, 1)])
def test_rows_after_an_idle_end_are_not_a_pass(
    early: int, code: int, options: list[str], capsys: Output, tmp_path: Path
) -> None:
    rows = [(i, "a", 1) for i in range(12)] + [(i, "b", early) for i in (0, 1)]
    rows += [(i, "b", 9) for i in (8, 9, 10)]
    text = "time,car,x\n" + "".join(f"{t},{car},{x}\n" for t, car, x in sorted(rows))
    path = tmp_path / "rows.csv"
    idle = ["--group-idle", "3", "--skip-bad", *options]
    got, _, errors = watched(capsys, path, text, *idle)
    assert got == code
    assert "group 'b' got 3 rows after --group-idle had ended it: these rows were left" in errors
    got, _, errors = watched(capsys, path, text, "--group-idle", "3", *options)
    assert (got, "group 'b' has already ended by --group-idle" in errors) == (2, True)
    text = "".join(line for line in text.splitlines(keepends=True) if not line.endswith("b,9\n"))
    got, _, errors = watched(capsys, path, text, *idle)
    assert (got, "--group-idle" in errors) == (code - 3 if code == 3 else 1, False)


@pytest.mark.parametrize("idle", [[], ["--group-idle", "5"]])
@pytest.mark.parametrize(
    ("stop", "value", "line", "decided"),
    [("decided", 1, 7, 2), ("violation", 9, 4, 1)],
)
def test_a_stop_reports_the_groups_on_which_it_rests(
    stop: str,
    value: int,
    line: int,
    decided: int,
    idle: list[str],
    capsys: Output,
    tmp_path: Path,
) -> None:
    path = tmp_path / "rows.csv"
    rows = [f"{time},{car},{value if time == 1 else 1}" for time in range(3) for car in "ab"]
    path.write_text("\n".join(["time,car,x", *rows, "3,c,9", "4,c,9"]) + "\n")
    arguments = ["watch", "always[0:2](x < 3)", str(path), "--stop", stop]
    code = 1 if stop == "violation" else 0
    assert main([*arguments, "--by", "car", *idle]) == code
    note = f"--stop {stop} ended the stream at line {line}, with {decided} of 2 groups decided: "
    assert f"{note}rows and groups after it were not read" in capsys.readouterr().err


def test_a_stop_reports_its_line(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text("time,x\n0,1\n1,9\n2,1\n")
    assert main(["watch", "always(x < 3)", str(path), "--stop", "violation"]) == 1
    note = "--stop violation ended the stream at line 3: rows after it were not read"
    assert note in capsys.readouterr().err
    assert main(["watch", "always(x < 3)", str(path), "--stop", "decided"]) == 1
    assert main(["watch", "always(x < 10)", str(path), "--stop", "decided"]) == 0
    assert "ended the stream" not in capsys.readouterr().err.splitlines()[-1]


def test_a_group_lasts_for_exactly_the_idle_time(capsys: Output, tmp_path: Path) -> None:
    """The difference of 0.7 and 0.4 as doubles is slightly more than 0.3."""
    path = tmp_path / "rows.csv"
    path.write_text("time,car,x\n0.1,a,1\n0.4,b,1\n0.4,a,1\n0.7,b,1\n0.7,a,1\n1.0,b,1\n1,a,1\n")
    arguments = ["watch", "always(x < 3)", str(path), "--by", "car", "--dense"]
    assert main([*arguments, "--group-idle", "300ms"]) == 0
    assert main([*arguments, "--group-idle", "299ms"]) == 2
    assert "has already ended by --group-idle" in capsys.readouterr().err
