"""Two sets of recordings: violations that are new, gone or moved, and the exit code."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from paths import ROOT

from rtamt_gym.__main__ import main
from rtamt_gym.evaluation.recording_changes import RecordingsComparison, recordings_lines
from rtamt_gym.reports.write import report_of

Output = pytest.CaptureFixture[str]
Judge = Callable[..., str]
Compare = Callable[..., tuple[int, RecordingsComparison, str]]
LIMIT = "limit = always(x < 1)"


@pytest.fixture
def judge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output) -> Judge:
    """Write recordings below a folder and return the name of the file of their verdicts."""
    monkeypatch.chdir(tmp_path)

    def judged(
        side: str,
        recordings: Mapping[str, Sequence[object]],
        *arguments: str,
        specs: Sequence[str] = (LIMIT,),
        start: float = 0.0,
        step: float = 1.0,
    ) -> str:
        folder = tmp_path / side
        folder.mkdir(exist_ok=True)
        for name, values in recordings.items():
            lines = ["time,x", *(f"{start + step * i},{x}" for i, x in enumerate(values))]
            if not step:
                lines = ["x", *map(str, values)]
            (folder / name).write_text("\n".join(lines) + "\n")
        capsys.readouterr()
        main(
            [
                "monitor",
                *specs,
                *arguments,
                "--json",
                "--occurrences",
                "--",
                side if recordings else f"{side}.csv",
            ]
        )
        Path(f"{side}.json").write_text(capsys.readouterr().out)
        return f"{side}.json"

    return judged


@pytest.fixture
def compare(capsys: Output) -> Compare:
    """Compare two files; return the exit code, the comparison, and the text."""

    def compared(*arguments: str) -> tuple[int, RecordingsComparison, str]:
        code = main(["compare", "a.json", "b.json", "--save", "c.json", *arguments])
        return code, RecordingsComparison.load("c.json"), capsys.readouterr().out

    return compared


def refused(capsys: Output, *arguments: str) -> str:
    assert main(["compare", "a.json", "b.json", *arguments]) == 2
    return " ".join(capsys.readouterr().err.split())


def statuses(comparison: RecordingsComparison) -> list[str]:
    return [row.status for row in comparison.changes]


QUIET = [0] * 12


def violated(*places: int) -> list[int]:
    return [int(i in places) for i in range(12)]


@pytest.mark.parametrize(
    ("a", "b", "tolerance", "status", "code"),
    [
        (violated(3, 4), violated(3, 4), "0", ["same"], 0),
        (QUIET, violated(3), "0", ["new"], 1),
        (violated(3), QUIET, "0", ["gone"], 0),
        (violated(3, 4, 5), violated(4, 5, 6), "0", ["moved"], 0),
        (violated(3, 4, 5), violated(4, 5, 6), "1s", ["same"], 0),
        (violated(3), violated(5), "0", ["gone", "new"], 1),
        (violated(3), violated(5), "2s", ["same"], 0),
        (violated(3), violated(3, 4, 5), "0", ["longer"], 1),
        (violated(3), violated(3, 4, 5), "2s", ["same"], 0),
        (violated(3, 4, 5), violated(3), "0", ["shorter"], 0),
        (violated(*range(2, 9)), violated(2, 3, 5, 6, 7), "0", ["shorter", "part"], 0),
        (violated(9, 10, 11), violated(9, 10, 11), "0", ["same"], 0),
        (violated(11), QUIET, "0", ["gone"], 0),
        (QUIET, violated(11), "0", ["new"], 1),
    ],
)
def test_status_and_exit_code(
    judge: Judge,
    compare: Compare,
    a: list[int],
    b: list[int],
    tolerance: str,
    status: list[str],
    code: int,
) -> None:
    judge("a", {"run.csv": a})
    judge("b", {"run.csv": b})
    found, comparison, _ = compare("--tolerance", tolerance)
    assert statuses(comparison) == status
    assert found == code


@pytest.mark.parametrize("seed", range(4))
def test_comparison_matches_pandas(judge: Judge, compare: Compare, seed: int) -> None:
    generator = np.random.default_rng(seed)
    values = {
        side: {f"{i}.csv": (generator.random(30) < 0.3).astype(int) for i in range(5)}
        for side in "ab"
    }
    for side, recordings in values.items():
        judge(side, {name: list(x) for name, x in recordings.items()}, step=0.5)
    code, comparison, _ = compare()
    frames = [
        pd.DataFrame({"name": name, "time": 0.5 * np.arange(30), "a": a, "b": values["b"][name]})
        for name, a in values["a"].items()
    ]
    frame = pd.concat(frames, ignore_index=True)
    spans: dict[str, pd.DataFrame] = {}
    for side, other in ("ab", "ba"):
        run = (frame[side].diff() != 0) | (frame["name"] != frame["name"].shift())
        groups = frame[frame[side] == 1].groupby([frame["name"], run.cumsum()])
        spans[side] = groups.agg(start=("time", "min"), last=("time", "max"), met=(other, "sum"))
    for side, word in (("a", "gone"), ("b", "new")):
        alone = {(name, row.start) for (name, _), row in spans[side].iterrows() if row.met == 0}
        found = {
            (row.recording, getattr(row, side).start)
            for row in comparison.rows("new", "gone")
            if row.status == word
        }
        assert alone <= found  # a violation that overlaps is new if it is only partly in the other
        item = comparison.requirements["limit"]
        assert getattr(item, f"count_{side}") == len(spans[side])
    keys = [
        {(name, *row[["start", "last"]]) for (name, _), row in spans[side].iterrows()}
        for side in "ab"
    ]
    assert len(comparison.rows("same")) == len(keys[0] & keys[1])
    satisfied = frame.groupby("name")[["a", "b"]].max() == 0
    table = pd.crosstab(satisfied["a"], satisfied["b"])
    compared = comparison.requirements["limit"].compared
    assert compared.both == table.get(True, {}).get(True, 0)
    assert compared.neither == table.get(False, {}).get(False, 0)
    times = comparison.requirements["limit"].violated_time
    assert times
    mean = 0.5 * (frame["b"].sum() - frame["a"].sum()) / 5
    assert times.value == pytest.approx(mean)
    assert code == int(bool(comparison.rows("new", "longer")))


def test_only_one_side_is_listed_apart(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": QUIET, "old.csv": violated(2)}, specs=[LIMIT, "gone = always(x < 9)"])
    judge("b", {"1.csv": QUIET, "new.csv": violated(2)}, specs=[LIMIT, "added = always(x < 1)"])
    code, comparison, text = compare()
    assert code == 0
    assert comparison.changes == ()
    assert (comparison.only_a, comparison.only_b) == (("old.csv",), ("new.csv",))
    assert (comparison.requirements_a, comparison.requirements_b) == (("gone",), ("added",))
    assert "only in A: old.csv" in text
    assert "requirements only in B: added" in text
    assert compare("--require-all")[0] == 3


def test_recordings_of_b_alone_lack_nothing(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": QUIET})
    judge("b", {"1.csv": QUIET, "new.csv": violated(2)})
    assert compare("--require-all")[0] == 0


def test_changed_text_error(judge: Judge, compare: Compare, capsys: Output) -> None:
    judge("a", {"1.csv": QUIET}, specs=[LIMIT, "wide = always(x < 9)"])
    judge("b", {"1.csv": QUIET}, specs=[LIMIT, "wide = always(x < 8)"])
    error = refused(capsys)
    assert "wide is always(x < 9) of A and always(x < 8) of B" in error
    assert "--accept-changed" in error
    code, comparison, text = compare("--accept-changed", "--require-all")
    assert code == 3
    assert comparison.changed == ("wide",)
    assert [*comparison.requirements] == ["limit"]
    assert "requirements with another text in B: wide" in text


def test_changed_constant_error(judge: Judge, capsys: Output) -> None:
    Path("spec.stl").write_text("const float c = 1\nlimit = always(x < c)\n")
    judge("a", {"1.csv": QUIET}, "--constant", "c=1", specs=["spec.stl"])
    judge("b", {"1.csv": QUIET}, "--constant", "c=2", specs=["spec.stl"])
    assert "constant:c is 1 of A and 2 of B" in refused(capsys)


@pytest.mark.parametrize("option", [("--end", "complete"), ("--dense",), ("--view", "step")])
def test_other_options_error(judge: Judge, capsys: Output, option: tuple[str, ...]) -> None:
    judge("a", {"1.csv": QUIET})
    judge("b", {"1.csv": QUIET}, *option)
    assert "evaluation options differ" in refused(capsys)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--signal", "x=time"], "--signal x is x of A and time of B"),
        (["--where", "x=0"], "--where x is not set of A and 0 of B"),
        (["--jitter", "10%"], "--jitter is not set of A and 0.1 of B"),
        (["--missing", "hold"], "--missing is not set of A and hold of B"),
        (["--time-unit", "ms"], "--time-unit is not set of A and ms of B"),
        (["--max-gap", "5s"], "--max-gap is not set of A and 5 of B"),
        (["--no-defaults"], "--no-defaults is not set of A and True of B"),
    ],
)
def test_other_columns_error(
    judge: Judge, compare: Compare, capsys: Output, options: list[str], text: str
) -> None:
    judge("a", {"1.csv": QUIET})
    judge("b", {"1.csv": QUIET}, *options)
    error = refused(capsys)
    assert f"variables are read differently: {text};" in error
    assert "--accept-changed" in error
    comparison = compare("--accept-changed")[1]
    assert any(note == f"variables are read differently: {text}" for note in comparison.notes)


def test_same_column_with_and_without_option(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": QUIET})
    judge("b", {"1.csv": QUIET}, "--signal", "x=x")
    assert compare()[0] == 0


def test_changed_annotation_error(judge: Judge, capsys: Output) -> None:
    for side, column in (("a", "x"), ("b", "time")):
        Path("spec.stl").write_text(f'@ column(x, "{column}")\n{LIMIT}\n')
        judge(side, {"1.csv": QUIET}, specs=["spec.stl"])
    assert "--signal x is x of A and time of B" in refused(capsys)


def test_changed_default_error(judge: Judge, compare: Compare, capsys: Output) -> None:
    for side, value in (("a", 1), ("b", 9)):
        Path("spec.stl").write_text(f"input float x\ninput float L = {value}\nl = always(x < L)\n")
        judge(side, {"1.csv": violated(3)}, specs=["spec.stl"])
    assert "the default of L is 1 of A and 9 of B" in refused(capsys)
    assert compare("--accept-changed")[0] == 0


def test_default_of_another_requirement(judge: Judge, compare: Compare) -> None:
    own = "input float x\ninput float L = 1\nother = always(x < L)\n"
    for side, text in (("a", own), ("b", "")):
        Path("spec.stl").write_text(f"{LIMIT}\n")
        Path("own.stl").write_text(text)
        judge(side, {"1.csv": QUIET}, specs=["spec.stl", *["own.stl"] * bool(text)])
    code, comparison, _ = compare()
    assert (code, comparison.requirements_a) == (0, ("other",))


def test_missing_occurrences_error(judge: Judge, capsys: Output) -> None:
    judge("a", {"1.csv": QUIET})
    judge("b", {"1.csv": QUIET})
    kept = json.loads(Path("b.json").read_text())
    del kept["trials"][0]["outcomes"]["limit"]["occurrences"]
    Path("b.json").write_text(json.dumps(kept))
    assert "b.json has no occurrences: write it with rtamt monitor --json" in refused(capsys)


UNKNOWN = ["" if i in (3, 4) else 0 for i in range(12)]


def test_unknown_samples_are_undecided(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": UNKNOWN}, "--missing", "unknown")
    judge("b", {"1.csv": violated(3, 4)}, "--missing", "unknown")
    code, comparison, text = compare()
    assert (code, statuses(comparison)) == (3, ["undecided"])
    assert "undecided in the other:" in text


def test_unknown_samples_of_b_are_undecided(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": QUIET}, "--missing", "unknown")
    judge("b", {"1.csv": UNKNOWN}, "--missing", "unknown")
    code, comparison, text = compare()
    assert (code, statuses(comparison)) == (3, [])
    assert comparison.requirements["limit"].open_b == 1
    assert "B does not decide `limit` in 1 stretch that A satisfies" in text


def test_unrecorded_instants_of_b_are_undecided(judge: Judge, compare: Compare) -> None:
    spec = ["bounded = always[0:10](x < 1)"]
    judge("a", {"1.csv": QUIET}, specs=spec)
    judge("b", {"1.csv": QUIET[:6]}, specs=spec)
    code, comparison, _ = compare()
    assert (code, statuses(comparison)) == (3, [])
    assert comparison.requirements["bounded"].open_b == 1


def test_exit_code_covers_worse_verdicts(judge: Judge, compare: Compare) -> None:
    """Every worse verdict in B fails, for any samples."""
    generator = np.random.default_rng(7)
    specs = ["answered = always(x > 0 implies eventually[1:2](x < 0))", "up = eventually(x > 0)"]
    codes = set()
    for _ in range(40):
        for side in "ab":
            values = generator.integers(-1, 2, generator.integers(2, 6)).tolist()
            judge(side, {"1.csv": values}, specs=specs)
        pairs = []
        for name in ("answered", "up"):
            kept = [json.loads(Path(f"{side}.json").read_text()) for side in "ab"]
            pairs.append(tuple(k["trials"][0]["outcomes"][name]["verdict"] for k in kept))
        code, comparison, _ = compare("--times", "recorded")
        codes.add(code)
        worse = [pair for pair in pairs if pair[0] == "SATISFIED" and pair[1] != "SATISFIED"]
        assert code in ({1, 3} if worse else {0, 1, 3}), (pairs, statuses(comparison))
        violated_rows = any(row.b for row in comparison.changes)
        assert violated_rows == ("VIOLATED" in [pair[1] for pair in pairs])
    assert codes == {0, 1, 3}


def test_unknown_samples_of_a_alone_pass(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": UNKNOWN}, "--missing", "unknown")
    judge("b", {"1.csv": QUIET}, "--missing", "unknown")
    assert compare()[0] == 0


@pytest.mark.parametrize(("broken", "code"), [("a", 0), ("b", 3), ("ab", 0)])
def test_errors_are_listed_apart(judge: Judge, compare: Compare, broken: str, code: int) -> None:
    for side in "ab":
        bad = ["x"] * 12 if side in broken else violated(5)
        judge(side, {"1.csv": QUIET, "2.csv": bad})
    found, comparison, text = compare()
    assert statuses(comparison) == []
    assert len(comparison.not_compared) == 1
    assert "not compared: limit in 2.csv (error in" in text
    assert found == code


def test_other_clock_error(judge: Judge, compare: Compare, capsys: Output) -> None:
    judge("a", {"1.csv": violated(3)})
    judge("b", {"1.csv": violated(3)}, start=2.0)
    error = refused(capsys)
    assert "1.csv starts at 0 s in A and at 2 s in B" in error
    assert "--times recorded or --times start" in error
    code, comparison, _ = compare("--times", "start")
    assert (code, statuses(comparison)) == (0, ["same"])
    assert comparison.shifts == {"1.csv": -2.0}
    code, comparison, _ = compare("--times", "recorded")
    assert (code, statuses(comparison)) == (1, ["gone", "new"])
    # within the tolerance, both clocks are equal
    assert compare("--tolerance", "2s")[0] == 0


def test_other_clock_without_violations(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": QUIET})
    judge("b", {"1.csv": QUIET}, start=2.0)
    assert compare()[0] == 0


def test_shorter_recordings(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": violated(2, 10), "2.csv": violated(2)})
    judge("b", {"1.csv": violated(2)[:6], "2.csv": [*violated(2), 0, 1]})
    code, comparison, text = compare()
    # A violates 1.csv at 10 s, which B has not recorded; B violates 2.csv at 13 s, which A has not
    assert statuses(comparison) == ["same", "undecided", "same", "undecided"]
    assert code == 3
    assert comparison.shorter == {"1.csv": 6.0}
    assert "B covers less time: 1.csv (6 s less)" in text


def test_shorter_recording_fails_on_request(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": QUIET})
    judge("b", {"1.csv": QUIET[:6]})
    assert compare()[0] == 0
    assert compare("--require-all")[0] == 3


def test_violation_to_the_end_of_a_shorter_recording(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": violated(4, 5)[:6]})
    judge("b", {"1.csv": violated(4, 5, 6, 7)})
    code, comparison, _ = compare()
    assert (code, statuses(comparison)) == (0, ["same"])


def test_samples_without_times(judge: Judge, compare: Compare, capsys: Output) -> None:
    judge("a", {"1.csv": violated(3)}, step=0.0)
    judge("b", {"1.csv": violated(5)}, step=0.0)
    assert compare()[0] == 1
    assert "leave the unit out" in refused(capsys, "--tolerance", "2s")
    code, comparison, text = compare("--tolerance", "2")
    assert (code, statuses(comparison)) == (0, ["same"])
    assert "tolerance 2 samples" in text


def test_long_tolerance(judge: Judge, compare: Compare, capsys: Output) -> None:
    for side, place in (("a", 1), ("b", 8)):
        judge(side, {"1.csv": violated(place), "2.csv": QUIET[:4]})
    error = refused(capsys, "--tolerance", "200")
    assert "expected less than the longest recording, 12 s, got 200 s; a number without" in error
    comparison = compare("--tolerance", "5s")[1]
    assert statuses(comparison) == ["gone", "new"]
    assert any("tolerance of 5 s is longer than 2.csv" in note for note in comparison.notes)
    assert not any("tolerance" in note for note in compare("--tolerance", "4s")[1].notes)


def test_long_tolerance_in_samples(judge: Judge, capsys: Output) -> None:
    for side in "ab":
        judge(side, {"1.csv": QUIET}, step=0.0)
    error = refused(capsys, "--tolerance", "13")
    assert "longest recording, 12 samples, got 13 samples" in error
    assert "seconds" not in error


def test_reasons_are_complete(judge: Judge, compare: Compare) -> None:
    for side in "ab":
        bad = ["" if side == "b" else 0] * 12
        judge(side, {"ok.csv": QUIET, **{f"{i}.csv": bad for i in range(5)}})
    _, comparison, text = compare()
    assert len(comparison.not_compared) == 5
    flat = " ".join(text.split())
    for item in comparison.not_compared[:3]:
        assert " ".join(f"limit in {item.recording} ({item.reason})".split()) in flat
    assert "not compared: 2 more" in text
    assert "..." not in flat


def test_two_units_are_not_compared(judge: Judge, compare: Compare, capsys: Output) -> None:
    judge("a", {"1.csv": violated(3)})
    judge("b", {"1.csv": violated(3)}, step=0.0)
    code, comparison, text = compare()
    assert (code, comparison.changes) == (3, ())
    assert "(times in s in A, and in samples in B)" in text
    assert "others have times" in refused(capsys, "--tolerance", "1")


@pytest.mark.parametrize("other", [2, 3])
def test_violation_after_the_recording(judge: Judge, compare: Compare, other: int) -> None:
    spec = ["late = always(x < 9) and always[6:6](once[3:3](x < 1))"]
    judge("a", {"1.csv": [0, 0, 0, int(other == 3), 0]}, specs=spec)
    judge("b", {"1.csv": [0, 0, 0, 1, 0]}, specs=spec)
    code, comparison, _ = compare()
    assert [row.b.unseen for row in comparison.changes if row.b] == [True]
    assert statuses(comparison) == ["same" if other == 3 else "new"]
    assert code == int(other == 2)


def test_dense_time(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": violated(3, 4)}, "--dense")
    judge("b", {"1.csv": violated(3, 4, 8)}, "--dense")
    code, comparison, _ = compare()
    assert (code, statuses(comparison)) == (1, ["same", "new"])


def test_groups_of_one_file(judge: Judge, compare: Compare, tmp_path: Path) -> None:
    for side, times in (("a", (2,)), ("b", (2, 7))):
        rows = [(car, t, int(car == 2 and t in times)) for t in range(10) for car in (1, 2)]
        text = "".join(f"{car},{t},{x}\n" for car, t, x in rows)
        (tmp_path / f"{side}.csv").write_text(f"car,time,x\n{text}")
        judge(side, {}, "--by", "car")
    code, comparison, text = compare()
    assert code == 1
    assert [(r.recording, r.status) for r in comparison.changes] == [
        ("[car=2]", "same"),
        ("[car=2]", "new"),
    ]
    assert "recordings of one file may depend on each other" in text


def test_bodies_are_matched_apart(judge: Judge, compare: Compare) -> None:
    spec = ["both = always(x < 1 and x > -1)"]
    judge("a", {"1.csv": violated(3)}, specs=spec)
    judge("b", {"1.csv": [-value for value in violated(3)]}, specs=spec)
    code, comparison, text = compare("--tolerance", "5s")
    assert code == 1
    assert [(row.body, row.status) for row in comparison.changes] == [
        ("x < 1", "gone"),
        ("x > -1", "new"),
    ]
    assert "both (x > -1) in 1.csv: B 3 s to 4 s, robustness" in text


def test_saved_comparison_and_page(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": violated(3, 8), "2.csv": QUIET})
    judge("b", {"1.csv": violated(3), "2.csv": violated(1, 2)})
    _, comparison, text = compare("--report", "page.html")
    assert RecordingsComparison.load("c.json") == comparison
    assert "\n".join(recordings_lines(comparison)) in text
    section = report_of("c.json").sections[0]
    assert section.kind == "recordings"
    assert section.requirements[0].legend.startswith("1 new, 0 longer, 1 gone, 0 moved")
    assert "B is worse than A" in Path("page.html").read_text()
    timeline = next(f for f in section.requirements[0].figures if getattr(f, "kind", "") != "")
    assert timeline.kind == "timeline"  # type: ignore[union-attr]


def test_undecided_violation_of_a_alone_passes(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": violated(3, 4)}, "--missing", "unknown")
    judge(
        "b", {"1.csv": ["" if i in range(2, 6) else 0 for i in range(12)]}, "--missing", "unknown"
    )
    code, comparison, _ = compare()
    # B is unknown at 2 s, which A satisfies, unless the tolerance covers it
    assert (code, statuses(comparison)) == (3, ["undecided"])
    code, comparison, _ = compare("--tolerance", "1s")
    assert (code, statuses(comparison)) == (0, ["undecided"])


@pytest.mark.parametrize("side", ["old", "new"])
def test_example_files_are_current(
    side: str, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    specs = ["limit = always(speed < 30)", "distance = always(gap > 2)"]
    main(["monitor", *specs, "--json", "--occurrences", "--", f"examples/releases/{side}"])
    fresh = json.loads(capsys.readouterr().out)
    kept = json.loads(Path(f"examples/releases/{side}.json").read_text())
    assert {**fresh, "rtamt": "", "versions": {}} == {**kept, "rtamt": "", "versions": {}}


def test_options_of_recordings_error(judge: Judge, capsys: Output) -> None:
    for side in "ab":
        judge(side, {"1.csv": QUIET})
    assert "--tolerance: expected a time" in refused(capsys, "--tolerance", "-1")
    assert "no recording is in the folder c" in refused(capsys, "--folders", "c", "b")


def test_tolerance_of_zero_has_any_unit(judge: Judge, compare: Compare) -> None:
    for side in "ab":
        judge(side, {"1.csv": QUIET})
    assert compare("--tolerance", "0s")[1] == compare()[1]


@pytest.mark.parametrize("name", ["1.csv", "2.csv"])
def test_only_recordings_are_a_pair(judge: Judge, compare: Compare, name: str) -> None:
    judge("a", {"1.csv": QUIET})
    judge("b", {name: QUIET})
    note = compare()[1].notes[0]
    assert note.startswith(f"a/1.csv is compared with b/{name}")
    assert note.endswith("although their names differ") == (name == "2.csv")


def test_two_kinds_of_files_error(judge: Judge, capsys: Output) -> None:
    judge("a", {"1.csv": QUIET})
    Path("b.json").write_text(Path("a.json").read_text().replace('"traces"', '"evaluation"'))
    assert "b.json holds no traces but a result of kind 'evaluation'" in refused(capsys)


def test_nothing_compared(judge: Judge, compare: Compare) -> None:
    for side in ("a", "b"):
        judge(side, {"1.csv": [0, "zz"], "2.csv": ["zz", 0]})
    code, comparison, text = compare()
    assert (code, comparison.words) == (3, {"undecided"})
    assert "nothing was compared: no verdict in both" in text


def test_lost_triggers_in_b(judge: Judge, compare: Compare) -> None:
    response = ("limit = always(x > 5 implies x > 6)",)
    judge("a", {"1.csv": [9, 0], "2.csv": [0, 0]}, specs=response)
    judge("b", {"1.csv": [0, 0], "2.csv": [0, 0]}, specs=response)
    code, comparison, text = compare()
    assert (code, comparison.untriggered) == (0, {"limit": 1})
    assert "never triggered in B: limit (1 of 2 recordings of A)" in text
    assert compare("--require-all")[0] == 3


def test_never_triggered_in_both(judge: Judge, compare: Compare) -> None:
    for side in ("a", "b"):
        judge(side, {"1.csv": [0, 0]}, specs=("limit = always(x > 5 implies x > 6)",))
    code, _, text = compare("--require-all")
    assert code == 0
    assert "never triggered in A and B: limit" in text


def test_one_file_on_both_sides(judge: Judge, capsys: Output) -> None:
    judge("a", {"1.csv": [0, 0]})
    assert main(["compare", "a.json", "./a.json"]) == 2
    assert "expected two results to compare, got the file a.json twice" in capsys.readouterr().err


def test_same_recordings_on_both_sides(judge: Judge, compare: Compare) -> None:
    judge("a", {"1.csv": [0, 0]})
    Path("b.json").write_text(Path("a.json").read_text())
    same = "A and B have recordings of the same paths"
    assert f"{same} and the same outcomes, so they may be" in " ".join(compare()[2].split())
    (Path("a") / "1.csv").write_text("time,x\n0,0\n1,2\n")
    judge("a", {"1.csv": [0, 2]})
    code, comparison, _ = compare()
    assert code == 0
    assert comparison.notes[0] == "a/1.csv is compared with a/1.csv"
    assert same in comparison.notes
