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
    assert judged(capsys, table, "--jitter", "5%")[0] == 1


def test_row_after_the_last_sample_matters(capsys: Output) -> None:
    table = "time,x; 0,1; 1,1; 2,1; 3.3,1; 4.4,1; 5.4,-1"
    assert judged(capsys, table, "--jitter", "5%")[0] == 2


@pytest.mark.parametrize("bound", ["x > -2", "x < 2", "y > 0"])
def test_harmless_rows_between_samples(capsys: Output, bound: str) -> None:
    table = "time,x,y; 0,1,1; 1,1,1; 2,1,1; 2.1,-1,1; 3,1,1; 4,1,1"
    assert judged(capsys, table, "--jitter", "5%", text=f"always({bound})")[0] == 0
