"""`OfflineRunner`: runs cases to their end and judges them afterwards, where this is faster."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from rtamt import Formula, RtamtError, Specification, Verdict
from rtamt.patterns import stages
from rtamt_gym.judging.judge import TriggerCounter
from rtamt_gym.play.history import SimulatedTrace
from rtamt_gym.play.runner import CaseLike, Runner
from rtamt_gym.results.outcome import Outcome
from rtamt_gym.results.trial import Trial


def prefers_offline(specs: Mapping[str, Specification], runner: Runner) -> bool:
    """Return whether an `OfflineRunner` is faster: a window contains a combination of windows.

    For ``always[0:30](p implies eventually[0:5] q)``, updates of a monitor take ten times as long
    as the simulation of a scenario, and the robustness of the whole trace a tenth.
    """
    return (
        runner.duration is not None
        and runner.evaluation_options.view == "episode"
        and runner.evaluation_options.semantics == "standard"
        and all(spec.unit == "s" and spec.horizon <= runner.duration for spec in specs.values())
        and any(_nests(spec.formula) for spec in specs.values())
    )


class OfflineRunner:
    """Runs cases to the end, and judges them by their samples.

    `Runner` returns the same rows, except that a run without a violation is never stopped, and that
    its verdicts are certain at its end. A run with a violation, with an error or with an open
    verdict runs again under monitors, which stop it.
    """

    def __init__(self, runner: Runner) -> None:
        self._runner = runner
        self._trigger_counters: dict[Fraction | None, TriggerCounter] = {}
        self._horizon = max(spec.horizon for spec in runner.requirements.values())

    def close(self) -> None:
        """Close the runner."""
        self._runner.close()

    def run(
        self,
        cases: Iterable[CaseLike],
        seeds: Sequence[int] | None = None,
        *,
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """Run cases, as `Runner.run` does."""
        listed = list(cases)
        satisfied: dict[int, Trial] = {}
        for index, row, trace in self._runner.whole(listed, seeds):
            if row.simulated < self._horizon:
                continue
            with suppress(RtamtError):  # the loop below runs these cases again
                judge, names = self._runner.judge, self._runner.requirements
                robustness = {name: judge(name, trace) for name in names}
                if not np.signbit(list(robustness.values())).any():
                    satisfied[index] = self._satisfied(row, robustness, trace)
        yield from satisfied.items()
        for index in range(len(listed)):
            if index not in satisfied:
                own = None if seeds is None else [seeds[index]]
                for _, row in self._runner.run([listed[index]], own, above=above):
                    yield index, row

    def _satisfied(
        self, row: Trial, robustness: Mapping[str, float], trace: SimulatedTrace
    ) -> Trial:
        """Return the row of a run that satisfies all requirements."""
        period, reading = trace.period, self._runner.evaluation_options
        if period not in self._trigger_counters:
            specs = self._runner.requirements
            self._trigger_counters[period] = TriggerCounter(specs, reading.having(period=period))
        verdicts = dict.fromkeys(robustness, Verdict.SATISFIED)
        terminated = row.ended == "terminated"
        end = (reading.at_termination or "complete") if terminated else reading.at_truncation
        evidence = self._trigger_counters[period].evidence(
            trace.signals, trace.samples, end, verdicts
        )
        last = round(row.simulated / (period or 1))
        outcomes = {
            name: Outcome.at(
                [value] * 3,
                Verdict.SATISFIED,
                last,
                period,
                evidence[name],
                1.0 if stages(self._runner.requirements[name]) else None,
            )
            for name, value in robustness.items()
        }
        return replace(row, outcomes=outcomes)


def _nests(formula: Formula) -> bool:
    """Return whether a window contains a combination of windows."""
    return any(_timed(node) and any(map(_combines, node.args)) for node in formula.nodes())


def _combines(node: Any) -> bool:  # noqa: ANN401 - a formula or a term
    """Return whether a node combines formulas, and one of them has a window."""
    if len(node.args) > 1 and any(_timed(part) for arg in node.args for part in arg.nodes()):
        return True
    return any(map(_combines, node.args))


def _timed(node: Any) -> bool:  # noqa: ANN401 - a formula or a term
    return node.op is not None and bool(node.op.timed)
