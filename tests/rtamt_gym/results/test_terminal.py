"""Tables on a terminal: one arrangement of cells, with colours if supported."""

import pytest

from rtamt_gym.tables import Coloured, Terminal, table

ROWS = [["requirement", "violated"], ["near", Coloured("12", "red")], ["slow", Coloured("0", "")]]


def test_colours_keep_widths() -> None:
    plain, coloured = Terminal(), Terminal(colours=True)
    lines = coloured.table(ROWS, "<>")
    assert lines[0].startswith("\x1b[1m")
    assert "\x1b[31m12\x1b[0m" in lines[1]
    for code in ("\x1b[1m", "\x1b[31m", "\x1b[0m"):
        lines = [line.replace(code, "") for line in lines]
    assert lines == plain.table(ROWS, "<>") == table(ROWS, "<>")


def test_names_are_cut_to_the_width() -> None:
    rows = [["requirement", "robustness"], ["a_name_of_" * 9, "-1.2345"]]
    lines = table(rows, "<>", 40)
    assert max(map(len, lines)) == 40
    assert lines[1].endswith("...     -1.2345")


def test_file_has_80_columns_without_colours(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not capsys.readouterr().out
    assert Terminal.present() == Terminal(80, colours=False)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "132")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert Terminal.present() == Terminal(132, colours=True)
    monkeypatch.setenv("NO_COLOR", "1")
    assert Terminal.present() == Terminal(132, colours=False)
