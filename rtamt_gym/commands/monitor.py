"""`rtamt monitor`: a recorded trace, judged."""

from __future__ import annotations

import argparse
from pathlib import Path

from rtamt import InputError, Verdict
from rtamt_gym.commands.arguments import (
    Commands,
    add_trace,
    check_folder,
    read_samples,
    read_specs,
    variables_of,
)

__all__ = ["add"]


def add(commands: Commands) -> None:
    """Adds the arguments of `rtamt monitor`."""
    monitor = commands.add_parser(
        "monitor",
        help="judge a recorded trace",
        description="Judges a file of samples or events under one specification or more. Columns "
        "that no specification reads are ignored. Exits 1 on a violation, else 0.",
        epilog="example: rtamt monitor requirements.stl drive.csv --out robustness.csv",
        allow_abbrev=False,
    )
    add_trace(monitor)
    monitor.add_argument(
        "--dense",
        action="store_true",
        help="rows are events at any time, each value holding until the next; an empty cell is "
        "no event; or one event a row, in the columns time, variable and value",
    )
    monitor.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="write the robustness of every formula as .csv",
    )
    monitor.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw the signals and the robustness"
    )
    monitor.set_defaults(run=_monitor)


def _monitor(options: argparse.Namespace) -> int:
    from rtamt_gym.recorded.judge import described, judge, judge_events, report, signals_of
    from rtamt_gym.recorded.output import save_csv
    from rtamt_gym.recorded.readers import open_recording
    from rtamt_gym.recorded.trace import EventTrace, Trace, read_events

    specs = read_specs(options.specs)
    for path in filter(None, (options.out, options.plot)):
        check_folder(path)
    if options.plot:
        from rtamt_gym.drawing import check_format

        check_format(options.plot)
    trace: EventTrace | Trace
    if options.dense:
        if options.period is not None:
            raise InputError("expected --period or --dense, which reads events at any time")
        with open_recording(options.trace) as recording:
            trace = read_events(recording, variables_of(specs))
        judgements = {n: judge_events(spec, trace, options.view) for n, spec in specs.items()}
    else:
        events = "give --dense to take rows as events at any time"
        trace, period = read_samples(options, specs, events)
        judgements = {n: judge(spec, trace, period, options.view) for n, spec in specs.items()}
    first = next(iter(judgements.values()))
    print(*report(judgements, described(trace, first.period)), sep="\n")
    if options.out:
        save_csv(judgements, options.out, dense=options.dense)
        print(f"robustness: {options.out}")
    if options.plot:
        from rtamt_gym.recorded.plot import draw_trace

        signals = signals_of(trace, first.period)
        draw_trace(signals, judgements, trace.source).savefig(options.plot, dpi=110)
        print(f"picture: {options.plot}")
    violated = any(j.verdict == Verdict.VIOLATED for j in judgements.values())
    return 1 if violated else 0
