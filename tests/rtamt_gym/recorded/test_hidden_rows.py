"""Tables in which rows would be lost, joined or taken in without a word, with verdicts by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
INVARIANT = "always(x > 0)"
NOTE = 40 * "a"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)


def judged(capsys: Output, table: str, *options: str, text: str = INVARIANT) -> tuple[int, str]:
    """Return the exit code and the output on one line, for a table with a semicolon per line."""
    Path("log.csv").write_text(table.replace("; ", "\n") + "\n")
    code = main(["monitor", text, *options, "--", "log.csv"])
    output = capsys.readouterr()
    return code, " ".join((output.out + output.err).split())


@pytest.mark.parametrize("last", ["", 'e"'])
@pytest.mark.parametrize("rows", [1, 300, pytest.param(30_000, marks=pytest.mark.slow)])
def test_quote_over_rows_is_refused(capsys: Output, last: str, rows: int) -> None:
    before = "; ".join(f"{i},1,{NOTE}" for i in range(rows))
    table = f'time,x,note; {before}; {rows},1,"abc; {rows + 1},-1,d; {rows + 2},1,{last}'
    code, text = judged(capsys, table)
    assert code == 2
    assert ("lines that may be rows" if last else "expected the end of a quoted cell") in text
    assert f"{rows + 2}" in text


@pytest.mark.parametrize("note", ['"two; lines"', '"two; ; lines"', '"a ""b"", c"', '5"'])
def test_quoted_cells_are_read(capsys: Output, note: str) -> None:
    code, text = judged(capsys, f"time,x,note; 0,1,{note}; 1,-1,a")
    assert (code, "2 samples" in text) == (1, True)


def test_quoted_cell_over_lines_of_a_long_file(capsys: Output) -> None:
    before = "; ".join(f"{i},1,{NOTE}" for i in range(30_000))
    code, text = judged(capsys, f'time,x,note; {before}; 30000,-1,"two; lines"')
    assert (code, "30001 samples" in text) == (1, True)


LATE = "0,1; 1,1; 2,1; 2.1,-1; 2.2,1; 3,1; 4,1; 5,1"


def test_row_between_resampled_samples_matters(capsys: Output) -> None:
    code, text = judged(capsys, f"time,x; {LATE}", "--jitter", "5%")
    assert code == 2
    assert "log.csv, line 5: SATISFIED if samples are resampled, but this depends on 1 row" in text
    assert judged(capsys, f"time,x; {LATE}", "--dense")[0] == 1


def test_violation_between_rows_that_were_passed(capsys: Output) -> None:
    table = "time,x; 0,1; 1,1; 2,1; 2.7,1; 3,-1; 4,1"
    code, text = judged(capsys, table, "--jitter", "5%")
    assert code == 1
    assert "left out between samples: 1 row with another value, first log.csv, line 5" in text


def test_row_after_the_last_sample_matters(capsys: Output) -> None:
    table = "time,x; 0,1; 1,1; 2,1; 3.3,1; 4.4,1; 5.4,-1"
    assert judged(capsys, table, "--jitter", "5%")[0] == 2


@pytest.mark.parametrize("bound", ["x > -2", "x < 2", "y > 0"])
def test_harmless_rows_between_samples(capsys: Output, bound: str) -> None:
    table = "time,x,y; 0,1,1; 1,1,1; 2,1,1; 2.1,-1,1; 3,1,1; 4,1,1"
    assert judged(capsys, table, "--jitter", "5%", text=f"always({bound})")[0] == 0


@pytest.mark.parametrize(
    "table",
    [
        "name,x; Berlin,1; Paris,1; Rome,1; {},-1",
        "x,note; 1,; 1,; 1,; -1,{}",
        "time,n,x; 0,1,1; 1,2,1; 2,3,1; 3,{},-1",
    ],
)
@pytest.mark.parametrize("name", ["Total", "Grand total:", "mean", "Summe"])
def test_named_row_of_totals_is_refused(capsys: Output, table: str, name: str) -> None:
    code, text = judged(capsys, table.format(name), text="eventually(x < 0)")
    assert code == 2
    assert f"'{name}' in" in text
    options = ("--one-trace",)
    assert judged(capsys, table.format(name), *options, text="eventually(x < 0)")[0] == 0


@pytest.mark.parametrize("last", ["max", "count"])
def test_name_of_a_statistic_next_to_numbers(capsys: Output, last: str) -> None:
    table = f"time,n,x; 0,1,1; 1,2,1; 2,{last},-1"
    assert judged(capsys, table, text="eventually(x < 0)")[0] == 2
    states = f"time,fan,x; 0,low,1; 1,high,1; 2,{last},-1"
    assert judged(capsys, states, text="eventually(x < 0)")[0] == 0


def test_group_of_totals_is_refused(capsys: Output) -> None:
    table = "time,id,x; 0,a,1; 1,a,1; 0,b,1; 1,b,1; 1,Total,-1"
    code, text = judged(capsys, table, "--by", "id", text="eventually(x < 0)")
    assert code == 2
    assert "names a row of totals" in text


@pytest.mark.parametrize("column", ["frame", "step", "index"])
def test_missing_row_numbers_are_refused(capsys: Output, column: str) -> None:
    table = f"{column},x; 0,1; 1,1; 5,1; 6,-1"
    goal = "eventually[0:3](x < 0)"
    code, text = judged(capsys, table, text=goal)
    assert code == 2
    assert f"line 4: expected rows at even distances in '{column}', got 5 after 1" in text
    assert judged(capsys, table, "--period", "1", text=goal)[0] == 0
    options = ("--time", column, "--time-unit", "s", "--max-gap", "1")
    assert judged(capsys, table, *options, text=goal)[0] == 3


def test_even_row_numbers_count_rows(capsys: Output) -> None:
    assert judged(capsys, "x,step; 1,0; 1,10; -1,20", text="eventually[0:2](x < 0)")[0] == 0


IDS = "time,id,x; 0,7.0,1; 1,7,-1; 0,8,1; 1,8,1"


@pytest.mark.parametrize("options", [("--by", "id"), ("--where", "id=7"), ("--where", "id=7.0")])
def test_number_of_an_object_in_two_writings(capsys: Output, options: tuple[str, ...]) -> None:
    code, text = judged(capsys, IDS, *options)
    assert code == 2
    assert "the column 'id' has '7' and '7.0', which may be one object or two" in text


def test_wide_number_of_an_object_in_two_writings(capsys: Output) -> None:
    options = ("--wide", "id", "--signal", "a=x.7")
    assert judged(capsys, IDS, *options, text="always(a > 0)")[0] == 2


@pytest.mark.parametrize("options", [("--by", "id"), ("--where", "id=007")])
def test_leading_zeros_are_other_objects(capsys: Output, options: tuple[str, ...]) -> None:
    table = "time,id,x; 0,007,1; 1,007,1; 0,7,1; 1,7,1; 0,7.5,1; 1,7.5,1"
    assert judged(capsys, table, *options)[0] == 0


RUNS = "time,run,name,x; 0,1,E,1; 0,1,F,1; 1,1,E,1; 1,1,F,1; 2,2,E,1; 2,2,F,1; 3,2,E,1; 3,2,F,-1"


def test_wide_table_of_several_runs_is_refused(capsys: Output) -> None:
    goal = "eventually(x.F < 0)"
    code, text = judged(capsys, RUNS, "--wide", "name", text=goal)
    assert code == 2
    assert "expected one trace of 'E', got 2 values of 'run'" in text
    assert judged(capsys, RUNS, "--wide", "name", "--by", "run", text=goal)[0] == 1
    assert judged(capsys, RUNS, "--wide", "name", "--one-trace", text=goal)[0] == 0


def test_wide_table_with_a_second_name_of_objects(capsys: Output) -> None:
    table = RUNS.replace("run", "vehicle_id").replace(",2,E", ",1,E").replace(",1,F", ",2,F")
    assert judged(capsys, table, "--wide", "name", text="eventually(x.F < 0)")[0] == 0


TWO = "time,id,x; 0,a,1; 5,a,1; {}"
OTHERS = "; ".join(f"{i},b,1" for i in range(6))


@pytest.mark.parametrize("text", ["always[0:5](x > 0)", "always(x > 0)"])
def test_two_rows_with_a_step_or_a_gap(capsys: Output, text: str) -> None:
    table = TWO.format(OTHERS)
    code, output = judged(capsys, table, "--by", "id", text=text)
    assert code == 2
    assert "line 3: expected samples at even distances, got time 5 after 0, elsewhere 1 s" in output
    assert "--period 5s for this trace alone if 5s is its step, --max-gap 1s" in output
    assert judged(capsys, table, "--by", "id", "--max-gap", "1s", text=text)[0] == 3
    assert main(["monitor", text, "--period", "5s", "--", "log.csv[id=a]"]) == 0


@pytest.mark.parametrize(
    "others", ["0,b,1; 5,b,1", "0,b,1; 1,b,1; 0,c,1; 1,c,1", "0,b,1; 5,b,1; 10,b,1", "1,b,1"]
)
def test_two_rows_without_a_shorter_step(capsys: Output, others: str) -> None:
    assert judged(capsys, TWO.format(others), "--by", "id", text=INVARIANT)[0] == 0


def test_dates_of_two_rows_with_a_step_or_a_gap(capsys: Output) -> None:
    day = "2024-05-01T00:00:0"
    table = f"time,id,x; {day}0,a,1; {day}5,a,1; " + "; ".join(f"{day}{i},b,1" for i in range(6))
    assert judged(capsys, table, "--by", "id")[0] == 2


def test_selection_between_counted_rows(capsys: Output) -> None:
    table = "mode,x; on,1; on,1; off,-1; on,1; on,-1"
    code, text = judged(capsys, table, "--where", "mode=on", text="always[0:2](x > 0)")
    assert code == 2
    assert "line 5: --where leaves out rows before this one" in text
    options = ("--where", "mode=on", "--one-trace")
    assert judged(capsys, table, *options, text="always[0:2](x > 0)")[0] == 0


@pytest.mark.parametrize("table", ["car,x; a,1; b,-1; b,-1; a,1", "mode,x; a,1; b,-1; a,1; b,-1"])
def test_selection_of_an_object_between_counted_rows(capsys: Output, table: str) -> None:
    column = table.partition(",")[0]
    assert judged(capsys, table, "--where", f"{column}=a", text="always[0:1](x > 0)")[0] == 0


def test_dropped_row_between_counted_rows(capsys: Output) -> None:
    table = "x,y; 1,1; ,1; 1,1; 1,1; -1,1"
    goal = "eventually[0:3](x < 0)"
    code, text = judged(capsys, table, "--missing", "drop", text=goal)
    assert code == 2
    assert "line 4: --missing drop leaves out the row before this one" in text
    assert judged(capsys, table, "--missing", "drop", "--one-trace", text=goal)[0] == 0
    assert judged(capsys, "x,y; ,1; 1,1; -1,1", "--missing", "drop", text=goal)[0] == 0


@pytest.mark.parametrize(
    ("table", "options"),
    [
        ("time,x; 0,1; 1,; 2,1", ("--missing", "drop")),
        ("time,id,x; 0,a,1; 1,a,; 2,a,1; 0,b,1; 1,b,1; 2,b,1", ("--missing", "drop", "--by", "id")),
        ("time,mode,x; 0,on,1; 1,off,-1; 2,on,1", ("--where", "mode=on")),
    ],
)
def test_two_rows_that_stay_are_not_a_step(
    capsys: Output, table: str, options: tuple[str, ...]
) -> None:
    code, text = judged(capsys, table, *options, text="always[0:2](x > 0)")
    assert code == 2
    assert "expected samples at even distances, got time 2 after 0, elsewhere 1 s" in text
    more = ("--max-gap", "1s") if "--where" in options else ("--missing", "unknown")
    assert judged(capsys, table, *options, *more, text="always[0:2](x > 0)")[0] == 3


def test_rows_that_stay_at_an_even_step(capsys: Output) -> None:
    table = "time,x; 0,1; 1,; 2,1; 3,; 4,1"
    assert judged(capsys, table, "--missing", "drop", text="always[0:4](x > 0)")[0] == 0
