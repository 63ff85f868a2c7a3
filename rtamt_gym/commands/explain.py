"""`rtamt explain`: which samples of a recorded trace decided the robustness."""

from __future__ import annotations

import argparse

import rtamt
from rtamt_gym.commands.arguments import Commands, add_trace, read_samples, read_specs

__all__ = ["add"]


def add(commands: Commands) -> None:
    """Adds the arguments of `rtamt explain`."""
    explain = commands.add_parser(
        "explain",
        help="say which samples of a recorded trace decided",
        description="Follows the robustness of a file of samples, from the specification through "
        "its formulas down to the predicate and the sample that decided it. Of equal values, the "
        "first operand and the first sample are shown. Exits 1 on a violation, else 0.",
        epilog="example: rtamt explain requirements.stl drive.csv",
        allow_abbrev=False,
    )
    add_trace(explain)
    explain.set_defaults(run=_explain)


def _explain(options: argparse.Namespace) -> int:
    from rtamt_gym.recorded.judge import viewed

    specs = read_specs(options.specs)
    trace, period = read_samples(options, specs)
    explanations = {
        name: rtamt.explain(
            viewed(spec, options.view), trace.columns, period, n=trace.samples, start=trace.start
        )
        for name, spec in specs.items()
    }
    several = len(specs) > 1
    texts = (f"{name}:\n{e}" if several else str(e) for name, e in explanations.items())
    print(*texts, sep="\n\n")
    return 1 if any(e.robustness < 0 for e in explanations.values()) else 0
