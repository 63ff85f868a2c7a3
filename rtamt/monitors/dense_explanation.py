"""The times that decided a robustness in dense time, and the sub-formulas through which they did.

`explain_dense` is the twin of `explain`, with times in place of samples.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from numbers import Real
from typing import Any, NamedTuple, Unpack, cast

import numpy as np

from rtamt.errors import InputError, InputTypeError, brief
from rtamt.inputs.arrays import kind_of
from rtamt.inputs.clock import shown
from rtamt.inputs.event_reader import Dated, EventReader, TimedColumn
from rtamt.inputs.events import EventsLike
from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.parser import as_specification
from rtamt.language.printing import number_text
from rtamt.language.table import Bounds, Operator
from rtamt.machines.backend import BACKENDS
from rtamt.machines.dense.outlook import recorded
from rtamt.machines.dense.rows import (
    FindBoth,
    RegionRows,
    TraceValues,
    Waiting,
    dense_of,
    readings_of,
    terms_of,
    together,
)
from rtamt.monitors.circumstances import Share, ShareRole, beside
from rtamt.monitors.dense_provenance import RegionValues, dense_origin_of
from rtamt.monitors.explanation import idle_registers, with_all_named
from rtamt.monitors.explanation_text import as_text
from rtamt.monitors.options import Options, Spec, compiled_dense, listed_in_signature
from rtamt.monitors.provenance import (
    FIRST_BEST,
    Origin,
    Visit,
    holds_by_sign,
    named,
    visits,
)
from rtamt.program.dense_lowering import MAX_TICKS
from rtamt.program.dense_regions import RegionProgram, regions_of_all
from rtamt.program.interface import PredicateValue
from rtamt.program.timing import Period

__all__ = [
    "DenseCause",
    "DenseCircumstance",
    "DenseExplanation",
    "DenseExplanationStep",
    "explain_dense",
]


class DenseCause(NamedTuple):
    """A value that a variable had from a time on."""

    variable: str
    time: float
    value: float


@dataclass(frozen=True, slots=True)
class DenseExplanationStep:
    """A formula on the way from the specification down to what decided its robustness.

    Times are of the kind of the events' times: numbers in the specification's unit, or
    `numpy.datetime64`.

    Attributes:
        formula: The formula.
        name: Its name in the specification, or None.
        text: The formula as text; named formulas inside it are shown by their names.
        time: The time at which it was evaluated.
        value: Its robustness there, exactly at this time, or right after it.
        witness: For ``until``, ``since`` and ``unless``: the time at which the right side was
            reached, whichever side decided, or which comes nearest to that where the formula fails;
            None if there is none.
        outside: Begin and end of the formula's window if the window lies outside the trace and
            that decided: the formula is then +inf or -inf whatever the signals are. The begin is
            None for a window without one, so is the end.
        reading: What a predicate counts under the semantics: its usual ``"value"``, +inf or -inf
            by its ``"sign"``, or ``"zero"``.
        after: Whether it was evaluated right after ``time``: up to the next tick, that not
            included.
        witness_after: Whether the right side was reached right after ``witness``.
    """

    formula: Formula
    name: str | None
    text: str
    time: float
    value: float
    witness: float | None = None
    outside: tuple[float | None, float | None] | None = None
    reading: PredicateValue = "value"
    after: bool = False
    witness_after: bool = False


@dataclass(frozen=True, slots=True)
class DenseCircumstance:
    """A formula that has a share in a violation, beside those that decided its robustness.

    It is what `Circumstance` is over samples.

    Attributes:
        formula: The formula.
        name: Its name in the specification, or None.
        text: The formula as text; named formulas inside it are shown by their names.
        role: As for `Circumstance`.
        window: Begin and end of the times at which it holds, or fails.
        time: Where it comes nearest to the other sign, the first of these times.
        value: Its robustness there, exactly at this time, or right after it.
        outside: As for `DenseExplanationStep`.
        after: Whether it comes nearest right after ``time``.
        open_begin: Whether the begin of ``window`` does not belong to it.
        open_end: Whether its end does not.
    """

    formula: Formula
    name: str | None
    text: str
    role: ShareRole
    window: tuple[float, float]
    time: float
    value: float
    outside: tuple[float | None, float | None] | None = None
    after: bool = False
    open_begin: bool = False
    open_end: bool = False


@dataclass(frozen=True)
class DenseExplanation:
    """The formulas and times that decided a robustness in dense time.

    It is what `Explanation` is over samples. ``str`` gives a table of at most 80 columns.

    Attributes:
        steps: From the specification down; each step takes its value, or the opposite, from the
            step below it. The last step is the predicate that decided, ``true`` or ``false``, or a
            temporal operator whose window lies outside the trace.
        causes: The variables of that predicate with their values at the time of the last step;
            empty if a window outside the trace decided.
        end: The time at which the trace ends.
        unit: The unit of the times, ``"s"`` unless the specification has another.
        circumstances: As for `Explanation`.
    """

    steps: tuple[DenseExplanationStep, ...]
    causes: tuple[DenseCause, ...]
    end: float
    unit: str = "s"
    circumstances: tuple[DenseCircumstance, ...] = ()

    @property
    def robustness(self) -> float:
        """The robustness that is explained."""
        return self.steps[0].value

    @property
    def time(self) -> float:
        """The time whose robustness is explained."""
        return self.steps[0].time

    @property
    def predicate(self) -> Formula | None:
        """The predicate that decided; None if a window outside the trace did."""
        last = self.steps[-1]
        return last.formula if last.outside is None else None

    def __str__(self) -> str:
        places: list[Any] = [_After(s.time) if s.after else s.time for s in self.steps]
        shown = [
            replace(s, witness=cast("Any", _After(s.witness))) if s.witness_after else s
            for s in self.steps
        ]
        circumstances: list[Any] = [
            (each, _After(each.time) if each.after else each.time, each.window)
            for each in self.circumstances
        ]
        return as_text(shown, places, self.causes, self._at, circumstances, end=self.end)

    def _at(self, time: object) -> str:
        if isinstance(time, _After):
            return f"after {self._at(time.time)}"
        if isinstance(time, np.datetime64):
            date, point, part = str(time).partition(".")
            part = part.rstrip("0")
            return f"{date}{point}{part}" if part else date
        return f"{number_text(float(cast('float', time)))} {self.unit}"


class _After(NamedTuple):
    """Right after a time."""

    time: object


@listed_in_signature(Options)
def explain_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    time: float | Fraction | np.datetime64 | None = None,
    *,
    resolution: Period = "1ns",
    **options: Unpack[Options],
) -> DenseExplanation:
    """Which sub-formulas and times decided the robustness at one time of a trace in dense time.

    It is `explain` for events: the way from the specification down to the predicate whose value at
    one time, or its opposite, is the robustness. It is exact at that instant, as `judge_dense` is:
    single instants count, which `evaluate_dense` leaves out. Where values are equal, the first
    operand decides, and of its times the first.

    Each step is at an instant, or right after one: a stretch between two instants has no first one.
    ``p since q`` asks for p right after the witness. Signals are right-continuous, so a variable
    has the same value right after a time.

    Where a window lies outside the trace, ``always`` is +inf and ``eventually`` -inf whatever the
    signals are; if that decided, the explanation ends with the operator and has no causes. It costs
    an evaluation for each operand of the formulas on the way.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: As for `evaluate_dense`.
        time: The time whose robustness is explained, of the kind of the events' times; it goes to
            the nearest tick. None: where the trace begins, the first time at which all variables
            are known.
        resolution: As for `DenseMonitor`.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`.

    Raises:
        SpecificationError: As for `evaluate_dense`.
        InputError: As for `evaluate_dense`, and if the time is not one of the trace, or a number
            where the events have dates, or the other way round.
        InputTypeError: As for `evaluate_dense`, and if ``time`` is no number.

    Example:
        >>> trace = {"req": [(0, 0), (1.5, 4), (1.6, 0), (9, 0)], "gnt": [(0, 0), (4, 2), (9, 2)]}
        >>> e = explain_dense("always(req >= 3 implies eventually[0:3](gnt >= 3))", trace)
        >>> print(e)
        robustness -1 at 0 s, decided by req >= 3 at 1.5 s
        <BLANKLINE>
           at  value  formula
          0 s     -1  always(req >= 3 implies eventually[0:3](gnt >= 3))
        1.5 s     -1  req >= 3 implies eventually[0:3](gnt >= 3)
        1.5 s      1  req >= 3
        1.5 s      4  req
          4 s     -1  missing: gnt >= 3
                        nowhere from 1.5 s to 4.5 s; this is the nearest
        >>> e.predicate, e.causes
        (<Formula req >= 3>, (DenseCause(variable='req', time=1.5, value=4.0),))

    Source: as for `explain`.
    """
    specification = as_specification(spec)
    names, observed = with_all_named(specification)
    _, interface, backend, whole = compiled_dense(
        explain_dense, observed, resolution, options, online=False
    )
    alone = whole.result_alone()
    reader = EventReader(alone)
    given = reader.whole(signals)
    made = BACKENDS[backend]
    made.dense_machine(alone, reader, ()).run(given)  # refuses what evaluate_dense refuses
    columns, dated = reader.counted(given, [-np.inf] * len(given), None)
    begin = max(int(ticks[0]) for ticks, _ in columns)
    end = min(int(ticks[-1]) for ticks, _ in columns)
    tick = begin if time is None else _tick(time, reader, begin, end, dated=bool(dated))
    regions = regions_of_all(observed, whole.resolution, interface=interface)
    if end - begin + regions.reach >= MAX_TICKS:
        reader.refuse_length(end - begin + regions.reach)
    terms = made.term_columns, made.term_ranges
    course = _Course(regions, names, terms, reader, _TraceEvents(columns, begin, end, dated))
    way = list(visits(specification, interface, 2 * (tick - begin), course.origin))

    def moment(place: int | None) -> Any:  # noqa: ANN401 - None, a float or a date
        return None if place is None else reader.time(begin + place // 2, dated)

    def circumstance(share: Share) -> DenseCircumstance:
        place, value = course.nearest(share)
        single = share.first == share.last
        window = (share.first, share.first) if single else (share.first, share.last + 1)
        return DenseCircumstance(
            *(share.formula, *named(specification, share.formula), share.role),
            (moment(window[0]), moment(window[1])),
            *(moment(place), value),
            share.outside and (moment(share.outside[0]), moment(share.outside[1])),
            after=place % 2 == 1,
            open_begin=share.first % 2 == 1,
            open_end=share.last % 2 == 1,
        )

    steps = tuple(
        DenseExplanationStep(
            *(visit.formula, visit.name, visit.text, moment(visit.place)),
            course.robustness(visit.formula).at(visit.place),
            moment(visit.origin.witness),
            visit.origin.outside
            and (moment(visit.origin.outside[0]), moment(visit.origin.outside[1])),
            visit.reading,
            after=visit.place % 2 == 1,
            witness_after=(visit.origin.witness or 0) % 2 == 1,
        )
        for visit in way
    )
    causes: tuple[DenseCause, ...] = ()
    if steps[-1].outside is None:
        decided = begin + way[-1].place // 2
        signal = dict(zip(alone.program.variables, columns, strict=True))
        causes = tuple(
            DenseCause(v, steps[-1].time, float(values[ticks.searchsorted(decided, "right") - 1]))
            for v in steps[-1].formula.variables
            for ticks, values in [signal[v]]
        )
    violated = not holds_by_sign(steps[0].value)
    circumstances = tuple(map(circumstance, course.beside(way) if violated else ()))
    last = moment(2 * (end - begin))
    return DenseExplanation(steps, causes, last, specification.unit, circumstances)


def _tick(time: object, reader: EventReader, begin: int, end: int, *, dated: bool) -> int:
    """The tick of a time of the trace."""
    if isinstance(time, np.number) and not isinstance(time, np.timedelta64):
        time = time.item()
    first, last = (shown(reader.time(tick, dated)) for tick in (begin, end))
    trace = f"expected a time from {first} to {last}"
    is_date = isinstance(time, np.datetime64)
    no_date = ", which is no datetime64" if dated else ""
    if not is_date and (not isinstance(time, Real) or isinstance(time, bool | np.timedelta64)):
        raise InputTypeError(f"{trace}, got {kind_of(time)}{no_date}")
    got = f"{trace}, got {shown(time) if is_date else brief(time)}"
    if dated != is_date:
        raise InputError(f"{got}{no_date or ', which is a date'}")
    if isinstance(time, np.datetime64):
        finite = not np.isnat(time)
        tick = int(reader.clock.ticks(np.array([time]), "")[0]) if finite else end + 1
    else:
        finite = not isinstance(time, float) or math.isfinite(time)
        tick = reader.clock.nearest(time) if finite else end + 1
    if not begin <= tick <= end:
        raise InputError(got)
    return tick


class _TraceEvents(NamedTuple):
    """The events of every variable, and the ticks at which the trace begins and ends."""

    columns: Sequence[TimedColumn]
    begin: int
    end: int
    dated: Dated


class _Course:
    """The robustness of every formula over the trace, each found when it is first asked for.

    Args:
        regions: The program, with an output for every formula.
        names: The names of the outputs.
        terms: Evaluates terms.
        reader: Raises the errors of terms.
        trace: The trace.
    """

    def __init__(
        self,
        regions: RegionProgram,
        names: Mapping[str, Formula],
        terms: FindBoth,
        reader: EventReader,
        trace: _TraceEvents,
    ) -> None:
        self._program, self._bounds = regions.program, dense_of(regions).bounds
        outputs = regions.program.outputs
        self._registers: dict[Node, int] = {f: outputs[name] for name, f in names.items()}
        self._idle = idle_registers(regions.program)
        self._terms, self._reader = terms, reader
        waiting = [Waiting() for _ in trace.columns]
        for each, column in zip(waiting, trace.columns, strict=True):
            each.extend(column)
        self._values = TraceValues(*together(waiting, trace.begin, trace.end), trace.dated)
        self._begin, self._last = trace.begin, 2 * (trace.end - trace.begin)
        self._found: dict[int, RegionValues] = {}

    def robustness(self, formula: Node) -> RegionValues:
        register = self._registers[formula]
        if register not in self._found:
            self._found[register] = self._run(register)
        return self._found[register]

    def _run(self, register: int) -> RegionValues:
        if register in self._idle:
            # What the result does not need decides nothing, and may have no value.
            return RegionValues(np.zeros(1, np.int64), np.array([math.nan]))
        part = self._program.restricted(register, {})
        positions = 2 * (self._values.ticks - self._begin)
        found = terms_of(readings_of(part), self._terms, self._reader, self._values)
        rows = [RegionRows(positions, each) for each in found]
        _, runs = recorded(part, rows, self._last, "complete")
        return RegionValues(runs.starts, runs.last)

    def nearest(self, share: Share) -> tuple[int, float]:
        """Where a formula comes nearest to the other sign, and its value there."""
        signal = self.robustness(share.formula)
        first, last = signal.starts.searchsorted((share.first, share.last), "right") - 1
        values = signal.values[first : last + 1]
        place = first + FIRST_BEST["min" if share.role == "held" else "max"](values)
        return max(share.first, int(signal.starts[place])), float(signal.values[place])

    def beside(self, way: Sequence[Visit]) -> Iterator[Share]:
        """What else the violation of a way stands on."""
        origin = functools.partial(self.origin, earliest=True)
        return beside(way, origin, lambda formula, i: self.robustness(formula).at(i))

    def origin(
        self, formula: Formula, row: Operator, position: int, *, earliest: bool = False
    ) -> Origin:
        operands = [self.robustness(arg) for arg in formula.args]
        bounds: Bounds | None = None
        if row.timed:
            begin, end = self._bounds(formula)
            bounds = 2 * begin, None if end is None else 2 * end
        return dense_origin_of(row, bounds, operands, self._last, position, earliest=earliest)
