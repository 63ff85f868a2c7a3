"""The options of ``rtamt monitor`` about all violations: lists, tables and clips."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rtamt import InputError
from rtamt_gym.commands.specs import variables_of
from rtamt_gym.commands.traces import TracesAsked, read_trace_of
from rtamt_gym.options.command_line import Option, positive
from rtamt_gym.recorded.columns import read_seconds
from rtamt_gym.recorded.readers import is_bag
from rtamt_gym.tables import counted

if TYPE_CHECKING:
    from rtamt_gym.results.matrix import Matrix

OPTIONS: Final = (
    Option(
        "--occurrences",
        "list every violation of each requirement and the answers to its triggers, in the report "
        "and in --json",
    ),
    Option(
        "--write-occurrences FILE",
        "write every violation, trigger and undecided stretch of all traces as .csv, .csv.gz, "
        ".parquet, .feather or .arrow",
        read=Path,
    ),
    Option(
        "--clip FOLDER",
        "write the part of the recording around each violation to an empty folder: CSV and Parquet "
        "in their own format, bags as MCAP",
        read=Path,
    ),
    Option(
        "--clip-around TIME",
        "the time before and after a violation in its clip, such as 500ms",
        usual="2s",
    ),
    Option("--clip-limit N", "the maximum number of clips", read=positive, usual="20"),
)
"""The options."""


def are_needed(options: argparse.Namespace) -> bool:
    """Return whether an option needs the occurrences."""
    return bool(options.occurrences or options.write_occurrences or options.clip)


def check_arguments(
    options: argparse.Namespace, request: TracesAsked, paths: Sequence[str]
) -> None:
    """Raise InputError if the table or the clips cannot be written."""
    if options.write_occurrences is not None:
        from rtamt_gym.recorded.output import check_output

        check_output(options.write_occurrences)
    if options.clip is None:
        for name in ("--clip-around", "--clip-limit"):
            if getattr(options, name.strip("-").replace("-", "_")) is not None:
                raise InputError(f"{name} sets how clips are cut; add --clip FOLDER")
        return
    from rtamt_gym.recorded.occurrences import check_clips

    if request.reading.period is not None and not all(map(is_bag, paths)):
        raise InputError("--clip: expected the times of the recording, got --period")
    _around(options)
    check_clips(options.clip, paths)


def _around(options: argparse.Namespace) -> float:
    return float(read_seconds("--clip-around", options.clip_around or "2s"))


def report(options: argparse.Namespace, matrix: Matrix) -> Sequence[str]:
    """Return the lines about all violations, between empty lines."""
    if not options.occurrences:
        return []
    from rtamt_gym.recorded.occurrences import occurrence_lines

    return ["", *occurrence_lines(matrix.rows), ""]


def write_files(
    options: argparse.Namespace, request: TracesAsked, matrix: Matrix, paths: Sequence[str]
) -> list[str]:
    """Write the table and the clips; return a line about each."""
    messages = []
    if options.write_occurrences is not None:
        from rtamt_gym.recorded.occurrences import save_occurrences

        save_occurrences(matrix.rows, options.write_occurrences)
        messages.append(f"occurrences: {options.write_occurrences}\n")
    if options.clip is not None:
        messages.append(_write_clips(options, request, matrix, paths))
    return messages


def _write_clips(
    options: argparse.Namespace, request: TracesAsked, matrix: Matrix, paths: Sequence[str]
) -> str:
    from rtamt_gym.recorded.names import with_columns
    from rtamt_gym.recorded.occurrences import clips_of, write_table_clips

    clips, left_out = clips_of(matrix.rows, _around(options), options.clip_limit or 20)
    options.clip.mkdir(parents=True, exist_ok=True)
    for path, own in zip(paths, clips, strict=True):
        if own and is_bag(path):
            from rtamt_gym.recorded.bag_output import write_bag_clips

            trace, _ = read_trace_of(request, path)
            spans = {options.clip / f"{clip.name}.mcap": (clip.begin, clip.end) for clip in own}
            write_bag_clips(path, trace.epoch, spans)
        elif own:
            names = variables_of(request.specs)
            columns = with_columns(request.specs, request.columns)
            write_table_clips(path, names, columns, own, options.clip)
    written = counted(sum(map(len, clips)), "clip")
    more = f"; --clip-limit leaves out {counted(left_out, 'violation')}" if left_out else ""
    return f"{written}: {options.clip}{more}\n"
