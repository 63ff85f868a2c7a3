"""`rtamt compare`: compares how often two policies or releases satisfy the requirements."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rtamt import InputError
from rtamt_gym.commands.evaluate import check_files, tell_files
from rtamt_gym.options.command_line import ALTHOUGH_CHANGED, Option, add_options, shared
from rtamt_gym.recorded.columns import read_seconds
from rtamt_gym.results.codec import build, read
from rtamt_gym.results.warnings import exit_code, print_warnings

_RECORDINGS = (
    Option(
        "--tolerance TIME",
        "times of violations that differ by at most this much are equal, such as 500ms, or a "
        "number of samples without times",
        usual="0",
    ),
    Option(
        "--times",
        "compare the recorded times, or the times since the start of each recording",
        choices=("recorded", "start"),
        usual="recorded; an error if recordings start at other times and it matters",
    ),
    Option(
        "--folders FOLDER",
        "the folders of A and of B; recordings with equal names below them are pairs, and a file "
        "with all recordings counts as a folder",
        nargs=2,
        usual="the folders with equal names below",
    ),
    Option(
        "--require-all",
        "exit 3 if B lacks a recording, a requirement, a time or all triggers of a requirement "
        "that A has, and is not worse",
    ),
)
"""The options for recordings."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Compares two evaluations by episodes with the same seed, or two sets of recordings by "
        "recordings with the same name. Exits 1 if B is shown to satisfy a requirement less often "
        "than A, or if a recording has a new or a longer violation in B; 3 if that is undecided; "
        "otherwise 0."
    )
    parser.epilog = "example: rtamt compare old.json new.json"
    evaluations = [
        Option(
            f"{name}.json",
            "a file of rtamt evaluate --save, or of rtamt monitor --json --occurrences",
            read=Path,
            dest=name.lower(),
        )
        for name in ("A", "B")
    ]
    add_options(
        parser,
        *evaluations,
        shared(
            "--accept-changed",
            about=f"evaluations: compare {ALTHOUGH_CHANGED}; recordings: leave out requirements "
            "with a changed text, and compare others although options or defaults read their "
            "variables differently, with a note",
        ),
        Option("--save FILE", "write the comparison as JSON", read=Path),
        Option("--report FILE", "write the comparison as a page of HTML", read=Path),
    )
    group = parser.add_argument_group("recordings")
    for option in _RECORDINGS:
        option.add_to(group, "recording")


def run(options: argparse.Namespace) -> int:
    """Print the comparison; return 1 if B is worse in a requirement."""
    check_files(options, options.a, options.b)
    side_a = read(options.a, ["evaluation", "traces"])
    side_b = read(options.b, [side_a["kind"]])
    compared = _recordings if side_a["kind"] == "traces" else _evaluations
    return compared(options, side_a, side_b)


def _evaluations(
    options: argparse.Namespace, side_a: Mapping[str, Any], side_b: Mapping[str, Any]
) -> int:
    from rtamt_gym.evaluation.comparison import compare
    from rtamt_gym.evaluation.evaluation import Evaluation

    for name in ("tolerance", "times", "folders", "require_all"):
        if getattr(options, name):
            flag = f"--{name.replace('_', '-')}"
            raise InputError(f"{flag} is for recordings, got evaluations of policies; leave it out")
    a = build(options.a, side_a, Evaluation.from_saved)
    b = build(options.b, side_b, Evaluation.from_saved)
    names = None
    if a.policy == b.policy and options.a != options.b:  # the file names distinguish them
        short = options.a.name != options.b.name
        files = [result.name if short else str(result) for result in (options.a, options.b)]
        names = [f"{a.policy} ({result})" for result in files]
    comparison = compare(a, b, names=names, accept_changed=options.accept_changed)
    print(comparison)
    if options.save:
        comparison.save(options.save)
    tell_files(comparison, options, "comparison")
    worse = (result.shown and result.difference < 0 for result in comparison.results)
    return exit_code(["violated"] if any(worse) else [])


def _recordings(
    options: argparse.Namespace, side_a: Mapping[str, Any], side_b: Mapping[str, Any]
) -> int:
    from rtamt_gym.evaluation.recording_changes import (
        RecordingSet,
        comparison_warnings,
        recordings_lines,
    )
    from rtamt_gym.evaluation.recordings import compare_recordings

    if options.a.samefile(options.b):
        raise InputError(f"expected two results to compare, got the file {options.b} twice")
    a, b = RecordingSet.of(options.a, side_a), RecordingSet.of(options.b, side_b)
    comparison = compare_recordings(
        a,
        b,
        tolerance=_tolerance(options.tolerance, a.units | b.units),
        times=options.times,
        folders=options.folders,
        accept_changed=options.accept_changed,
    )
    print(*recordings_lines(comparison), sep="\n")
    if options.save:
        comparison.save(options.save)
    tell_files(comparison, options, "comparison")
    warnings = comparison_warnings(comparison, require_all=options.require_all)
    print_warnings(warnings)
    return exit_code(comparison.words, warnings)


def _tolerance(text: str | None, units: set[str]) -> float:
    """Return the tolerance in the unit of the recordings.

    Args:
        text: The value of the option; None without it.
        units: The units of times in the recordings: ``"s"``, ``"samples"`` or both.
    """
    if text is None or re.fullmatch(r"0+(\.0*)?\s*[a-z]*", text.strip(), re.ASCII):
        return 0.0
    value = float(read_seconds("--tolerance", text))
    bare = not text.strip()[-1:].isalpha()
    if "samples" in units and (len(units) > 1 or not bare):
        other = "some recordings count samples, and others have times"
        only = "the recordings count samples"
        raise InputError(
            f"--tolerance: {other if len(units) > 1 else only}, got {text!r}; "
            + ("compare them one after the other" if len(units) > 1 else "leave the unit out")
        )
    return value
