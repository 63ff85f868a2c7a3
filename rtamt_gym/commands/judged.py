"""A recorded trace with the judgements of its requirements, or their failures."""

from __future__ import annotations

import traceback
from dataclasses import dataclass, field
from fractions import Fraction

from rtamt.errors import shown_lines
from rtamt_gym.commands.errors import options_of, refusal, unexpected
from rtamt_gym.recorded.judge import TraceJudgement
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.results.outcome import Failure


@dataclass(slots=True)
class Judged:
    """A trace with the results of its requirements.

    Attributes:
        path: The name of the trace.
        trace: Its samples or events; None if it could not be read.
        period: Seconds between samples, if they are known.
        judgements: The judgement of each requirement that was evaluated.
        failures: The failure of each other requirement.
    """

    path: str
    trace: Trace | EventTrace | None = None
    period: Fraction | None = None
    judgements: dict[str, TraceJudgement] = field(default_factory=dict)
    failures: dict[str, Failure] = field(default_factory=dict)


def failure_of(error: Exception) -> Failure:
    """Return an error as a failure, with a traceback if it was not expected."""
    message = refusal(error, options_of("explain"))  # all commands of traces have them
    if message is None:
        return Failure(unexpected(error), shown_lines("".join(traceback.format_exception(error))))
    return Failure(message)
