"""What a robustness says under a semantics, in words."""

from __future__ import annotations

import rtamt
from rtamt import SemanticsName

__all__ = ["EXACT", "described", "robustness_text"]

EXACT: tuple[SemanticsName, ...] = ("standard", "boolean")
"""The semantics under which every predicate counts, so that the sign of a robustness decides."""


def robustness_text(
    value: float, semantics: SemanticsName, verdict: rtamt.Verdict, form: str = ".6g"
) -> str:
    """Writes a robustness; one of 0 with what its sign says, unless that is not known.

    Example:
        >>> undecided = rtamt.Verdict.UNDECIDED
        >>> [robustness_text(value, "standard", undecided) for value in (0.5, 0.0, -0.0)]
        ['0.5', '0, holds', '0, violated']
        >>> robustness_text(0.0, "input-vacuity", undecided)
        '0'
    """
    if value != 0.0:
        return format(value, form)
    if verdict == 0 and semantics not in EXACT:
        return "0"
    return "0, holds" if rtamt.holds(value) else "0, violated"


def described(spec: rtamt.Specification, judge: rtamt.EpisodeMonitor) -> str:
    """The formula of a judge, with its semantics unless that is the standard one."""
    interface = judge.interface
    if interface.semantics == "standard":
        return str(spec.formula)
    words = [str(interface.semantics)]
    words += [f"input {name}" for name in interface.inputs]
    words += [f"output {name}" for name in interface.outputs]
    return f"{spec.formula} under {', '.join(words)}"
