"""`rtamt monitor`: a recorded trace, judged."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rtamt import Verdict
from rtamt_gym.commands.arguments import Commands, add_reading, read_spec

__all__ = ["add"]


def add(commands: Commands) -> None:
    """Adds the arguments of `rtamt monitor`."""
    monitor = commands.add_parser(
        "monitor",
        help="judge a recorded trace",
        description="Judges a file of samples: comma-separated values below a line of names. "
        "Columns that the specification does not read are ignored. Exits 1 on a violation, "
        "else 0.",
        allow_abbrev=False,
    )
    monitor.add_argument("spec", metavar="SPEC", help="the path of a .stl file, or a formula")
    monitor.add_argument("trace", metavar="TRACE", help="the path of a .csv file, or - for stdin")
    add_reading(monitor, "read from a column 'time', else bounds count samples")
    monitor.set_defaults(run=_monitor)


def _monitor(options: argparse.Namespace) -> int:
    from rtamt_gym.judge import judge
    from rtamt_gym.trace import read_trace

    spec = read_spec(options.spec)
    if options.trace == "-":
        trace = read_trace(sys.stdin, "stdin", spec.variables)
    else:
        with Path(options.trace).open(encoding="utf-8-sig", newline="") as file:
            trace = read_trace(file, options.trace, spec.variables)
    judgement = judge(spec, trace, options.period, options.view)
    print(*judgement.lines(), sep="\n")
    return 1 if judgement.verdict == Verdict.VIOLATED else 0
