"""`rtamt monitor`: a recorded trace, judged."""

from __future__ import annotations

import argparse
from pathlib import Path

from rtamt import Verdict
from rtamt_gym.commands.arguments import (
    Commands,
    add_trace,
    check_folder,
    read_samples,
    read_specs,
)

__all__ = ["add"]


def add(commands: Commands) -> None:
    """Adds the arguments of `rtamt monitor`."""
    monitor = commands.add_parser(
        "monitor",
        help="judge a recorded trace",
        description="Judges a file of samples under one specification or more. Columns "
        "that no specification reads are ignored. Exits 1 on a violation, else 0.",
        epilog="example: rtamt monitor requirements.stl drive.csv --out robustness.csv",
        allow_abbrev=False,
    )
    add_trace(monitor)
    monitor.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="write the robustness of every formula as .csv",
    )
    monitor.set_defaults(run=_monitor)


def _monitor(options: argparse.Namespace) -> int:
    from rtamt_gym.judge import described, judge, report
    from rtamt_gym.output import save_csv

    specs = read_specs(options.specs)
    if options.out:
        check_folder(options.out)
    trace, period = read_samples(options, specs)
    judgements = {name: judge(spec, trace, period, options.view) for name, spec in specs.items()}
    first = next(iter(judgements.values()))
    print(*report(judgements, described(trace, first.period)), sep="\n")
    if options.out:
        save_csv(judgements, options.out, dense=False)
        print(f"robustness: {options.out}")
    violated = any(j.verdict == Verdict.VIOLATED for j in judgements.values())
    return 1 if violated else 0
