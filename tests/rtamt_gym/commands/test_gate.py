"""A gate in CI: its requirements on traces, and its files."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from rtamt import ParseError, parse
from rtamt_gym.__main__ import main
from rtamt_gym.reports.write import section_of

Output = pytest.CaptureFixture[str]
UP = "up = always(v > 1 implies w > 0)"
IDENTIFIED = '@ id(near, "R-1")\nnear = always(v < 9)\nslow = always(near implies w < 9)\n'


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory: three traces, two of which trigger `UP`, and other files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    for name, v in (("a", 2), ("b", 2), ("c", 0)):
        (tmp_path / f"runs/{name}.csv").write_text(f"time,v,w\n0,0,1\n1,{v},1\n2,0,1\n")
    return tmp_path


def monitor(*words: str) -> int:
    return main(["monitor", UP, "--", "runs", *words])


@pytest.mark.parametrize(
    ("option", "code"),
    [
        ("--require-triggered", 0),
        ("--require-triggered=1", 0),
        ("--require-triggered=2", 0),
        ("--require-triggered=3", 3),
        ("--require-triggered=4", 3),
        ("--require-triggered=all", 3),
    ],
)
@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_require_triggered_counts_traces(
    command: str, option: str, code: int, capsys: Output
) -> None:
    assert main([command, UP, "--", "runs", option]) == code
    line = "triggered too seldom: up in 2 of 3 traces;"
    assert (line in capsys.readouterr().out) is (code == 3)


def test_require_triggered_all_passes_where_all_trigger() -> None:
    assert main(["monitor", UP, "--require-triggered=all", "--", "runs/a.csv", "runs/b.csv"]) == 0


def test_word_behind_bare_option_is_no_value(folder: Path) -> None:
    (folder / "spec.stl").write_text(UP)
    assert main(["monitor", "--require-triggered", "spec.stl", "runs/a.csv"]) == 0
    assert main(["monitor", "--require-triggered", "spec.stl", "runs/c.csv"]) == 3


@pytest.mark.parametrize("value", ["0", "-1", "1.5", "some", ""])
def test_require_triggered_refuses_other_values(value: str, capsys: Output) -> None:
    assert monitor(f"--require-triggered={value}") == 2
    assert f"expected all or a whole number above 0, got {value!r}" in capsys.readouterr().err


def _cases(path: Path) -> dict[str, str]:
    """Return the failure type of each test case, or the tag of its result, or ``passed``."""
    found = {}
    for case in ET.parse(path).iter("testcase"):  # noqa: S314 - our own file
        results = [each for each in case if each.tag in {"failure", "error", "skipped"}]
        found[case.get("classname", "")] = (
            results[0].get("type") or results[0].tag if results else "passed"
        )
    return found


def test_junit_fails_the_traces_that_do_not_trigger(folder: Path) -> None:
    assert monitor("--require-triggered=all", "--junit", "o.xml") == 3
    assert _cases(folder / "o.xml") == {
        "runs/a.csv": "passed",
        "runs/b.csv": "passed",
        "runs/c.csv": "triggered too seldom",
    }


def test_undecided_sets_the_result_in_junit_alone(folder: Path, capsys: Output) -> None:
    words = ["monitor", "always[0:9](w > 0)", "runs/a.csv", "--end", "open", "--junit", "o.xml"]
    for option, kind in (([], "skipped"), (["skip"], "skipped"), (["fail"], "undecided")):
        assert main([*words, *(["--undecided", *option] if option else [])]) == 3
        assert _cases(folder / "o.xml") == {"runs/a.csv": kind}
        suite = next(ET.parse(folder / "o.xml").iter("testsuite"))  # noqa: S314 - our own file
        assert (suite.get("failures"), suite.get("skipped")) == (
            ("1", "0") if kind == "undecided" else ("0", "1")
        )
    capsys.readouterr()
    assert monitor("--undecided", "fail") == 2
    assert "sets how --junit reports undecided requirements" in capsys.readouterr().err


def test_min_traces(capsys: Output, folder: Path) -> None:
    (folder / "runs/notes.txt.bak").touch()
    assert monitor("--min-traces", "3") == 0
    capsys.readouterr()
    assert monitor("--min-traces", "4") == 2
    assert capsys.readouterr().err == (
        "rtamt: error: --min-traces: expected 4 traces or more, got 3; runs: 1 entry is not a "
        "trace and was not read: notes.txt.bak\n"
    )


def test_a_trace_that_is_named_twice_counts_once(capsys: Output) -> None:
    words = ["monitor", UP, "--", "runs/a.csv", "./runs/a.csv", "runs/*.csv", "--min-traces", "4"]
    assert main(words) == 2
    assert "expected 4 traces or more, got 3" in capsys.readouterr().err


def test_other_files_in_a_folder_are_counted(folder: Path, capsys: Output) -> None:
    for name in ("a.log", "b.pdf", "z.bin", ".hidden"):
        (folder / "runs" / name).touch()
    (folder / "runs/old").mkdir()
    line = "runs: 4 entries are not traces and were not read: a.log, b.pdf, old/, ..."
    assert monitor() == 0
    assert line in capsys.readouterr().out.splitlines()
    assert monitor("--json") == 0
    assert line in capsys.readouterr().err.splitlines()


def test_files_of_other_kinds_are_no_traces(folder: Path, capsys: Output) -> None:
    contents = {
        "junit.xml": b"<testsuites/>",
        "weights.bin": b"\0" * 100,
        "thumbs.db": b"other",
        "b.xml.gz": gzip.compress(b"<x/>"),
    }
    for name, content in contents.items():
        (folder / "runs" / name).write_bytes(content)
    assert monitor() == 0
    assert "runs: 4 entries are not traces and were not read: b.xml.gz, junit.xml" in " ".join(
        capsys.readouterr().out.split()
    )
    assert main(["monitor", UP, "--", "runs/weights.bin"]) == 2
    assert "dataflash" in capsys.readouterr().err
    (folder / "runs/b.xml.gz").write_bytes(b"damaged")
    assert monitor() == 2
    assert "runs/b.xml.gz" in capsys.readouterr().err
    (folder / "runs/b.xml.gz").unlink()
    (folder / "runs/fcd.xml").write_text("<!-- a comment -->\n<fcd-export>")
    assert monitor() == 2
    assert "runs/fcd.xml" in capsys.readouterr().err


@pytest.mark.parametrize("broken", ["--bogus", "--require-triggered=0", "--expect=down"])
def test_run_that_stops_early_leaves_no_old_outcomes(broken: str, folder: Path) -> None:
    assert monitor("--junit", "o.xml") == 0
    assert monitor("--junit=o.xml", broken) == 2
    assert not (folder / "o.xml").exists()


def test_other_files_are_never_removed(folder: Path) -> None:
    (folder / "spec.stl").write_text(UP)
    assert main(["monitor", "spec.stl", "runs/a.csv", "--junit", "spec.stl"]) == 2
    assert (folder / "spec.stl").read_text() == UP


def test_expect(capsys: Output) -> None:
    assert monitor("--expect", "up") == 0
    capsys.readouterr()
    assert monitor("--expect", "up", "--expect", "upp") == 2
    assert "--expect: no requirement 'upp' is evaluated; did you mean 'up'?" in (
        capsys.readouterr().err
    )


def test_formula_with_an_id_is_judged_though_another_uses_it(folder: Path, capsys: Output) -> None:
    (folder / "spec.stl").write_text(IDENTIFIED)
    (folder / "far.csv").write_text("time,v,w\n0,9,1\n1,9,1\n")
    assert main(["monitor", "spec.stl", "--", "far.csv", "runs/a.csv"]) == 1  # near is violated
    out = capsys.readouterr().out
    assert "near is evaluated on its own, because it has the id R-1; 'slow' uses it too" in out
    assert main(["monitor", "spec.stl", "far.csv", "--only", "slow"]) == 0


def test_requirements_with_ids_keep_their_parts() -> None:
    spec = parse(IDENTIFIED)
    assert [*spec.requirements] == ["near", "slow"]
    for name, requirement in spec.requirements.items():
        assert [*requirement.requirements] == [name]
        assert [*parse(str(requirement)).requirements] == [name]
    assert [*parse(str(spec)).requirements] == ["near", "slow"]


@pytest.mark.parametrize("result", ["close = always(gap > 1)", "always(gap > 1)"])
def test_id_of_a_number_is_an_error(result: str) -> None:
    with pytest.raises(ParseError, match=r"'gap' is a number in .*, not a requirement"):
        parse(f'@ id(gap, "R-1")\ngap = x - y\n{result}')


def test_id_of_a_first_sample_formula_says_what_to_do(folder: Path, capsys: Output) -> None:
    (folder / "spec.stl").write_text('@ id(p, "R-1")\np = v < 9\nq = always(p)\n')
    assert main(["monitor", "spec.stl", "runs/a.csv"]) == 2
    assert "remove the id, write always(v < 9) or --view step" in capsys.readouterr().err


def test_constants_of_the_command_line_are_written(folder: Path, capsys: Output) -> None:
    (folder / "spec.stl").write_text("const float most = 1\nfine = always(v <= most)\n")
    words = ["monitor", "spec.stl", "runs/a.csv", "--constant", "most=2"]
    assert main([*words, "--junit", "o.xml", "--markdown", "o.md", "--json"]) == 0
    written = capsys.readouterr().out
    assert json.loads(written)["reading"]["constant:most"] == "2"
    properties = {
        each.get("name"): each.get("value")
        for each in ET.parse(folder / "o.xml").iter("property")  # noqa: S314 - our own file
    }
    assert properties["constant:most"] == "2"
    assert "Constants set on the command line: most = 2" in (folder / "o.md").read_text()
    (folder / "o.json").write_text(written)
    facts = dict(section_of("o.json", 1000).facts)
    assert facts["constant most"] == "2"


@pytest.mark.parametrize(
    ("formula", "codes", "lines"),
    [
        (
            "always(level > 9)",
            (0, 1),
            ["never satisfied: spec in 0 of 3 simulations, violated in 3"],
        ),
        ("always(level < 1.5)", (0, 0), []),  # violated by two of three
    ],
)
def test_sweep_that_never_satisfies(
    formula: str,
    codes: tuple[int, int],
    lines: list[str],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Output,
) -> None:
    (folder / "gate_plant.py").write_text(
        "def tank(gain):\n    for i in range(3):\n        yield {'level': gain * i}\n"
    )
    monkeypatch.syspath_prepend(folder)
    words = ["sweep", "gate_plant:tank", "--vary", "gain=0.5:2.5", "--requirement", formula]
    words += ["--sampler", "grid", "--samples", "3"]
    for switch, code in zip(([], ["--require-satisfied"]), codes, strict=True):
        assert main([*words, *switch]) == code
        out = capsys.readouterr().out
        assert [line for line in out.splitlines() if "never satisfied" in line] == lines


@pytest.mark.parametrize("signal", ["b=missing", "b=word"])
@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_bad_column_of_a_signal_spares_other_requirements(
    signal: str, dense: list[str], folder: Path, capsys: Output
) -> None:
    (folder / "bad.csv").write_text("time,v,word\n0,1,x\n1,1,y\n")
    words = ["monitor", "good = always(v > 0)", "bad = always(b > 0)", "bad.csv", "--json", *dense]
    assert main([*words, "--signal", signal, "--signal", "v=v"]) == 2
    outcomes = json.loads(capsys.readouterr().out)["trials"][0]["outcomes"]
    assert outcomes["good"]["verdict"] == "SATISFIED"
    assert outcomes["bad"]["verdict"] == "ERROR"
