"""The command line, `rtamt COMMAND`.

A command returns its exit code. On bad input, the code is 2, with one message on stderr; on an
unexpected error too, after its traceback. An error never exits with 1, which means a violation or
another verdict than expected. Commands import Gymnasium, MuJoCo and matplotlib when they need them.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from importlib import import_module
from itertools import pairwise
from typing import Any, Final, NoReturn, TextIO, cast

import rtamt
from rtamt import InputError
from rtamt.errors import nearest, no_such, shown_lines
from rtamt.renamed import new_options
from rtamt_gym.commands import COMMANDS, LISTED, OF_TRACES, SEPARATOR
from rtamt_gym.commands.errors import options_of, refusal, unexpected, valued
from rtamt_gym.results.warnings import INTERRUPTED

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    words = sys.argv[1:] if argv is None else argv
    if sys.stdout is None:  # in a program without a console
        return _run(words)
    output = _Output(sys.stdout)
    with redirect_stdout(cast("TextIO", output)):
        code = _run(words)
    return _BROKEN_PIPE if output.closed_by_reader else code


def _run(words: Sequence[str]) -> int:
    options = None
    try:
        options = _options(words)
        code: int = options.run(options)
        print(end="", flush=True)
    except SystemExit as end:
        if options is None and not end.code:  # --help and --version
            return 0
        # also with code 0: the program ended before a verdict
        return _refuse(f"the program was ended by what it ran: SystemExit({end.code!r})")
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # from standard error, or from code that the command runs
        return _BROKEN_PIPE
    except Exception as error:  # noqa: BLE001 - Python's own exit code would be 1
        command = _command(words)
        message = refusal(error, options_of(command), command)
        if message is None:
            above = shown_lines("".join(traceback.format_exception(error)))
            return _refuse(unexpected(error), above)
        return _refuse(message)
    return code


_BROKEN_PIPE: Final = 141
"""The exit code if the reader of our output has ended, such as `head`."""


class _Output:
    """Standard output that drops further text after its reader has ended; files are still written.

    Attributes:
        closed_by_reader: Whether its reader has ended.

    Args:
        stream: Standard output.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.closed_by_reader = False

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - what the stream has
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text."""
        if not self.closed_by_reader:
            with self._dropping():
                self._stream.write(text)
        return len(text)

    def writelines(self, texts: Iterable[str]) -> None:
        """Write texts."""
        for text in texts:
            self.write(text)

    def flush(self) -> None:
        """Write the buffered text."""
        if not self.closed_by_reader:
            with self._dropping():
                self._stream.flush()

    @contextmanager
    def _dropping(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            self.closed_by_reader = True
            # discard buffered output: at exit Python would print an error of its own
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


def _command(argv: Sequence[str]) -> str:
    return next((word for word in argv if not word.startswith("-")), "")


def _options(argv: Sequence[str]) -> argparse.Namespace:
    argv = written = new_options(argv)
    command = _command(argv)
    if command == "monitor":
        if "numpy" not in sys.modules:
            # The command multiplies no matrices, and its workers start faster from one thread.
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        from rtamt_gym.commands.monitor import discard_old_outcomes

        discard_old_outcomes(argv)
    if command and command not in COMMANDS:
        raise InputError(no_such("command", command, COMMANDS))
    parser = _parser(command)
    if command:  # the list of commands is printed without NumPy, which this module needs
        from rtamt_gym.options.command_line import with_default_count

        argv = with_default_count(argv)
    if command in OF_TRACES:
        argv = _separated(argv, command)
    options, remainder = parser.parse_known_args(argv)
    plain = not any(text.startswith("-") for text in remainder)
    if remainder and command in OF_TRACES and plain:
        # argparse ends the list of specifications at the first option after it.
        options.specs += [options.trace, *remainder]
        options.trace = options.specs.pop()
    elif remainder and "requirements" in options and plain:
        options.requirements = [
            *options.requirements,
            *remainder,
        ]  # requirements after the first option
    elif command == "watch" and options.source == "-" and len(remainder) == 1 and plain:
        (options.source,) = remainder  # argparse takes the default before the first option
    elif remainder:
        # argparse leaves them to the parser of all commands.
        added = {*with_default_count(written)} - {*written}
        remainder = [word.partition("=")[0] if word in added else word for word in remainder]
        near = _instead(remainder, command)
        raise InputError(
            f"unrecognized arguments: {' '.join(remainder)}{near}; "
            f"see {parser.prog} {command} --help"
        )
    return options


_SAME: Final = {
    "--at-truncation": "--end",
    "--at-termination": "--end",
    "--end": "--at-truncation",
    "--spec": "--requirement",
    "--requirement": "--spec",
}
"""Options with another name in other commands."""


def _instead(rest: Sequence[str], command: str) -> str:
    """Return a clause with the option that is meant; empty if none is similar."""
    option, equals, value = rest[0].partition("=")
    known = [*options_of(command).values()]
    if (same := _SAME.get(option)) in known:
        value = value if equals else (rest[1] if len(rest) > 1 else "")
        return f"; write {same} {value}".rstrip()
    others = [name for name in COMMANDS if option in options_of(name).values()]
    if option.startswith("--") and others:
        return f"; {option} is an option of rtamt {', '.join(others)}"
    return nearest(option, known)


def _separated(argv: Sequence[str], command: str) -> list[str]:
    """Return the arguments with `SEPARATOR` for each ``--``, which argparse drops.

    Raises:
        InputError: If ``--`` stands where an option has its value.
    """
    for option, separator in pairwise(argv):
        if separator == "--" and option in valued(command):
            raise InputError(f"argument {option}: expected a value, got '--'")
    listed = any(word.partition("=")[0] == "--files-from" for word in argv)
    more = ["--", LISTED] if listed and "--" not in argv else []
    return [SEPARATOR if word == "--" else word for word in (*argv, *more)]


def _refuse(message: str, above: str = "") -> int:
    with suppress(OSError):  # stderr may be closed, or a file on a full disk
        print(f"{above}rtamt: error: {message}", file=sys.stderr)
    return 2


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}{_choice_hint(message)}; see {self.prog} --help")


def _choice_hint(message: str) -> str:
    """Return a clause with the choice that is meant, for a message of argparse; may be empty."""
    wrong = re.search(r"argument ([\w-]+): invalid choice: '?(.*?)'? \(choose from (.*)\)", message)
    if wrong is None:
        return ""
    if wrong[1] == "--end" and wrong[2] == "failure":
        return "; failure is for environments, --at-termination failure"
    return nearest(wrong[2], re.findall(r"[\w.-]+", wrong[3]))


class _Version(argparse.Action):
    """Print the version; only then import the machines, for the name of the back-end."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(f"rtamt {rtamt.__version__} ({rtamt.BACKEND})")
        parser.exit()


def _parser(chosen: str) -> argparse.ArgumentParser:
    """Return the parser of the command line, with the arguments of the chosen command."""
    parser = _Parser(
        prog="rtamt",
        description="Monitors simulations and recorded traces under Signal Temporal Logic.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version",
        action=_Version,
        dest=argparse.SUPPRESS,
        default=argparse.SUPPRESS,
        nargs=0,
        help="show program's version number and exit",
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, line in COMMANDS.items():
        command = commands.add_parser(name, help=line, allow_abbrev=False)
        if name == chosen:
            module = import_module(f"rtamt_gym.commands.{name}")
            module.add_arguments(command)
            command.set_defaults(run=module.run)
    return parser


if __name__ == "__main__":
    sys.exit(main())
