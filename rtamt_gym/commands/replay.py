"""`rtamt replay`: runs a saved case again."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rtamt.errors import shown, shown_lines
from rtamt_gym.commands.arguments import check_outputs
from rtamt_gym.commands.end_notes import noted_ends
from rtamt_gym.options.command_line import ALTHOUGH_CHANGED, Option, add_options, shared
from rtamt_gym.results.warnings import (
    Required,
    evidence_warnings,
    exit_code,
    print_warnings,
)
from rtamt_gym.tables import counted, number, sample_text

if TYPE_CHECKING:
    from rtamt_gym.play.run import Run
    from rtamt_gym.play.saved_case import SavedCase


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Runs a saved case of rtamt falsify --save or Falsification.save. A case is code of its "
        "author, as a pickle is: it names modules, policies, FMUs, which are imported and run. "
        "Exits 0 if the verdict is the verdict in the file, otherwise 1."
    )
    parser.epilog = "example: rtamt replay case.json --explain --plot run.png"
    add_options(
        parser,
        Option("CASE", "the file, such as case.json"),
        Option("--explain", "print which formulas and samples decided the robustness"),
        shared("--accept-changed", about=f"run the case {ALTHOUGH_CHANGED}"),
        "--require-triggered",
        "--require-answered",
        Option("--plot FILE", "draw the input and the run", read=Path),
        Option("--save FILE", "write the run as a Parquet file, a row for each sample", read=Path),
        trial="run",
    )


def run(options: argparse.Namespace) -> int:
    """Run the case, and print the run and its verdict; return 1 if it is unexpected."""
    from rtamt_gym.play.saved_case import SavedCase
    from rtamt_gym.results.statistics import Results

    check_outputs(options.save, picture=options.plot, inputs=[options.case])
    saved = SavedCase.load(options.case)
    with noted_ends():
        replayed = saved.replay(accept_changed=options.accept_changed)
        changes = _changes(saved, accepted=options.accept_changed)
    print(*map(shown_lines, [*_lines(saved, replayed), *changes]), sep="\n")
    if options.explain:
        print("", shown_lines(str(replayed.explain())), sep="\n")
    if options.save:
        replayed.save(options.save)
        print("", f"run: {options.save}", sep="\n")
    if options.plot:
        from rtamt_gym.drawing import save
        from rtamt_gym.play.run import draw
        from rtamt_gym.search.falsification.falsification import with_inputs

        save(draw([with_inputs(replayed, saved.case)]), options.plot)
        print("", f"picture: {options.plot}", sep="\n")
    trial, text = replayed.trial(), str(saved.requirement.formula)
    warnings = evidence_warnings(Results([trial], {saved.name: text}), "run", Required.of(options))
    print_warnings(warnings)
    return exit_code([] if saved.gives(replayed) else ["violated"], warnings)


_ENDED = {
    "violation": "stopped at a violation",
    "decided": "stopped when every verdict was certain",
    "known": "stopped when every robustness was known",
    "terminated": "until the system ended",
    "truncated": "until the time limit",
    "duration": "until the duration was over",
    "error": "until an error",
}
"""How a run ended, in words."""


def _lines(saved: SavedCase, replayed: Run) -> Iterator[str]:
    from rtamt_gym.play.summaries import case_lines
    from rtamt_gym.results.outcome import verdict_text
    from rtamt_gym.results.warnings import trigger_texts

    course = replayed.histories[saved.name]
    yield shown(f"{saved.name} of {replayed.system}")
    yield from _wrapped(str(saved.requirement.formula))
    yield "input:"
    yield from case_lines(saved.case)
    seed = "" if saved.seed is None else f", seed {saved.seed}"
    last = sample_text(replayed.last_sample, replayed.period)
    yield f"{counted(replayed.steps + 1, 'sample')} to {last}, {_ENDED[replayed.ended]}{seed}"
    yield ""
    verdict = verdict_text(course.verdict, course.final)
    got = f"{verdict}, robustness {course.final_text('.6g')}"
    triggers = trigger_texts(
        course.triggers or (), lambda at: sample_text(int(at), replayed.period)
    )
    if saved.repeats(replayed):
        yield f"{got}: as expected, to the last bit"
        yield from (line for text in triggers for line in _wrapped(text, ""))
        return
    yield got
    other = "another robustness" if saved.gives(replayed) else "another verdict"
    yield from _wrapped(
        f"expected {verdict_text(saved.verdict, saved.robustness)}, robustness "
        f"{number(saved.robustness)}: {other}",
        "",
    )
    changes = [f"{name} {now} (then {then})" for name, (then, now) in saved.newer().items()]
    if changes:
        yield from _wrapped(f"run by {', '.join(changes)}", "")
    yield from (line for text in triggers for line in _wrapped(text, ""))


def _changes(saved: SavedCase, *, accepted: bool) -> list[str]:
    """Return lines on the known changes since the case was saved."""
    from rtamt_gym.results.provenance import listed

    if saved.fingerprint is None:
        return _wrapped("note: no hashes in the file: a change of the model cannot be seen", "")
    changes = saved.fingerprint.changes(saved.current()) if accepted else []
    lines = _wrapped(f"since the case was saved: {listed(changes)}", "") if changes else []
    for change in saved.fingerprint.unseen:
        lines += _wrapped(f"note: a change of {change} cannot be seen", "")
    return lines


def _wrapped(text: str, indent: str = "  ") -> list[str]:
    return textwrap.wrap(text, 79, initial_indent=indent, subsequent_indent="  ")
