"""The options of a stream: how it is read and judged."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import rtamt
from rtamt import InputError
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.watching.states import StreamStop

RowFormat = Literal["csv", "ndjson"]
"""How lines hold rows."""


@dataclass(frozen=True)
class WatchOptions:
    """How a stream is read and judged.

    Attributes:
        specs: The requirements by name.
        reading: The options of evaluation.
        columns: How columns are read.
        format: How lines hold rows; None to recognise it by the first byte.
        by: The columns that name groups; without one, all rows are one trace.
        max_groups: The maximum number of groups at one time.
        group_idle: Seconds of trace time after which a group has ended; None: never.
        every: Whether every sample has lines.
        stop: When the stream stops.
        skip_bad: Whether bad lines are left out.
        min_duration: Minimum length of each trace in seconds; None for any length.
        live: Whether the input may end in the middle of a line, as a socket or a growing file.
    """

    specs: Mapping[str, rtamt.Specification]
    reading: EvaluationOptions
    columns: Columns
    format: RowFormat | None = None
    by: Sequence[str] = ()
    max_groups: int = 100_000
    group_idle: Fraction | None = None
    every: bool = False
    stop: StreamStop = "end"
    skip_bad: bool = False
    min_duration: Fraction | None = None
    live: bool = False

    def __post_init__(self) -> None:
        stated = self.reading.period is not None
        if stated and self.reading.dense:
            raise InputError("expected --period or --dense, which reads events at any time")
        if self.min_duration is not None and self.stop != "end":
            raise InputError(
                f"expected --min-duration without --stop {self.stop}, which ends a trace early"
            )
        if not self.by and self.group_idle is not None:
            raise InputError("--group-idle ends groups, which --by COLUMN makes")
        if self.by and self.skip_bad and stated:
            raise InputError(
                "expected --skip-bad without --by and --period: the group of a bad line is not "
                "known. Leave out --period, so that the times show the gap."
            )
        unknown = self.skip_bad or self.columns.missing == "unknown"
        bounded = [name for name, spec in self.specs.items() if spec.horizon < math.inf]
        if unknown and self.reading.view == "step" and bounded:
            option = "--skip-bad" if self.skip_bad else "--missing unknown"
            raise InputError(
                f"{option}: --view step needs the robustness at each instant, which a sample that "
                "is not known does not have"
            )
