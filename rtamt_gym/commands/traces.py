"""Arguments of the commands that judge recorded traces, and how the traces are read."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from glob import glob
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final, get_args

import rtamt
from rtamt import InputError
from rtamt.errors import Argument, nearest, shown
from rtamt_gym.checks.names import listing
from rtamt_gym.commands import LISTED, SEPARATOR
from rtamt_gym.commands.collection import without_collection
from rtamt_gym.commands.specs import chosen, read_constants, read_requirements, variables_of
from rtamt_gym.options.command_line import (
    Option,
    add_options,
    read_evaluation_options,
    shared,
    whole,
)
from rtamt_gym.recorded.columns import (
    UNITS,
    Columns,
    DateOrder,
    Missing,
    SameTime,
    Start,
    read_columns,
    read_seconds,
)
from rtamt_gym.recorded.parts import file_of
from rtamt_gym.recorded.readers import (
    extensions,
    folder_format,
    group_of,
    has_marks,
    is_bag,
    samples_clocks,
    traces_in,
)
from rtamt_gym.tables import shorten

if TYPE_CHECKING:
    from rtamt_gym.options.evaluation import EvaluationOptions
    from rtamt_gym.recorded.trace import EventTrace, Trace


@dataclass(frozen=True)
class TracesAsked:
    """The request of a command: requirements and how traces are read.

    Attributes:
        specs: The requirements by name.
        reading: How traces are judged.
        columns: How their columns are read.
        min_duration: Minimum length of each trace in seconds; None for any length.
        constants: The values of constants that the command line sets, by name.
        ignored: A text for each folder with files that are not traces.
        strict_ranges: Whether the command fails for values outside their declared ranges.
        groups: The values that identify each group in its file, by the name of the trace.
        occurrences: Whether all violations are listed.
    """

    specs: Mapping[str, rtamt.Specification]
    reading: EvaluationOptions
    columns: Columns
    min_duration: Fraction | None = None
    constants: Mapping[str, str] = field(default_factory=dict)
    ignored: Sequence[str] = ()
    strict_ranges: bool = False
    groups: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    occurrences: bool = False

    def having(self, specs: Mapping[str, rtamt.Specification]) -> TracesAsked:
        """Return the request for some requirements, with the ``--signal`` of their variables."""
        read = {*variables_of(specs), *_messages(specs)}
        signals = {name: where for name, where in self.columns.signals.items() if name in read}
        return replace(self, specs=specs, columns=replace(self.columns, signals=signals))


_SPECS = (
    "a .stl file, a folder of them, name=path, or a formula; every formula that no other formula "
    "of its text uses is a requirement"
)


COLUMNS: Final = (
    Option(
        "--signal VARIABLE=COLUMN",
        "the column of a variable with another name: 'speed=Vehicle Speed [km/h]'; in a bag "
        "its topic and field, speed=/odom.twist.twist.linear.x, or the topic of a message, "
        "cmd=/robot1/cmd_vel",
        repeat=True,
    ),
    Option(
        "--time COLUMN",
        "the column of times, or two, as in secs+nsecs (default: time, timestamp, t, stamp, "
        "Time [s], elapsed_time, TimeUS, Zeit ...); for a bag log, when messages were "
        "recorded, or header, their stamps",
        usual="log",
    ),
    Option(
        "--time-unit UNIT",
        f"the unit of the times: {', '.join(UNITS)} (default: the unit in the name or the "
        f"type of the column, otherwise s)",
    ),
    Option(
        "--date-order",
        "the order of day, month and year in dates such as 03/04/2024",
        usual="an error if the order matters",
        choices=get_args(DateOrder),
    ),
    Option(
        "--where COLUMN=VALUE",
        "read only rows with this text in the column, such as vehicle_id=3",
        repeat=True,
    ),
    Option(
        "--by COLUMN",
        "evaluate the rows with each value of this column, such as vehicle_id, as a trace of "
        "its own, called FILE[vehicle_id=7]",
        repeat=True,
    ),
    Option(
        "--long NAMES=VALUES",
        "with --dense: read a table with one event in each row, a name and a value, from "
        "these two columns, such as PID=VALUE",
        usual="variable=value, if they exist",
    ),
    Option(
        "--wide COLUMN",
        "evaluate a table with a row per object and time as one trace, with the names of "
        "objects from this column and variables such as speed.Ego; values of an absent object "
        "are unknown",
        several=True,
    ),
    Option(
        "--as",
        "how to read a folder with meta/info.json: lerobot, a data set with a trace per "
        "episode; files, a folder of files",
        default="lerobot",
        choices=("lerobot", "files"),
        dest="folders",
    ),
    Option(
        "--sorted",
        "with --by: read a Parquet file larger than memory in parts; the rows of each group "
        "must follow each other",
    ),
    Option(
        "--one-trace",
        "evaluate all rows as one trace, although they look like several objects or episodes",
        usual="an error",
    ),
    Option(
        "--separator CHARACTER",
        "the character between cells, such as ';' or tab",
        usual="from the line of names",
    ),
    Option(
        "--skip N",
        "skip N lines before the line of names",
        default=0,
        usual="lines that can only be comments or metadata",
        read=whole,
    ),
    Option(
        "--decimal MARK",
        "the decimal mark, . or ,",
        usual="from the cells; an error if they can be read in two ways",
    ),
    Option(
        "--missing",
        "the meaning of an empty cell, or nan in a bag: raise, an error; hold, the value "
        "before; drop, its row is left out; unknown, an unknown value, not for rtamt mine",
        default="raise",
        choices=get_args(Missing),
    ),
    Option(
        "--jitter PART",
        "samples within this part of the period, such as 5%, count as on the grid; a trace "
        "with others is resampled by holding values",
        usual="an uneven trace is an error",
    ),
    Option(
        "--stale SECONDS",
        "refuse a bag if a topic has no message for longer than this",
        usual="its last value holds, with a note on a long silence",
        read=float,
    ),
    Option(
        "--same-time",
        "the record that counts if records of a variable at one instant differ",
        usual="an error; in bags and ULog files, last",
        choices=get_args(SameTime),
    ),
    Option(
        "--max-gap TIME",
        "the longest time, such as 10s, that a value holds until the next record of its "
        "column, or with --dense and in bags until the end; after that it is unknown",
        usual="no limit, with a note on a gap of more than 10 usual steps",
    ),
    Option(
        "--default NAME",
        "use the declared default of this variable if it has no column, even with a similar "
        "column or --no-defaults",
        repeat=True,
    ),
    Option(
        "--no-defaults",
        "refuse a trace in which a variable would have its declared default value",
        usual="it has that value, with a note",
    ),
    Option(
        "--start",
        "with --dense and in bags, the time before all variables of a requirement have a "
        "value: known leaves it out; unknown reports the worse of the verdicts without it and "
        "with unknown values in it",
        default="unknown",
        choices=get_args(Start),
    ),
)
"""The options of `read_columns`."""


def add_arguments(parser: argparse.ArgumentParser, command: str, specs: str = _SPECS) -> None:
    """Add the specifications, the traces and the options for reading them."""
    parser.usage = (
        f"rtamt {command} [options] SPEC... TRACE\n"
        f"       rtamt {command} [options] SPEC... -- TRACE..."
    )
    *others, last = extensions()
    add_options(
        parser,
        Option("SPEC", specs, nargs="+", dest="specs"),
        Option(
            "TRACE",
            f"a {', '.join(others)} or {last} file, the folder of a bag or of a LeRobot data set, "
            "or - for CSV on stdin; after --, several files, folders and patterns",
        ),
        "--only",
        "--constant",
        "--end",
        shared(
            "--period",
            about="time between samples, such as 100ms; bags, PX4 logs and MDF files are sampled "
            "at this period, and a value holds until the next",
            usual="from the times; without times, bounds count samples",
        ),
        *("--view", "--semantics", "--align", "--dense"),
    )
    add_options(parser.add_argument_group("columns"), *COLUMNS)


def read_arguments(options: argparse.Namespace) -> tuple[TracesAsked, list[str]]:
    """Read the requirements and the options of evaluation, and find the traces."""
    specs, traces = _divided([*options.specs, options.trace])
    if "" in specs:
        raise InputError("expected a requirement, got an empty text; write always(x > 0)")
    if (listed := getattr(options, "files_from", None)) is not None:
        traces = [*(trace for trace in traces if trace != LISTED), *listed_paths(listed)]
    as_files = options.folders == "files"
    paths, ignored = trace_paths(traces, as_files=as_files)
    texts = [p for word in specs for p in _files(word, [".stl"], [], pattern=word.endswith(".stl"))]
    constants = read_constants(options.constant)
    all_specs = read_requirements(texts, constants)
    requirements = chosen(all_specs, options.only)
    reading = read_evaluation_options(options)
    same = {f.name for f in fields(Columns)} - {"signals", "starts", "defaults"}
    columns = read_columns(
        signals=options.signal,
        defaults=tuple(dict.fromkeys(options.default)),
        **{name: getattr(options, name) for name in same},
    )
    least = getattr(options, "min_duration", None)
    request = TracesAsked(
        *(requirements, reading, columns),
        None if least is None else read_seconds("--min-duration", least),
        constants,
        ignored,
        getattr(options, "strict_ranges", False),
    )
    request, paths = checked_request(request, all_specs, paths, as_files=as_files)
    return request.having(requirements) if options.only else request, paths


def checked_request(
    request: TracesAsked,
    all_specs: Mapping[str, rtamt.Specification],
    files: Sequence[str],
    *,
    as_files: bool = False,
) -> tuple[TracesAsked, list[str]]:
    """Check that options, requirements and files fit each other, and list the traces.

    Args:
        request: The request, without groups.
        all_specs: All requirements, including those that ``--only`` leaves out.
        files: The paths of files.
        as_files: Whether each path is a trace.
    """
    from rtamt_gym.recorded.judge import viewed
    from rtamt_gym.recorded.names import starts_of

    requirements, reading, columns, paths = (
        request.specs,
        request.reading,
        request.columns,
        [*files],
    )
    for spec in requirements.values():
        viewed(spec, reading.view)
    if reading.period is not None:
        _check_period(columns, paths, dense=reading.dense)
        reading = reading.having(period=reading.seconds)
    _check_forms(columns, dense=reading.dense)
    if not as_files:
        paths = [name for path in paths for name in traces_in(path, columns.where)]
    groups = {path: group for path in paths if (group := group_of(path))}
    if columns.by:
        from rtamt_gym.recorded.groups import groups_in

        with without_collection():
            groups = {n: keys for path in paths for n, keys in groups_in(path, columns).items()}
        paths = [*groups]
    if columns.start == "known" and not reading.dense and not any(map(samples_clocks, files)):
        raise InputError(
            "expected ",
            Argument("start", "known"),
            " with ",
            Argument("dense", True),  # noqa: FBT003 - the value of the argument
            " or with a bag or log, where variables start at times of their own",
        )
    _check_signals(columns, all_specs)
    starts_of(requirements, columns)
    _check_defaults(columns, all_specs)
    if any(map(is_bag, files)):
        from rtamt_gym.recorded.bag_topics import check_topics

        check_topics(requirements)
    return replace(request, reading=reading, groups=groups), paths


def _check_forms(columns: Columns, *, dense: bool) -> None:
    """Refuse options about the form of tables that do not go together."""
    if columns.sorted and not columns.by:
        raise InputError("expected --by COLUMN with --sorted, got none")
    if columns.long is not None and not dense:
        raise InputError(
            "expected ",
            Argument("dense", True),  # noqa: FBT003 - the value of the argument
            " with ",
            Argument("long"),
            ", because each row is an event of one variable",
        )
    if columns.long is not None and columns.wide is not None:
        raise InputError("expected ", Argument("long"), " or ", Argument("wide"), ", got both")


def _check_period(columns: Columns, traces: Sequence[str], *, dense: bool) -> None:
    """Refuse ``--period`` next to options that read times."""
    if dense:
        raise InputError(
            "expected ",
            Argument("period"),
            " or ",
            Argument("dense", True),  # noqa: FBT003 - the value of the argument
            ", which reads events at any time",
        )
    if all(map(is_bag, traces)):
        return
    clocks = all(map(samples_clocks, traces))
    for name, value in {"jitter": columns.jitter, "max_gap": columns.max_gap}.items():
        if value is not None and not (clocks and name == "max_gap"):
            raise InputError(
                "expected ",
                Argument("period"),
                ", which leaves the times aside, or ",
                Argument(name),
            )


def _check_signals(columns: Columns, specs: Mapping[str, rtamt.Specification]) -> None:
    """Refuse ``signals`` for a name that no specification reads."""
    variables = variables_of(specs)
    for name in columns.signals:
        if name not in variables and name not in _messages(specs):
            hint = nearest(name, variables) or f"; they read {listing(variables)}"
            raise InputError(
                Argument("signals", words='columns["signals"]'),
                f": no specification reads {name!r}{hint}",
            )


def _check_defaults(columns: Columns, specs: Mapping[str, rtamt.Specification]) -> None:
    """Refuse ``defaults`` for a variable without one."""
    declared = sorted({name for spec in specs.values() for name in spec.defaults})
    for name in columns.defaults:
        if name not in declared:
            hint = nearest(name, declared) or f"; they declare one for {listing(declared)}"
            where = Argument("defaults", words='columns["defaults"]')
            raise InputError(where, f": no specification declares one for {name!r}{hint}")


def refuse_unknown(options: argparse.Namespace, command: str, does: str) -> None:
    """Refuse unknown values for a command that needs the robustness at each instant.

    Args:
        options: The arguments.
        command: Its name.
        does: How it uses the robustness, as a clause such as ``"compares ..."``.
    """
    if options.missing == "unknown":
        raise InputError(
            f"--missing: {command} {does}, which a sample that is not known does not have; give "
            "--missing hold or --missing drop"
        )
    if options.max_gap is not None:
        raise InputError(
            f"--max-gap: {command} {does}, and an unknown sample has no single value; omit "
            "--max-gap"
        )


def read_trace_of(request: TracesAsked, path: str) -> tuple[Trace | EventTrace, Fraction | None]:
    """Read a trace and its period: ``--period``, or the period of the samples, or None."""
    from rtamt_gym.recorded.judge import extent_of
    from rtamt_gym.recorded.trace import constant_note, outside_ranges
    from rtamt_gym.recorded.trace_files import read_ruled

    trace, period = read_ruled(path, request.specs, request.reading, request.columns)
    if request.min_duration is not None and extent_of(trace, period).length is None:
        raise InputError(
            f"{trace.source}: expected a column of times, by which --min-duration measures, got "
            "none; give --time COLUMN or --period"
        )
    outside = [outside_ranges(spec, trace).values() for spec in request.specs.values()]
    notes = dict.fromkeys([*trace.notes, *chain.from_iterable(outside), constant_note(trace)])
    return replace(trace, notes=[note for note in notes if note]), period


def _messages(specs: Mapping[str, rtamt.Specification]) -> set[str]:
    """Return the variables of messages with fields that specifications read."""
    return {
        subscription.variable for spec in specs.values() for subscription in spec.subscriptions()
    }


_SURE = tuple(extension for extension in extensions() if extension != ".txt")
"""The file extensions of traces only; ``.txt`` may also be a specification."""


def _divided(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the specifications and the traces; without ``--``, the last word is the trace."""
    if SEPARATOR in words:
        index = words.index(SEPARATOR)
        specs, traces = list(words[:index]), list(words[index + 1 :])
        if SEPARATOR in traces or not (specs and traces):
            raise InputError(
                "expected SPEC... -- TRACE..., specifications before -- and traces after it"
            )
    else:
        specs, traces = list(words[:-1]), list(words[-1:])
    for word in traces:
        if word.endswith(".json"):
            raise InputError(
                f"expected a trace, got {word}; --json takes no file, it writes to stdout"
            )
        if word.endswith(".stl"):
            raise InputError(
                f"expected a trace, got the specification {word}; put specifications first"
            )
    formula_last = len(words) > 1 and not names_file(words[-1])
    as_traces = [
        word
        for word in specs
        if is_trace(word) or folder_format(word) or (formula_last and _may_be_trace(word))
    ]
    if as_traces and formula_last:
        spec = shorten(words[-1], 60)
        raise InputError(
            f"expected a specification first, got the trace {as_traces[0]}; write '{spec}' "
            f"{' '.join(as_traces[:2])}"
        )
    if as_traces:
        text = " ".join(word for word in specs if word not in as_traces) or "SPEC..."
        several = [*dict.fromkeys((*as_traces, *traces))]
        more = " ..." if len(several) > 2 else ""
        raise InputError(
            f"expected a specification, got the trace {as_traces[0]}; for several traces write "
            f"{shorten(text, 60)} -- {' '.join(several[:2])}{more}"
        )
    return specs, traces


def names_file(word: str) -> bool:
    """Return whether a word is a path, and not the text of a specification."""
    return os.path.exists(word) or re.search(r"[\s(<>]", word) is None  # noqa: PTH110 - a formula may be longer than a name


def is_trace(word: str) -> bool:
    """Return whether the end of a name shows that a word is a trace."""
    return word.lower().endswith(_SURE)


def _may_be_trace(word: str) -> bool:
    """Return whether a word in front of a formula is a trace: standard input, or a file."""
    return word == "-" or (os.path.isfile(word) and not word.endswith(".stl"))  # noqa: PTH113 - as above


def trace_paths(words: Sequence[str], *, as_files: bool = False) -> tuple[list[str], list[str]]:
    """Return the unique paths of the traces, and a text for each folder with other files.

    A word is the path of a file, a folder or a pattern. A folder with a format of its own counts
    as one file, unless it holds several traces and ``as_files`` is set.
    """
    ends, ignored = extensions(), list[str]()

    def alone(path: str | Path) -> bool:
        row = folder_format(path)
        return row is not None and not (row.several and as_files)

    paths = [
        path for word in words for path in _files(word, ends, ignored, pattern=True, alone=alone)
    ]
    if "-" in paths and len(paths) > 1:
        raise InputError("expected - as the only trace, which is read from standard input")
    by_target: dict[str, str] = {}
    for path in paths:
        by_target.setdefault(os.path.realpath(path), path)
    return list(by_target.values()), list(dict.fromkeys(ignored))


def _files(
    word: str,
    ends: Sequence[str],
    ignored: list[str],
    *,
    pattern: bool,
    alone: Callable[[str | Path], bool] = lambda _: False,
) -> list[str]:
    """Return the word itself, or the files in the folder or pattern that it names."""
    paths = [word]
    exists = os.path.exists(file_of(word))  # noqa: PTH110 - "./"
    if pattern and re.search(r"[*?\[]", word) and not exists:
        paths = sorted(glob(word, recursive=True))  # noqa: PTH207 - stays as it was written
        if not paths:
            raise InputError(f"no file has a name like {word}")
    files = []
    for path in paths:
        if alone(path) or not os.path.isdir(path):  # noqa: PTH112 - a formula may be longer than a name
            files.append(path)
            continue
        others, inside = list[Path](), list[Path]()
        for entry in sorted(Path(path).iterdir()):
            named = entry.name.lower().endswith(tuple(ends))
            read = (named and has_marks(entry)) or alone(entry)
            (inside if read else others).append(entry)
        if not inside:
            raise InputError(
                f"{shown(path)}: expected files that end in {', '.join(ends)}, found none"
            )
        files += map(str, inside)
        ignored += _ignored_text(path, others)
    return files


def _ignored_text(folder: str, others: Sequence[Path]) -> list[str]:
    """Return a text about unread files and folders in a folder; an empty list without any."""
    names = [entry.name + "/" * entry.is_dir() for entry in others if entry.name[0] != "."]
    if not names:
        return []
    listed = ", ".join(map(shown, names[:3])) + ", ..." * (len(names) > 3)
    entries = (
        "1 entry is not a trace and was"
        if len(names) == 1
        else (f"{len(names)} entries are not traces and were")
    )
    return [f"{shown(folder)}: {entries} not read: {listed}"]


def listed_paths(name: Path) -> list[str]:
    """Return the paths in a list of files, one on each line; ``-`` is standard input."""
    try:
        text = sys.stdin.read() if str(name) == "-" else name.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(f"--files-from: expected UTF-8 text, got {name}") from None
    paths = list(dict.fromkeys(line for line in text.splitlines() if line.strip()))
    if not paths:
        raise InputError(f"--files-from: expected a path on each line, got none in {name}")
    return paths
