"""Arguments that several commands have: environments, readings, numbers, files to write."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.judging.reading import ROWS, Reading

if TYPE_CHECKING:
    from rtamt_gym.signals.signals import SignalLike

__all__ = [
    "EPISODES",
    "add_accept_changed",
    "add_environment",
    "add_folder",
    "add_max_steps",
    "add_output",
    "add_reading",
    "add_require_triggered",
    "add_spec",
    "add_workers",
    "check_outputs",
    "positive",
    "read_options",
    "read_reading",
    "read_signals",
    "whole",
    "with_default_count",
]


def add_environment(
    parser: argparse.ArgumentParser,
    metavar: str = "ENV_ID",
    about: str = "such as CartPole-v1 or module:Name-v0",
    *,
    needed: bool = True,
) -> None:
    """Adds the id of an environment and ``--env-kwarg``, which `read_options` reads."""
    parser.add_argument(
        "env_id",
        nargs=None if needed else "?",
        metavar=metavar,
        help=about,
    )
    parser.add_argument(
        "--env-kwarg",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="an argument of the environment, its value in JSON or else text: frame_skip=2, "
        "xml_file=./hopper.xml, 'config={\"duration\": 20}'; may be repeated",
    )


def read_options(arguments: Sequence[str]) -> dict[str, Any]:
    """Reads ``--env-kwarg``: values in JSON, or as Python writes them, or else text.

    Raises:
        InputError: If an argument has no ``=``, a key comes twice, or a list or an object is not
            JSON.
    """
    options: dict[str, Any] = {}
    for argument in arguments:
        key, _, value = (part.strip() for part in argument.partition("="))
        if not (key.isidentifier() and value):
            raise InputError(
                f"--env-kwarg: expected KEY=VALUE, such as frame_skip=2, got {argument!r}"
            )
        if key in options:
            raise InputError(f"--env-kwarg: expected one {key!r}, got two")
        options[key] = _read_value(value)
    return options


_PYTHON = {"True": True, "False": False, "None": None}
"""What would be text, and so true, if it were not read as Python writes it."""


def _read_value(text: str) -> Any:  # noqa: ANN401 - what JSON holds
    if text in _PYTHON:
        return _PYTHON[text]
    try:
        return json.loads(text)
    except ValueError as error:
        if text[0] in "[{":
            raise InputError(
                f"--env-kwarg: expected JSON, such as '{{\"duration\": 20}}', got {text!r}: {error}"
            ) from error
        return text


def add_spec(parser: argparse.ArgumentParser) -> None:
    """Adds ``--spec``."""
    parser.add_argument(
        "--spec",
        action="append",
        default=[],
        metavar="SPEC",
        help="a formula, name = formula, the path of a .stl file, name=path, or the name of a "
        "requirement of the scenario; may be repeated (default: all of the scenario)",
    )


def add_max_steps(parser: argparse.ArgumentParser) -> None:
    """Adds ``--max-steps``."""
    parser.add_argument(
        "--max-steps",
        type=positive,
        metavar="N",
        help="time limit of an episode in steps (default: the environment's own)",
    )


def read_signals(arguments: Sequence[str]) -> dict[str, SignalLike]:
    """Reads ``--signal NAME=SELECTOR``, with the value at reset behind a comma.

    Raises:
        InputError: If an argument is not of this form, or a name comes twice.
    """
    signals: dict[str, SignalLike] = {}
    for argument in arguments:
        name, _, selector = (part.strip() for part in argument.partition("="))
        if not (name and selector):
            raise InputError(
                f"--signal: expected NAME=SELECTOR, such as angle=obs[2], got {argument!r}"
            )
        if name in signals:
            raise InputError(f"--signal: expected one signal {name!r}, got two")
        signals[name] = selector
        value, comma, reset = selector.rpartition(",")
        if comma and "]" not in reset:  # a comma before a bracket belongs to a key
            at_reset = [None] if reset.strip() == "unknown" else read_floats([reset])
            if at_reset is None:
                raise InputError(
                    "--signal: expected a number behind the comma, the value at reset, or unknown, "
                    f"got {argument!r}"
                )
            signals[name] = (value, *at_reset)
    return signals


EPISODES = (
    *("period", "view", "semantics", "align", "at_termination", "at_truncation"),
    *("below", "rescaled"),
)
"""The options of a reading that commands have which judge episodes."""


def add_reading(parser: argparse.ArgumentParser, *names: str, **defaults: str) -> None:
    """Adds options of `Reading`, which `read_reading` reads, with the words that stand there.

    Args:
        parser: The parser of the command.
        *names: The names of the options.
        **defaults: The default of an option in words, where its row has another.
    """
    for name in names:
        row = ROWS[name]
        option, default = f"--{name.replace('_', '-')}", defaults.get(name, row.default)
        about = re.sub(r'`+"?|"?`+', "", row.metadata["about"]).rstrip(".").replace("%", "%%")
        about = about[0].lower() + about[1:]
        if row.type == "bool":
            parser.add_argument(option, action="store_true", default=argparse.SUPPRESS, help=about)
            continue
        parser.add_argument(
            option,
            choices=[choice for choice in row.metadata["choices"] if choice is not None] or None,
            metavar=row.metadata["metavar"] or None,
            default=argparse.SUPPRESS,
            help=about if default is None else f"{about} (default: {default})",
        )


def read_reading(options: argparse.Namespace) -> Reading:
    """The reading that was asked for; what is not among the arguments is not given."""
    return Reading(**{name: value for name, value in vars(options).items() if name in ROWS})


def add_output(parser: argparse.ArgumentParser, option: str, help_line: str) -> None:
    """Adds an option that names a file to write."""
    parser.add_argument(option, type=Path, metavar="FILE", help=help_line)


def whole(text: str) -> int:
    """Reads an argument that is a whole number."""
    if not _is_whole(text):
        raise argparse.ArgumentTypeError(f"expected a whole number, got {text!r}")
    return int(text)


def positive(text: str) -> int:
    """Reads an argument that is a whole number greater than 0."""
    if not _is_whole(text) or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected a whole number greater than 0, got {text!r}")
    return int(text)


def _is_whole(text: str) -> bool:
    return text.isascii() and text.isdecimal()


def check_outputs(*files: Path | None, picture: Path | None, inputs: Sequence[str] = ()) -> None:
    """Checks the files that a command is to write before it begins; None is no file.

    Args:
        files: The files.
        picture: One more, whose name says its format.
        inputs: The files that the command reads; other arguments may be among them.

    Raises:
        InputError: If a folder does not exist, or a file is a folder, is read, or is to be written
            twice, or the picture's name has no known format.
    """
    read = {Path(name).resolve() for name in inputs}
    written: set[Path] = set()
    for path in filter(None, (*files, picture)):
        whole = path.resolve()
        if whole in read:
            raise InputError(f"cannot write {shown(str(path))}: it is read")
        if whole in written:
            raise InputError(f"cannot write {shown(str(path))}: two options name it")
        written.add(whole)
        if path.is_dir():
            raise InputError(f"cannot write {shown(str(path))}: it is a folder")
        if not path.parent.is_dir():
            raise InputError(f"cannot write {shown(str(path))}: there is no folder {path.parent}")
    if picture:
        from rtamt_gym.drawing import check_format

        check_format(picture)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Adds ``-j`` and ``--timeout``, of simulations in processes of their own."""
    parser.add_argument(
        "-j",
        dest="n_jobs",
        type=positive,
        metavar="N",
        help="run simulations in N processes of their own: one that crashes loses itself alone",
    )
    parser.add_argument(
        "--timeout",
        type=float,
        metavar="SECONDS",
        help="end a simulation that takes longer, even if it hangs; it runs in another process",
    )


def add_folder(parser: argparse.ArgumentParser, trial: str, also: str = "") -> None:
    """Add ``--folder`` and ``--accept-changed``.

    Args:
        parser: The parser of the command.
        trial: The word for a result, such as ``simulation``.
        also: When else the same command goes on.
    """
    parser.add_argument(
        "--folder",
        type=Path,
        metavar="FOLDER",
        help=f"keep finished {trial}s there; after an interruption the same command goes on{also}, "
        "unless the model, its source, its policy, rtamt or the simulator has changed",
    )
    add_accept_changed(parser, f"use the {trial}s in --folder")


def add_accept_changed(parser: argparse.ArgumentParser, use: str) -> None:
    """Add ``--accept-changed``; ``use`` says what it does."""
    parser.add_argument(
        "--accept-changed",
        action="store_true",
        help=f"{use} although the model, its source, its policy, rtamt or the simulator has "
        "changed since; the output states it",
    )


_TRIGGERED: Final = ("--require-triggered", "--require-asked")


def with_default_count(words: Sequence[str]) -> list[str]:
    """Return the command line with ``=1`` after each bare ``--require-triggered``.

    The option takes a value only in the form ``--require-triggered=N``: the word after the bare
    option is an argument of its own, such as a specification.
    """
    return [f"{word}=1" if word in _TRIGGERED else word for word in words]


def _trials(text: str) -> int | Literal["all"]:
    if text == "all":
        return "all"
    if not _is_whole(text) or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected all or a whole number from 1 on, got {text!r}")
    return int(text)


def add_require_triggered(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``--require-triggered`` and ``--require-answered``, which `Required.of` reads.

    Args:
        parser: The parser of the command.
        what: The word for a trial, such as ``trace``.
    """
    parser.add_argument(
        *_TRIGGERED,
        type=_trials,
        metavar="N",
        help=f"exit 3 if a requirement with an implication is triggered in fewer than N {what}s "
        "and nothing is violated; N stands behind =, as in --require-triggered=5, and may be all "
        "(default without =N: 1)",
    )
    parser.add_argument(
        "--require-answered",
        action="store_true",
        help=f"exit 3 too if the verdict on such a requirement hangs on an answer in no {what}: "
        "each that puts it to the test satisfies it without one, or leaves it open",
    )
