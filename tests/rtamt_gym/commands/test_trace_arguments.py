"""The arguments of `rtamt monitor` and `rtamt explain`: their meaning, and errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from catalogue import entries

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
ERRORS = entries(Path(__file__).with_name("trace_arguments.txt"))
OTHERS = (
    *("req.stl a.csv --signal gap", "req.stl a.csv --end never"),
    "req.stl a.csv --dense --period 1",
)
"""Words with an error that names the command."""
TEXT = "const float limit = 30\nnear = always(gap > 2)\nslow = always(speed < limit)\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with requirements, traces, and a folder without traces."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "req.stl").write_text(TEXT)
    for name in ("a.csv", "b.csv", "c.csv"):
        (tmp_path / name).write_text("time,gap,speed\n0,5,20\n0.1,5,25\n0.25,5,20\n")
    (tmp_path / "even.csv").write_text("time,gap,speed\n0,5,20\n0.1,5,25\n0.2,5,20\n")
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / "notes.md").write_text("")
    return tmp_path


@pytest.mark.parametrize("command", ["monitor", "explain"])
@pytest.mark.parametrize(("words", "message"), [*ERRORS, *((words, None) for words in OTHERS)])
def test_wrong_arguments_are_refused_at_once(
    command: str, words: str, message: str | None, capsys: Output
) -> None:
    assert main([command, *words.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    if message is not None:
        assert line == f"rtamt: error: {message}"


def test_a_folder_without_traces_is_refused(capsys: Output) -> None:
    assert main(["monitor", "req.stl", "--", "none"]) == 2
    out, err = capsys.readouterr()
    assert (out, err[:47]) == ("", "rtamt: error: none: expected files that end in ")
    assert err.endswith(", found none\n")


@pytest.mark.parametrize(("option", "name"), [("--out", "r.csv"), ("--plot", "r.png")])
def test_the_files_of_one_trace_are_not_written_of_several(
    option: str, name: str, capsys: Output
) -> None:
    assert main(["monitor", "req.stl", option, name, "--", "a.csv", "even.csv"]) == 2
    assert capsys.readouterr() == ("", f"rtamt: error: expected one trace for {option}, got 2\n")
    assert not Path(name).exists()


@pytest.mark.parametrize("option", ["--junit", "--markdown"])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_judged(
    option: str, capsys: Output
) -> None:
    assert main(["monitor", "req.stl", "even.csv", option, "no/out"]) == 2
    assert capsys.readouterr() == (
        "",
        "rtamt: error: cannot write no/out: the folder no does not exist\n",
    )
    assert main(["monitor", "req.stl", "even.csv", option, ""]) == 2
    assert capsys.readouterr() == ("", "rtamt: error: cannot write .: it is a folder\n")


@pytest.mark.parametrize("option", ["--out", "--junit", "--markdown", "--plot"])
@pytest.mark.parametrize("name", ["a.csv", "../{}/a.csv", "p.stl"])
def test_what_is_read_is_not_written(option: str, name: str, folder: Path, capsys: Output) -> None:
    (folder / "p.stl").write_text("always(x > 0)")
    before = (folder / "a.csv").read_bytes()
    path = name.format(folder.name)
    assert main(["monitor", "p.stl", "a.csv", option, path]) == 2
    assert capsys.readouterr() == (
        "",
        f"rtamt: error: cannot write {path}: it is an input of the command\n",
    )
    assert (folder / "a.csv").read_bytes() == before


def test_a_file_is_written_by_one_option(capsys: Output) -> None:
    files = ["--junit", "same", "--markdown", "./same"]
    assert main(["monitor", "always(x > 0)", "a.csv", *files]) == 2
    assert capsys.readouterr() == ("", "rtamt: error: cannot write same: two options write it\n")


def test_only_judges_the_requirements_that_it_names(capsys: Output) -> None:
    assert main(["monitor", "req.stl", "even.csv", "--constant", "limit=10"]) == 1
    assert main(["monitor", "req.stl", "even.csv", "--constant", "limit=10", "--only", "near"]) == 0
    capsys.readouterr()
    words = ["req.stl", "always(gap > 4)", "even.csv", "--only", "spec3", "--only", "near"]
    assert main(["monitor", *words]) == 0
    assert capsys.readouterr().out.startswith("near: SATISFIED, robustness 3")


def test_a_column_that_is_missing_or_bad_is_an_error_of_those_that_read_it(
    folder: Path, capsys: Output
) -> None:
    (folder / "gap.csv").write_text("time,gap\n0,5\n1,5\n")
    (folder / "bad.csv").write_text("time,gap,speed\n0,1,5\n1,5,fast\n")
    for trace, report, message in (
        (
            "gap.csv",
            "SATISFIED, robustness 3, at the end of the trace\n",
            (
                "gap.csv: no column 'speed', which the specification reads; "
                "the columns are time, gap; give --signal speed=COLUMN"
            ),
        ),
        (
            "bad.csv",
            "VIOLATED, robustness -1, certain from 0 s on\n",
            "bad.csv, line 3, column 'speed': expected a number, got 'fast'",
        ),
    ):
        assert main(["monitor", "req.stl", trace]) == 2
        out, err = capsys.readouterr()
        assert out.startswith(report)
        assert err == f"rtamt: error: {message}\n"
        assert main(["explain", "req.stl", trace]) == 2
        out, err = capsys.readouterr()
        assert ("near:" in out, "slow:" in out) == (True, False)
        assert err == f"rtamt: error: {message}\n"
    assert main(["monitor", "req.stl", "gap.csv", "--only", "near"]) == 0
    assert main(["monitor", "req.stl", "bad.csv", "--only", "near"]) == 1
    (folder / "none.csv").write_text("time,x\n0,5\n1,5\n")
    capsys.readouterr()
    assert main(["monitor", "req.stl", "none.csv"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("rtamt: error: none.csv: no column 'gap', which the specification reads")
    assert len(err.splitlines()) == 1


def test_each_text_gets_the_constants_that_it_names(folder: Path) -> None:
    (folder / "other.stl").write_text("const float least = 3\nfar = always(gap > least)\n")
    words = ["req.stl", "other.stl", "even.csv", "--constant"]
    assert main(["monitor", *words, "limit=40"]) == 0
    assert main(["monitor", *words, "least=5"]) == 1
    assert main(["monitor", *words, "least=4", "--constant", "limit=25.1"]) == 0
    assert main(["monitor", *words, "least=4", "--constant", "limit=25"]) == 1


def test_a_constant_may_be_a_bound(folder: Path) -> None:
    (folder / "bound.stl").write_text("const float T = 0.1\nsoon = eventually[0:T](speed > 22)\n")
    assert main(["monitor", "bound.stl", "even.csv"]) == 0
    assert main(["monitor", "bound.stl", "even.csv", "--constant", "T=0"]) == 1
    assert main(["monitor", "bound.stl", "even.csv", "--constant", "T=0.15"]) == 2
    words = ["even.csv", "--constant", "T=0.15", "--align", "inward"]
    assert main(["monitor", "bound.stl", *words]) == 0
    assert main(["explain", "bound.stl", *words]) == 0


def test_a_period_is_read_once_and_for_all_traces(capsys: Output) -> None:
    assert main(["monitor", "req.stl", "--period", "0", "--", "a.csv", "b.csv"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("rtamt: error: expected a period from 1e-300 to 1e300 s, or text ")
    assert main(["monitor", "req.stl", "--period", "100ms", "--", "a.csv", "b.csv"]) == 0


def test_two_requirements_of_one_name_are_told_apart_by_names(folder: Path, capsys: Output) -> None:
    (folder / "other.stl").write_text("near = always(gap > 4)\n")
    assert main(["monitor", "req.stl", "other.stl", "even.csv"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: expected one specification 'near', got two; rename one\n"
    )
    assert main(["monitor", "req.stl", "more=other.stl", "even.csv"]) == 0
    assert capsys.readouterr().out.splitlines()[4].startswith("more: SATISFIED, robustness 1, ")
    assert main(["monitor", "all=req.stl", "other.stl", "even.csv", "--only", "all.slow"]) == 0


def test_specifications_may_stand_in_folders_and_patterns_too(folder: Path, capsys: Output) -> None:
    (folder / "texts").mkdir()
    (folder / "texts" / "a.stl").write_text(TEXT)
    (folder / "texts" / "b.stl").write_text("far = always(gap > 1)\n")
    (folder / "texts" / "notes.md").write_text("")
    said = []
    for specs in (["texts/a.stl", "texts/b.stl"], ["texts"], ["texts/*.stl"]):
        assert main(["monitor", *specs, "even.csv"]) == 0
        said.append(capsys.readouterr().out)
    assert len(set(said)) == 1
    assert main(["monitor", "none", "even.csv"]) == 2
    assert main(["monitor", "no*.stl", "even.csv"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: none: expected files that end in .stl, found none\n"
        "rtamt: error: no file has a name like no*.stl\n"
    )


def test_a_table_says_that_bounds_count_samples(folder: Path, capsys: Output) -> None:
    for name in ("x.csv", "y.csv"):
        (folder / name).write_text("gap\n5\n6\n5\n")
    note = "note on x.csv and 1 more: there is no column of times, so bounds count samples"
    assert main(["monitor", "always[0:2](gap > 4)", "--", "x.csv", "y.csv"]) == 0
    assert note in " ".join(capsys.readouterr().out.split())
    for words in (["always[0:2](gap > 4)", "--period", "1"], ["always(gap > 4)"]):
        assert main(["monitor", *words, "--", "x.csv", "y.csv"]) == 0
        assert "note on" not in capsys.readouterr().out


GOAL = "task = eventually always[0:1](up > 0.1)"
STAGES = ["--stage", "near > 0", "--stage", "up > 0.1"]


@pytest.fixture
def trace(tmp_path: Path) -> str:
    path = tmp_path / "run.csv"
    rows = ["near,up", "-4,0", "1,-0.1", "1,0.05", "1,0"]
    path.write_text("\n".join(rows), encoding="utf-8")
    return str(path)


def says(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    main(["monitor", *arguments])
    return capsys.readouterr().out


def test_the_progress_in_named_stages_is_said(
    trace: str, capsys: pytest.CaptureFixture[str]
) -> None:
    goal = GOAL.replace("always[0:1](up > 0.1)", "always[0:1](up > 0.1 and near > 0)")
    out = says([goal, trace, *STAGES], capsys)
    assert "VIOLATED, robustness -0.1, at the end of the trace, progress 0.87" in out
    assert "progress 0" not in says([goal, trace], capsys)
    data = json.loads(says([goal, trace, *STAGES, "--json"], capsys))
    assert data["trials"][0]["outcomes"]["task"]["progress"] == pytest.approx(0.875)
    assert data["reading"]["stages"] == {"task": ["near > 0", "up > 0.1"]}


def test_stages_are_of_the_requirement_that_they_name(
    trace: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "task = eventually(near > 0 and up > 1); calm = always(up < 9)"
    stages = ["--stage", "task: near > 0", "--stage", "task: up > 1"]
    data = json.loads(says([text, trace, *stages, "--json"], capsys))
    outcomes = data["trials"][0]["outcomes"]
    assert 0.5 < outcomes["task"]["progress"] < 1
    assert "progress" not in outcomes["calm"]


@pytest.mark.parametrize(
    ("spec", "stages", "said"),
    [
        (GOAL, ["up > 0"], "expected two or more --stage, got 1"),
        (
            GOAL,
            ["up > 0", "near > 0"],
            "in the stages of 'task': stage 2, near > 0, reads near, which the",
        ),
        (GOAL, ["up > 0", "up >"], "in stage 2: in the stages of 'task': "),
        (
            f"{GOAL}; calm = always(up < 9)",
            ["up > 0", "up > 1"],
            "as in 'task: up > 0', for there are several: 'task', 'calm'",
        ),
        (
            f"{GOAL}; calm = always(up < 9)",
            ["tsk: up > 0", "tsk: up > 1"],
            "a requirement, 'task', 'calm', got 'tsk'; did you mean 'task'?",
        ),
    ],
)
def test_bad_stages_exit_with_2(
    spec: str, stages: list[str], said: str, trace: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [word for stage in stages for word in ("--stage", stage)]
    assert main(["monitor", spec, trace, *options]) == 2
    assert said in " ".join(capsys.readouterr().err.split())


def test_instants_and_intervals_are_refused_where_they_mean_nothing(
    tmp_path: Path, trace: str, capsys: pytest.CaptureFixture[str]
) -> None:
    stages = ["--stage", "up > 0", "--stage", "always[0:2](up > 0.1)"]
    assert main(["monitor", "up > 0", trace, "--view", "step", *stages]) == 2
    assert "--view step evaluates every instant by itself" in capsys.readouterr().err
    events = tmp_path / "events.csv"
    events.write_text("time,up\n0,-1\n0.5,1\n3,1\n", encoding="utf-8")
    goal = "eventually always[0:1](up > 0.1)"
    assert main(["monitor", goal, str(events), "--dense", *stages]) == 2
    assert "in dense time a stage is reached at an event" in " ".join(
        capsys.readouterr().err.split()
    )
    plain = ["--stage", "up > 0", "--stage", "up > 4"]
    assert main(["monitor", "eventually always[0:1](up > 4)", str(events), "--dense", *plain]) == 1
    assert "progress 0.50" in capsys.readouterr().out


SLOW = "always(speed < 30)"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a.csv", SLOW], f"expected a specification first, got the trace a.csv; write '{SLOW}' "),
        (["log", SLOW], f"expected a specification first, got the trace log; write '{SLOW}' log"),
        (["-", SLOW], f"expected a specification first, got the trace -; write '{SLOW}' -"),
    ],
)
def test_a_trace_before_a_formula_is_an_error(
    words: list[str], message: str, folder: Path, capsys: Output
) -> None:
    (folder / "log").write_text("time,speed\n0,1\n")
    assert main(["monitor", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("spec", [SLOW, "req.stl"])
@pytest.mark.parametrize("stream", ["a.csv", "log", "-", "tcp:9000", "new.ndjson"])
def test_a_stream_before_its_specification_is_an_error(
    stream: str, spec: str, folder: Path, capsys: Output
) -> None:
    (folder / "log").write_text("time,speed\n0,1\n")
    written = f"'{spec}'" if spec == SLOW else spec
    assert main(["watch", stream, spec]) == 2
    swapped = f"expected a specification first, got the stream {stream}; write rtamt watch "
    assert f"{swapped}{written} {stream}" in capsys.readouterr().err


def test_a_stream_needs_one_specification(capsys: Output) -> None:
    assert main(["watch", "a.csv"]) == 2
    assert "got the stream a.csv; write rtamt watch SPEC a.csv" in capsys.readouterr().err
    for second in (SLOW, "req.stl"):
        assert main(["watch", "req.stl", second]) == 2
        errors = capsys.readouterr().err
        assert (
            f"expected a stream after the specification, got the specification {second}" in errors
        )
