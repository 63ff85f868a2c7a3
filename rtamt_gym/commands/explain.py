"""`rtamt explain`: prints which samples or times of a recorded trace decided the robustness."""

from __future__ import annotations

import argparse

import rtamt
from rtamt_gym.commands.arguments import (
    add_dense,
    add_specs_and_trace,
    read_dense,
    read_samples,
    read_specs,
)
from rtamt_gym.judges.interface import EXACT

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Follows the robustness of a recorded trace from the specification through its formulas "
        "down to the predicate and the sample or the time that decided it. Where several have the "
        "same value, the first operand and the first sample are shown. Exits 1 on a violation, "
        "else 0."
    )
    parser.epilog = "example: rtamt explain requirements.stl drive.csv"
    add_specs_and_trace(parser)
    add_dense(parser)


def run(options: argparse.Namespace) -> int:
    """Prints an explanation for each specification; returns 1 if one is violated, else 0."""
    from rtamt_gym.recorded.judge import viewed

    specs = read_specs(options.specs)
    semantics = options.semantics
    explanations: dict[str, rtamt.Explanation | rtamt.DenseExplanation]
    if options.dense:
        tables = read_dense(options, specs).tables
        explanations = {
            name: rtamt.explain_dense(viewed(spec, options.view), tables, semantics=semantics)
            for name, spec in specs.items()
        }
    else:
        trace, period = read_samples(options, specs)
        explanations = {
            name: rtamt.explain(
                viewed(spec, options.view),
                trace.columns,
                period,
                n=trace.samples,
                start=trace.start,
                semantics=semantics,
            )
            for name, spec in specs.items()
        }
    several = len(specs) > 1
    texts = (f"{name}:\n{e}" if several else str(e) for name, e in explanations.items())
    print(*texts, sep="\n\n")
    return 1 if any(_is_violated(e.robustness, options) for e in explanations.values()) else 0


def _is_violated(robustness: float, options: argparse.Namespace) -> bool:
    """Whether the sign says so; that of a 0 says nothing where predicates may be left out."""
    if robustness == 0.0 and options.semantics not in EXACT:
        return False
    return not rtamt.holds(robustness)
