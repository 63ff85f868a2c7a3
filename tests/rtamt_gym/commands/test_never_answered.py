"""A requirement that hangs on an answer in no trace fails where that is asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
EITHER = "either = eventually(gnt > 5) or eventually(req >= 3 implies gnt > 99)"
RESPONSE = "answered = always(req >= 3 implies eventually[0:1](gnt >= 3))"
LATE = "late = always(req >= 3 implies always[0:60](gnt >= 3))"
SAID = "never answered: either hung on an answer in 0 of 1 trace"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with traces of which one has a request."""
    monkeypatch.chdir(tmp_path)
    for name, request in (("idle", 0), ("busy", 4)):
        rows = "".join(f"{time},{request if time == 1 else 0},9\n" for time in range(5))
        (tmp_path / f"{name}.csv").write_text(f"time,req,gnt\n{rows}")
    return tmp_path


@pytest.mark.parametrize("dense", [[], ["--dense"]])
@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_it_exits_3_for_what_needed_no_answer(
    command: str, dense: list[str], capsys: Output
) -> None:
    words = [command, EITHER, "--", "busy.csv", *dense]
    assert main(words) == 0
    assert SAID not in capsys.readouterr().out
    assert main([*words, "--require-answered"]) == 3
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "satisfied without an answer: either in 1 of 1 trace",
        SAID,
    ]
    assert main([*words, "--require-asked"]) == 0


def test_it_asks_for_a_request_too(capsys: Output) -> None:
    for switches in (["--require-answered"], ["--require-answered", "--require-asked"]):
        assert main(["monitor", RESPONSE, "--", "idle.csv", *switches]) == 3
        last = capsys.readouterr().out.splitlines()[-1]
        assert last == "never asked: answered was put to the test in 0 of 1 trace"


def test_one_trace_that_hangs_on_an_answer_is_enough() -> None:
    assert main(["monitor", RESPONSE, "--require-answered", "--", "idle.csv", "busy.csv"]) == 0


def test_what_is_open_and_a_violation_by_an_answer(capsys: Output) -> None:
    assert main(["monitor", LATE, "--require-answered", "--", "busy.csv"]) == 3
    assert "never answered: late hung on an answer" in capsys.readouterr().out
    violated = RESPONSE.replace("gnt >= 3", "gnt >= 10")
    assert main(["monitor", violated, "--require-answered", "--", "busy.csv"]) == 1
    assert "never answered" not in capsys.readouterr().out


def test_junit_and_markdown_fail_too(folder: Path) -> None:
    files = ["--junit", "out.xml", "--markdown", "out.md"]
    assert main(["monitor", EITHER, *files, "--", "busy.csv"]) == 0
    assert "failure" not in (folder / "out.xml").read_text().replace('failures="0"', "")
    assert main(["monitor", EITHER, *files, "--require-answered", "--", "busy.csv"]) == 3
    assert f'<failure message="{SAID}" type="never answered"' in (folder / "out.xml").read_text()
    assert "# SATISFIED, never answered: either" in (folder / "out.md").read_text()
