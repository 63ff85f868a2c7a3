"""`rtamt monitor`: judges recorded traces."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import TextWrapper
from typing import TYPE_CHECKING, Final

from rtamt import InputError, Verdict
from rtamt.errors import nearest, shown
from rtamt_gym.checks.names import listing
from rtamt_gym.commands import SEPARATOR
from rtamt_gym.commands.arguments import check_outputs
from rtamt_gym.commands.collection import without_collection
from rtamt_gym.commands.mutants import MutantWatch, score_warnings, write_apart
from rtamt_gym.commands.mutants import add_arguments as add_mutants
from rtamt_gym.commands.mutants import check_arguments as check_mutants
from rtamt_gym.commands.specs import STAGE, files_of, identified_texts, variables_of, with_stages
from rtamt_gym.commands.traces import TracesAsked, read_arguments, read_trace_of, refuse_unknown
from rtamt_gym.commands.traces import add_arguments as add_traces
from rtamt_gym.options.command_line import Option, add_options, positive
from rtamt_gym.recorded.columns import read_seconds
from rtamt_gym.recorded.parts import files_of as recorded_files
from rtamt_gym.recorded.readers import is_bag
from rtamt_gym.results.warnings import (
    Required,
    VerdictWarning,
    evidence_warnings,
    exit_code,
    length_warnings,
    print_warnings,
    range_warnings,
    undecided_cells,
)
from rtamt_gym.tables import counted

if TYPE_CHECKING:
    from rtamt_gym.commands.judged import Judged
    from rtamt_gym.recorded.columns import Columns
    from rtamt_gym.results.matrix import Matrix
    from rtamt_gym.results.mutation import MutationScore
    from rtamt_gym.results.trial import Trial

_OVER_TIME = ("--out", "--plot", "--write-mcap")
"""The options that write the robustness of one trace over time."""


_OCCURRENCES: Final = (
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
"""The options about all violations."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Evaluates files of samples or events under one or more specifications. Columns that no "
        "specification reads are ignored. Exits with the first that applies: 2 for a bad argument "
        "or trace, 1 for a violation, 3 for an undecided requirement, otherwise 0."
    )
    parser.epilog = "example: rtamt monitor requirements.stl -- runs/*.csv --junit outcomes.xml"
    add_traces(parser, "monitor")
    add_options(
        parser,
        Option(
            "-j N",
            "number of processes",
            default=1,
            read=positive,
            dest="workers",
        ),
        Option("--json", "write the outcomes to standard output as JSON, in place of the report"),
        STAGE,
        "--require-triggered",
        "--require-answered",
        "--min-duration",
        Option(
            "--strict-ranges",
            "exit 3 if a variable leaves its declared range, as in 'input float x in [0, 120]'",
            usual="a note reports it",
        ),
        *_OCCURRENCES,
        Option("--min-traces N", "exit 2 if there are fewer than N traces", read=positive),
        Option(
            "--expect NAME", "exit 2 if no requirement with this name is evaluated", repeat=True
        ),
        Option("--junit FILE", "write the outcomes as JUnit XML", read=Path),
        Option(
            "--undecided",
            "report undecided requirements in --junit as skipped or as failures; the exit code "
            "stays the same",
            usual="skip",
            choices=("skip", "fail"),
        ),
        Option("--markdown FILE", "write the outcomes as Markdown", read=Path),
        Option(
            "--out FILE",
            "write the robustness of every formula of one trace as .csv, .csv.gz, .parquet, "
            ".feather or .arrow",
            read=Path,
        ),
        Option(
            "--write-mcap FILE",
            "write a copy of one bag with robustness and verdicts as topics",
            read=Path,
        ),
        Option(
            "--violated-episodes FILE",
            "write the indices of the violated episodes of one LeRobot data set, for "
            "lerobot-edit-dataset --operation.episode_indices",
            read=Path,
        ),
        Option("--plot FILE", "draw the signals and the robustness of one trace", read=Path),
        Option("--all", "draw all requirements; otherwise --plot draws the worst of many"),
        trial="trace",
    )
    add_options(
        parser.add_argument_group("many files"),
        Option(
            "--files-from FILE",
            "read the paths of traces from the lines of a file, or of standard input with -",
            read=Path,
        ),
        Option(
            "--results DIR",
            "write the outcomes into this folder as Parquet; the next run evaluates only new and "
            "changed files",
            read=Path,
        ),
        Option("--verify", "with --results: compare files by SHA-256, not by size and time"),
        Option(
            "--backend",
            "with --results: evaluate the files on the workers of a Dask or Ray cluster",
            usual="-j processes of this machine",
            choices=("dask", "ray"),
        ),
        Option(
            "--scheduler ADDRESS",
            "the address of the cluster, such as tcp://host:8786",
            usual="a cluster on this machine",
        ),
    )
    add_mutants(parser.add_argument_group("mutants"))


def _check_expected(
    options: argparse.Namespace, request: TracesAsked, paths: Sequence[str]
) -> None:
    """Raise InputError if a requirement or traces that the command line expects are missing."""
    if options.undecided and not options.junit:
        raise InputError(
            f"--undecided {options.undecided} sets how --junit reports undecided requirements; "
            "add --junit FILE or leave it out"
        )
    for name in options.expect:
        if name not in request.specs:
            hint = nearest(name, request.specs) or f"; they are {listing(request.specs)}"
            raise InputError(f"--expect: no requirement {name!r} is evaluated{hint}")
    if options.min_traces is not None and len(paths) < options.min_traces:
        raise InputError(
            "; ".join(
                [
                    f"--min-traces: expected {options.min_traces} traces or more, got {len(paths)}",
                    *request.ignored,
                ]
            )
        )


def discard_old_outcomes(words: Sequence[str]) -> None:
    """Remove the JUnit file of an earlier run, before the command line is parsed.

    A run that stops early, for example at a misspelt option, then does not leave old outcomes.
    """
    for word, following in zip(words, (*words[1:], ""), strict=True):
        option, _, value = word.partition("=")
        if option == "--junit" and (path := value or following):
            from rtamt_gym.results.ci_outcomes import discard_junit

            discard_junit(Path(path))


def _given(options: argparse.Namespace, option: str) -> bool:
    return getattr(options, option.strip("-").replace("-", "_")) is not None


def _check_files(options: argparse.Namespace, paths: Sequence[str]) -> None:
    """Refuse output files that cannot be written."""
    inputs = [word for word in (*options.specs, *recorded_files(paths)) if word != SEPARATOR]
    outputs = (
        *(options.junit, options.markdown, options.out, options.write_mcap),
        options.write_occurrences,
    )
    check_outputs(*outputs, options.violated_episodes, picture=options.plot, inputs=inputs)
    if options.out:
        from rtamt_gym.recorded.output import check_output

        check_output(options.out)
    if options.violated_episodes:
        from rtamt_gym.recorded.output import data_set_of

        data_set_of(paths)
    if options.write_mcap and len(paths) == 1:
        from rtamt_gym.recorded import bag_output

        bag_output.check_output(options.write_mcap, paths[0])


def run(options: argparse.Namespace) -> int:
    """Judge the traces, print the report and write the files; return the exit code."""
    for option in _OVER_TIME:
        if _given(options, option):
            refuse_unknown(options, option, "needs the robustness at every sample")
    request, paths = read_arguments(options)
    _check_expected(options, request, paths)
    request = replace(request, reading=with_stages(request.specs, request.reading))
    if options.results is not None:
        from rtamt_gym.commands.fleet import run_fleet

        return run_fleet(options, request, paths)
    return _judge(options, request, paths)


def _judge(options: argparse.Namespace, request: TracesAsked, paths: Sequence[str]) -> int:
    """Judge the traces with all outcomes in memory; return the exit code."""
    from rtamt_gym.commands.judging import (
        failure_lines,
        judge_file,
        judge_files,
        matrix_of,
        row_of,
    )

    for option in ("--verify", "--backend", "--scheduler"):
        if getattr(options, option.removeprefix("--")):
            raise InputError(f"expected --results DIR with {option}, got none")
    request = replace(
        request, occurrences=bool(options.occurrences or options.write_occurrences or options.clip)
    )
    _check_occurrences(options, request, paths)
    check_mutants(options, request)
    _check_files(options, paths)
    detailed = options.json or options.junit or options.markdown
    explain = (Verdict.VIOLATED,) if detailed else ()
    judged = None
    watch = MutantWatch(options, request) if options.mutants else None
    if len(paths) == 1:
        judged = judge_file(request, paths[0], formulas=True)
        rows = [row_of(request, judged, explain=explain)]
        if watch is not None:
            watch.take(rows[0], watch.see(judged, rows[0]))
    else:
        for option in _OVER_TIME:
            if _given(options, option):
                raise InputError(f"expected one trace for {option}, got {len(paths)}")
        workers = options.workers
        rows = judge_files(request, paths, workers=workers, explain=explain, watch=watch)
    matrix = matrix_of(request, rows)
    warnings = evidence_warnings(matrix, "trace", Required.of(options))
    warnings += length_warnings(rows, request.min_duration)
    warnings += range_warnings(rows) if request.strict_ranges else []
    warnings += map(VerdictWarning, (*identified_texts(request.specs), *request.ignored))
    scores = {} if watch is None else watch.scores(matrix)
    warnings += score_warnings(options, scores)
    # Traces that test a requirement also violate it, so their verdicts are not failures.
    word = "satisfied" if options.mutants and matrix.word != "failed" else matrix.word
    code = exit_code([word], warnings)
    if options.json:
        from rtamt_gym.recorded.output import json_parts

        made_of = matrix.with_files([*files_of(options.specs), *recorded_files(paths)])
        columns, least = _columns(request, paths), request.min_duration
        mutants = {"scores": scores, "least": options.min_killed} if options.mutants else None
        rules = {
            **_rules(request),
            **({"stages": stages} if (stages := request.reading.stages) else {}),
        }
        groups = {shown(name): keys for name, keys in request.groups.items()}
        parts = json_parts(
            *(made_of, rules, columns, code), least=least, mutants=mutants, groups=groups
        )
        with without_collection():
            sys.stdout.writelines(parts)
        print()
    else:
        with without_collection():
            lines = _report(request, matrix, judged)
        print(*lines, sep="\n", end="")
        print(*_occurrence_lines(options, matrix), sep="\n", end="")
        print(*_mutants(scores, matrix), sep="\n", end="")
    undecided = [undecided_cells(matrix)] if options.undecided == "fail" else []
    messages = _write(options, request, matrix, judged, [*undecided, *warnings])
    messages += _write_occurrences(options, request, matrix, paths)
    messages += _list_episodes(options, rows, paths)
    if options.write_killing_traces is not None:
        messages.append(write_apart(scores, request, matrix, options.write_killing_traces))
    print(*messages, sep="", end="", file=sys.stderr if options.json else sys.stdout)
    print_warnings(warnings, stderr=options.json)
    print(end="", flush=True)
    if failed := failure_lines(matrix):
        print(*failed, sep="", end="", file=sys.stderr)
    return code


def _list_episodes(
    options: argparse.Namespace, rows: Sequence[Trial], paths: Sequence[str]
) -> list[str]:
    """Write the violated episodes if the option is set; return a line about it."""
    if not options.violated_episodes:
        return []
    from rtamt_gym.recorded.output import violated_episodes

    text, summary = violated_episodes(rows, paths)
    options.violated_episodes.write_text(text, encoding="utf-8")
    return [f"violated episodes: {options.violated_episodes}, {summary}\n"]


def _report(request: TracesAsked, matrix: Matrix, judged: Judged | None) -> Sequence[str]:
    """Return the lines of the report: on one trace in detail, on several as a table."""
    if judged is None:
        from rtamt_gym.results.matrix import matrix_lines

        return [*matrix_lines(matrix), ""]
    if judged.trace is None or not judged.judgements:
        return []
    from rtamt_gym.commands.judging import reasons_of
    from rtamt_gym.recorded.judge import extent_of
    from rtamt_gym.recorded.output import report
    from rtamt_gym.results.provenance import ids_lines

    trace = judged.trace
    head = extent_of(trace, judged.period).lines(trace.source)
    lines = report(judged.judgements, head, trace.notes, reasons_of(request, judged))
    return [*lines, *ids_lines(matrix.provenance), ""]


def _mutants(scores: Mapping[str, MutationScore], matrix: Matrix) -> Sequence[str]:
    """Return the lines about mutants, after an empty line."""
    if not scores:
        return []
    from rtamt_gym.results.mutation import score_lines

    return ["", *score_lines(scores, len(matrix.rows)), ""]


def _columns(request: TracesAsked, paths: Sequence[str]) -> Columns:
    """Return the options of columns with the defaults of specifications and topics of bags.

    With these, formulas without their declarations read a trace in the same way.
    """
    from rtamt_gym.recorded.names import starts_of, with_columns
    from rtamt_gym.recorded.readers import is_bag

    columns = replace(request.columns, starts=starts_of(request.specs, request.columns))
    bags = [*map(is_bag, recorded_files(paths))]
    if not all(bags):
        return columns if any(bags) else with_columns(request.specs, columns)
    from rtamt_gym.recorded.bag_topics import columns_of

    return columns_of(request.specs, columns)


def _rules(request: TracesAsked) -> dict[str, str]:
    """Return the options of evaluation by name."""
    names = ("end", "view", "semantics", "align", "period")
    rules = {name: getattr(request.reading, name) for name in names}
    texts = {name: str(value) for name, value in rules.items() if value is not None}
    if request.min_duration is not None:
        texts["min_duration"] = str(request.min_duration)
    texts |= {f"constant:{name}": value for name, value in request.constants.items()}
    return texts | {"time": "dense" if request.reading.dense else "sampled"}


def _write(
    options: argparse.Namespace,
    request: TracesAsked,
    matrix: Matrix,
    judged: Judged | None,
    warnings: Sequence[VerdictWarning],
) -> list[str]:
    """Write the output files; return a line about each."""
    messages = []
    if options.junit:
        from rtamt_gym.results.ci_outcomes import junit_parts

        parts = junit_parts(matrix, _rules(request), warnings, least=request.min_duration)
        with options.junit.open("wb") as file, without_collection():
            file.writelines(parts)
        messages.append(f"outcomes: {options.junit}\n")
    if options.markdown:
        from rtamt_gym.results.ci_outcomes import to_markdown

        options.markdown.write_text(
            to_markdown(matrix, warnings, request.constants), encoding="utf-8"
        )
        messages.append(f"outcomes: {options.markdown}\n")
    if judged is None or judged.trace is None or not judged.judgements:
        return messages
    if options.out:
        from rtamt_gym.recorded.output import save as save_robustness

        save_robustness(judged.judgements, options.out, dense=request.reading.dense)
        messages.append(f"robustness: {options.out}\n")
    if options.write_mcap:
        from rtamt_gym.recorded.bag_output import write_mcap

        listed = {
            name: outcome.occurrences
            for name, outcome in matrix.rows[0].outcomes.items()
            if outcome.occurrences is not None
        }
        added, lost = write_mcap(
            judged.trace, judged.judgements, request.specs, options.write_mcap, listed
        )
        copied = f"copy of the bag: {options.write_mcap}, with {', '.join(added)}"
        if lost:
            copied += f"; without {', '.join(lost)}, whose classes the bag does not define"
        lines = TextWrapper(80, subsequent_indent="  ")
        lines.break_on_hyphens = lines.break_long_words = False  # paths must not be broken
        messages.append(lines.fill(copied) + "\n")
    if options.plot:
        from rtamt_gym.drawing import save
        from rtamt_gym.recorded.judge import signals_of
        from rtamt_gym.recorded.plot import draw_trace

        signals = signals_of(judged.trace, judged.period)
        reads = {name: spec.variables for name, spec in request.specs.items()}
        source = judged.trace.source
        figure = draw_trace(signals, judged.judgements, source, reads, everything=options.all)
        save(figure, options.plot)
        messages.append(f"picture: {options.plot}\n")
    return messages


def _check_occurrences(
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


def _occurrence_lines(options: argparse.Namespace, matrix: Matrix) -> Sequence[str]:
    """Return the lines about all violations, between empty lines."""
    if not options.occurrences:
        return []
    from rtamt_gym.recorded.occurrences import occurrence_lines

    return ["", *occurrence_lines(matrix.rows), ""]


def _write_occurrences(
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
