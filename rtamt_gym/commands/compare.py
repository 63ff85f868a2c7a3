"""`rtamt compare`: which of two policies satisfies the requirements more often."""

from __future__ import annotations

import argparse
from pathlib import Path

from rtamt_gym.commands.evaluate import check_files, tell_files
from rtamt_gym.options.command_line import ALTHOUGH_CHANGED, Option, add_options, shared
from rtamt_gym.results.warnings import exit_code


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Compares two evaluations of the same requirements, pair by pair of episodes with the same "
        "seed. Exits 1 if B is shown to satisfy a requirement less often than A, else 0."
    )
    parser.epilog = "example: rtamt compare old.json new.json"
    evaluations = [
        Option(
            f"{name}.json",
            f"the evaluation {name}, as rtamt evaluate --save writes it",
            read=Path,
            dest=name.lower(),
        )
        for name in ("A", "B")
    ]
    add_options(
        parser,
        *evaluations,
        shared("--accept-changed", about=f"compare two evaluations {ALTHOUGH_CHANGED}"),
        Option("--save FILE", "write the comparison as JSON", read=Path),
        Option("--report FILE", "write the comparison as a page of HTML", read=Path),
    )


def run(options: argparse.Namespace) -> int:
    """Compares, and prints what is shown; returns 1 if B is worse in a requirement."""
    from rtamt_gym.evaluation.comparison import compare
    from rtamt_gym.evaluation.evaluation import Evaluation

    check_files(options, options.a, options.b)
    a, b = Evaluation.load(options.a), Evaluation.load(options.b)
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
