"""Exit code 1 means a violation: no error has it, expected or not."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from gymnasium.envs.classic_control import CartPoleEnv

from rtamt_gym import demo
from rtamt_gym.__main__ import main
from rtamt_gym.recorded import cells, judge

Output = pytest.CaptureFixture[str]
WIDE = " and ".join(f"abs(x - {i}) > 0.25" for i in range(40))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with a trace."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trace.csv").write_text("time,x\n0,1.5\n1,2.5\n2,3.5\n")
    return tmp_path


def descend() -> Any:  # noqa: ANN401
    return descend()


def recurse(*_: object, **__: object) -> None:
    # Python 3.13.0 does not limit the depth of a function that calls itself with *args.
    descend()


def divide(*_: object, **__: object) -> float:
    return 1 / 0


def leave(*_: object, **__: object) -> None:
    sys.exit("enough")


def leave_with_a_code(*_: object, **__: object) -> None:
    sys.exit(1)


def leave_as_if_all_were_well(*_: object, **__: object) -> None:
    sys.exit(0)


COMMANDS = {
    "monitor": (["monitor", "always(x > 2)", "trace.csv"], judge, "judge"),
    "monitor --dense": (["monitor", "always(x > 2)", "trace.csv", "--dense"], judge, "_parts"),
    "explain": (["explain", "always(x > 2)", "trace.csv"], judge, "viewed"),
    "reader": (["explain", "always(x > 2)", "trace.csv"], cells, "_numbers_in"),
    "demo": (["demo"], demo, "watch"),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("fails", "message"),
    [
        (recurse, "unexpected RecursionError: maximum recursion depth exceeded"),
        (divide, "unexpected ZeroDivisionError: division by zero"),
        (leave, "the program was ended by what it ran: SystemExit('enough')"),
        (leave_with_a_code, "the program was ended by what it ran: SystemExit(1)"),
        (leave_as_if_all_were_well, "the program was ended by what it ran: SystemExit(0)"),
    ],
)
def test_an_unexpected_error_is_code_2_with_a_message(
    command: str,
    fails: Callable[..., object],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Output,
) -> None:
    arguments, module, name = COMMANDS[command]
    monkeypatch.setattr(module, name, fails)
    assert main(arguments) == 2
    *_, last = capsys.readouterr().err.splitlines()
    assert last.startswith(f"rtamt: error: {message}")


class Faulty(CartPoleEnv):
    """An environment whose steps fail."""

    def step(self, action: object) -> Any:  # noqa: ANN401, ARG002
        raise ValueError("the simulator has crashed " + "x" * 999)


def test_an_error_of_an_environment_is_code_2_below_its_traceback(capsys: Output) -> None:
    gym.register("Faulty-v0", lambda **_: Faulty())
    try:
        command = ["run", "Faulty-v0", "--spec", "always(x < 9)", "--signal", "x=obs[0]"]
        assert main(command) == 2
    finally:
        del gym.registry["Faulty-v0"]
    shown = capsys.readouterr().err
    assert "in step" in shown
    last = shown.splitlines()[-1]
    assert last.startswith("rtamt: error: unexpected ValueError: the simulator has crashed xxx")
    assert last.endswith("xxx...")
    assert len(last) < 300


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(
    ("text", "trace", "code"),
    [
        ("always(x > 0)", "t.csv", 0),
        ("always(x > 1)", "t.csv", 1),
        ("always[0:9](x > 0)", "t.csv", 3),
        ("always(x > 0)", "absent.csv", 2),
        ("always(x >> 0)", "t.csv", 2),
    ],
)
@pytest.mark.parametrize("closed", ["sys.stderr = open(os.devnull)", "sys.stderr = None"])
def test_the_code_is_the_same_where_errors_cannot_be_written(
    text: str, trace: str, code: int, closed: str, folder: Path
) -> None:
    (folder / "t.csv").write_text("time,x\n0,1\n1,2\n")
    program = f"import os, sys; from rtamt_gym.__main__ import main; {closed}; sys.exit(main())"
    command = [sys.executable, "-c", program, "monitor", text, trace]
    assert subprocess.run(command, capture_output=True, cwd=folder, check=False).returncode == code


def test_the_code_is_the_same_where_nothing_can_be_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "t.csv").write_text("time,x\n0,1\n1,2\n")
    monkeypatch.setattr(sys, "stdout", None)
    assert main(["monitor", "always(x > 1)", str(folder / "t.csv")]) == 1


def test_a_module_that_no_extra_installs_is_code_2(
    monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    def absent(*_: object, **__: object) -> None:
        raise ModuleNotFoundError("No module named 'colorama'", name="colorama")

    monkeypatch.setattr(judge, "judge", absent)
    assert main(COMMANDS["monitor"][0]) == 2
    assert capsys.readouterr().err.endswith(
        "rtamt: error: unexpected ModuleNotFoundError: No module named 'colorama'\n"
    )


def test_a_formula_longer_than_the_name_of_a_file_is_a_formula(capsys: Output) -> None:
    assert main(["monitor", f"always({WIDE})", "trace.csv"]) == 0
    assert capsys.readouterr().out.startswith("SATISFIED, robustness 0.25, ")


@pytest.mark.parametrize(
    "command",
    [
        ["monitor", WIDE, "trace.csv"],
        ["explain", WIDE, "trace.csv"],
        ["run", "CartPole-v1", "--spec", WIDE, "--signal", "x=obs[0]"],
    ],
)
def test_a_wide_formula_is_no_wider_in_an_error(command: list[str], capsys: Output) -> None:
    assert main(command) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(
        "is about the first sample only; write always(abs(x - 0) > 0.25 and abs(x - 1) > 0.25 "
        "and abs(x - 2) > ...) or --view step"
    )


# Numbers that `float` and `int` read, and no other program. --------------------------------------


@pytest.mark.parametrize("cell", ["1_0", "٣", "1٫5", "１", "1e1_0"])  # noqa: RUF001
@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_a_cell_that_is_no_plain_number_is_refused(
    cell: str, dense: list[str], folder: Path, capsys: Output
) -> None:
    for column, text in (("x", f"time,x\n0,1\n1,{cell}\n"), ("time", f"time,x\n0,1\n{cell},1\n")):
        (folder / "odd.csv").write_text(text, encoding="utf-8")
        assert main(["monitor", "always(x < 9)", "odd.csv", *dense]) == 2
        assert capsys.readouterr().err == (
            f"rtamt: error: odd.csv, line 3, column '{column}': expected a number, got {cell!r}\n"
        )


def test_plain_numbers_are_read(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    cells = ["7", " 8 ", "+9", "1e1", "1E+1", "7.", "0.7e1", "inf", "Infinity", "\t11"]
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n".join(["x", *cells])))
    assert main(["monitor", "always(x > 6)", "-"]) == 0
    assert capsys.readouterr().out.startswith("SATISFIED, ")


def test_an_empty_cell_beside_an_odd_one_does_not_hide_it(folder: Path, capsys: Output) -> None:
    (folder / "odd.csv").write_text("time,x,y\n0,1,1\n1,,1_0\n2,1_0,\n")
    assert main(["monitor", "always(x < 9 and y < 9)", "odd.csv", "--dense"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: odd.csv, line 3, column 'y': expected a number, got '1_0'\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--signal", "u=action[0],1_0"],
            (
                "--signal: expected a number after the comma, the value at reset, or unknown, got "
                "'u=action[0],1_0'"
            ),
        ),
        (
            ["--signal", "u=action[0],٣"],
            (
                "--signal: expected a number after the comma, the value at reset, or unknown, got "
                "'u=action[0],٣'"
            ),
        ),
        (["--seed", "٣"], "argument --seed: expected a whole number, got '٣'"),
        (
            ["--episodes", "٣"],
            "argument --episodes: expected a whole number greater than 0, got '٣'",
        ),
        (["--seed", "1_0"], "argument --seed: expected a whole number, got '1_0'"),
    ],
)
def test_an_argument_that_is_no_plain_number_is_refused(
    arguments: list[str], message: str, capsys: Output
) -> None:
    assert main(["run", "CartPole-v1", "--spec", "always(u < 9)", *arguments]) == 2
    assert capsys.readouterr().err.startswith(f"rtamt: error: {message}")


# Periods that no float or no memory holds. -------------------------------------------------------


@pytest.mark.parametrize("command", ["monitor", "explain"])
@pytest.mark.parametrize("formula", ["always(x > 0)", "always[0:1](x > 0)"])
@pytest.mark.parametrize("period", ["1e400", "1e-400", "1e99999999", "1_0", "٣", "1" * 5000])
def test_a_period_out_of_range_is_refused(
    command: str, formula: str, period: str, capsys: Output
) -> None:
    assert main([command, formula, "trace.csv", "--period", period]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("rtamt: error: expected a period from 1e-300 to 1e300 s, or text ")
    assert len(line) < 200


@pytest.mark.parametrize("command", ["monitor", "explain"])
@pytest.mark.parametrize(
    ("times", "got"),
    [
        (("0", "1e-320", "2e-320"), "9.99989e-321"),
        (("0", "5e-324", "1e-323"), "4.94066e-324"),
        (("0", "1e305", "2e305"), "1e+305"),
    ],
)
def test_times_that_no_period_can_have_are_refused(
    command: str, times: tuple[str, ...], got: str, folder: Path, capsys: Output
) -> None:
    (folder / "odd.csv").write_text("\n".join(["time,x", *(f"{time},1" for time in times)]))
    assert main([command, "always(x > 0)", "odd.csv"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: odd.csv, line 3: expected samples from 1e-300 to 1e+300 s apart, "
        f"got {got} s; give --period to leave the column 'time' aside\n"
    )
    assert main(["monitor", "always(x > 0)", "odd.csv", "--period", "1"]) == 0


@pytest.mark.parametrize("options", [[], ["--dense"], ["--jitter", "0.1"]])
def test_times_that_are_too_far_apart_are_code_2(
    options: list[str], folder: Path, capsys: Output
) -> None:
    (folder / "odd.csv").write_text("time,x\n-1e308,1\n1e308,1\n")
    assert main(["monitor", "always(x > 0)", "odd.csv", *options]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: odd.csv, line 3, column 'time': expected times at finite distances, got "
        "1e+308 after -1e+308; --period reads samples and ignores the column\n"
    )
    assert main(["monitor", "always(x > 0)", "odd.csv", "--period", "1"]) == 0
