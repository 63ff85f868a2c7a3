"""`rtamt falsify`: searches for an input that makes a system violate a requirement."""

from __future__ import annotations

import argparse
import math
import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rtamt_gym.commands.arguments import check_outputs, read_signals
from rtamt_gym.commands.end_notes import noted_ends, short_warnings
from rtamt_gym.commands.specs import files_of, requirements_of, selected, told_apart
from rtamt_gym.commands.systems import opened_system, read_varied
from rtamt_gym.options.command_line import (
    EPISODES,
    Option,
    add_options,
    positive,
    read_evaluation_options,
    shared,
)
from rtamt_gym.results.warnings import (
    INTERRUPTED,
    Required,
    VerdictWarning,
    evidence_warnings,
    exit_code,
    failure_warnings,
    print_warnings,
    undecided_warnings,
)
from rtamt_gym.tables import shorten

if TYPE_CHECKING:
    from rtamt_gym.results.outcome import Word
    from rtamt_gym.search.falsification.falsification import Falsification

_WHY = 12
"""The maximum number of lines of an explanation."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from rtamt_gym.search.falsification.optimizers import described

    parser.description = (
        "Searches for an input with which a system violates one of its requirements. Prints a "
        "simplified input and why it violates. Exits 1 if a requirement is violated; otherwise "
        "3 if simulations failed or if all leave a requirement undecided; otherwise 0, which is "
        "not a proof. After Ctrl-C it prints the best input so far and exits 130."
    )
    parser.epilog = "example: rtamt falsify rtamt/AutomaticTransmission-v0 AT6a --save case.json"
    add_options(
        parser,
        "SYSTEM",
        "--env-kwarg",
        Option(
            "REQUIREMENT",
            "a requirement of the scenario, such as AT6a, a formula, name = formula, or a .stl "
            "file; the search ends at the first violation",
            usual="all of the scenario",
            nargs="*",
            dest="requirements",
        ),
        shared("--only", about="search for a violation of this requirement only"),
        "--signal",
        "--distance",
        "--vary",
        "--set",
        Option(
            "--budget N",
            "maximum number of simulations; a larger number continues the search in --folder",
            default=300,
            read=positive,
        ),
        shared(
            "--seed",
            about="seed of the search and of the first simulation; each further simulation adds 1",
        ),
        Option(
            "--optimizer NAME",
            f"how inputs are chosen (default: portfolio). {described()}",
            default="portfolio",
        ),
        Option(
            "--no-reduce",
            "do not simplify the input, which takes up to 200 more simulations",
        ),
        "--policy",
        "--duration",
        "-j",
        "--timeout",
        shared("--allow-failures", default=0),
        "--folder",
        "--accept-changed",
        *EPISODES,
        "--require-triggered",
        "--require-answered",
        Option(
            "--save FILE",
            "write the violation as a case for rtamt replay; without a violation, keep an "
            "existing file",
            read=Path,
        ),
        Option("--plot FILE", "draw the input and the run", read=Path),
        Option(
            "--record FILE", "write all simulations as a Parquet file, a row for each", read=Path
        ),
        Option("--json", "print JSON instead of text"),
        trial="simulation",
    )


def run(options: argparse.Namespace) -> int:
    """Run the search, print the result and write the files; return 1 after a violation."""
    from rtamt_gym.results.codec import check_name
    from rtamt_gym.search.falsification.falsify import IrreproducibleWarning, falsify
    from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning

    check_outputs(options.save, options.record, picture=options.plot)
    if options.save:
        check_name(options.save)
    signals = read_signals(options.signal)
    with opened_system(options) as opened, noted_ends() as notes:
        entries, numbers = read_varied(options.vary, options.set, opened.scenario)
        requirements = requirements_of(options.requirements, opened.requirements, options.env_id)
        specs, signals = selected(requirements, options.only, signals)
        with warnings.catch_warnings():
            for category in (
                FailedSimulationWarning,
                IrreproducibleWarning,
            ):  # the report contains them
                warnings.simplefilter("ignore", category)
            try:
                result = falsify(
                    opened.system,
                    told_apart(specs, options.distance),
                    entries,
                    fixed=numbers,
                    budget=options.budget,
                    seed=options.seed,
                    optimizer=options.optimizer,
                    signals=signals or None,
                    policy=opened.policy,
                    duration=options.duration,
                    reduce=not options.no_reduce,
                    n_jobs=options.n_jobs,
                    timeout=options.timeout,
                    folder=options.folder,
                    accept_changed=options.accept_changed,
                    progress=True,
                    **read_evaluation_options(options).options(),
                )
            except KeyboardInterrupt as pressed:
                result = _so_far(pressed)
        paths = files_of(options.requirements, options.policy)
        result = replace(result, record=result.record.with_files(paths))
        # Print the result first: writing files may take simulations, and may fail.
        print(result.to_json() if options.json else "\n".join(_lines(result, notes)), flush=True)
        files = list(_write(result, options, opened.path))
        if files and not options.json:
            print("", *files, sep="\n")
    verdict_warnings: list[VerdictWarning] = []
    if not result.falsified:
        verdict_warnings += failure_warnings(
            len(result.record.failed()), options.allow_failures, result.not_violated
        )
        verdict_warnings += undecided_warnings(result.record, "simulation", fails=True)
    verdict_warnings += evidence_warnings(result.record, "simulation", Required.of(options))
    verdict_warnings += short_warnings(result.record, options)
    print_warnings(verdict_warnings, stderr=options.json)
    words: list[Word] = ["violated"] if result.falsified else []
    return INTERRUPTED if result.interrupted else exit_code(words, verdict_warnings)


def _so_far(pressed: KeyboardInterrupt) -> Falsification:
    """Return the findings of a search after an interrupt."""
    result: Falsification | None = getattr(pressed, "falsification", None)
    if result is None:
        print("interrupted before a simulation was over", file=sys.stderr)
        raise pressed
    return result


def _lines(result: Falsification, notes: list[str]) -> Iterator[str]:
    """Yield the findings, with an explanation unless an interrupt came: it needs a simulation."""
    yield from result.lines()
    if result.judged and not result.interrupted and not math.isnan(result.robustness):
        why = [shorten(line, 80) for line in str(result.explain()).splitlines()]
        yield from ("", *why[:_WHY])
        if len(why) > _WHY:
            yield f"... {len(why) - _WHY} more lines: rtamt replay CASE --explain"
    yield from ["", *notes] if notes else []


def _write(result: Falsification, options: argparse.Namespace, system: str | None) -> Iterator[str]:
    """Write the output files; return a line for each."""
    if options.record:
        result.record.save(options.record)
        yield f"record: {options.record}"
    if options.save and not result.falsified and Path(options.save).exists():
        # The old file may hold an earlier violation.
        yield f"case: no violation found, {options.save} is unchanged"
    elif options.save:
        result.save(options.save, system=system, policy=options.policy)
        yield f"case: {options.save} (run it again: rtamt replay {options.save})"
    if options.plot:
        result.plot(options.plot)
        yield f"picture: {options.plot}"
