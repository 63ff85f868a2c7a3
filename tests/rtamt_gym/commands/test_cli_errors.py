"""Errors of the command line: one message on stderr, exit code 2."""

import io
import sys
from pathlib import Path

import pytest
from catalogue import entries
from command_line import run_without

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
ERRORS = entries(Path(__file__).with_name("cli_errors.txt"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with specifications and traces, good and bad."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.stl").write_text("always(speed < 30)")
    (tmp_path / "trace.csv").write_text("speed\n29\n31\n")
    (tmp_path / "bad.stl").write_text("always\n(speed > )")
    (tmp_path / "latin.csv").write_bytes(b"speed\n\xe4\n")
    (tmp_path / "latin.doc").write_bytes(b"speed\n\xe4\n")
    return tmp_path


@pytest.mark.parametrize(
    ("trace", "message"),
    [
        ("", "stdin: expected a first line with the names of the columns, got none"),
        ("x\n", "stdin: expected at least one sample below the line of names"),
        (
            "0,1\n2,3\n",
            (
                "stdin, line 1: expected the names of the columns, got 0, 1; "
                "write a line of names first, such as time,x"
            ),
        ),
        (
            "time,z,xx\n0,1,2\n",
            (
                "stdin: no column 'x', which the specification reads; "
                "the columns are time, z, xx; did you mean 'xx'?"
            ),
        ),
        (
            "time:x\n0:1\n",
            (
                "stdin: no column 'x', which the specification reads; "
                "the columns are time:x; say with --separator what stands between columns, or with "
                "--skip N how many lines stand before the names"
            ),
        ),
        (
            "time,variable,value\n0,x,1\n",
            (
                "stdin: no column 'x', which the specification reads; the columns are "
                "time, variable, value; give --dense to take rows as events at any time"
            ),
        ),
        ("x,x\n1,2\n", "stdin, line 1: expected one column 'x', got two"),
        ("x,y\n1,2\n3\n", "stdin, line 3: expected 2 values (x, y), got 1"),
        ("x,y\n1,2\n\na,4\n", "stdin, line 4, column 'x': expected a number, got 'a'"),
        (
            "x\nnan\n",
            (
                "stdin, line 2, column 'x': expected a number, got 'nan'; "
                "give --missing unknown, or --missing hold if the value before holds; "
                "give --dense to take rows as events at any time"
            ),
        ),
        ("x,time\n1,inf\n", "stdin, line 2, column 'time': expected a finite number, got inf"),
        (
            "time,x\n0,1\n0.5,1\n1,1\n1.7,1\n2.2,1\n",
            (
                "stdin, line 5: expected samples at even distances, got time 1.7 after 1, "
                "elsewhere 0.5 s; give --dense to take rows as events at any time or --jitter 5% "
                "to resample by holding values"
            ),
        ),
        (
            "time,x\n1,1\n1,2\n",
            (
                "stdin, column 'x': expected one value at 1 s, got 1 and 2; choose with "
                "--same-time first or --same-time last"
            ),
        ),
        (
            "time,x\n0,1\n",
            (
                "stdin: expected at least two samples to read the period from, got one; "
                "give --period in seconds"
            ),
        ),
        (
            "time,x\n0,1\n0.4,1\n",
            (
                "STL:1:7: bound 1 s is not a multiple of the period 0.4 s (2.5 steps)\n"
                "  always[0:1](x > 0)\n"
                "        ^\n"
                "  hint: use 0.8 s or 1.2 s, take samples 0.2 s apart, or let --align round it"
            ),
        ),
        (
            'x,y\n1,"' + "a" * 200_000 + '"\n',
            "stdin, line 2: field larger than field limit (131072)",
        ),
    ],
)
def test_a_bad_trace_is_refused_in_one_message_that_says_where(
    capsys: Output, monkeypatch: pytest.MonkeyPatch, trace: str, message: str
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(trace))
    assert main(["monitor", "always[0:1](x > 0)", "-"]) == 2
    assert capsys.readouterr() == ("", f"rtamt: error: {message}\n")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("arguments", "message"), ERRORS)
def test_bad_input_is_refused_in_one_message_and_exit_code_2(
    capsys: Output, arguments: str, message: str
) -> None:
    assert main(arguments.split()) == 2
    assert capsys.readouterr() == ("", f"rtamt: error: {message}\n")


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_monitor_needs_no_extra() -> None:
    ran = run_without(
        ["gymnasium", "mujoco", "highway_env", "matplotlib"], ["monitor", "spec.stl", "trace.csv"]
    )
    assert (ran.returncode, ran.stderr) == (1, "")


@pytest.mark.usefixtures("folder")
def test_empty_requirement_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["monitor", "", "trace.csv"]) == 2
    assert "expected a requirement, got an empty text; write always" in capsys.readouterr().err


@pytest.mark.slow(keep=2)
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("module", "extra", "arguments"),
    [
        ("gymnasium", "gym", ["run", "CartPole-v1", "--spec", "always(x > 0)"]),
        ("highway_env", "highway", ["demo"]),
        ("matplotlib", "plot", ["demo"]),
        ("scipy", "search", ["falsify", "rtamt/RequestGrant-v0", "--budget", "2"]),
        ("scipy", "files", ["monitor", "spec.stl", "trace.mat"]),
        ("scipy", "search", ["sweep", "rtamt/RequestGrant-v0", "--samples", "2"]),
    ],
)
def test_a_missing_extra_is_named(module: str, extra: str, arguments: list[str]) -> None:
    ran = run_without([module], arguments)
    assert (ran.returncode, ran.stdout, ran.stderr) == (
        2,
        "",
        f"rtamt: error: {module} is not installed; from the checkout: pip install '.[{extra}]'\n",
    )


def test_misspelt_command_error(capsys: Output) -> None:
    assert main(["moniter", "spec.stl", "trace.csv"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("rtamt: error: No command 'moniter'. The commands are 'demo', 'init'")
    assert error.endswith("'export'. Did you mean 'monitor'?\n")
