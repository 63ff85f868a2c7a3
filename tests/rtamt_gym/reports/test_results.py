"""Files of results become sections and pages; other files are errors that list the kinds."""

import hashlib
import json
import shlex
from pathlib import Path

import pandas as pd
import pytest
from made_results import SPACE, evaluation, figures, row, searched, swept, tank, wave

import rtamt_gym
from rtamt import InputError, InputTypeError
from rtamt_gym import compare, compare_methods, write_report
from rtamt_gym.__main__ import main
from rtamt_gym.play.summaries import record_json
from rtamt_gym.reports.html import render
from rtamt_gym.reports.model import Cell, Table, Text
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.write import report_of, section_of
from rtamt_gym.results import Evaluation

KINDS = (
    "holds no result: expected a file that rtamt run --json, rtamt monitor --json, rtamt sweep "
    "--json, rtamt falsify --json, rtamt falsify --save and Falsification.save, rtamt evaluate "
    "--save and Evaluation.save, rtamt compare --save and Comparison.save, rtamt compare --save of "
    "recordings, MethodComparison.save, rtamt mine --json write, or the Parquet file or the folder "
    "of a sweep, a campaign or a run"
)


def evaluated(shift: float = 0.0) -> Evaluation:
    """Return an evaluation of ten episodes, one of which is kept."""
    rows = [row({"low": i - 4.0 + shift, "seen": 1.0}, seed=7 + i) for i in range(10)]
    return evaluation(rows, {"low": (wave(30),)})


def test_evaluation_file(tmp_path: Path) -> None:
    made = evaluated()
    made.save(tmp_path / "e.json")
    assert section_of(tmp_path / "e.json", ROOM) == section_of(made, ROOM)


def test_comparison_file(tmp_path: Path) -> None:
    made = compare(evaluated(), evaluated(3.0))
    made.save(tmp_path / "c.json")
    section = section_of(str(tmp_path / "c.json"), ROOM)
    assert section == section_of(made, ROOM)
    low, *_ = section.requirements
    pairs, _ = low.figures
    assert isinstance(pairs, Table)
    counts = [[cell.text for cell in row.cells[1:] if isinstance(cell, Cell)] for row in pairs.rows]
    assert counts == [["6", "0"], ["3", "1"]]
    assert low.rate == pytest.approx(0.3)
    assert low.legend == "A 60 %, B 90 %"
    assert low.words == "x0 stays below 5 at all times"
    _, rates = low.blocks
    assert isinstance(rates, Table)
    assert rates.rows[-1].cells == ("mean robustness, B less A", Cell("+3", "n"), "3 to 3")
    assert (-4.0, -1.0) in figures(section, "pairs")[0].data["pairs"]
    assert section.blocks[0] == Text(made.sentence, "sentence")


def test_methods_file(tmp_path: Path) -> None:
    curves = {
        "plain": [[0.0, 0.25], [0.25, 0.0], [0.0, 0.0]],
        "shaped": [[0.5, 1.0], [0.25, 0.75], [0.0, 0.125]],
    }
    made = compare_methods(curves, steps=[100, 200], resamples=200)
    made.save(tmp_path / "m.json")
    section = section_of(tmp_path / "m.json", ROOM)
    assert section == section_of(made, ROOM)
    assert section.lead == section.blocks[0] == Text(made.sentence, "sentence")
    table = section.blocks[1]
    assert isinstance(table, Table)
    texts = [[c if isinstance(c, str) else c.text for c in row.cells] for row in table.rows]
    plain, shaped = texts
    assert (plain[1], plain[-2:]) == ("3", ["", ""])
    assert shaped[6:9] == ["0.125", "0.4375, 0.75, 0.875", "1"]
    assert shaped[9].startswith("0.8889 (")
    learning, _ = figures(section, "curves")
    assert [curve["name"] for curve in learning.data["curves"]] == ["plain", "shaped"]
    curve = learning.data["curves"][1]
    assert curve["values"] == [0.25, 0.625]
    band = zip(curve["low"], curve["values"], curve["high"], strict=True)
    assert all(low <= value <= high for low, value, high in band)
    page = render(report_of(made))
    assert "shaped" in page
    assert page.count('data-chart="methods-curves') == 2  # learning, and profiles
    of_tasks = {name: {"reach": runs, "push": runs} for name, runs in curves.items()}
    several = section_of(compare_methods(of_tasks, steps=[100, 200], resamples=200), ROOM)
    assert ("tasks", "reach, push") in several.facts
    assert "tasks" not in dict(section.facts)
    without = section_of(compare_methods({"plain": [0.0, 0.5], "shaped": [1.0, 0.5]}), ROOM)
    assert [each.title for each in figures(without, "curves")] == ["Performance profile"]


def test_sweep_files(tmp_path: Path) -> None:
    done = swept()
    done.save(tmp_path / "s.parquet")
    done.record.save(tmp_path / "r.parquet")
    (tmp_path / "s.json").write_text(
        record_json(done.record, {"sampler": "grid"}), encoding="utf-8"
    )
    made = section_of(done, ROOM)
    for name in ("s.parquet", "r.parquet", "s.json"):
        read = section_of(tmp_path / name, ROOM)
        assert read.cases == made.cases
        assert [each.trials for each in read.requirements] == [
            each.trials for each in made.requirements
        ]
        cells = [[each.data["cells"] for each in figures(one, "map")] for one in (read, made)]
        assert cells[0] == cells[1]


def test_campaign_folder(tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    specs = {"dry": "always(level < 2)"}
    rtamt_gym.sweep(
        tank, specs, SPACE, samples=3, sampler="grid", period=1, folder=folder, progress=False
    )
    section = section_of(folder, ROOM)
    assert len(section.requirements[0].trials) == 9


def test_falsify_output(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["falsify", "rtamt/ChasingCars-v0", "CC1", "--budget", "20", "--json"]) == 1
    printed = capsys.readouterr().out
    (tmp_path / "f.json").write_text(printed, encoding="utf-8")
    section = section_of(tmp_path / "f.json", ROOM)
    kept = json.loads(printed)
    (course,) = figures(section, "convergence")
    assert len(course.data["simulations"]) == kept["simulations"]
    assert section.requirements[0].trials[0].verdict == "violated"
    assert section.requirements[0].words == "y5 - y4 stays at most 40 during the first 100 s"


def test_page_from_objects_and_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = evaluated()
    made.save(tmp_path / "e.json")
    write_report(tmp_path / "a.html", made, searched(), title="All & more")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<h1>All &amp; more</h1>" in page
    assert "x0 stays below 5 at all times" in page
    out = tmp_path / "b.html"
    assert main(["report", str(tmp_path / "e.json"), "-o", str(out)]) == 0
    assert capsys.readouterr().out == f"report: {out}\n"
    assert "<h1>random on Waves-v0</h1>" in out.read_text(encoding="utf-8")
    assert report_of(made, made).title == "2 results"


def test_equal_titles(tmp_path: Path) -> None:
    made = evaluated()
    for folder in ("", "old", "new"):
        (tmp_path / folder).mkdir(exist_ok=True)
        made.save(tmp_path / folder / "e.json")
    made.save(tmp_path / "f.json")
    old, new, other = (tmp_path / each for each in ("old/e.json", "new/e.json", "f.json"))

    def titles(*results: Path | Evaluation, names: list[str] | None = None) -> list[str]:
        return [each.title for each in report_of(*results, names=names).sections]

    title = "random on Waves-v0"
    assert titles(old) == [title]
    assert titles(old, other) == [f"{title} (e.json)", f"{title} (f.json)"]
    assert titles(old, new) == [f"{title} ({old})", f"{title} ({new})"]
    assert titles(made, other) == [f"{title} (result 1)", f"{title} (f.json)"]
    assert titles(old, old) == [f"{title} (result 1)", f"{title} (result 2)"]
    assert titles(old, new, names=["old", "new"]) == [f"old: {title}", f"new: {title}"]


@pytest.mark.parametrize("names", ["ab", ["a"], ["a", "a"], ["a", ""], ["a", 3], 7])
def test_names_error(names: object) -> None:
    made = evaluated()
    with pytest.raises(InputError, match=r"^names=: expected"):
        report_of(made, made, names=names)  # type: ignore[arg-type]


def test_page_has_file_hash(tmp_path: Path) -> None:
    made = evaluated()
    made.save(tmp_path / "e.json")
    sha = hashlib.sha256((tmp_path / "e.json").read_bytes()).hexdigest()
    section = report_of(tmp_path / "e.json").sections[0]
    assert section.source == (str(tmp_path / "e.json"), sha)
    assert report_of(made).sections[0].source is None
    write_report(tmp_path / "e.html", tmp_path / "e.json")
    page = (tmp_path / "e.html").read_text(encoding="utf-8")
    assert f'<abbr title="SHA-256: {sha}">{sha[:12]}</abbr>' in page


def test_page_is_reproducible(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = evaluated()
    pages = []
    berlin = pd.Timestamp("2026-01-02 04:05:06+01:00").to_pydatetime()
    for date in (berlin, None):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", str(int(berlin.timestamp())) if not date else "0")
        write_report(tmp_path / "e.html", made, date=date)
        pages.append((tmp_path / "e.html").read_bytes())
    assert pages[0] == pages[1]
    assert b"Made on 2026-01-02 03:05 UTC with rtamt" in pages[0]
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    assert report_of(made).made_on.endswith(" UTC")


@pytest.mark.parametrize("epoch", ["", "today", "1.5", "9" * 30])
def test_date_error(epoch: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", epoch)
    with pytest.raises(InputError, match=r"^expected SOURCE_DATE_EPOCH as seconds since 1970, got"):
        report_of(evaluated())


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("time,x\n0,1\n", ", got no JSON: Extra data: line 1 column 5 (char 4)"),
        ('{"format": "rtamt dream 7"}', ""),
        ("[1, 2]", ""),
    ],
)
def test_file_without_result_error(
    tmp_path: Path, text: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "some.json"
    path.write_text(text.replace("time", "0"), encoding="utf-8")
    why = why.replace("column 5 (char 4)", "column 2 (char 1)")
    assert main(["report", str(path), "-o", str(tmp_path / "page.html")]) == 2
    assert capsys.readouterr().err == f"rtamt: error: {path} {KINDS}{why}\n"
    assert not (tmp_path / "page.html").exists()


def test_wrong_parquet_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "some.parquet"
    path.write_text("nothing", encoding="utf-8")
    assert main(["report", str(path), "-o", str(tmp_path / "page.html")]) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: cannot read {path}: it is not a Parquet file\n"
    )


def test_damaged_result_error(tmp_path: Path) -> None:
    path = tmp_path / "o.json"
    path.write_text(
        '{"format": "rtamt result", "version": 2, "kind": "traces", "trials": []}', encoding="utf-8"
    )
    with pytest.raises(InputError) as caught:
        section_of(path, ROOM)
    assert str(caught.value) == (
        f"cannot read {path}: it is not a result of kind 'traces' from rtamt monitor --json: "
        "KeyError: 'requirements'"
    )


def test_wrong_result_error(tmp_path: Path) -> None:
    with pytest.raises(InputTypeError) as caught:
        write_report(tmp_path / "a.html", 3)  # type: ignore[arg-type]
    assert str(caught.value) == (
        "expected a result (Evaluation, Comparison, RecordingsComparison, MethodComparison, Sweep, "
        "Record, Falsification, SavedCase) or the path of its file, got int"
    )
    for name, message in (
        ("a.pdf", f"cannot write {tmp_path / 'a.pdf'}: expected a name that ends in .html"),
        ("a.html", "expected at least one result, such as an Evaluation or its file, got none"),
    ):
        with pytest.raises(InputError) as refused:
            write_report(tmp_path / name)
        assert str(refused.value) == message
    with pytest.raises(FileNotFoundError):
        write_report(tmp_path / "a.html", tmp_path / "no.json")


@pytest.mark.parametrize("name", ["drive.mcap", "runs/a.csv", "my drive.bag", "bag"])
def test_trace_as_result_error(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bag").mkdir()
    Path("bag/metadata.yaml").touch()
    assert main(["report", name, "-o", "page.html"]) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: expected a result, got the trace {name}; evaluate it first: rtamt monitor "
        f"--json SPEC {shlex.quote(name)} > outcomes.json\n"
    )
    assert not Path("page.html").exists()
