"""What the arguments of several commands have in common."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import rtamt
from rtamt import InputError
from rtamt_gym.recorded.readers import READERS, open_recording

if TYPE_CHECKING:
    from rtamt_gym.recorded.trace import Trace

__all__ = [
    "Commands",
    "add_reading",
    "add_trace",
    "check_folder",
    "positive",
    "read_samples",
    "read_specs",
    "variables_of",
    "whole",
]

Commands: TypeAlias = "argparse._SubParsersAction[Any]"  # noqa: SLF001 - it has no public name
"""What commands are added to."""


def add_reading(command: argparse.ArgumentParser, otherwise: str) -> None:
    """Adds what says how a trace is read; ``otherwise`` is the period if none is given."""
    command.add_argument(
        "--period",
        metavar="TIME",
        help=f"time between samples: 0.1 (seconds) or 100ms ({otherwise})",
    )
    command.add_argument(
        "--view",
        choices=("episode", "step"),
        default="episode",
        help="whether a formula speaks of the whole, as seen from the first sample, "
        "or of every sample (episode)",
    )


def add_trace(command: argparse.ArgumentParser) -> None:
    """Adds specifications, a trace, and how it is read."""
    command.add_argument(
        "specs",
        nargs="+",
        metavar="SPEC",
        help="the path of a .stl file, name=path, or a formula; one or more",
    )
    *others, last = READERS
    command.add_argument(
        "trace",
        metavar="TRACE",
        help=f"the path of a {', '.join(others)} or {last} file, or - for CSV on stdin",
    )
    add_reading(command, "read from a column 'time', else bounds count samples")


def whole(text: str) -> int:
    """The type of a whole number, 0 or more."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a whole number, got {text!r}")
    return int(text)


def positive(text: str) -> int:
    """The type of a whole number, 1 or more."""
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected a whole number greater than 0, got {text!r}")
    return int(text)


def _read_spec(argument: str) -> rtamt.Specification:
    """The specification that an argument means: a path has no blank, bracket or comparison."""
    if re.search(r"[\s(<>=!]", argument) and not Path(argument).is_file():
        return rtamt.parse(argument)
    return rtamt.load(argument)


def read_specs(arguments: Sequence[str]) -> dict[str, rtamt.Specification]:
    """The specifications that arguments mean, each by a name of its own."""
    specs: dict[str, rtamt.Specification] = {}
    for argument in arguments:
        named = re.fullmatch(r"(\w+)=([^\s(<>=!]+\.stl)", argument)
        spec = _read_spec(named[2] if named else argument)
        own = (n for n, formula in spec.formulas.items() if formula is spec.formula)
        name = named[1] if named else spec.name or next(own, None)
        if name is None:
            is_path = argument.endswith(".stl")
            name = Path(argument).stem if is_path else f"spec{len(specs) + 1 if specs else ''}"
        if name in specs:
            raise InputError(f"expected one specification {name!r}, got two; name one of them")
        specs[name] = spec
    return specs


def variables_of(specs: Mapping[str, rtamt.Specification]) -> list[str]:
    """The variables of all specifications."""
    return list(dict.fromkeys(v for spec in specs.values() for v in spec.variables))


def read_samples(
    options: argparse.Namespace, specs: Mapping[str, rtamt.Specification], events: str = ""
) -> tuple[Trace, str | Fraction | None]:
    """The samples that the arguments of `add_trace` mean, and the period.

    Args:
        options: The arguments.
        specs: Say which columns are read.
        events: As for `read_trace`.
    """
    from rtamt_gym.recorded.trace import read_trace

    with open_recording(options.trace) as recording:
        trace = read_trace(recording, variables_of(specs), events)
    if options.period is not None:
        return trace, options.period
    period = trace.period()
    if period is None and trace.times is not None and any(s.timed for s in specs.values()):
        raise InputError(
            f"{trace.source}: expected at least two samples to read the period from, got one; "
            "give --period in seconds"
        )
    return trace, period


def check_folder(path: Path) -> None:
    """Refuses a file in a folder that is not there."""
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no folder {path.parent}")
