"""Requirements that no trace triggers, and requirements without an answered trigger."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import rtamt
from rtamt import Verdict
from rtamt.monitors import TriggerCount
from rtamt_gym.__main__ import main
from rtamt_gym.reports.html import render, standing_of
from rtamt_gym.reports.model import Report
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.write import section_of
from rtamt_gym.results.codec import outcome_of, plain_outcome
from rtamt_gym.results.outcome import Outcome

Output = pytest.CaptureFixture[str]
RESPONSE = "answered = always(req >= 3 implies eventually[0:1](gnt >= 3))"
SAID = "never triggered: answered in 0 of 2 traces"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with traces of which one has a request."""
    monkeypatch.chdir(tmp_path)
    for name, request in (("idle", 0), ("calm", 1), ("busy", 4)):
        rows = "".join(f"{time},{request if time == 1 else 0},9\n" for time in range(5))
        (tmp_path / f"{name}.csv").write_text(f"time,req,gnt\n{rows}")
    return tmp_path


def run(*words: str, command: str = "monitor") -> int:
    return main([command, RESPONSE, "calm = always(gnt < 99)", "--", *words])


@pytest.mark.parametrize("dense", [[], ["--dense"]])
@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_it_is_said_in_a_line_at_the_end_always(
    command: str, dense: list[str], capsys: Output
) -> None:
    assert run("idle.csv", "calm.csv", *dense, command=command) == 0
    assert capsys.readouterr().out.splitlines()[-2:] == ["", SAID]
    assert run("idle.csv", *dense, command=command) == 0
    assert capsys.readouterr().out.splitlines()[-1] == SAID.replace("2 traces", "1 trace")
    assert run("idle.csv", "busy.csv", *dense, command=command) == 0
    assert "never triggered" not in capsys.readouterr().out


@pytest.mark.parametrize("dense", [[], ["--dense"]])
@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_require_asked_makes_it_exit_3(command: str, dense: list[str], capsys: Output) -> None:
    assert run("idle.csv", "calm.csv", "--require-triggered", *dense, command=command) == 3
    assert capsys.readouterr().out.splitlines()[-1] == SAID
    assert run("idle.csv", "busy.csv", "--require-triggered", *dense, command=command) == 0


def test_errors_and_violations_come_first(folder: Path) -> None:
    low = "low = always(gnt < 5)"
    assert main(["monitor", RESPONSE, low, "--require-triggered", "--", "idle.csv"]) == 1
    (folder / "bad.csv").write_text("time,gnt\n0,1\n")
    words = [RESPONSE, low, "--require-triggered", "--", "idle.csv", "bad.csv"]
    assert main(["monitor", *words]) == 2


def test_json_has_it_and_standard_error_says_it(capsys: Output) -> None:
    assert run("idle.csv", "calm.csv", "--json", "--require-triggered") == 3
    out, said = capsys.readouterr()
    assert said == f"{SAID}\n"
    kept = json.loads(out)
    assert kept["exit_code"] == 3
    outcomes = kept["trials"][0]["outcomes"]
    assert outcomes["answered"]["asked"] == [
        {
            "text": "req >= 3 implies eventually[0:1](gnt >= 3)",
            "samples": 0,
            "occasions": 0,
            "first": None,
            "vacuous": True,
        }
    ]
    assert (outcomes["answered"]["vacuous"], outcomes["answered"]["never_asked"]) == (True, True)
    assert outcomes["calm"]["asked"] == []
    assert "vacuous" not in outcomes["calm"]


@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_what_may_have_been_asked_is_not_said_to_be_never_asked(
    dense: list[str], folder: Path, capsys: Output
) -> None:
    (folder / "holes.csv").write_text("time,req,gnt\n0,0,9\n1,nan,9\n2,0,9\n")
    said = "not certainly triggered: answered in 0 of 2 traces"
    words = ["--missing", "unknown", *dense, "--require-triggered"]
    files = ["--json", "--junit", "out.xml", "--markdown", "out.md"]
    assert run("idle.csv", "holes.csv", *words, *files) == 3
    out, errors = capsys.readouterr()
    assert " ".join(errors.split()).endswith(said)
    (folder / "result.json").write_text(out)
    kept = json.loads(out)
    outcomes = [each["outcomes"]["answered"] for each in kept["trials"]]
    assert [each.get("unknown") for each in outcomes] == [None, ["req"]]
    assert outcome_of(outcomes[1]).unknown == ("req",)  # type: ignore[union-attr]
    markdown = (folder / "out.md").read_text()
    assert markdown.startswith("# SATISFIED, not certainly triggered: answered\n")
    assert "triggered: answered in 0 of 2 traces for certain" in markdown
    written = (folder / "out.xml").read_text()
    assert f'message="{said}"' in written
    assert written.count("not certainly triggered: req &gt;= 3 implies") == 1
    # idle.csv is completely known.
    assert written.count("never triggered: req &gt;= 3 implies") == 1
    section = section_of("result.json", ROOM)
    assert "; not certainly triggered: answered" in str(standing_of([section]))
    page = render(Report("made up", "rtamt", (section,)))
    assert "Not certainly triggered in 2 traces." in page
    assert "ever asked" not in page
    # One trace with a certain trigger is enough.
    assert run("busy.csv", "holes.csv", *words) == 0
    assert "not asked" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "asked",
    [
        TriggerCount("a implies b", 3, 2, 1, vacuous=False),
        rtamt.dense.TriggerCount("p", 0.5, 1, 2.5, vacuous=True),
    ],
)
def test_an_outcome_keeps_it_in_json(asked: TriggerCount | rtamt.dense.TriggerCount) -> None:
    outcome = Outcome(1.0, 1.0, 1.0, Verdict.SATISFIED, triggers=(asked,), vacuous=asked.vacuous)
    assert outcome_of(json.loads(json.dumps(plain_outcome(outcome)))) == outcome
    assert not outcome.never_triggered


@pytest.mark.parametrize("asked", [None, ()])
def test_json_tells_what_nobody_counted_from_what_has_no_implication(
    asked: tuple[()] | None,
) -> None:
    outcome = Outcome(1.0, 1.0, 1.0, Verdict.SATISFIED, triggers=asked)
    kept = plain_outcome(outcome)
    assert ("asked" in kept) == (asked is not None)
    read = outcome_of(kept)
    assert isinstance(read, Outcome)
    assert (read.triggers, read.never_triggered, read.trigger_count) == (asked, False, None)


def test_an_implication_of_several_that_nothing_asked_is_said_and_fails_nothing(
    capsys: Output,
) -> None:
    both = "both = always((req >= 3 implies gnt > 1) and (req >= 9 implies gnt > 1))"
    assert main(["monitor", both, "--require-triggered", "--", "idle.csv", "busy.csv"]) == 0
    said = capsys.readouterr().out.splitlines()[-2:]
    assert said == ["", "never triggered in both: req >= 9 implies gnt > 1 in 0 of 2 traces"]


@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_a_trace_that_needed_no_answer_is_said(dense: list[str], capsys: Output) -> None:
    either = "either = eventually(gnt > 5) or eventually(req >= 3 implies gnt > 99)"
    assert main(["monitor", either, "busy.csv", *dense]) == 0
    out = capsys.readouterr().out.splitlines()
    assert "    triggered 1 time, first at 1 s, satisfied without an answer" in out
    assert out[-2:] == ["", "satisfied without an answer: either in 1 of 1 trace"]


EITHER = "either = eventually(gnt > 5) or eventually(req >= 3 implies gnt > 99)"
LATE = "late = always(req >= 3 implies always[0:60](gnt >= 3))"
SAID_ANSWERED = "never answered: either depended on an answer in 0 of 1 trace"


@pytest.mark.parametrize("dense", [[], ["--dense"]])
@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_it_exits_3_for_what_needed_no_answer(
    command: str, dense: list[str], capsys: Output
) -> None:
    words = [command, EITHER, "--", "busy.csv", *dense]
    assert main(words) == 0
    assert SAID_ANSWERED not in capsys.readouterr().out
    assert main([*words, "--require-answered"]) == 3
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "satisfied without an answer: either in 1 of 1 trace",
        SAID_ANSWERED,
    ]
    assert main([*words, "--require-triggered"]) == 0


def test_it_asks_for_a_request_too(capsys: Output) -> None:
    for switches in (["--require-answered"], ["--require-answered", "--require-triggered"]):
        assert main(["monitor", RESPONSE, "--", "idle.csv", *switches]) == 3
        last = capsys.readouterr().out.splitlines()[-1]
        assert last == "never triggered: answered in 0 of 1 trace"


def test_one_trace_that_hangs_on_an_answer_is_enough() -> None:
    assert main(["monitor", RESPONSE, "--require-answered", "--", "idle.csv", "busy.csv"]) == 0


def test_what_is_open_and_a_violation_by_an_answer(capsys: Output) -> None:
    assert main(["monitor", LATE, "--require-answered", "--", "busy.csv"]) == 3
    assert "never answered: late depended on an answer" in capsys.readouterr().out
    violated = RESPONSE.replace("gnt >= 3", "gnt >= 10")
    assert main(["monitor", violated, "--require-answered", "--", "busy.csv"]) == 1
    assert "never answered" not in capsys.readouterr().out


def test_junit_and_markdown_fail_too(folder: Path) -> None:
    files = ["--junit", "out.xml", "--markdown", "out.md"]
    assert main(["monitor", EITHER, *files, "--", "busy.csv"]) == 0
    assert "failure" not in (folder / "out.xml").read_text().replace('failures="0"', "")
    assert main(["monitor", EITHER, *files, "--require-answered", "--", "busy.csv"]) == 3
    assert (
        f'<failure message="{SAID_ANSWERED}" type="never answered"'
        in (folder / "out.xml").read_text()
    )
    assert "# SATISFIED, never answered: either" in (folder / "out.md").read_text()
