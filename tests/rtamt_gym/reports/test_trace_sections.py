"""The section of recorded traces: every outcome, and the worst trace read again."""

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

from rtamt_gym.__main__ import main
from rtamt_gym.reports.html import render
from rtamt_gym.reports.model import Cell, Figure, Table
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.traces import of_matrix
from rtamt_gym.reports.write import report_of
from rtamt_gym.results.outcome import Moment

SPEC = "near = always(gap > 2); answered = always(req >= 3 implies eventually[0:1](gnt >= 3))"
TRACES = {
    "good.csv": "time,gap,req,gnt\n0,5,0,0\n0.5,4,0,0\n1,3,0,0\n",
    "near.csv": "time,gap,req,gnt\n0,5,4,0\n0.5,1,0,4\n1,3,0,0\n",
    "bad.csv": "time,gap\n0,5\n0.5,x\n",
}


def judged(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    *options: str,
) -> dict[str, Any]:
    """Return the JSON of ``rtamt monitor --json`` for the traces in a folder."""
    monkeypatch.chdir(folder)
    for name, text in TRACES.items():
        (folder / name).write_text(text, encoding="utf-8")
    main(["monitor", SPEC, "--json", *options, "--", *TRACES])
    outcomes: dict[str, Any] = json.loads(capsys.readouterr().out)
    return outcomes


def test_outcomes_and_worst_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    section = of_matrix(judged(tmp_path, monkeypatch, capsys), tmp_path, ROOM)
    (table,) = section.blocks
    assert isinstance(table, Table)
    assert [column.requirement for column in table.head] == ["", "", "near", "answered"]
    cells = [[cell for cell in row.cells if isinstance(cell, Cell)] for row in table.rows]
    words = {first.text: [cell.verdict for cell in others] for first, _, *others in cells}
    assert words == {
        "good.csv": ["satisfied", "satisfied"],
        "near.csv": ["violated", "satisfied"],
        "bad.csv": ["failed", "failed"],
    }
    near, answered = section.requirements
    assert near.words == "gap stays above 2 at all times"
    assert answered.words == "whenever req is at least 3, gnt reaches at least 3 within 1 s"
    assert [trial.label for trial in near.trials] == ["bad.csv", "near.csv", "good.csv"]
    assert near.trials[0].text
    (episode,) = near.worst
    assert episode.times == (0.0, 0.5, 1.0)
    assert episode.signals["gap"] == (5.0, 1.0, 3.0)
    assert episode.robustness == (3.0, -1.0, -1.0)
    assert episode.upper == (3.0, -1.0, -1.0)
    assert episode.lower == (-math.inf,) * 3
    assert episode.decided_at == near.trials[1].violated_at == Moment(1, 0.5)
    assert episode.deciding[0].values == {"gap": 1.0}


def test_occurrence_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    outcomes = judged(tmp_path, monkeypatch, capsys, "--occurrences")
    near, answered = of_matrix(outcomes, tmp_path, ROOM).requirements
    statistics, timeline = near.figures[-2:]
    assert isinstance(statistics, Table)
    texts = [cell.text for cell in statistics.rows[0].cells if isinstance(cell, Cell)]
    assert texts == ["", "1", "17 %", "1200", "", ""]  # 0.5 s of 3 s in two traces
    assert isinstance(timeline, Figure)
    assert timeline.data["bodies"][0]["runs"] == [[0.5, 1.0, "violated", "\N{MINUS SIGN}1"]]
    assert timeline.data["span"] == [0.0, 1.0]
    assert timeline.summary == (
        "near.csv: 1 violation, 0.5 s in all; the longest starts at 0.5 s and lasts 0.5 s."
    )
    (satisfied,) = [each for each in answered.figures if isinstance(each, Table)]
    texts = [cell.text for cell in satisfied.rows[0].cells if isinstance(cell, Cell)]
    assert texts == ["", "0", "0 %", "0", "1", "0.5 s"]


def test_column_options_are_reused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    outcomes = judged(
        tmp_path, monkeypatch, capsys, "--signal", "gap=req", "--time-unit", "ms", "--view", "step"
    )
    assert outcomes["reading"]["columns"] == {"signals": {"gap": "req"}, "time_unit": "ms"}
    near, _ = of_matrix(outcomes, tmp_path, ROOM).requirements
    assert near.words == "at all times, gap stays above 2 from then on"
    (episode,) = near.worst
    assert episode.label == near.trials[1].label
    assert episode.times == (0.0, 0.0005, 0.001)


def test_traces_below_allowed_folders(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    outcomes = judged(tmp_path, monkeypatch, capsys)
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    monkeypatch.chdir(elsewhere)
    for folder, traces in ((tmp_path, []), (elsewhere, [tmp_path]), (elsewhere, [tmp_path.parent])):
        shown = of_matrix(outcomes, folder, ROOM, traces=traces).requirements[0]
        assert bool(shown.worst) is (tmp_path.parent not in traces)
    for folder, below in (
        (elsewhere, f"{elsewhere}"),
        (elsewhere / "results", f"{elsewhere} or {elsewhere / 'results'}"),
    ):
        section = of_matrix(outcomes, folder, ROOM)
        near = section.requirements[0]
        assert near.worst == ()
        assert near.note.endswith(
            f"is not shown in full: no regular file of this name lies below {below}; rtamt report "
            "--traces DIR reads below another folder."
        )
        assert section.notes == ()


def test_changed_trace_is_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    outcomes = judged(tmp_path, monkeypatch, capsys)
    known = outcomes["files"]
    assert of_matrix(outcomes, tmp_path, ROOM).requirements[0].worst
    for trial in outcomes["trials"]:
        path = tmp_path / trial["name"]
        path.write_text(path.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    near = of_matrix(outcomes, tmp_path, ROOM).requirements[0]
    assert near.worst == ()
    sha = next(sha for name, sha in known.items() if f"`{name}`" in near.note)
    assert f"has changed since it was judged: its SHA-256 began with {sha[:12]}, now" in near.note
    del outcomes["files"]  # as an older version wrote it
    assert of_matrix(outcomes, tmp_path, ROOM).requirements[0].worst


def test_bounds_count_steps_without_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.csv").write_text("x\n1\n5\n", encoding="utf-8")
    main(["monitor", "always[0:1](x < 3)", "--json", "t.csv"])
    section = of_matrix(json.loads(capsys.readouterr().out), tmp_path, ROOM)
    assert section.unit == "steps"
    assert section.requirements[0].words == "x stays below 3 during the first 1 step"
    assert section.requirements[0].worst[0].decided_at == Moment(1, None)


@pytest.mark.parametrize(("end", "value"), [("cut", 2.0), ("open", 2.0), ("complete", 5.0)])
def test_end_mode_sets_deciding_values(
    end: str,
    value: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = ["0,0,0", "1,5,0", "2,0,2", "3,0,2", "4,0,0", "5,5,-10"]  # the last request is open
    Path("t.csv").write_text("\n".join(["time,req,gnt", *rows, ""]), encoding="utf-8")
    spec = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
    assert main(["monitor", spec, "--json", "t.csv", "--end", end]) == 1
    section = of_matrix(json.loads(capsys.readouterr().out), tmp_path, ROOM)
    (deciding,) = section.requirements[0].worst[0].deciding
    assert [*deciding.values.values()] == [value]


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(("samples", "drawn"), [(20_000, True), (20_001, False)])
def test_very_long_trace_has_no_bounds(
    samples: int,
    drawn: bool,  # noqa: FBT001
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = ["5"] * samples
    rows[700] = "1"
    (tmp_path / "t.csv").write_text("\n".join(["gap", *rows, ""]), encoding="utf-8")
    main(["monitor", "always(gap > 2)", "--json", "t.csv"])
    section = of_matrix(json.loads(capsys.readouterr().out), tmp_path, ROOM)
    (episode,) = section.requirements[0].worst
    assert (episode.samples, episode.final) == (samples, -1.0)
    assert episode.decided_at == Moment(700, None)
    assert episode.deciding[0].values == {"gap": 1.0}
    assert min(episode.signals["gap"]) == min(episode.predicates["gap > 2"]) + 2 == 1.0
    for curve in (episode.robustness, episode.lower, episode.upper):
        assert len(curve) == drawn * len(episode.times)


def test_outcome_with_time_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = judged(tmp_path, monkeypatch, capsys)
    (cell,) = (trial["outcomes"]["near"] for trial in kept["trials"] if trial["name"] == "near.csv")
    assert cell["decided_at"] == {"sample": 1, "seconds": 0.5}
    cell["decided_at"]["sample"] = None
    (episode,) = of_matrix(kept, tmp_path, ROOM).requirements[0].worst
    assert episode.decided_at == Moment(1, 0.5)


def test_rows_show_triggers_and_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{time},{4 if time == 1 else 0},9\n" for time in range(5))
    (tmp_path / "t.csv").write_text(f"time,req,gnt\n{rows}", encoding="utf-8")
    either = "either = eventually(gnt > 5) or eventually(req >= 3 implies gnt > 99)"
    others = "answered = always(req >= 3 implies gnt > 5); idle = always(req >= 5 implies gnt > 5)"
    assert main(["monitor", f"{either}; {others}", "--json", "t.csv"]) == 0
    (tmp_path / "t.json").write_text(capsys.readouterr().out, encoding="utf-8")
    page = render(report_of(tmp_path / "t.json"))
    cells = re.findall(r">(\d+x[^<]*|never|not for certain)</td>", page)
    assert cells == ["1x, no answer", "1x", "never"]
