"""Errors of the library name Python arguments; commands name their options instead."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from paths import ROOT

from rtamt import InputError
from rtamt.errors import Advice, Argument, shown_lines
from rtamt_gym.__main__ import main
from rtamt_gym.commands import COMMANDS
from rtamt_gym.commands.errors import options_of, refusal
from rtamt_ros.parameters import PARAMETERS

Output = pytest.CaptureFixture[str]

# Arguments without an option of a command.
OF_PYTHON = {
    *("batch", "cost", "eval_freq", "inputs", "keep", "modules", "names", "observe", "outputs"),
    *("resamples", "resolution", "window"),
}


def calls() -> Iterator[ast.Call]:
    """Return every ``Argument(...)`` with a literal name."""
    for package in ("rtamt", "rtamt_gym", "rtamt_ros"):
        for path in (ROOT / package).rglob("*.py"):
            if "Argument(" in (text := path.read_text()):
                for node in ast.walk(ast.parse(text)):
                    if isinstance(node, ast.Call) and ast.unparse(node.func) == "Argument":
                        yield node


def name_of(call: ast.Call) -> str | None:
    first = call.args[0]
    return str(first.value) if isinstance(first, ast.Constant) else None


NAMES = sorted({name for call in calls() if (name := name_of(call))})


@pytest.mark.parametrize("name", [name for name in NAMES if name not in OF_PYTHON])
def test_an_argument_of_errors_is_an_option_of_some_command(name: str) -> None:
    assert name in PARAMETERS or any(name in options_of(command) for command in COMMANDS)


@pytest.mark.parametrize("name", sorted(OF_PYTHON))
def test_an_argument_of_python_alone_is_no_option(name: str) -> None:
    assert not any(name in options_of(command) for command in COMMANDS)


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("command", COMMANDS)
def test_advice_names_options_that_the_command_has(command: str, capsys: Output) -> None:
    assert main([command, "--help"]) == 0
    helped = capsys.readouterr().out
    if command == "compare":  # it names the command that creates its input
        assert main(["evaluate", "--help"]) == 0
        helped += capsys.readouterr().out
    for call in calls():
        name = name_of(call)
        if name is None or name in OF_PYTHON:
            continue
        words = any(keyword.arg == "words" for keyword in call.keywords)
        valued = len(call.args) > 1 or any(each.arg == "value" for each in call.keywords)
        argument = Argument(name, 3 if valued else ..., "call another function" if words else "")
        said = refusal(InputError("wrong", Advice("; give ", argument)), options_of(command))
        assert said is not None
        if said == "wrong":  # the command has no such option, and the advice would not help
            assert name not in options_of(command)
            continue
        assert "another function" not in said
        (option,) = re.findall(r"(?<![\w-])-[a-z-]+", said)
        assert re.search(rf"(?<![\w-]){option}(?![\w-])", helped)


@pytest.mark.slow
@given(st.text(), st.sampled_from(NAMES))
def test_text_that_looks_like_an_argument_stays_as_it_was_given(text: str, name: str) -> None:
    error = InputError(f"got {name}={text}")
    for command in ("run", "monitor", "falsify"):
        assert refusal(error, options_of(command)) == f"got {name}={shown_lines(text)}"


def test_notes_on_what_an_error_carries_are_for_python_callers(tmp_path: Path) -> None:
    error = InputError("nan")
    error.add_note("error.run holds 3 samples, up to sample 2")
    error.add_note(f"in {tmp_path}")
    assert refusal(error, {}) == f"in {tmp_path}: nan"
