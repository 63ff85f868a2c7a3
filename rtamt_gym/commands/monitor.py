"""`rtamt monitor`: judges recorded traces."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import TextWrapper
from typing import TYPE_CHECKING

from rtamt import InputError, Verdict
from rtamt.errors import nearest, shown
from rtamt_gym.checks.names import listing
from rtamt_gym.commands import SEPARATOR, occurrences
from rtamt_gym.commands.arguments import check_outputs
from rtamt_gym.commands.collection import without_collection
from rtamt_gym.commands.mutants import MutantWatch, score_warnings, write_apart
from rtamt_gym.commands.mutants import add_arguments as add_mutants
from rtamt_gym.commands.mutants import check_arguments as check_mutants
from rtamt_gym.commands.specs import STAGE, files_of, identified_texts, with_stages
from rtamt_gym.commands.traces import TracesAsked, read_arguments, refuse_unknown
from rtamt_gym.commands.traces import add_arguments as add_traces
from rtamt_gym.options.command_line import Option, add_options, positive
from rtamt_gym.recorded.parts import files_of as recorded_files
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

if TYPE_CHECKING:
    from rtamt_gym.commands.judged import Judged
    from rtamt_gym.recorded.columns import Columns
    from rtamt_gym.results.matrix import Matrix
    from rtamt_gym.results.mutation import MutationScore
    from rtamt_gym.results.trial import Trial

_OVER_TIME = ("--out", "--plot", "--write-mcap")
"""The options that write what becomes of one trace over time."""


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
        *occurrences.OPTIONS,
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


def _check_expected(options: argparse.Namespace, asked: TracesAsked, paths: Sequence[str]) -> None:
    """Raise InputError if a requirement or traces that the command line expects are missing."""
    if options.undecided and not options.junit:
        raise InputError(
            f"--undecided {options.undecided} sets how --junit reports undecided requirements; "
            "add --junit FILE or leave it out"
        )
    for name in options.expect:
        if name not in asked.specs:
            hint = nearest(name, asked.specs) or f"; they are {listing(asked.specs)}"
            raise InputError(f"--expect: no requirement {name!r} is evaluated{hint}")
    if options.min_traces is not None and len(paths) < options.min_traces:
        raise InputError(
            "; ".join(
                [
                    f"--min-traces: expected {options.min_traces} traces or more, got {len(paths)}",
                    *asked.ignored,
                ]
            )
        )


def discard_old_outcomes(words: Sequence[str]) -> None:
    """Remove the JUnit file of an earlier run, before the command line is parsed.

    A run that stops early, for example at a misspelt option, then leaves no outcomes behind.

    Args:
        words: The command line.
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
        from rtamt_gym.recorded.outcomes_json import data_set_of

        data_set_of(paths)
    if options.write_mcap and len(paths) == 1:
        from rtamt_gym.recorded import bag_output

        bag_output.check_output(options.write_mcap, paths[0])


def run(options: argparse.Namespace) -> int:
    """Judge the traces, print the report and write the files; return the exit code."""
    for option in _OVER_TIME:
        if _given(options, option):
            refuse_unknown(options, option, "needs the robustness at every sample")
    asked, paths = read_arguments(options)
    _check_expected(options, asked, paths)
    asked = replace(asked, reading=with_stages(asked.specs, asked.reading))
    if options.results is not None:
        from rtamt_gym.commands.fleet import run_fleet

        return run_fleet(options, asked, paths)
    return _judge(options, asked, paths)


def _judge(options: argparse.Namespace, asked: TracesAsked, paths: Sequence[str]) -> int:
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
    asked = replace(asked, occurrences=occurrences.are_needed(options))
    occurrences.check_arguments(options, asked, paths)
    check_mutants(options, asked)
    _check_files(options, paths)
    wanted = options.json or options.junit or options.markdown
    explain = (Verdict.VIOLATED,) if wanted else ()
    judged = None
    watch = MutantWatch(options, asked) if options.mutants else None
    if len(paths) == 1:
        judged = judge_file(asked, paths[0], formulas=True)
        rows = [row_of(asked, judged, explain=explain)]
        if watch is not None:
            watch.take(rows[0], watch.see(judged, rows[0]))
    else:
        for option in _OVER_TIME:
            if _given(options, option):
                raise InputError(f"expected one trace for {option}, got {len(paths)}")
        workers = options.workers
        rows = judge_files(asked, paths, workers=workers, explain=explain, watch=watch)
    matrix = matrix_of(asked, rows)
    warnings = evidence_warnings(matrix, "trace", Required.of(options))
    warnings += length_warnings(rows, asked.min_duration)
    warnings += range_warnings(rows) if asked.strict_ranges else []
    warnings += map(VerdictWarning, (*identified_texts(asked.specs), *asked.ignored))
    scores = {} if watch is None else watch.scores(matrix)
    warnings += score_warnings(options, scores)
    # Traces that test a requirement violate it too: then their verdicts are no failure.
    word = "satisfied" if options.mutants and matrix.word != "failed" else matrix.word
    code = exit_code([word], warnings)
    if options.json:
        from rtamt_gym.recorded.outcomes_json import json_parts

        made_of = matrix.with_files([*files_of(options.specs), *recorded_files(paths)])
        columns, least = _columns(asked, paths), asked.min_duration
        mutants = {"scores": scores, "least": options.min_killed} if options.mutants else None
        rules = {
            **_rules(asked),
            **({"stages": stages} if (stages := asked.reading.stages) else {}),
        }
        groups = {shown(name): keys for name, keys in asked.groups.items()}
        parts = json_parts(
            *(made_of, rules, columns, code), least=least, mutants=mutants, groups=groups
        )
        with without_collection():
            sys.stdout.writelines(parts)
        print()
    else:
        with without_collection():
            lines = _report(asked, matrix, judged)
        print(*lines, sep="\n", end="")
        print(*occurrences.report(options, matrix), sep="\n", end="")
        print(*_mutants(scores, matrix), sep="\n", end="")
    undecided = [undecided_cells(matrix)] if options.undecided == "fail" else []
    messages = _write(options, asked, matrix, judged, [*undecided, *warnings])
    messages += occurrences.write_files(options, asked, matrix, paths)
    messages += _list_episodes(options, rows, paths)
    if options.write_killing_traces is not None:
        messages.append(write_apart(scores, asked, matrix, options.write_killing_traces))
    print(*messages, sep="", end="", file=sys.stderr if options.json else sys.stdout)
    print_warnings(warnings, stderr=options.json)
    print(end="", flush=True)
    if failed := failure_lines(matrix):
        print(*failed, sep="", end="", file=sys.stderr)
    return code


def _list_episodes(
    options: argparse.Namespace, rows: Sequence[Trial], paths: Sequence[str]
) -> list[str]:
    """Write the violated episodes if a file is asked for; return a line about it."""
    if not options.violated_episodes:
        return []
    from rtamt_gym.recorded.outcomes_json import violated_episodes

    text, summary = violated_episodes(rows, paths)
    options.violated_episodes.write_text(text, encoding="utf-8")
    return [f"violated episodes: {options.violated_episodes}, {summary}\n"]


def _report(asked: TracesAsked, matrix: Matrix, judged: Judged | None) -> Sequence[str]:
    """Return the lines of the report: on one trace in detail, on several as a table."""
    if judged is None:
        from rtamt_gym.results.matrix import matrix_lines

        return [*matrix_lines(matrix), ""]
    if judged.trace is None or not judged.judgements:
        return []
    from rtamt_gym.commands.judging import reasons_of
    from rtamt_gym.recorded.judge import extent_of
    from rtamt_gym.recorded.report import report
    from rtamt_gym.results.provenance import ids_lines

    trace = judged.trace
    head = extent_of(trace, judged.period).lines(trace.source)
    lines = report(judged.judgements, head, trace.notes, reasons_of(asked, judged))
    return [*lines, *ids_lines(matrix.provenance), ""]


def _mutants(scores: Mapping[str, MutationScore], matrix: Matrix) -> Sequence[str]:
    """Return the lines about mutants, after an empty line."""
    if not scores:
        return []
    from rtamt_gym.results.mutation import score_lines

    return ["", *score_lines(scores, len(matrix.rows)), ""]


def _columns(asked: TracesAsked, paths: Sequence[str]) -> Columns:
    """Return the options of columns with the defaults of specifications and topics of bags.

    With these a trace is read alike under formulas that have lost their declarations.
    """
    from rtamt_gym.recorded.names import starts_of, with_columns
    from rtamt_gym.recorded.readers import is_bag

    columns = replace(asked.columns, starts=starts_of(asked.specs, asked.columns))
    bags = [*map(is_bag, recorded_files(paths))]
    if not all(bags):
        return columns if any(bags) else with_columns(asked.specs, columns)
    from rtamt_gym.recorded.bag_topics import columns_of

    return columns_of(asked.specs, columns)


def _rules(asked: TracesAsked) -> dict[str, str]:
    """Return the options of evaluation by name."""
    names = ("end", "view", "semantics", "align", "period")
    rules = {name: getattr(asked.reading, name) for name in names}
    texts = {name: str(value) for name, value in rules.items() if value is not None}
    if asked.min_duration is not None:
        texts["min_duration"] = str(asked.min_duration)
    texts |= {f"constant:{name}": value for name, value in asked.constants.items()}
    return texts | {"time": "dense" if asked.reading.dense else "sampled"}


def _write(
    options: argparse.Namespace,
    asked: TracesAsked,
    matrix: Matrix,
    judged: Judged | None,
    warnings: Sequence[VerdictWarning],
) -> list[str]:
    """Write the output files; return a line about each."""
    messages = []
    if options.junit:
        from rtamt_gym.results.ci_outcomes import junit_parts

        parts = junit_parts(matrix, _rules(asked), warnings, least=asked.min_duration)
        with options.junit.open("wb") as file, without_collection():
            file.writelines(parts)
        messages.append(f"outcomes: {options.junit}\n")
    if options.markdown:
        from rtamt_gym.results.ci_outcomes import to_markdown

        options.markdown.write_text(
            to_markdown(matrix, warnings, asked.constants), encoding="utf-8"
        )
        messages.append(f"outcomes: {options.markdown}\n")
    if judged is None or judged.trace is None or not judged.judgements:
        return messages
    if options.out:
        from rtamt_gym.recorded.output import save as save_robustness

        save_robustness(judged.judgements, options.out, dense=asked.reading.dense)
        messages.append(f"robustness: {options.out}\n")
    if options.write_mcap:
        from rtamt_gym.recorded.bag_output import write_mcap

        found = {
            name: outcome.occurrences
            for name, outcome in matrix.rows[0].outcomes.items()
            if outcome.occurrences is not None
        }
        added, lost = write_mcap(
            judged.trace, judged.judgements, asked.specs, options.write_mcap, found
        )
        copied = f"copy of the bag: {options.write_mcap}, with {', '.join(added)}"
        if lost:
            copied += f"; without {', '.join(lost)}, whose classes the bag does not define"
        lines = TextWrapper(80, subsequent_indent="  ")
        lines.break_on_hyphens = lines.break_long_words = False  # a path stays whole
        messages.append(lines.fill(copied) + "\n")
    if options.plot:
        from rtamt_gym.drawing import save
        from rtamt_gym.recorded.judge import signals_of
        from rtamt_gym.recorded.plot import draw_trace

        signals = signals_of(judged.trace, judged.period)
        reads = {name: spec.variables for name, spec in asked.specs.items()}
        source = judged.trace.source
        figure = draw_trace(signals, judged.judgements, source, reads, everything=options.all)
        save(figure, options.plot)
        messages.append(f"picture: {options.plot}\n")
    return messages
