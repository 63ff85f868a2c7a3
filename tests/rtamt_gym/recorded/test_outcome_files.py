"""Outcomes for CI: JUnit XML, Markdown, and JSON on standard output."""

from __future__ import annotations

import json
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator, Sized
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

import rtamt
from rtamt import Verdict
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.output import json_parts
from rtamt_gym.results.ci_outcomes import junit_parts, to_markdown
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.outcome import Failure, Outcome
from rtamt_gym.results.trial import Trial

Output = pytest.CaptureFixture[str]
TEXT = """\
near = always(gap > 2)
answered = always(req >= 3 implies eventually[0:1](gnt >= 3))
"""
HEAD = "time,gap,req,gnt\n"
OTHERS = ("traces", "trials", "versions", "files")
"""The keys of the JSON that have tests of their own."""


@pytest.fixture(autouse=True)
def folder(folder: Path) -> Path:
    """The working directory, with a trace for each verdict and one that cannot be read."""
    (folder / "req.stl").write_text(TEXT)
    (folder / "good.csv").write_text(HEAD + "0,5,0,0\n0.5,4,4,0\n1,5,0,5\n")
    (folder / "near.csv").write_text(HEAD + "0,5,0,0\n0.5,1,0,0\n1,5,0,0\n")
    (folder / "open.csv").write_text(HEAD + "0,5,0,0\n0.5,4,4,0\n")
    (folder / "bad.csv").write_text(HEAD + "0,5,0\n")
    return folder


TRACES = ["good.csv", "near.csv", "open.csv", "bad.csv"]
EXPLAINED = """\
robustness -1 at 0 s, decided by gap > 2 at 0.5 s

   at  value  formula
  0 s     -1  near = always(gap > 2)
0.5 s     -1  gap > 2
0.5 s      1  gap"""
CONSTANT = "constant over the whole trace: req (0), gnt (0)"
DESCRIBED = "near.csv: 3 samples, one every 0.5 s, 0 s to 1 s, 1 s long, longest gap 0.5 s"
WHY_OPEN = "eventually[0:1](gnt >= 3) at 0.5 s: not recorded: 1 s to 1.5 s"
WAY_OUT = "if nothing follows (--end complete), the verdict is VIOLATED"
BAD = "bad.csv, line 2: expected 4 values (time, gap, req, gnt), got 3"


def test_junit_suites_and_cases(folder: Path, capsys: Output) -> None:
    assert main(["monitor", "req.stl", "--junit", "out.xml", "--", *TRACES]) == 2
    assert capsys.readouterr().out.endswith("\noutcomes: out.xml\n")
    root = ET.parse(folder / "out.xml").getroot()  # noqa: S314 - our own
    assert (root.tag, root.attrib) == (
        "testsuites",
        {"name": "rtamt", "tests": "8", "failures": "1", "errors": "2"},
    )
    counts = {
        suite.get("name"): tuple(
            suite.get(each) for each in ("tests", "failures", "errors", "skipped")
        )
        for suite in root
    }
    assert counts == {
        "good.csv": ("2", "0", "0", "0"),
        "near.csv": ("2", "1", "0", "0"),
        "open.csv": ("2", "0", "0", "1"),
        "bad.csv": ("2", "0", "2", "0"),
    }
    assert [each.tag for each in root[0]] == ["properties", "testcase", "testcase", "system-out"]
    assert root[0][-1].text == (
        "good.csv: 3 samples, one every 0.5 s, 0 s to 1 s, 1 s long, longest gap 0.5 s"
    )
    said = {}
    for case in root.iter("testcase"):
        for found in case:
            if found.tag not in {"properties", "system-out"}:
                said[case.get("classname"), case.get("name")] = found.tag, found.attrib, found.text
    assert said == {
        ("near.csv", "near"): (
            "failure",
            {"message": "VIOLATED, robustness -1, certain from 0.5 s on", "type": "violation"},
            f"always(gap > 2)\n\n{EXPLAINED}",
        ),
        ("open.csv", "answered"): (
            "skipped",
            {"message": f"{WHY_OPEN}; {WAY_OUT}"},
            f"{rtamt.parse(TEXT).formula}\n\nUNDECIDED, robustness -1\n{WHY_OPEN}\n{WAY_OUT}",
        ),
        **{
            ("bad.csv", name): ("error", {"message": BAD, "type": "error"}, BAD)
            for name in ("near", "answered")
        },
    }


def test_junit_reports_trigger_counts(folder: Path) -> None:
    main(["monitor", "req.stl", "--junit", "out.xml", "--", *TRACES])
    root = ET.parse(folder / "out.xml").getroot()  # noqa: S314 - our own
    found = {
        (case.get("classname"), case.get("name")): (
            {each.get("name"): each.get("value") for each in case.iter("property")},
            case.findtext("system-out"),
        )
        for case in root.iter("testcase")
    }
    text = "req >= 3 implies eventually[0:1](gnt >= 3)"
    asked = {"asked": "1"}, f"triggered 1 time, first at sample 1: {text}"
    never = {"asked": "0", "vacuous": "true", "never_asked": "true"}, f"never triggered: {text}"
    said = {("good.csv", "answered"): asked, ("open.csv", "answered"): asked}
    said |= {("near.csv", "answered"): never}
    assert {name: each for name, each in found.items() if each[0]} == said
    assert [each.tag for each in root[2][2]] == ["properties", "skipped", "system-out"]


def failures_in(path: Path) -> dict[tuple[str | None, str | None], tuple[str, str | None]]:
    """Return the tag and the type of each test case without success."""
    root = ET.parse(path).getroot()  # noqa: S314 - our own
    for element in (root, *root):
        assert element.get("failures") == str(len(list(element.iter("failure"))))
    assert [each.get("skipped") for each in root] == [
        str(len(list(each.iter("skipped")))) for each in root
    ]
    return {
        (case.get("classname"), case.get("name")): (found.tag, found.get("type"))
        for case in root.iter("testcase")
        for found in case
        if found.tag in {"failure", "error", "skipped"}
    }


def test_untriggered_requirements_fail_with_option(
    folder: Path,
) -> None:
    never = "rare = always(req >= 9 implies eventually[0:1](gnt >= 3))"
    files = ["--junit", "out.xml", "--markdown", "out.md"]
    words = ["monitor", "req.stl", never, *files]
    traces = ["good.csv", "near.csv", "open.csv", "bad.csv"]
    alone = {
        ("near.csv", "near"): ("failure", "violation"),
        ("open.csv", "answered"): ("skipped", None),
        **{("bad.csv", name): ("error", "error") for name in ("near", "answered", "rare")},
    }
    assert main([*words, "--", *traces]) == 2
    assert failures_in(folder / "out.xml") == alone
    assert (folder / "out.md").read_text().startswith("# ERROR\n")
    assert main([*words, "--require-triggered", "--", *traces]) == 2
    asked = {(trace, "rare"): ("failure", "never asked") for trace in traces[:3]}
    assert failures_in(folder / "out.xml") == alone | asked
    assert (folder / "out.md").read_text().startswith("# ERROR, never triggered: rare\n")
    found = ET.parse(folder / "out.xml").getroot().find(".//failure")  # noqa: S314 - our own
    assert found is not None
    message = "never triggered: rare in 0 of 3 traces"
    assert found.get("message") == message
    assert f"\n\n{message}\nSATISFIED, robustness 5" in str(found.text)
    # One trace with a trigger is enough.
    assert (
        main(["monitor", "req.stl", *files, "--require-triggered", "--", "near.csv", "good.csv"])
        == 1
    )
    assert failures_in(folder / "out.xml") == {("near.csv", "near"): ("failure", "violation")}
    assert (folder / "out.md").read_text().startswith("# VIOLATED\n")


def test_short_traces_fail_in_junit_and_markdown(folder: Path) -> None:
    (folder / "long.csv").write_text(HEAD + "".join(f"{i},5,0,0\n" for i in range(9)))
    files = ["--junit", "out.xml", "--markdown", "out.md", "--min-duration", "5s"]
    words = ["monitor", "calm = always(gap > 2)", "answered = always(req >= 9 implies gnt > 0)"]
    assert main([*words, *files, "--", "long.csv", "good.csv"]) == 3
    short = {("good.csv", name): ("failure", "too short") for name in ("calm", "answered")}
    assert failures_in(folder / "out.xml") == short
    found = ET.parse(folder / "out.xml").getroot().find(".//failure")  # noqa: S314 - our own
    assert found is not None
    assert found.get("message") == "shorter than 5 s: good.csv (1 s)"
    heading = (folder / "out.md").read_text().partition("\n")[0]
    assert heading == "# SATISFIED, shorter than 5 s: good.csv (1 s)"
    assert main([*words, *files, "--require-triggered", "--", "long.csv", "good.csv"]) == 3
    never = {(trace, "answered"): ("failure", "never asked") for trace in ("long.csv", "good.csv")}
    assert failures_in(folder / "out.xml") == short | never
    heading = (folder / "out.md").read_text().partition("\n")[0]
    assert heading == "# SATISFIED, never triggered: answered; shorter than 5 s: good.csv (1 s)"
    # A violated case fails as a violation.
    assert main(["monitor", "calm = always(gap > 9)", *files, "--", "good.csv"]) == 1
    assert failures_in(folder / "out.xml") == {("good.csv", "calm"): ("failure", "violation")}


def test_what_no_xml_may_hold_is_escaped() -> None:
    name = "a\x1b[0m\ud800<&>\"'\uffff.csv"
    failure = Failure("bad \x00 byte & <tag>")
    matrix = Matrix([Trial.of_trace(name, "", {"p": failure})], {"p": "x > 0"})
    data = b"".join(junit_parts(matrix, {"end": "cut"}))
    root = ET.fromstring(data)  # noqa: S314 - our own
    assert root[0].get("name") == "a\\x1b[0m\\ud800<&>\"'\ufffd.csv"
    error = root.find(".//error")
    assert error is not None
    assert (error.get("message"), error.text) == ("bad \\x00 byte & <tag>",) * 2


def many(count: int) -> Matrix:
    """Return outcomes of a number of traces, some of them violated, open or failed."""
    outcomes: list[Outcome | Failure] = [
        Outcome(1.0, 1.0, 1.0, Verdict.SATISFIED),
        Outcome(-1.0, -1.0, -1.0, Verdict.VIOLATED, text="VIOLATED", explanation="x at 3 s\n  why"),
        Outcome(0.5, -1.0, 1.0, Verdict.UNDECIDED, not_recorded=("1 s to 2 s",)),
        Failure("no column 'x'"),
    ]
    rows = [
        Trial.of_trace(
            f"t[car={i}]", f"t[car={i}]: 3 samples", {"p": outcomes[i % 4]}, ["note " * 100]
        )
        for i in range(count)
    ]
    return Matrix(rows, {"p": "always(x > 0)"})


@pytest.mark.parametrize("count", [1, 2, 40])
def test_parts_of_junit_are_one_document(count: int) -> None:
    data = b"".join(junit_parts(many(count), {"end": "cut"}))
    head, _, text = data.decode().partition("\n")
    assert head == '<?xml version="1.0" encoding="UTF-8"?>'
    root = ET.fromstring(data)  # noqa: S314 - our own
    assert len(root) == count
    ET.indent(root)
    assert text == ET.tostring(root, encoding="unicode") + "\n"


@pytest.mark.parametrize("count", [1, 2, 40])
def test_parts_of_json_are_one_document(count: int) -> None:
    matrix = many(count)
    groups = {row.name: {"car": i} for i, row in enumerate(matrix.rows)}
    text = "".join(json_parts(matrix, {"end": "cut"}, Columns(), 1, groups=groups))
    stored = json.loads(text)
    assert [trial["group"]["car"] for trial in stored["trials"]] == [*range(count)]
    # Everything else is indented, with plain lists on one line; each trial is a line.
    lines = [f"    {json.dumps(trial)}" for trial in stored["trials"]]
    assert ",\n".join(lines) in text
    assert text.count("\n    {") == count
    assert [*stored][:4] == ["format", "version", "kind", "rtamt"]


@pytest.mark.parametrize("form", ["json", "junit"])
def test_many_outcomes_are_written_in_parts(form: str) -> None:
    """The text of all traces is never in memory at once."""
    matrix, size = many(10_001), 0
    tracemalloc.start()
    try:
        parts: Iterator[Sized] = junit_parts(matrix, {"end": "cut"})
        if form == "json":
            parts = json_parts(matrix, {"end": "cut"}, Columns(), 1)
        for part in parts:
            size += len(part)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert size > 5_000_000
    assert peak < size / 2


def test_markdown_table_and_failures(folder: Path, capsys: Output) -> None:
    assert main(["monitor", "req.stl", "--markdown", "out.md", "--", *TRACES]) == 2
    assert capsys.readouterr().out.endswith("\noutcomes: out.md\n")
    assert (
        (folder / "out.md").read_text()
        == f"""\
# ERROR

4 traces, 2 requirements: 2 errors, 1 violated, 1 undecided, 4 satisfied{"  "}
worst requirement: near, violated in 1 of 3 traces, minimum -1 in near.csv{"  "}
worst trace: near.csv, 1 of 2 requirements violated, minimum -1 of near{"  "}
triggered: answered in 2 of 3 traces{"  "}
note on near.csv: constant over the whole trace: req (0), gnt (0){"  "}
note on open.csv: constant over the whole trace: gnt (0){"  "}

| trace | verdict | near | answered | triggers |
|---|---|---:|---:|---:|
| good.csv | SATISFIED | 2 | 2 | 1x |
| near.csv | VIOLATED | -1 V | 3 | 0x |
| open.csv | UNDECIDED | 2 | -1 U | 1x |
| bad.csv | ERROR | E | E |  |

numbers are robustness; V: violated, U: undecided, E: error, otherwise satisfied.

<details><summary>near.csv: near: VIOLATED, robustness -1, certain from 0.5 s on</summary>

```
always(gap > 2)

{EXPLAINED}
```

</details>

<details><summary>open.csv: answered: UNDECIDED, robustness -1</summary>

```
always(req >= 3 implies eventually[0:1](gnt >= 3))

{WHY_OPEN}
{WAY_OUT}
```

</details>

<details><summary>bad.csv: near: error</summary>

```
{BAD}
```

</details>

<details><summary>bad.csv: answered: error</summary>

```
{BAD}
```

</details>
"""
    )


def test_names_are_no_markdown(folder: Path) -> None:
    (folder / "a|b_c.csv").write_text((folder / "near.csv").read_text())
    main(["monitor", "so_near = always(gap > 2)", "--markdown", "out.md", "--", "a|b_c.csv"])
    lines = (folder / "out.md").read_text().splitlines()
    assert "| trace | verdict | so\\_near |" in lines
    assert "| a\\|b\\_c.csv | VIOLATED | -1 V |" in lines


def test_markdown_limits_explanations(folder: Path) -> None:
    for i in range(60):
        (folder / f"run{i}.csv").write_text((folder / "near.csv").read_text())
    main(["monitor", "always(gap > 2)", "--markdown", "out.md", "--", "run*.csv"])
    text = (folder / "out.md").read_text()
    assert text.count("<details>") == 50
    assert text.endswith("\n10 more are not explained here.\n")


def test_explanation_keeps_markdown_block() -> None:
    why = "decided by\n```\nx > 0"
    found = Outcome(-1.0, -1.0, -1.0, rtamt.Verdict.VIOLATED, explanation=why)
    matrix = Matrix([Trial.of_trace("a.csv", "", {"near": found})], {"near": "always(x > 0)"})
    lines = to_markdown(matrix).splitlines()
    begin, end = (place for place, line in enumerate(lines) if line == "````")
    assert lines[begin + 1 : end][-3:] == why.splitlines()


def strict(text: str) -> Any:  # noqa: ANN401
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def test_json_is_alone_on_stdout(capsys: Output) -> None:
    options = ["--json", "--junit", "out.xml"]
    assert main(["monitor", "req.stl", *options, "--", "near.csv", "bad.csv"]) == 2
    out, err = capsys.readouterr()
    said = "outcomes: out.xml\nnever triggered: answered in 0 of 1 trace\n"
    assert err == f"{said}rtamt: error: {BAD}\n"
    kept = strict(out)
    assert {name: each for name, each in kept.items() if name not in OTHERS} == {
        "format": "rtamt result",
        "version": 2,
        "kind": "traces",
        "rtamt": rtamt.__version__,
        "system": "",
        "reading": {
            "end": "cut",
            "view": "episode",
            "semantics": "standard",
            "time": "sampled",
            "columns": {},
        },
        "verdict": "ERROR",
        "exit_code": 2,
        "counts": {"error": 2, "violated": 1, "undecided": 0, "satisfied": 1},
        "worst_requirement": "near",
        "worst_trace": "near.csv",
        "requirements": {
            "near": "always(gap > 2)",
            "answered": "always(req >= 3 implies eventually[0:1](gnt >= 3))",
        },
        "results": {
            "near": results(-1.0, violated=1, first_violations=[0.5], worst=[[0, -1.0]]),
            "answered": results(3.0, satisfied=1, worst=[[0, 3.0]], asked=0),
        },
    }
    near, bad = kept["trials"]
    assert near == {
        "name": "near.csv",
        "described": DESCRIBED,
        "notes": [CONSTANT],
        "extent": {
            "samples": 3,
            "period": "1/2",
            "begin": 0.0,
            "end": 1.0,
            "length": 1.0,
            "usual_step": 0.5,
            "gap": {"seconds": 0.5, "begin": 0.0, "usual": 0.5},
        },
        "ended": "recorded",
        "outcomes": {
            "near": {
                "verdict": "VIOLATED",
                "robustness": -1.0,
                "lower": -1.0,
                "upper": -1.0,
                "decided_at": {"sample": 1, "seconds": 0.5},
                "text": "VIOLATED, robustness -1, certain from 0.5 s on",
                "explanation": EXPLAINED,
                "asked": [],
            },
            "answered": {
                "verdict": "SATISFIED",
                "robustness": 3.0,
                "lower": 3.0,
                "upper": 3.0,
                "decided_at": None,
                "text": "SATISFIED, robustness 3, at the end of the trace",
                "asked": [
                    {
                        "text": "req >= 3 implies eventually[0:1](gnt >= 3)",
                        "samples": 0,
                        "occasions": 0,
                        "first": None,
                        "vacuous": True,
                    }
                ],
                "vacuous": True,
                "never_asked": True,
            },
        },
        "verdict": "VIOLATED",
    }
    assert bad["outcomes"] == {
        name: {"verdict": "ERROR", "error": BAD} for name in ("near", "answered")
    }


def results(height: float, **counts: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return the statistics of a requirement that judged one of two traces."""
    numbers = dict.fromkeys(["least", "cvar", "median", "greatest"], height)
    shares = dict.fromkeys(["0.05", "0.25", "0.5", "0.75", "0.95"], height)
    found: dict[str, Any] = {
        "episodes": 2,
        "satisfied": 0,
        "violated": 0,
        "undecided": 0,
        "failed": 1,
        "asked": None,
        "progress": None,
    }
    found |= {"quantiles": shares, "first_violations": [], "saved": 0.0, "worst": []}
    return {**found, **numbers, **counts}


def test_json_open_verdicts_and_signed_zeros(folder: Path, capsys: Output) -> None:
    assert main(["monitor", "req.stl", "--json", "open.csv"]) == 3
    cell = strict(capsys.readouterr().out)["trials"][0]["outcomes"]["answered"]
    assert (cell["not_recorded"], cell["way_out"]) == ([WHY_OPEN], WAY_OUT)
    (folder / "zero.csv").write_text("x\n0\n")
    assert main(["monitor", "always(x > 0)", "--json", "zero.csv"]) == 1
    assert '"robustness": -0.0,' in capsys.readouterr().out


def test_unreadable_trace_is_in_files(folder: Path, capsys: Output) -> None:
    assert main(["monitor", "req.stl", "--junit", "out.xml", "bad.csv"]) == 2
    assert capsys.readouterr() == ("outcomes: out.xml\n", f"rtamt: error: {BAD}\n")
    assert (folder / "out.xml").read_text().count("<error ") == 2


@pytest.mark.slow
@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_files_do_not_depend_on_jobs(dense: list[str], folder: Path) -> None:
    written = set()
    for workers in ("1", "3"):
        command = [sys.executable, "-m", "rtamt_gym", "monitor", "req.stl", "-j", workers]
        command += ["--json", "--junit", "out.xml", "--markdown", "out.md", *dense]
        ran = subprocess.run(
            [*command, "--", *TRACES], capture_output=True, text=True, check=False, cwd=folder
        )
        files = [(folder / name).read_text() for name in ("out.xml", "out.md")]
        written.add((ran.returncode, ran.stdout, ran.stderr, *files))
    assert len(written) == 1
    assert next(iter(written))[0] == 2
