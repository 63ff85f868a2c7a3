"""`rtamt mine`: its output, its exit codes, and errors."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from catalogue import entries

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
BELOW = "always(speed < ?v)"
FORMULA = "always(req >= 3 implies eventually[0:?t](gnt >= ?w))"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with traces and requirements."""
    monkeypatch.chdir(tmp_path)
    runs = tmp_path / "runs"
    runs.mkdir()
    for name, rows in {
        "a.csv": "0,4,0,20\n0.5,0,5,25\n1,0,0,22",
        "b.csv": "0,4,0,18\n0.5,0,2,31.5\n1,0,3,30",
    }.items():
        (runs / name).write_text(f"time,req,gnt,speed\n{rows}\n")
    (tmp_path / "late.csv").write_text("time,km/h\n0,20\n0.1,25\n0.31,22\n0.4,23\n")
    (tmp_path / "one.stl").write_text("// slow enough?\nslow = always(speed < ?v)\n")
    (tmp_path / "two.stl").write_text(
        "const float limit = 30\nslow = always(speed < limit)\nfast = eventually(speed > limit)\n"
    )
    return tmp_path


def found(words: list[str], capsys: Output) -> tuple[float, str, float]:
    """Return the value, the side and the failing neighbour in JSON."""
    assert main(["mine", *words, "--json"]) == 0
    output = capsys.readouterr()
    assert output.err == ""
    read = json.loads(output.out)
    return read["value"], read["side"], read["fails_at"]


def refused(words: list[str], capsys: Output) -> str:
    assert main(["mine", *words]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    return output.err.removeprefix("rtamt: error: ").removesuffix("\n")


def test_it_prints_the_constant_and_the_trace_that_decided(capsys: Output) -> None:
    assert main(["mine", BELOW, "--range", "v=0:200", "--", "runs"]) == 0
    assert capsys.readouterr().out == (
        "v = 31.501 is the smallest for which all 2 traces satisfy always(speed < ?v)\n"
        "at v = 31.5 runs/b.csv does not\n"
        "no trace changes its verdict more than once at the 17 values that were tried\n"
        "  from 0 to 200 (50 evaluations)\n"
        "\n"
        "runs/b.csv at v = 31.501:\n"
        "robustness 0.001 at 0 s, decided by speed < 31.501 at 0.5 s\n"
        "\n"
        "   at  value  formula\n"
        "  0 s  0.001  always(speed < 31.501)\n"
        "0.5 s  0.001  speed < 31.501\n"
        "0.5 s   31.5  speed\n"
    )


def test_options_of_traces_constants_and_tolerances_are_those_of_other_commands(
    capsys: Output,
) -> None:
    times = ["--range", "t=0:3", "--", "runs/a.csv", "runs/b.csv"]
    assert found([FORMULA, "--constant", "w=2", *times], capsys) == (0.5, "least", 0.0)
    assert found([FORMULA, "--constant", "w=2.5", *times], capsys) == (1.0, "least", 0.5)
    assert found(["speed < ?v", "--view", "step", "--range", "v=0:50", "runs/a.csv"], capsys) == (
        25.0001,
        "least",
        25.0,
    )
    resampled = ["--signal", "speed=km/h", "--jitter", "5%", "--tolerance", "0.5"]
    assert found([BELOW, "--range", "v=0:50", *resampled, "late.csv"], capsys) == (
        25.5,
        "least",
        25.0,
    )
    assert main(["mine", BELOW, "--range", "v=0:50", *resampled, "late.csv"]) == 0
    assert "note: late.csv: resampled every 0.1 s" in capsys.readouterr().out


def test_a_file_has_a_mark_or_a_constant(capsys: Output) -> None:
    assert found(["one.stl", "--range", "v=0:50", "--", "runs"], capsys)[0] == 31.5001
    words = ["two.stl", "--range", "limit=0:50", "--", "runs"]
    assert found([*words[:1], "--only", "slow", *words[1:]], capsys)[:2] == (31.5001, "least")
    assert found([*words[:1], "--only", "fast", *words[1:]], capsys)[:2] == (24.9999, "greatest")
    assert refused(words, capsys) == (
        "expected one requirement, got 'slow', 'fast'; give --only with its name"
    )


UNASKED = ["always(speed > ?v implies gnt < 0)", "--range", "v=0:100", "--", "runs"]
NEVER = "never triggered: v = 31.5 in 0 of 2 traces\n"


def test_a_constant_that_is_never_asked_is_said_beside_the_json(capsys: Output) -> None:
    assert main(["mine", *UNASKED[:-2], "--json", *UNASKED[-2:]]) == 0
    output = capsys.readouterr()
    assert output.err == NEVER
    assert json.loads(output.out)["asked"] == 0


def test_nobody_who_reads_what_is_said_ends_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    def closed(_text: str) -> int:
        raise BrokenPipeError

    monkeypatch.setattr(sys.stderr, "write", closed)
    assert main(["mine", *UNASKED[:-2], "--json", *UNASKED[-2:]]) == 141  # as of SIGPIPE


def test_no_value_is_code_2_with_the_trace_that_has_none(capsys: Output) -> None:
    assert refused([BELOW, "--range", "v=0:30", "--", "runs"], capsys) == (
        "none of the 17 tried values of 'v' from 0 to 30 satisfies the requirement on all 2 "
        "traces: runs/b.csv comes closest at v = 30, VIOLATED with robustness -1.5; give a wider "
        "range"
    )
    open_end = ["always(speed > 30 implies eventually[0:1](gnt > ?v))", "--range", "v=3:9"]
    assert refused([*open_end, "runs/b.csv"], capsys).endswith(
        "runs/b.csv comes closest at v = 3, UNDECIDED with robustness 0; the samples that would "
        "decide it are missing; leave it out, or judge it as complete with --end complete"
    )


@pytest.mark.parametrize(("words", "message"), entries(Path(__file__).with_name("mine.txt")))
def test_mistakes_have_a_way_out(words: str, message: str, capsys: Output) -> None:
    assert refused(shlex.split(words), capsys) == message


def test_files_are_mined_without_gymnasium() -> None:
    program = (
        "import sys; sys.modules['gymnasium'] = None; from rtamt_gym.__main__ import main; "
        f"sys.exit(main(['mine', '{BELOW}', '--range', 'v=0:200', '--', 'runs']))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)  # noqa: PLW1510 - our own program
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("v = 31.501 is the smallest for which all 2 traces satisfy ")
