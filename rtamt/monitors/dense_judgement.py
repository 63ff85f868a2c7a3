"""The verdict on a whole trace in dense time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Unpack

import numpy as np

from rtamt.inputs.event_reader import Column, EventReader
from rtamt.inputs.events import EventsLike, Given
from rtamt.machines.backend import BACKENDS
from rtamt.machines.dense.foresight import DenseForesight, MakeDense
from rtamt.machines.protocols import End
from rtamt.machines.readout import verdict_of
from rtamt.monitors.dense_untested import found_untested_dense
from rtamt.monitors.judgement import Judgement
from rtamt.monitors.monitor import Verdict
from rtamt.monitors.options import Options, Spec, checked_end, compiled_dense, listed_in_signature
from rtamt.monitors.untested import Untested
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.polarity import positive
from rtamt.program.timing import Period

__all__ = ["judge_dense"]


@listed_in_signature(Options)
def judge_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    end: End = "cut",
    *,
    resolution: Period = "1ns",
    **options: Unpack[Options],
) -> Judgement:
    """The verdict on a whole trace in dense time, by what its end means.

    It is about the first time at which all variables are known; the trace ends at the earliest of
    their last events, an instant that is known. Invariants are written ``always(...)``. It costs
    about ten evaluations of the trace; the attributes `untested` and `decided_at` of the result
    cost more, when they are first asked for.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: As for `evaluate_dense`.
        end: As for `judge`: ``"complete"``, ``"cut"`` or ``"open"``.
        resolution: As for `DenseMonitor`.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`.

    Returns:
        The judgement. Its ``decided_at`` is a time as those of the events, `numpy.datetime64` too;
        ``untested`` is in seconds, of dates since 1970.

    Raises:
        SpecificationError: As for `evaluate_dense`.
        InputError: As for `evaluate_dense`, on another reading of the end, and on a trace that with
            the bounds of the formula lasts 2^62 ticks or more.
        InputTypeError: As for `evaluate_dense`.

    Example:
        >>> trace = {"req": [(0, 0), (1, 4), (1.5, 0), (6, 0)], "gnt": [(0, 0), (2.25, 5), (6, 5)]}
        >>> judge_dense("always(req >= 3 implies eventually[0:2](gnt >= 3))", trace).verdict.name
        'SATISFIED'
        >>> print(judge_dense("always[0:8](gnt < 9)", trace))
        UNDECIDED: always[0:8](gnt < 9)
        robustness 4, bounds -inf to 4 under end="cut"
        always[0:8](gnt < 9): not recorded: 6 s to 8 s
        if the trace is all there is, end="complete" says SATISFIED

    Source: see `DenseMonitor`.
    """
    reading = checked_end(end)
    specification, _, backend, whole = compiled_dense(
        judge_dense, spec, resolution, options, online=False
    )
    alone = whole.result_alone()
    reader = EventReader(alone)
    given = reader.whole(signals)
    machine = BACKENDS[backend].dense_machine
    worst, robustness = _complete(alone, machine, given)
    columns, dated = reader.counted(given, [-np.inf] * len(given), None)
    begin = max(int(ticks[0]) for ticks, _ in columns)
    last = min(int(ticks[-1]) for ticks, _ in columns)
    known = [_between(column, begin, last) for column in columns]
    foresight = DenseForesight(whole, machine, known, last - begin)
    lower, upper = foresight.bounds(cut=False)
    decided = verdict_of(lower, upper) != 0
    if not decided and reading == "complete":
        lower, upper = worst, robustness
    elif not decided and reading == "cut":
        lower, upper = foresight.bounds(cut=True)

    def untested() -> tuple[Untested, ...]:
        if reading == "complete" or verdict_of(lower, upper) != 0:
            return ()
        return found_untested_dense(foresight, begin, whole.resolution, cut=reading == "cut")

    return Judgement.of(
        (robustness, lower, upper),
        reading,
        str(specification.formula),
        Verdict(verdict_of(worst, robustness)),
        untested,
        lambda: reader.time(begin + _first_decided(foresight), dated) if decided else None,
    )


def _complete(alone: DenseProgram, machine: MakeDense, given: list[Given]) -> tuple[float, float]:
    """The robustness if the trace is all there is: two zeros if it hangs on neutral predicates."""
    readings = [alone.program]
    if alone.program.neutral:
        readings = [positive(alone.program).reading(zero) for zero in (-0.0, 0.0)]
    found = []
    for program in readings:
        part = DenseProgram(program, alone.resolution)
        _, values = machine(part, EventReader(part), ()).run(given)
        found.append(float(values[0]))
    return found[0], found[-1]


def _between(column: Column, begin: int, last: int) -> Column:
    """The events of the trace, counted from its begin, where the first one is."""
    ticks, values = column
    first = int(np.searchsorted(ticks, begin, "right")) - 1
    after = int(np.searchsorted(ticks, last, "right"))
    return np.maximum(ticks[first:after], begin) - begin, values[first:after]


def _first_decided(foresight: DenseForesight) -> int:
    """The first tick at which the open reading of the trace up to it is decided."""
    low, high = -1, foresight.last
    while high - low > 1:
        middle = (low + high) // 2
        decided = verdict_of(*foresight.until(middle).bounds(cut=False)) != 0
        low, high = (low, middle) if decided else (middle, high)
    return high
