"""Arguments that several commands have: specifications, traces, files to write."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import rtamt
from rtamt import InputError
from rtamt_gym.judges.interface import Semantics
from rtamt_gym.recorded.readers import extensions, open_recording

if TYPE_CHECKING:
    from rtamt_gym.recorded.trace import EventTrace, Trace

__all__ = [
    "add_align",
    "add_dense",
    "add_environment",
    "add_output",
    "add_reading",
    "add_specs_and_trace",
    "check_outputs",
    "positive",
    "read_dense",
    "read_options",
    "read_requirements",
    "read_samples",
    "read_specs",
    "variables_of",
    "whole",
]


def add_environment(parser: argparse.ArgumentParser, *, needed: bool = True) -> None:
    """Adds the id of an environment and ``--env-kwarg``, which `read_options` reads."""
    parser.add_argument(
        "env_id",
        nargs=None if needed else "?",
        metavar="ENV_ID",
        help="such as CartPole-v1 or module:Name-v0",
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


def add_reading(parser: argparse.ArgumentParser, default: str) -> None:
    """Adds ``--period``, whose default is described by a text, ``--view`` and ``--semantics``."""
    parser.add_argument(
        "--period",
        metavar="TIME",
        help=f"time between samples: 0.1 (seconds) or 100ms (default: {default})",
    )
    parser.add_argument(
        "--view",
        choices=("episode", "step"),
        default="episode",
        help="episode: a formula is evaluated at the first sample; step: at every sample, and all "
        "have to satisfy it (default: episode)",
    )
    parser.add_argument(
        "--semantics",
        metavar="NAME",
        choices=get_args(Semantics),
        default="standard",
        help=f"how predicates count: {', '.join(get_args(Semantics))}; those about inputs or "
        "outputs read the declarations of the text (default: standard)",
    )


def add_align(parser: argparse.ArgumentParser) -> None:
    """Adds ``--align``."""
    parser.add_argument(
        "--align",
        choices=("outward", "inward", "nearest"),
        help="how a bound that is no multiple of the period is rounded to samples (default: such "
        "a bound is an error)",
    )


def add_dense(parser: argparse.ArgumentParser) -> None:
    """Adds ``--dense``, under which the trace consists of events."""
    parser.add_argument(
        "--dense",
        action="store_true",
        help="rows are events at any time, and a value holds until the next event; an empty cell "
        "is no event; with the columns time, variable and value a row is one event",
    )


def add_output(parser: argparse.ArgumentParser, option: str, help_line: str) -> None:
    """Adds an option that names a file to write."""
    parser.add_argument(option, type=Path, metavar="FILE", help=help_line)


def add_specs_and_trace(parser: argparse.ArgumentParser) -> None:
    """Adds the specifications, the trace, and the options that say how it is read."""
    parser.add_argument(
        "specs",
        nargs="+",
        metavar="SPEC",
        help="the path of a .stl file, name=path, or a formula",
    )
    *others, last = extensions()
    parser.add_argument(
        "trace",
        metavar="TRACE",
        help=f"the path of a {', '.join(others)} or {last} file, or - for CSV on stdin",
    )
    add_reading(parser, "the distance of two times; without a column 'time', bounds count samples")


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


def _read_spec(argument: str) -> rtamt.Specification:
    """Reads a formula or the path of a file; a path has no blank, bracket or comparison."""
    if re.search(r"[\s(<>=!]", argument) and not _is_file(argument):
        return rtamt.parse(argument)
    return rtamt.load(argument)


def _is_file(argument: str) -> bool:
    try:
        return Path(argument).is_file()
    except OSError:  # a formula may be longer than a file's name can be
        return False


def read_specs(arguments: Sequence[str]) -> dict[str, rtamt.Specification]:
    """Reads specifications whose last formulas are judged, each under a different name.

    The name is that given in ``name=path``, else that in the text, else that of the file, else
    ``spec``, ``spec2`` and so on.

    Raises:
        InputError: If two specifications have the same name.
    """
    specs: dict[str, rtamt.Specification] = {}
    for argument in arguments:
        given, spec = _read_argument(argument)
        _add(specs, given or spec.title or _name(argument, specs), spec)
    return specs


def read_requirements(arguments: Sequence[str]) -> dict[str, rtamt.Specification]:
    """Reads specifications of which every requirement is judged, each under a different name.

    One with a single requirement has the name that `read_specs` gives it. Of several requirements
    each has its own name in the text, behind that given in ``name=path``: ``safe.near``.

    Raises:
        InputError: If two requirements have the same name.
    """
    specs: dict[str, rtamt.Specification] = {}
    for argument in arguments:
        given, spec = _read_argument(argument)
        if len(spec.requirements) == 1:
            _add(specs, given or spec.title or _name(argument, specs), spec)
            continue
        for name, requirement in spec.requirements.items():
            _add(specs, f"{given}.{name}" if given else name, requirement)
    return specs


def _read_argument(argument: str) -> tuple[str | None, rtamt.Specification]:
    """Reads the name that an argument gives, or None, and the specification."""
    named = re.fullmatch(r"(\w+)=([^\s(<>=!]+\.stl)", argument)
    return (named[1], _read_spec(named[2])) if named else (None, _read_spec(argument))


def _name(argument: str, specs: Mapping[str, rtamt.Specification]) -> str:
    """Names a specification that has no name: after its file, or by its number."""
    if argument.endswith(".stl"):
        return Path(argument).stem
    return f"spec{len(specs) + 1 if specs else ''}"


def _add(specs: dict[str, rtamt.Specification], name: str, spec: rtamt.Specification) -> None:
    if name in specs:
        raise InputError(f"expected one specification {name!r}, got two; name one of them")
    specs[name] = spec


def variables_of(specs: Mapping[str, rtamt.Specification]) -> list[str]:
    """The variables of all specifications, each once."""
    return list(dict.fromkeys(v for spec in specs.values() for v in spec.variables))


def read_dense(options: argparse.Namespace, specs: Mapping[str, rtamt.Specification]) -> EventTrace:
    """Reads the events of the trace.

    Raises:
        InputError: If the trace cannot be read, or there is a period.
    """
    from rtamt_gym.recorded.trace import read_events

    if options.period is not None:
        raise InputError("expected --period or --dense, which reads events at any time")
    with open_recording(options.trace) as recording:
        return read_events(recording, variables_of(specs))


def read_samples(
    options: argparse.Namespace, specs: Mapping[str, rtamt.Specification]
) -> tuple[Trace, str | Fraction | None]:
    """Reads the samples of the trace, and the period: that given, else that of the trace.

    Args:
        options: The arguments of `add_specs_and_trace`.
        specs: The specifications, whose variables are the columns to read.

    Raises:
        InputError: If the trace cannot be read, or is too short to have a period.
    """
    from rtamt_gym.recorded.trace import read_trace

    if_events = "give --dense to take rows as events at any time"
    with open_recording(options.trace) as recording:
        trace = read_trace(recording, variables_of(specs), if_events=if_events)
    if options.period is not None:
        return trace, options.period
    period = trace.period()
    if period is None and trace.times is not None and any(s.timed for s in specs.values()):
        raise InputError(
            f"{trace.source}: expected at least two samples to read the period from, got one; "
            "give --period in seconds"
        )
    return trace, period


def check_outputs(*files: Path | None, picture: Path | None) -> None:
    """Checks the files that a command is to write before it begins; None is no file.

    Raises:
        InputError: If a folder does not exist, or the picture's name has no known format.
    """
    for path in filter(None, (*files, picture)):
        if not path.parent.is_dir():
            raise InputError(f"cannot write {path}: there is no folder {path.parent}")
    if picture:
        from rtamt_gym.drawing import check_format

        check_format(picture)
