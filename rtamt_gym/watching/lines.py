"""The state of a requirement of a stream at one time, and its line of JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import NamedTuple

from rtamt import Verdict


class Line(NamedTuple):
    """A requirement at one time.

    Attributes:
        requirement: Its name.
        group: The group; None without groups.
        time: The time of the sample in seconds; None if bounds count samples.
        sample: The number of the sample, from 0; None in dense time.
        verdict: The verdict.
        robustness: The robustness if the trace ended here; nan before it has one.
        lower: The minimum robustness over all continuations.
        upper: The maximum robustness over all continuations.
        end: The end mode; ``"open"`` before the end of the input.
        decided_at: The time of the decisive sample, or its number without times; None if undecided.
        reason: The decisive values or end; empty if undecided.
        final: Whether the trace has ended.
        instants: The numbers of instants by verdict, in a final line of ``--view step``.
        missing: The number of empty cells of each variable, in a final line; None without any.
    """

    requirement: str
    group: str | None
    time: float | None
    sample: int | None
    verdict: Verdict
    robustness: float
    lower: float
    upper: float
    end: str = "open"
    decided_at: float | None = None
    reason: str = ""
    final: bool = False
    instants: Mapping[str, int] | None = None
    missing: Mapping[str, int] | None = None

    def to_json(self) -> str:
        """Return the line as strict JSON, as results are written."""
        time = "null" if self.time is None else _number(self.time)
        group = "" if self.group is None else f'"group": {json.dumps(self.group)}, '
        head = (
            f'{{"time": {time}, "sample": {"null" if self.sample is None else self.sample}, '
            f'"requirement": {_quoted(self.requirement)}, {group}'
            f'"verdict": "{_NAMES[self.verdict]}", "robustness": {_number(self.robustness)}, '
            f'"lower": {_number(self.lower)}, "upper": {_number(self.upper)}, '
            f'"end": "{self.end}"'
        )
        if self.decided_at is not None:
            head += f', "decided_at": {_number(self.decided_at)}'
        if self.reason:
            head += f', "reason": {json.dumps(self.reason)}'
        if self.instants is not None:
            head += f', "instants": {json.dumps(dict(self.instants))}'
        if self.missing:
            head += f', "missing": {json.dumps(dict(self.missing))}'
        return f'{head}, "final": {"true" if self.final else "false"}}}'


_NAMES = {verdict: verdict.name for verdict in Verdict}

_quotes: dict[str, str] = {}


def _quoted(name: str) -> str:
    if name not in _quotes:
        _quotes[name] = json.dumps(name)
    return _quotes[name]


def _number(value: float) -> str:
    if math.isfinite(value):
        return repr(value)
    return "null" if math.isnan(value) else ('"inf"' if value > 0 else '"-inf"')
