"""Errors in the words of the command line.

To add an option with another name than its argument in Python, add a row to `_CALLED`. If an error
quotes code, ``Argument("dense", words="...")``, add the text for the command line to `_WRITTEN`.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import Final

from rtamt.errors import Argument, RtamtError, shown, shown_lines
from rtamt_gym.checks.extras import advice, missing
from rtamt_gym.commands import COMMANDS
from rtamt_gym.tables import shorten

_CALLED: Final[Mapping[str, str]] = {
    "constants": "constant",
    "defaults": "default",
    "nan": "missing",
    "ranges": "range",
    "rates": "rate",
    "signals": "signal",
    "space": "vary",
}
"""The option of each argument that has another name in Python."""

_OF_RESULTS: Final[Mapping[str, str]] = {"compare": "evaluate"}
"""The command that writes the input of a command; errors may name its options too."""

_WRITTEN: Final[Mapping[str, str]] = {
    "defaults": "{}",
    "dense": "leave out {}",
    "duration": "give {} 30, in seconds",
    "policy": "{} names one",
    "signals": "{}",
    "space": "write {} mass=1:2",
}
"""The text for the command line where the error for Python callers quotes code."""


_NEEDS: Final[Mapping[str, str]] = {
    **dict.fromkeys(("evaluate", "falsify", "replay", "sweep"), "search"),
    "report": "report",
}
"""The extra that installs the packages of a command."""


def refusal(error: Exception, options: Mapping[str, str], command: str = "") -> str | None:
    """Return the message for an error that a user can cause; None for unexpected errors.

    Args:
        error: The error.
        options: The options of the command by argument name, as `options_of` returns them.
        command: The command of `rtamt`; empty for another program.
    """
    match error:
        case RtamtError():
            text = error.message.worded(lambda argument: _worded(argument, options))
            # Notes on attributes of an error are for Python callers.
            notes = [n for n in getattr(error, "__notes__", []) if not n.startswith("error.")]
            return shown_lines(": ".join([*notes, text]))
        case ModuleNotFoundError():
            package = missing(error)
            if package is None:
                return None
            return f"{package} is not installed; {advice(package, _NEEDS.get(command, ''))}"
        case OSError():
            name = "" if error.filename is None else f" {shown(str(error.filename))}"
            return f"cannot open{name}: {error.strerror or error}"
    return None


@cache
def options_of(command: str) -> Mapping[str, str]:
    """Return the options of a command by argument name."""
    if command not in COMMANDS:
        return {}
    source = _OF_RESULTS.get(command, "")
    return {**options_of(source), **options_in(_parser_of(command))}


@cache
def valued(command: str) -> frozenset[str]:
    """Return the options of a command that are followed by a value."""
    actions = _parser_of(command)._actions  # noqa: SLF001 - argparse has no other list of them
    return frozenset(
        name for action in actions if action.nargs is None for name in action.option_strings
    )


def _parser_of(command: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(add_help=False)
    with suppress(RtamtError):  # of a package that adds to a table: this is the error to word
        import_module(f"rtamt_gym.commands.{command}").add_arguments(parser)
    return parser


def options_in(parser: argparse.ArgumentParser) -> Mapping[str, str]:
    """Return the options of a parser by argument name."""
    options = {
        action.dest: action.option_strings[-1]
        for action in parser._actions  # noqa: SLF001 - argparse has no other list of them
        if action.option_strings
    }
    renamed = {name: options[other] for name, other in _CALLED.items() if other in options}
    return {**options, **renamed}


def _worded(argument: Argument, options: Mapping[str, str]) -> str | None:
    """Return an argument as an option; None if the command does not have the option."""
    option = options.get(argument.name)
    if option is None:
        return None
    if argument.value is not ...:
        return " ".join(filter(None, (option, _value(argument.value))))
    return _WRITTEN[argument.name].format(option) if argument.words else option


def _value(value: object) -> str:
    """Return the text of a value after an option; empty for a switch."""
    match value:
        case True:
            return ""
        case float():
            return f"{value:g}"
        case tuple() | list():
            return ",".join(map(_value, value))
        case dict():
            text = ",".join(f"{name}={_value(element)}" for name, element in value.items())
            return text if re.fullmatch(r"[\w.:=-]+", text) else f'"{text}"'
    return str(value)


def unexpected(error: Exception) -> str:
    """Return the message for an unexpected error."""
    return f"unexpected {type(error).__name__}: {shorten(shown(str(error)), 200)}"
