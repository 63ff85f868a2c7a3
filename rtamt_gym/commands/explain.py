"""`rtamt explain`: prints which samples or times of recorded traces decided the robustness."""

from __future__ import annotations

import argparse
import sys

from rtamt import Verdict
from rtamt_gym.commands.traces import add_arguments as add_traces
from rtamt_gym.commands.traces import read_arguments
from rtamt_gym.options.command_line import add_options
from rtamt_gym.results.warnings import (
    Required,
    evidence_warnings,
    exit_code,
    length_warnings,
    print_warnings,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Follows the robustness of a recorded trace through the formulas of the specification to "
        "the predicate and the sample or time that decided it. If several have the same value, it "
        "shows the first operand and the first sample. The exit codes are as for rtamt monitor."
    )
    parser.epilog = "example: rtamt explain requirements.stl drive.csv --only near"
    add_traces(parser, "explain")
    add_options(
        parser,
        "--require-triggered",
        "--require-answered",
        "--min-duration",
        trial="trace",
    )


def run(options: argparse.Namespace) -> int:
    """Print an explanation for each requirement of each trace; return the exit code."""
    from rtamt_gym.commands.judging import failure_lines, judge_files, matrix_of
    from rtamt_gym.results.matrix import note_lines, undecided_lines

    request, paths = read_arguments(options)
    rows = judge_files(request, paths, workers=1, explain=tuple(Verdict))
    texts = []
    for row in rows:
        for name, cell in row.outcomes.items():
            names = [row.name] * (len(rows) > 1) + [name] * (len(request.specs) > 1)
            lines = [f"{', '.join(names)}:"] if names else []
            lines.append(cell.explanation)
            if cell.way_out:
                lines += ["", cell.text, *undecided_lines(cell.not_recorded, cell.way_out)]
            texts.append("\n".join(lines))
    if texts:
        print(*texts, sep="\n\n", flush=True)
    matrix = matrix_of(request, rows)
    extent_lines = [line for row in rows if row.extent for line in row.extent.lines(row.name)]
    if extent_lines := [*extent_lines, *note_lines(matrix)]:
        print("", *extent_lines, sep="\n", flush=True)
    warnings = evidence_warnings(matrix, "trace", Required.of(options))
    warnings += length_warnings(rows, request.min_duration)
    print_warnings(warnings)
    print(*failure_lines(matrix), sep="", end="", file=sys.stderr)
    return exit_code([matrix.word], warnings)
