"""The monitors of one requirement on the events of one trace, and their verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import rtamt
from rtamt import InputError, Verdict
from rtamt.typing import End
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.watching.states import RowValues, StreamRules


class EventState:
    """A requirement on the events of one trace.

    If its variables start at different times, two traces are judged: one from the first value, with
    unknown values of the other variables, and one from the time when all variables have values. The
    worse verdict counts, as in a file.

    Args:
        rules: How traces are judged.
        name: The requirement.
        absent: The variables without a column.
    """

    def __init__(self, rules: StreamRules, name: str, absent: Sequence[str]) -> None:
        spec, options = rules.specs[name], rules.reading
        self.name = name
        nan = "unknown" if options.nan == "unknown" else "raise"
        self._keywords: dict[str, Any] = {"semantics": options.semantics, "nan": nan}
        self._spec = viewed(spec, options.view)
        self.monitor = rtamt.dense.EpisodeMonitor(self._spec, **self._keywords)
        declared = {*absent} & spec.defaults.keys()
        names = [v for v in self.monitor.variables if v not in declared] or self.monitor.variables
        self._places = {v: rules.variables.index(v) for v in names}
        self._started = False
        self._before: rtamt.dense.EpisodeMonitor | None = None
        self.verdict, self.reason = Verdict.UNDECIDED, ""
        self.decided_at: float | None = None
        self.begin = math.nan
        """The time at which the trace of the verdict starts."""
        self._instants: rtamt.dense.Monitor | None = None
        self.last_instant: Verdict | None = None
        self.changes = 0
        if rules.by_step and spec.horizon < math.inf:
            self._instants = rtamt.dense.Monitor(spec, semantics=options.semantics)

    def update(self, time: float, row: RowValues, known: Sequence[bool]) -> None:
        """Update the monitors with the values of the known variables from a time on."""
        present = [known[place] for place in self._places.values()]
        if not any(present):
            return
        if not all(present) and self._before is None:
            keywords = {**self._keywords, "nan": "unknown"}
            self._before = rtamt.dense.EpisodeMonitor(self._spec, **keywords)
            self.begin = time
        events = {
            name: [(time, row[place] if known[place] else math.nan)]
            for name, place in self._places.items()
        }
        if self._before is not None:
            self._before.update(events)
        if all(present):
            if not self._started and self._before is None:
                self.begin = time
            self._started = True
            self.monitor.update(events)

    def instants(
        self, time: float, row: RowValues, known: Sequence[bool]
    ) -> list[tuple[float, float]]:
        """Return the breakpoints of the robustness that the values settle."""
        if self._instants is None or not all(known[place] for place in self._places.values()):
            return []
        return self._instants.update({n: [(time, row[place])] for n, place in self._places.items()})

    @property
    def _counted(self) -> rtamt.dense.EpisodeMonitor:
        """The monitor whose verdict counts."""
        before = self._before
        if before is not None and (not self._started or before.verdict < self.monitor.verdict):
            return before
        return self.monitor

    def decide(self, time: float) -> bool:
        """Note a decision; return whether the values up to a time have decided the verdict."""
        counted = self._counted
        verdict = counted.verdict
        if not self._started and verdict is not Verdict.VIOLATED:
            verdict = Verdict.UNDECIDED  # the trace with all values has not started
        if verdict is self.verdict or self.verdict:
            return False
        self.verdict = verdict
        self.decided_at = time if self._before is not None else counted.decided_at
        return True

    def bounds(self) -> tuple[float, float, float]:
        """Return the robustness and its bounds."""
        counted, other = self._counted, self._before
        if self.verdict or self.monitor.finished or other is None:
            return counted.robustness, counted.lower, counted.upper
        if not self._started:
            return math.nan, -math.inf, math.inf
        lower = min(self.monitor.lower, other.lower)
        return counted.robustness, lower, max(self.monitor.upper, other.upper)

    def finish(self, end: End, *, early: bool) -> None:
        """End the trace.

        Args:
            end: The end mode.
            early: Whether more rows could have come.

        Raises:
            InputError: If a variable never had a value.
        """
        if not self._started and early:
            return
        if not self._started:
            raise InputError(f"{self.name}: expected events of every variable that it reads")
        self.monitor.finish(end)
        if self._before is not None:
            self._before.finish(end)
        verdict = self._counted.verdict
        if verdict is not self.verdict:
            self.verdict, self.reason = verdict, f"the end of the trace ({end})"

    @property
    def violates(self) -> bool:
        """Whether a violation is known that ``--stop violation`` waits for."""
        if self._instants is not None:
            return self.last_instant is Verdict.VIOLATED
        return self.verdict is Verdict.VIOLATED
