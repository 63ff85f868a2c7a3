"""What the command line refuses: one message on stderr, exit code 2."""

import io
import sys
from pathlib import Path

import pytest
from command_line import run_without

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with specifications and traces, good and bad."""
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
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("", "the following arguments are required: COMMAND; see rtamt --help"),
        (
            "monitor spec.stl",
            "the following arguments are required: TRACE; see rtamt monitor --help",
        ),
        ("monitor no.stl trace.csv", "cannot open no.stl: No such file or directory"),
        (
            "monitor spc.stl trace.csv",
            "cannot open spc.stl: No such file or directory; did you mean 'spec.stl'?",
        ),
        (
            "monitor spc.stl --constant a=1 -- trace.csv",
            "cannot open spc.stl: No such file or directory; did you mean 'spec.stl'?",
        ),
        (
            "monitor spec.stl trace.csv --juint x.xml",
            (
                "unrecognized arguments: --juint x.xml; did you mean '--junit'?; "
                "see rtamt monitor --help"
            ),
        ),
        (
            "monitor spec.stl trace.csv --screen",
            (
                "unrecognized arguments: --screen; --screen is an option of rtamt run, watch; "
                "see rtamt monitor --help"
            ),
        ),
        (
            "watch spec.stl trace.csv --require-triggered",
            (
                "unrecognized arguments: --require-triggered; --require-triggered is an option of "
                "rtamt run, evaluate, compare, sweep, falsify, replay, monitor, explain; "
                "see rtamt watch --help"
            ),
        ),
        ("monitor spec.stl trace.csv --junit --", "argument --junit: expected a value, got '--'"),
        ("monitor --out -- spec.stl trace.csv", "argument --out: expected a value, got '--'"),
        (
            "explain spec.stl --period -- trace.csv",
            "argument --period: expected a value, got '--'",
        ),
        ("monitor spec.stl no.csv", "cannot open no.csv: No such file or directory"),
        (
            "monitor latin.csv trace.csv",
            (
                "expected a specification, got the trace latin.csv; for several traces write "
                "SPEC... -- latin.csv trace.csv"
            ),
        ),
        (
            "monitor spec.stl latin.csv",
            "latin.csv, line 2, column 'speed': expected a number, got 'ä'",
        ),
        (
            "monitor spec.stl latin.doc",
            (
                "latin.doc: expected a name that ends in .csv, .csv.gz, .tsv, .txt, .parquet, "
                ".feather, .arrow, .ndjson, .jsonl, .npz, .mat, .mf4, .mdf, .ulg, .bin, .hdf5, "
                ".h5, .sqlite, .sqlite3, .db, .xml, .xml.gz, .mcap, .db3 or .bag"
            ),
        ),
        (
            "monitor bad.stl trace.csv",
            (
                "in bad.stl: STL:2:10: expected an operand after '>', got ')'\n"
                "  (speed > )\n"
                "           ^\n"
                "  hint: write a variable, a number or '(' there"
            ),
        ),
        (
            "monitor speed<30 trace.csv",
            (
                "the specification is about the first sample only; "
                "write always(speed < 30) or --view step"
            ),
        ),
        (
            "monitor spec.stl trace.csv --period 0",
            "expected a period from 1e-300 to 1e300 s, or text such as \"100ms\", got '0'",
        ),
        (
            "run CartPol-v1 --spec always(x<1) --signal x=obs[0]",
            (
                "cannot make CartPol-v1: Environment `CartPol` doesn't exist. "
                "Did you mean: `CartPole`?"
            ),
        ),
        (
            "run CartPole-v1 --spec always(x<1)",
            (
                "variable 'x' has no signal; pass --signal \"x=obs[INDEX]\""
                ", or declare a constant: const float x = VALUE"
            ),
        ),
        (
            "run CartPole-v1 --spec always(x<1) --signal x=obs[4]",
            (
                "signal 'x': obs[4] does not fit: the observation space has 4 elements there, "
                "0 to 3; it is Box(shape=(4,), dtype=float32)"
            ),
        ),
        (
            "run CartPole-v1 --spec always(x<1) --signal x=action",
            (
                "signal 'x': action has no value at reset; "
                'give a first value, --signal "x=action,VALUE", or --signal '
                '"x=action,unknown" if it is unknown: then no always over it can be '
                "satisfied"
            ),
        ),
        (
            "run CartPole-v1 --spec always(x<1) --signal x=action,up",
            (
                "--signal: expected a number after the comma, the value at reset, or unknown, got "
                "'x=action,up'"
            ),
        ),
        (
            "run CartPole-v1 --spec always(x<1) --signal x",
            "--signal: expected NAME=SELECTOR, such as angle=obs[2], got 'x'",
        ),
        (
            "run CartPole-v1 --spec always(x<1) --signal x=obs[0] --signal x=obs[1]",
            "--signal: expected one signal 'x', got two",
        ),
        (
            "run CartPole-v1 --spec a=always(x<1) --spec a=always(x<2) --signal x=obs[0]",
            "expected one specification 'a', got two; rename one",
        ),
        (
            "run CartPole-v1 --spec x<1 --signal x=obs[0]",
            (
                "specification 'spec' is about the first sample only; "
                "write always(x < 1) or --view step"
            ),
        ),
        (
            "run Blackjack-v1 --spec always[0:2](x<1) --signal x=obs[0]",
            (
                "specification 'spec' has bounds in time, but Blackjack-v1 does not state the "
                "duration of a step: there is no dt, tau or config['policy_frequency'] in it, or "
                "in an environment inside it; give --period in seconds, or --period 1 if every "
                "bound counts steps"
            ),
        ),
        (
            "run CartPole-v1 --spec always(x<1) --signal x=obs[0] --plot x.doc",
            "cannot draw x.doc: expected a name that ends in .png, .svg or .pdf",
        ),
        (
            "run CartPole-v1 --spec always(x<1) --signal x=obs[0] --json no/x.json",
            "cannot write no/x.json: the folder no does not exist",
        ),
        (
            "run CartPole-v1 --spec always(x<1) --episodes 0",
            (
                "argument --episodes: expected a whole number greater than 0, got '0'; "
                "see rtamt run --help"
            ),
        ),
        (
            "run CartPole-v1 --spec always(x<1) --seed -1",
            "argument --seed: expected a whole number, got '-1'; see rtamt run --help",
        ),
        ("demo --plot no/x.png", "cannot write no/x.png: the folder no does not exist"),
    ],
)
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
