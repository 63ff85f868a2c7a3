"""The functions that explain a robustness, over samples and over dense time.

A robustness is computed from the values of predicates by minimum, maximum and a change of sign, so
it *is* the value of one predicate, or its opposite. The module `origins` follows it from the root
down, by the operand and the place from which each formula has its value.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from numbers import Real
from typing import Any, NamedTuple, SupportsIndex, Unpack

import numpy as np

from rtamt.errors import InputError, InputTypeError, brief
from rtamt.inputs.arrays import kind_of
from rtamt.inputs.clock import shown
from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import EventsLike
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import Formula
from rtamt.language.node import Node
from rtamt.language.operators import Bounds
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification
from rtamt.machines.backend import BACKENDS, Factories
from rtamt.machines.dense.episode import with_robustness
from rtamt.machines.dense.rows import TraceValues, rows_of, values_between
from rtamt.machines.dense.runs import Runs, clipped
from rtamt.machines.offline import Passes
from rtamt.machines.protocols import End
from rtamt.machines.walk import Keys, numbers_of
from rtamt.monitors.evaluation import raw_trace
from rtamt.monitors.explanation import (
    Cause,
    Contribution,
    DenseCause,
    DenseContribution,
    DenseExplanation,
    DenseExplanationStep,
    Explanation,
    ExplanationStep,
)
from rtamt.monitors.options import (
    Options,
    SampleOptions,
    Spec,
    compiled,
    compiled_dense,
    listed_in_signature,
)
from rtamt.monitors.origins import (
    BoundSignal,
    FormulaSignals,
    NoSingleCause,
    RobustnessSignal,
    Share,
)
from rtamt.monitors.traces import SampleTrace
from rtamt.program.dense_lowering import MAX_TICKS, RegionProgram, compile_regions
from rtamt.program.instructions import Const, Map, operands
from rtamt.program.program import Program
from rtamt.program.timing import Period, alignment

UNSEEN = (-math.inf, math.inf)
"""The lower and the upper bound of a predicate after the trace."""

_MAX_AHEAD = 1 << 20
"""Samples after a trace for which bounds are computed."""


class DecidingBound(NamedTuple):
    """The bound that an explanation follows: the upper one if ``best`` is true."""

    end: End
    best: bool


def places_ahead(formula: Formula, bounds: Callable[[Formula], Bounds]) -> int:
    """Return how many places after the trace its bounds can depend on."""
    ahead = 1
    for node in formula.nodes():
        if node.op is None or not isinstance(node, Formula):
            continue
        if node.op.timed:
            begin, end = bounds(node)
            ahead += begin if end is None else end
        elif node.op.sampled:
            ahead += 1
    return ahead


def unseen_from(place: int, runs: Runs, value: float) -> RobustnessSignal:
    """Return runs that end before a place, with a value from there on."""
    count = int(runs.starts.searchsorted(place))
    starts = np.append(runs.starts[:count], place)
    return RobustnessSignal(np.append(runs.last[:count], value), starts)


def sample_signals(
    trace: SampleTrace, ahead: int, known: Mapping[Node, RobustnessSignal]
) -> BoundSignal:
    """Return the bounds of formulas over the samples and ``ahead`` samples after them.

    They are computed at the first use. ``known`` has the robustness on the complete trace; nan for
    a formula that is not needed.
    """
    if ahead > _MAX_AHEAD:
        raise NoSingleCause

    @functools.cache
    def both(formula: Node) -> tuple[RobustnessSignal, RobustnessSignal]:
        if not isinstance(formula, Formula) or np.isnan(known[formula].values).all():
            return known[formula], known[formula]
        low, high = (extended(*keys) for keys in trace.around_end(formula))
        return low, high

    def extended(recorded: Keys, beyond: Keys) -> RobustnessSignal:
        rest = beyond[:ahead]
        rest = np.concatenate([rest, np.full(ahead - len(rest), beyond[-1])])
        return RobustnessSignal(numbers_of(np.concatenate([recorded, rest])))

    return lambda formula, best: both(formula)[best]


@listed_in_signature(SampleOptions)
def explain(
    spec: Spec,
    data: TraceColumns,
    period: Period | None = None,
    *,
    sample: SupportsIndex = 0,
    start: float = 0.0,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> Explanation:
    """Return which sub-formulas and samples decided the robustness at one sample of a trace.

    The robustness is the value of one predicate at one sample, or its opposite; the explanation is
    the path there, from the specification down. Of equal values, the first operand decides, and its
    first sample. The robustness does not change as long as the deciding value stays and no other
    value of a predicate crosses it or its opposite. It follows the deciding value up to the next
    such value.

    If a window lies outside the trace, ``always`` is +inf and ``eventually`` -inf whatever the
    samples are. If that decided, the explanation ends with the operator and has no causes.

    Args:
        spec: Text, a formula, or a parsed specification.
        data: As for `evaluate`.
        period: As for `Monitor`.
        sample: The sample whose robustness is explained, from 0.
        start: Time of the first sample in seconds, for the times of the explanation.
        n: The length, for a formula without variables.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`.

    Raises:
        SpecificationError: As for `evaluate`.
        InputError: As for `evaluate`, and if the trace does not have this sample, or ``start`` is
            not finite.
        InputTypeError: As for `evaluate`, and if ``sample`` is not a whole number or ``start`` not
            a number.

    Example:
        >>> trace = {"req": [0, 4, 0, 0, 0], "gnt": [5, 0, 0, 1, 4]}
        >>> e = explain("always(req >= 3 implies eventually[0:2](gnt >= 3))", trace)
        >>> print(e)
        robustness -1 at sample 0, decided by req >= 3 at sample 1
        <BLANKLINE>
              at  value  formula
        sample 0     -1  always(req >= 3 implies eventually[0:2](gnt >= 3))
        sample 1     -1  req >= 3 implies eventually[0:2](gnt >= 3)
        sample 1      1  req >= 3
        sample 1      4  req
        sample 3     -2  missing: gnt >= 3
                           never from sample 1 to sample 3; this is the nearest
        >>> e.predicate, e.causes
        (<Formula req >= 3>, (Cause(variable='req', sample=1, value=4.0),))

    Source: the arguments of the minima and maxima in the robustness of Fainekos and Pappas,
    "Robustness of temporal logic specifications for continuous-time signals", TCS 2009.
    """
    whole = DecidingBound("complete", best=False)
    return _explained(spec, data, period, whole, (sample, start, n), options)


def explain_verdict(
    spec: Spec,
    data: TraceColumns,
    period: Period | None = None,
    *,
    end: End,
    violated: bool,
    start: float = 0.0,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> Explanation | None:
    """Return the explanation of a decided verdict; other arguments are as for `explain`.

    It follows the bound that decides under the end mode. None if the verdict does not rest on one
    value of the trace, as with a formula that fails at an unseen sample.
    """
    try:
        return _explained(spec, data, period, DecidingBound(end, violated), (0, start, n), options)
    except NoSingleCause:
        return None


def _explained(
    spec: Spec,
    data: TraceColumns,
    period: Period | None,
    decision: DecidingBound,
    which: tuple[SupportsIndex, float, int | None],
    options: SampleOptions,
) -> Explanation:
    """Return an explanation of samples; see `explain` and `explain_verdict`."""
    sample, start, n = which
    specification = as_specification(spec)
    start = _start(start)
    names, observed = _with_all_named(specification)
    parts = compiled(explain, observed, period, options, online=False)
    _, interface, backend, nan, seconds, _, program = parts
    reader = SampleReader(program, nan)
    columns, length = raw_trace(reader, data, n, period)
    columns = reader.without_nan(columns)
    sample_index = _place(sample, length)
    # Formulas that the result does not need decide nothing, and may have no value.
    unneeded, unknown = _unneeded(program), RobustnessSignal(np.full(length, math.nan))
    outputs = {n: program.outputs[n] for n in names if program.outputs[n] not in unneeded}
    program = program.restricted(program.result, outputs)
    machine = BACKENDS[backend].discrete_machine
    values = Passes(program, reader, machine, length).run(columns, length)
    signals: dict[Node, RobustnessSignal] = {
        f: RobustnessSignal(values[name]) if name in values else unknown
        for name, f in names.items()
    }
    parts = parts._replace(specification=specification)
    bounds = parts.bounds

    def aligned(formula: Formula) -> str | None:
        """Return the aligned interval of an operator; None if its bounds fit."""
        if formula.op is None or not formula.op.timed:
            return None
        return alignment(formula.interval, seconds, specification.unit, bounds(formula))

    def robustness(formula: Node, _best: bool) -> RobustnessSignal:  # noqa: FBT001 - one for both
        return signals[formula]

    signal: BoundSignal = robustness
    ahead = 0
    if decision.end != "complete":
        ahead = places_ahead(specification.formula, bounds)
        parts = parts._replace(program=program)
        both = columns, columns
        trace = SampleTrace(parts, decision.end, both, length, by_columns=True)
        signal = sample_signals(trace, ahead, signals)
    formulas = FormulaSignals(
        *(specification, interface, signal, bounds, length - 1), best=decision.best, ahead=ahead
    )
    path = formulas.path(sample_index)
    if decision.end != "complete" and not formulas.rests_on_trace(path):
        raise NoSingleCause
    steps = tuple(
        ExplanationStep(
            *(step.formula, step.name, step.text, step.place),
            None if seconds is None else start + float(step.place * seconds),
            signal(step.formula, step.best).at(step.place),
            step.origin.witness,
            step.origin.outside,
            step.reading,
            aligned(step.formula),
        )
        for step in path
    )
    contributions = tuple(
        Contribution(
            *(share.formula, *formulas.named(share.formula), share.role),
            (share.first, share.last),
            *formulas.nearest(share),
            share.outside,
        )
        for share in formulas.shares(path)
    )
    formula, sample_index = steps[-1].formula, steps[-1].sample
    causes: tuple[Cause, ...] = ()
    if steps[-1].outside is None:
        column = dict(zip(program.variables, columns, strict=True))
        rates = {
            n.args[0].leaf for n in formula.nodes() if n.op is not None and n.op.name == "rate"
        }
        causes = tuple(
            Cause(v, i, float(column[v][i]))
            for v in formula.variables
            for i in (
                [sample_index - 1, sample_index] if v in rates and sample_index else [sample_index]
            )
        )
    period = None if seconds is None else float(seconds)
    return Explanation(steps, causes, period, start, contributions)


@listed_in_signature(Options)
def explain_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    time: float | Fraction | np.datetime64 | None = None,
    *,
    resolution: Period = "1ns",
    **options: Unpack[Options],
) -> DenseExplanation:
    """Return which sub-formulas and times decided the robustness at one time in dense time.

    It is `explain` for events, exact at that instant as `rtamt.dense.judge` is: single instants
    count, which `rtamt.dense.evaluate` leaves out.

    Each step is at an instant, or right after an instant: a stretch between two instants has no
    first time. ``p since q`` needs p right after the witness. Signals are right-continuous, so a
    variable has the same value right after a time. It costs an evaluation for each operand of the
    formulas on the path.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: As for `rtamt.dense.evaluate`.
        time: The time whose robustness is explained, of the kind of the events' times; it goes to
            the nearest tick. Default: the start of the trace, the first time at which all variables
            are known.
        resolution: As for `rtamt.dense.Monitor`.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`.

    Raises:
        SpecificationError: As for `rtamt.dense.evaluate`.
        InputError: As for `rtamt.dense.evaluate`, and if the time is outside the trace, a number
            although the events have dates, or a date although they have numbers.
        InputTypeError: As for `rtamt.dense.evaluate`, and if ``time`` is not a number.

    Example:
        >>> import rtamt
        >>> trace = {"req": [(0, 0), (1.5, 4), (1.6, 0), (9, 0)], "gnt": [(0, 0), (4, 2), (9, 2)]}
        >>> e = rtamt.dense.explain("always(req >= 3 implies eventually[0:3](gnt >= 3))", trace)
        >>> print(e)
        robustness -1 at 0 s, decided by req >= 3 at 1.5 s
        <BLANKLINE>
           at  value  formula
          0 s     -1  always(req >= 3 implies eventually[0:3](gnt >= 3))
        1.5 s     -1  req >= 3 implies eventually[0:3](gnt >= 3)
        1.5 s      1  req >= 3
        1.5 s      4  req
          4 s     -1  missing: gnt >= 3
                        never from 1.5 s to 4.5 s; this is the nearest
        >>> e.predicate, e.causes
        (<Formula req >= 3>, (DenseCause(variable='req', time=1.5, value=4.0),))

    Source: as for `explain`.
    """
    whole = DecidingBound("complete", best=False)
    return _explained_dense(spec, signals, time, resolution, whole, options)


def explain_dense_verdict(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    end: End,
    *,
    violated: bool,
    resolution: Period = "1ns",
    **options: Unpack[Options],
) -> DenseExplanation | None:
    """Return the explanation of a decided verdict in dense time; see `explain_verdict`."""
    decision = DecidingBound(end, violated)
    try:
        return _explained_dense(spec, signals, None, resolution, decision, options)
    except NoSingleCause:
        return None


def _explained_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    time: float | Fraction | np.datetime64 | None,
    resolution: Period,
    decision: DecidingBound,
    options: Options,
) -> DenseExplanation:
    """Return an explanation in dense time; see `explain_dense` and `explain_dense_verdict`."""
    specification = as_specification(spec)
    names, observed = _with_all_named(specification)
    _, interface, backend, program = compiled_dense(
        explain_dense, observed, resolution, options, online=False
    )
    alone = program.result_alone()
    reader = EventReader(alone)
    events_read = reader.whole(signals)
    machines = BACKENDS[backend]
    # This raises the errors of rtamt.dense.evaluate.
    machines.dense_machine(alone, reader, ()).run(events_read)
    columns, dated = reader.counted(events_read)
    begin = max(int(ticks[0]) for ticks, _ in columns)
    end = min(int(ticks[-1]) for ticks, _ in columns)
    tick = begin if time is None else _tick(time, reader, begin, end, dated=bool(dated))
    regions = compile_regions(observed, program.resolution, interface=interface, named=True)
    if end - begin + regions.reach >= MAX_TICKS:
        reader.refuse_length(end - begin + regions.reach)
    values = values_between((columns, dated), (begin, end))
    run = _RegionRun(regions, names, values, reader, machines, decision.end)
    last = 2 * (end - begin)
    complete = decision.end == "complete"
    ahead = 0 if complete else places_ahead(specification.formula, run.bounds)
    formulas = FormulaSignals(
        *(specification, interface, run.signal, run.bounds, last),
        dense=True,
        best=decision.best,
        ahead=ahead,
    )
    path = formulas.path(2 * (tick - begin))
    if not complete and not formulas.rests_on_trace(path):
        raise NoSingleCause

    def moment(place: int | None) -> Any:  # noqa: ANN401 - None, a float or a date
        return None if place is None else reader.time(begin + place // 2, dated)

    def window(outside: tuple[int | None, int | None] | None) -> tuple[Any, Any] | None:
        return outside and (moment(outside[0]), moment(outside[1]))

    def contribution(share: Share) -> DenseContribution:
        place, value = formulas.nearest(share)
        after = share.first != share.last  # a stretch lasts up to the next tick
        return DenseContribution(
            *(share.formula, *formulas.named(share.formula), share.role),
            (moment(share.first), moment(share.last + after)),
            *(moment(place), value),
            window(share.outside),
            after=place % 2 == 1,
            open_begin=share.first % 2 == 1,
            open_end=share.last % 2 == 1,
        )

    steps = tuple(
        DenseExplanationStep(
            *(step.formula, step.name, step.text, moment(step.place)),
            run.signal(step.formula, step.best).at(step.place),
            moment(step.origin.witness),
            window(step.origin.outside),
            step.reading,
            after=step.place % 2 == 1,
            witness_after=(step.origin.witness or 0) % 2 == 1,
        )
        for step in path
    )
    causes: tuple[DenseCause, ...] = ()
    if steps[-1].outside is None:
        decided = begin + path[-1].place // 2
        events = dict(zip(alone.program.variables, columns, strict=True))
        causes = tuple(
            DenseCause(v, steps[-1].time, float(values[ticks.searchsorted(decided, "right") - 1]))
            for v in steps[-1].formula.variables
            for ticks, values in [events[v]]
        )
    contributions = tuple(map(contribution, formulas.shares(path)))
    return DenseExplanation(steps, causes, moment(last), specification.unit, contributions)


def _with_all_named(specification: Specification) -> tuple[dict[str, Formula], Specification]:
    """Return new names for all formulas in a specification, and the specification with them."""
    formulas = [node for node in specification.formula.nodes() if isinstance(node, Formula)]
    names = {f"#{i}": formula for i, formula in enumerate(formulas)}
    return names, replace(specification, formulas={**specification.formulas, **names})


def _unneeded(program: Program) -> set[int]:
    """Return the registers that may be nan: their terms are not needed by the result."""
    needed = program.needed(program.result)
    registers: set[int] = set()
    for register, instruction in enumerate(program.instructions):
        term = register < program.terms and isinstance(instruction, Map)
        if (term and register not in needed) or not registers.isdisjoint(operands(instruction)):
            registers.add(register)
    return registers


def _start(start: float) -> float:
    if not isinstance(start, Real) or isinstance(start, np.timedelta64):
        raise InputTypeError(
            f"expected the time of the first sample in seconds as start, got {kind_of(start)}"
        )
    try:
        time = float(start)
    except OverflowError:
        time = math.inf
    if not math.isfinite(time):
        raise InputError(f"expected a finite time of the first sample as start, got {brief(start)}")
    return time


def _place(sample: SupportsIndex, length: int) -> int:
    try:
        index = operator.index(sample)
    except TypeError:
        raise InputTypeError(
            f"expected the number of a sample, got {type(sample).__name__} {brief(sample)}"
        ) from None
    if not 0 <= index < length:
        raise InputError(f"expected a sample from 0 to {length - 1}, got {brief(index)}")
    return index


def _tick(time: object, reader: EventReader, begin: int, end: int, *, dated: bool) -> int:
    """Return the tick of a time of the trace."""
    if isinstance(time, np.number) and not isinstance(time, np.timedelta64):
        time = time.item()
    first, last = (shown(reader.time(tick, dated)) for tick in (begin, end))
    trace = f"expected a time from {first} to {last}"
    is_date = isinstance(time, np.datetime64)
    no_date = ", which is not a datetime64" if dated else ""
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


class _RegionRun:
    """The values of formulas over the regions of a trace, each computed at its first use."""

    def __init__(
        self,
        regions: RegionProgram,
        names: Mapping[str, Formula],
        values: TraceValues,
        reader: EventReader,
        machines: Factories,
        end: End,
    ) -> None:
        self._program, self._bounds = regions.program, regions.bounds
        outputs = regions.program.outputs
        self._registers: dict[Node, int] = {f: outputs[name] for name, f in names.items()}
        self._unneeded = _unneeded(regions.program)
        self._values, self._reader, self._end = values, reader, end
        self._find = machines.term_ranges
        self._signals: dict[int, tuple[RobustnessSignal, RobustnessSignal]] = {}

    def bounds(self, formula: Formula) -> Bounds:
        begin, end = self._bounds(formula)
        return 2 * begin, None if end is None else 2 * end

    def signal(self, formula: Node, best: bool) -> RobustnessSignal:  # noqa: FBT001 - see bounds
        register = self._registers[formula]
        if register not in self._signals:
            self._signals[register] = self._run(register)
        return self._signals[register][best]

    def _run(self, register: int) -> tuple[RobustnessSignal, RobustnessSignal]:
        """Return the lower and the upper bound of a register."""
        if register in self._unneeded:
            # Formulas that the result does not need decide nothing, and may have no value.
            unknown = RobustnessSignal(np.array([math.nan]), np.zeros(1, np.int64))
            return unknown, unknown
        part = self._program.restricted(register, {})
        rows = rows_of(part, self._values, self._reader, self._find)
        last = 2 * (self._values.last - self._values.begin)
        _, *bounds = with_robustness(part, rows, last, self._end)
        if self._end == "complete":
            runs = clipped(bounds[1], 0, last)
            signal = RobustnessSignal(runs.last, runs.starts)
            return signal, signal
        seen = part.result < part.terms and not isinstance(part.instructions[part.result], Const)
        if seen:  # a predicate, which is unknown after the trace
            low, high = (unseen_from(last + 1, b, v) for b, v in zip(bounds, UNSEEN, strict=True))
            return low, high
        low, high = (RobustnessSignal(runs.last, runs.starts) for runs in bounds)
        return low, high
