"""`rtamt monitor`: judges a recorded trace."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rtamt import Verdict
from rtamt_gym.commands.arguments import (
    add_dense,
    add_output,
    add_specs_and_trace,
    check_outputs,
    read_dense,
    read_samples,
    read_specs,
)

if TYPE_CHECKING:
    from rtamt_gym.recorded.trace import EventTrace, Trace

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Judges a file of samples or events under one or more specifications. Columns that no "
        "specification reads are ignored. Exits 1 on a violation, else 0."
    )
    parser.epilog = "example: rtamt monitor requirements.stl drive.csv --out robustness.csv"
    add_specs_and_trace(parser)
    add_dense(parser)
    add_output(parser, "--out", "write the robustness of every formula to a .csv file")
    add_output(parser, "--plot", "draw the signals and the robustness")


def run(options: argparse.Namespace) -> int:
    """Prints the verdicts and writes the files asked for; returns 1 on a violation, else 0."""
    from rtamt_gym.recorded.judge import described, judge, judge_events, report, signals_of
    from rtamt_gym.recorded.output import save_csv

    specs = read_specs(options.specs)
    check_outputs(options.out, picture=options.plot)
    trace: EventTrace | Trace
    if options.dense:
        trace = read_dense(options, specs)
        judgements = {
            name: judge_events(spec, trace, options.view, options.semantics)
            for name, spec in specs.items()
        }
    else:
        trace, period = read_samples(options, specs)
        judgements = {
            name: judge(spec, trace, period, options.view, options.semantics)
            for name, spec in specs.items()
        }
    first = next(iter(judgements.values()))
    print(*report(judgements, described(trace, first.period)), sep="\n")
    if options.out:
        save_csv(judgements, options.out, dense=options.dense)
        print(f"robustness: {options.out}")
    if options.plot:
        from rtamt_gym.drawing import save
        from rtamt_gym.recorded.plot import draw_trace

        signals = signals_of(trace, first.period)
        save(draw_trace(signals, judgements, trace.source), options.plot)
        print(f"picture: {options.plot}")
    violated = any(j.verdict == Verdict.VIOLATED for j in judgements.values())
    return 1 if violated else 0
