"""`rtamt mine`: finds the tightest constant for which recorded traces satisfy a requirement."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from rtamt import InputError
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.commands import SEPARATOR
from rtamt_gym.commands.traces import TracesAsked, read_arguments, read_trace_of, refuse_unknown
from rtamt_gym.commands.traces import add_arguments as add_traces
from rtamt_gym.options.command_line import Option, add_options, read_evaluation_options
from rtamt_gym.recorded.progress import progress
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.results.warnings import VerdictWarning, print_warnings

if TYPE_CHECKING:
    from rtamt_gym.search.mining.traces import Samples


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Finds the tightest value of a parameter for which all traces satisfy a requirement. A ? "
        "before a name makes it the parameter: always(speed < ?v), eventually[0:?t](x > 1). Exits "
        "0 if there is such a value, otherwise 2."
    )
    parser.epilog = "example: rtamt mine 'always(speed < ?v)' --range v=0:200 -- runs/*.csv"
    add_traces(parser, "mine", "the requirement: a formula or a .stl file")
    parser.usage = (
        "rtamt mine [options] SPEC --range NAME=LOW:HIGH TRACE\n"
        "       rtamt mine [options] SPEC --range NAME=LOW:HIGH -- TRACE..."
    )
    add_options(
        parser,
        Option(
            "--range NAME=LOW:HIGH",
            "the parameter with its range, v=0:200; other parameters need a value, --constant w=3",
            several=True,
            required=True,
        ),
        Option(
            "--tolerance STEP",
            "resolution of the value, 0 for all floats; not for a bound of an interval, which "
            "is a multiple of the period",
            usual="the power of ten at or below a 100000th of the range",
        ),
        Option("--json", "print JSON instead of text"),
    )


def run(options: argparse.Namespace) -> int:
    """Mine the parameter and print the result; return 0."""
    from rtamt_gym.search.mining.mining import mined_over
    from rtamt_gym.search.mining.requirement import check_parameter, template, unmarked
    from rtamt_gym.search.mining.traces import notes_on

    name, low, high = _read_range(options.range)
    tolerance = _read_tolerance(options.tolerance)
    if read_evaluation_options(options).dense:
        raise InputError("rtamt mine judges samples; expected no --dense")
    refuse_unknown(options, "rtamt mine", "compares the robustness of traces")
    count = options.specs.index(SEPARATOR) if SEPARATOR in options.specs else len(options.specs)
    if count != 1:
        raise InputError(
            f"expected one specification, got {count}; for several traces write SPEC -- TRACE..."
        )
    text = _text_of(options.specs[0])
    plain, marked = unmarked(text)
    options.specs[0] = plain if marked else options.specs[0]
    fixed = dict.fromkeys(assignment.partition("=")[0].strip() for assignment in options.constant)
    check_parameter(text, name, dict.fromkeys(fixed, 1.0))
    options.constant = [*options.constant, f"{name}={low}"]
    request, paths = read_arguments(options)
    if len(request.specs) != 1:
        raise InputError(
            f"expected one requirement, got {listing(request.specs)}; give --only with its name"
        )
    (spec,) = request.specs.values()
    wanted = template(
        spec,
        {name: (low, high)},
        every=request.reading.view == "step",
        text=text if marked else "",
    )
    traces = []
    with progress("reading", len(paths), "trace") as advance:
        for path in paths:
            traces.append(_read(request, path))
            advance(1)
    mined = mined_over(wanted, traces, tolerance, notes_on(traces), shown=True)
    print(mined.to_json() if options.json else mined)
    if options.json and mined.never_triggered:
        print_warnings([VerdictWarning(mined.never_triggered)], stderr=True)
    return 0


def _read_range(arguments: list[str]) -> tuple[str, float, float]:
    if len(arguments) != 1:
        raise InputError(
            f"--range: expected one parameter, got {len(arguments)}; mine one parameter, and set "
            "the others with --constant w=3"
        )
    name, _, span = (part.strip() for part in arguments[0].partition("="))
    ends = read_floats(span.split(":"))
    if not name.isidentifier() or ends is None or len(ends) != 2:
        raise InputError(f"--range: expected NAME=LOW:HIGH, such as v=0:200, got {arguments[0]!r}")
    return name, ends[0], ends[1]


def _read_tolerance(text: str | None) -> float | None:
    if text is None:
        return None
    read = read_floats([text])
    if read is None or not 0 <= read[0] < math.inf:
        raise InputError(f"--tolerance: expected a number, such as 0.01, or 0, got {text!r}")
    return read[0]


def _text_of(word: str) -> str:
    """Return the text of a formula, or of the file that the word names."""
    if word.endswith(".stl"):
        return Path(word).read_text(encoding="utf-8-sig", errors="replace")
    return word


def _read(request: TracesAsked, path: str) -> Samples:
    """Read a trace under the options of evaluation."""
    from rtamt_gym.search.mining.traces import Samples

    trace, period = read_trace_of(request, path)
    assert isinstance(trace, Trace), "dense time was refused"  # noqa: S101 - for mypy
    return Samples(
        path,
        path,
        trace.columns,
        request.reading.having(period=period),
        trace.samples,
        trace.start,
        tuple(trace.notes),
    )
