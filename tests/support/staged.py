"""An independent implementation of progress in stages."""

import math
from collections.abc import Sequence
from typing import Literal

import rtamt
from rtamt import Formula, Verdict

NAMES = ("a", "b", "c")
End = Literal["complete", "cut", "open"]
Rows = Sequence[Sequence[float]]


def taken(formula: Formula, row: Sequence[float]) -> dict[str, float]:
    """Return the sample for a monitor of the formula."""
    named = zip(NAMES, row, strict=True)
    return {name: value for name, value in named if name in formula.variables}


def verdict(formula: Formula, rows: Rows, end: End | None = None) -> Verdict:
    """Return the verdict after these samples, or after the end."""
    monitor = rtamt.EpisodeMonitor(formula)
    for row in rows:
        monitor.update(taken(formula, row))
    if end is not None:
        monitor.finish(end)
    return monitor.verdict


def fed(formula: Formula, rows: Rows) -> float:
    """Return the robustness after these samples."""
    monitor = rtamt.EpisodeMonitor(formula)
    robustness = math.nan
    for row in rows:
        robustness = monitor.update(taken(formula, row))
    return robustness


def decided(chains: Sequence[Formula], rows: Rows, end: End | None = None) -> int:
    """Return the stages that are certainly satisfied after these samples.

    Args:
        chains: The formula of the first stage, of the first two, and so on.
        rows: The samples.
        end: The end mode, if the trace has ended.
    """
    found = [verdict(each, rows, end) is Verdict.SATISFIED for each in chains]
    return max((number for number, holds in enumerate(found, 1) if holds), default=0)


def progress(
    whole: Formula,
    stages: Sequence[Formula],
    chains: Sequence[Formula],
    rows: Rows,
    end: End | None,
) -> list[float]:
    """Return the progress after every sample, and after the end.

    Args:
        whole: The requirement.
        stages: Its stages.
        chains: As for `decided`.
        rows: The samples.
        end: The end mode.
    """
    found = [0.0]
    count, begun, r0 = len(stages), 0, math.nan
    reached, almost = -1, math.nextafter(1, 0)
    for t in range(len(rows)):
        now = decided(chains, rows[: t + 1])
        if now != reached:
            reached, begun, r0 = now, t, math.nan
        if verdict(whole, rows[: t + 1]) is Verdict.SATISFIED:
            found.append(1.0)
            continue
        if reached == count:
            found.append(max(found[-1], almost))
            continue
        r = fed(stages[reached].eventually(), rows[begun : t + 1])
        if math.isnan(r0) and math.isfinite(r):
            r0 = r
        share = 1.0 if r >= 0 else max(0.0, 1 - r / r0) if r0 < 0 else 0.0
        place = min((reached + share) / count, math.nextafter((reached + 1) / count, 0))
        found.append(max(found[-1], place))
    last = 1.0
    if verdict(whole, rows, end) is not Verdict.SATISFIED:
        last = min(decided(chains, rows, end) / count, almost)
    return [*found[1:], max(found[-1], last)]
