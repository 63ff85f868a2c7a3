"""`rtamt report`: shows results as a page of HTML."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from rtamt import InputError, RtamtError
from rtamt.errors import shown
from rtamt_gym.commands.arguments import check_outputs
from rtamt_gym.commands.end_notes import noted_ends
from rtamt_gym.options.command_line import Option, add_options
from rtamt_gym.results.warnings import (
    VerdictWarning,
    exit_code,
    print_warnings,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Writes one page of HTML that needs no network: each requirement in words, how often it "
        "is satisfied, and a plot of the worst episode. Results are files of the --save, --json "
        "and --folder of other commands. Files are only read: a saved case is code of its author, "
        "as a pickle is, and only --play runs it. Exits 3 if --play cannot run a case."
    )
    parser.epilog = "example: rtamt report old.json new.json outcomes.json -o report.html"
    add_options(
        parser,
        Option(
            "RESULT",
            "a file or folder; NAME=PATH gives it a name on the page",
            nargs="+",
            dest="results",
        ),
        Option(
            "-o PAGE",
            "the page, a name that ends in .html",
            read=Path,
            required=True,
            alias="--output",
        ),
        Option(
            "--examples FILE",
            "draw the examples in a file of rtamt examples --json next to their requirements",
            repeat=True,
        ),
        Option("--title TEXT", "the title of the page"),
        Option(
            "--play",
            "run saved cases, which imports the modules, policies and FMUs that standard error "
            "lists first",
        ),
        Option(
            "--traces DIR",
            "also read recorded traces below this folder",
            usual="only below the current folder and the folder of the result",
            read=Path,
            repeat=True,
        ),
    )


def run(options: argparse.Namespace) -> int:
    """Write the page; return 0, or 3 if a case could not be replayed."""
    from rtamt_gym.recorded.readers import extensions, folder_format
    from rtamt_gym.reports.html import render
    from rtamt_gym.reports.write import Access, check_page, report_of

    check_page(options.output)
    traces = tuple(extension for extension in extensions() if extension != ".parquet")
    paths, names = _named(options.results)
    for result in paths:
        if result.lower().endswith(traces) or folder_format(result):
            raise InputError(
                f"expected a result, got the trace {result}; evaluate it first: rtamt monitor "
                f"--json SPEC {shlex.quote(result)} > outcomes.json"
            )
    for folder in options.traces:
        if not folder.is_dir():
            raise InputError(f"--traces: expected a folder, got {folder}")
    check_outputs(options.output, picture=None, inputs=[*paths, *options.examples])
    access = Access(options.play, tuple(options.traces))
    if options.play:
        _tell_imports(paths)
    with noted_ends():
        report = report_of(
            *paths, title=options.title, names=names, examples=options.examples, access=access
        )
    options.output.write_text(render(report), encoding="utf-8")
    print(f"report: {options.output}", flush=True)
    warnings = [
        VerdictWarning(f"{path} was not run: {section.not_played}", fails=options.play)
        for path, section in zip(paths, report.sections, strict=True)
        if section.not_played
    ]
    print_warnings(warnings, stderr=True)
    return exit_code([], warnings)


def _tell_imports(paths: Sequence[str]) -> None:
    """Print the imports of the cases to standard error, before they run."""
    from rtamt_gym.play.saved_case import SavedCase
    from rtamt_gym.results.codec import read

    for path in paths:
        with suppress(RtamtError, OSError, ValueError):  # the reader of the result reports it
            if Path(path).suffix.lower() == ".json" and read(path)["kind"] == "case":
                code = ", ".join(SavedCase.load(path).imports) or "nothing"
                text = shown(f"playing {path}, which imports {code}")
                print(text, file=sys.stderr, flush=True)


def _named(results: Sequence[str]) -> tuple[list[str], list[str] | None]:
    """Return the paths of results, and their names; None if none is named."""
    paths, names = [], []
    named = False
    for result in results:
        name, equals, path = result.partition("=")
        own = bool(equals and name and path) and not Path(result).exists()
        named |= own
        paths.append(path if own else result)
        names.append(name if own else Path(result).name)
    if named and len(set(names)) < len(names):
        raise InputError(f"expected different names of results, got {', '.join(names)}")
    return paths, names if named else None
