"""The verdict on a whole trace."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from typing import Any, Final, Generic, TypeVar, Unpack

from rtamt.errors import InputError, SpecificationError
from rtamt.inputs.between import identical
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.machines.backend import BACKENDS
from rtamt.machines.bounds import TraceBounds
from rtamt.machines.protocols import End
from rtamt.machines.readout import moved, verdict_of
from rtamt.monitors.asked import (
    Asked,
    Evidence,
    SampledQuestion,
    evidence_of,
    reads_hidden,
    text_of,
)
from rtamt.monitors.evaluation import trace_between
from rtamt.monitors.holds import holds, zero_text
from rtamt.monitors.monitor import Verdict
from rtamt.monitors.options import (
    SampleOptions,
    Spec,
    checked_end,
    compiled,
    listed_in_signature,
)
from rtamt.monitors.untested import Untested, found_untested
from rtamt.program.memory import episode_numbers, limit_beyond
from rtamt.program.placement import place
from rtamt.program.program import Program
from rtamt.program.timing import Period

__all__ = ["Judgement", "judge"]

_T = TypeVar("_T")


class _Once(Generic[_T]):
    """A value that is found when it is first asked for."""

    __slots__ = ("_find", "_value")

    def __init__(self, find: Callable[[], _T]) -> None:
        self._find: Callable[[], _T] | None = find
        self._value: _T

    def __call__(self) -> _T:
        if self._find is not None:
            self._value, self._find = self._find(), None
        return self._value

    def __reduce__(self) -> tuple[Any, ...]:
        return _found, (self(),)


def _found(value: _T) -> _Once[_T]:
    return _Once(lambda: value)


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class Judgement:
    """The verdict on a whole trace, and what it rests on; made by `judge` or `judge_dense`.

    ``str`` gives a text of at most 80 columns, which says what was not recorded, how often each
    implication was put to the test, and the way out. `judge_dense` makes the same of a trace in
    dense time, with times in place of sample numbers.

    Attributes:
        robustness: The robustness at the first sample if the trace is all there is: `evaluate`'s;
            moved to the nearest bound if it is outside, which it can be under ``"cut"``.
        lower: The least robustness that the reading of the end leaves possible.
        upper: The greatest.
        verdict: VIOLATED if ``upper`` is below 0 or -0.0, SATISFIED if ``lower`` is above 0 or
            +0.0, else UNDECIDED.
        end: The reading of the end: ``"complete"``, ``"cut"`` or ``"open"``.
        formula: The formula as text.
        complete: The verdict of the complete reading.
        unknown: The variables of which a value is not known (`Between`, ``nan="unknown"``).
    """

    robustness: float
    lower: float
    upper: float
    verdict: Verdict
    end: End
    formula: str
    complete: Verdict
    unknown: tuple[str, ...]
    _untested: Callable[[], tuple[Untested, ...]]
    _decided_at: Callable[[], float | None]
    _evidence: Callable[[], Evidence[Any]]
    _early_end: Callable[[], str]

    @staticmethod
    def of(
        bounds: tuple[float, float, float],
        end: End,
        formula: str,
        complete: Verdict,
        untested: Callable[[], tuple[Untested, ...]],
        decided_at: Callable[[], float | None],
        evidence: Callable[[Verdict], Evidence[Any]],
        unknown: tuple[str, ...] = (),
        early_end: Callable[[], str] = str,
    ) -> Judgement:
        """The judgement for robustness, lower and upper bound.

        Args:
            bounds: Robustness, lower and upper bound.
            end: The reading of the end.
            formula: The formula as text.
            complete: The verdict of the complete reading.
            untested: Finds what was not recorded, when that is first asked for.
            decided_at: Finds when the open reading was decided, when that is first asked for.
            evidence: Finds what the verdict stands on, when that is first asked for.
            unknown: The variables of which a value is not known.
            early_end: Describes how a variable ends a trace in dense time before others do; empty
                if none does.
        """
        verdict = _verdict(*bounds[1:])
        return Judgement(
            *bounds,
            verdict,
            end,
            formula,
            complete,
            unknown,
            _Once(untested),
            _Once(decided_at),
            _Once(lambda: evidence(verdict)),
            _Once(early_end),
        )

    @property
    def open_for(self) -> str:
        """What leaves the verdict of the complete reading open, in words; empty if it is not."""
        if self.complete is not Verdict.UNDECIDED:
            return ""
        if self.unknown:
            return f"values of {', '.join(self.unknown)} that are not known"
        return "a predicate that counts 0"

    @property
    def untested(self) -> tuple[Untested, ...]:
        """What the verdict needs and the trace does not have; empty if the verdict is decided.

        It is found when it is first asked for.
        """
        return self._untested()

    @property
    def decided_at(self) -> float | None:
        """The first sample after which nothing could change the verdict; None: there is no such.

        It is the sample at which `EpisodeMonitor` decides, the first one if it needs none; found
        when it is first asked for.
        """
        return self._decided_at()

    @property
    def asked(self) -> tuple[Any, ...]:
        """For each implication of the formula an `Asked`: how often it was put to the test.

        In dense time it is a `DenseAsked`.

        Those count that stand in positive position: more robustness of them is never less of the
        whole. They come in the order of the text, the outer one first, after names are substituted.
        It is found when it is first asked for.
        """
        return self._evidence().asked

    @property
    def vacuous(self) -> bool:
        """Whether the verdict is SATISFIED without an answer.

        The formula has an implication then, and the verdict stays SATISFIED with ``false`` as the
        right side of all of them, as on a trace of no request, or of a goal that was reached
        without one.
        """
        return self._evidence().vacuous

    @property
    def never_asked(self) -> bool:
        """Whether the verdict is SATISFIED, and none of the implications was put to the test.

        A formula without an implication is never said to be.
        """
        return self._evidence().never_asked

    def _robustness_text(self) -> str:
        open_ = {self.verdict, self.complete} == {Verdict.UNDECIDED}
        if self.robustness == 0.0 and not open_:
            return zero_text(held=bool(holds(self.robustness)))
        return _number(self.robustness)

    def _values(self) -> tuple[object, ...]:
        return (
            *(self.robustness, self.lower, self.upper, self.verdict, self.end, self.formula),
            *(self.complete, self.unknown, self.untested, self.decided_at),
            *(self.asked, self.vacuous),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Judgement):
            return NotImplemented
        return self._values() == other._values()

    def __hash__(self) -> int:
        return hash((self.robustness, self.lower, self.upper, self.end, self.formula))

    def __repr__(self) -> str:
        values = f"robustness={self.robustness}, lower={self.lower}, upper={self.upper}"
        return f"<Judgement {self.verdict.name}, {values}, end={self.end!r}>"

    def __str__(self) -> str:
        lines = [f"{self.verdict.name}: {self.formula}", *self._said()]
        return "\n".join(line for each in lines for line in _wrapped(each))

    def _repr_html_(self) -> str:
        """What a notebook shows: the verdict, the formula, and what ``str`` says of them."""
        head = f"{self.verdict._repr_html_()} <code>{escape(self.formula)}</code>"
        return "<br>".join([head, *map(escape, self._said())])

    def _said(self) -> Iterator[str]:
        """The lines below the formula, before they are wrapped."""
        bounds = f"bounds {_number(self.lower)} to {_number(self.upper)}"
        yield f'robustness {self._robustness_text()}, {bounds} under end="{self.end}"'
        yield from map(str, self.untested)
        if early_end := self._early_end():
            yield early_end
        for each in self.asked:
            # Where values are not known, its left side may hold at an instant.
            never = each.first is None and bool(self.unknown)
            said = "not asked for certain" if never else str(each)
            yield said if len(self.asked) == 1 else f"{said}: {each.text}"
        if self.verdict is Verdict.UNDECIDED:
            if self.complete is Verdict.UNDECIDED:
                yield f"no reading of the end decides it: it hangs on {self.open_for}"
            else:
                yield f'if the trace is all there is, end="complete" says {self.complete.name}'


def _verdict(lower: float, upper: float) -> Verdict:
    return Verdict(verdict_of(lower, upper))


@listed_in_signature(SampleOptions)
def judge(
    spec: Spec,
    signals: TraceColumns,
    period: Period | None = None,
    end: End = "cut",
    *,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> Judgement:
    """The verdict on a whole trace, by what its end means.

    It is what `EpisodeMonitor` says after ``finish(end)`` of the same samples, about the first of
    them; invariants are written ``always(...)``. The native back-end runs the machine of
    `EpisodeMonitor` on short traces; long ones, and all those of the Python back-end, are judged
    column by column (`rtamt.machines.walk`). On a million samples that costs 1.3 to 4.2 times as
    much as `evaluate`.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: As for `evaluate`; a column may also be a `Between` of two arrays.
        period: As for `Monitor`.
        end: What lies behind the last sample. ``"complete"``: nothing, windows are cut to the
            trace. ``"cut"``: the trace is a recording; what bounded windows need of the time after
            it is unknown, and future operators without an end speak of the recorded time.
            ``"open"``: the trace is a beginning, of which nothing may be said that a continuation
            could change. See `EpisodeMonitor.finish`.
        n: The length, for a formula without variables.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`; ``nan="unknown"`` takes a nan for a value of which nothing is known.

    Raises:
        SpecificationError: As for `evaluate`.
        InputError: As for `evaluate`, and on another reading of the end.
        InputTypeError: As for `evaluate`.

    Example:
        >>> trace = {"req": [0, 4, 0, 0, 4], "gnt": [0, 0, 5, 0, 0]}
        >>> spec = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
        >>> print(judge(spec, trace, period=1))
        UNDECIDED: always(req >= 3 implies eventually[0:2](gnt >= 3))
        robustness -1, bounds -1 to 2 under end="cut"
        eventually[0:2](gnt >= 3) at 4 s: not recorded: 5 s to 6 s
        asked 2x, first at sample 1
        if the trace is all there is, end="complete" says VIOLATED
        >>> judge(spec, trace, period=1, end="complete").verdict.name
        'VIOLATED'
        >>> idle = judge(spec, {"req": [0, 0, 0], "gnt": [0, 0, 0]}, end="complete")
        >>> idle.verdict.name, idle.never_asked, idle.asked[0].occasions
        ('SATISFIED', True, 0)

        >>> print(judge("always(x > 1)", {"x": [3, float("nan"), 5]}, nan="unknown"))
        UNDECIDED: always(x > 1)
        robustness -inf, bounds -inf to 2 under end="cut"
        no reading of the end decides it: it hangs on values of x that are not known
    """
    reading = checked_end(end)
    specification, interface, backend, nan, seconds, program = compiled(
        judge, spec, period, options, online=False
    )
    reader = SampleReader(program, nan, bounds=True)
    least, greatest, length = trace_between(reader, signals, n, period)
    limit_beyond(program, length, unknown=greatest is not least)
    unknown = []
    if greatest is not least:
        pairs = zip(program.inputs, least, greatest, strict=False)  # rates follow
        unknown = [name for name, low, high in pairs if not identical(low, high)]
    made, hides = BACKENDS[backend], reads_hidden(specification.formula, interface)
    ran, run = None, made.episode_run
    if run is not None and greatest is least and _is_short(program, length):
        with suppress(InputError):  # of a sample that may not matter: columns tell
            ran = run(program, reader, least, length, reading)
    if ran is not None or hides:  # they are read later, and the caller may write to them
        same = greatest is least
        least = [column.copy() for column in least]
        greatest = least if same else [column.copy() for column in greatest]

    def bounds_of_trace() -> TraceBounds:
        machines = made.discrete_machine, made.term_ranges
        return TraceBounds.of(program, reader, *machines, (least, greatest), length)

    if ran is None:
        trace = bounds_of_trace()
        complete, bounds = trace.bounds("complete"), trace.bounds(reading)
        robustness = moved(trace.robustness(), *bounds)
        kept = trace.until(trace.n)  # without the columns that were made, as long as the trace
        whole = _found(kept)
        decided_at = _Once(lambda: _first_decided(kept))
    else:
        robustness, bounds = ran.robustness, (ran.lower, ran.upper)
        complete = ran.complete, ran.complete
        whole, decided_at = _Once(bounds_of_trace), _found(ran.decided_at)
    columns = None
    if hides:
        columns = dict(zip(program.variables, zip(least, greatest, strict=True), strict=True))

    def evidence(verdict: Verdict) -> Evidence[Asked]:
        its, align = whole(), options.get("align")
        judged = specification, seconds, align, interface, reading, its.n
        question = SampledQuestion(*judged, its, columns, nan, backend)
        return evidence_of(question, satisfied=verdict is Verdict.SATISFIED)

    def untested() -> tuple[Untested, ...]:
        if reading == "complete" or _verdict(*bounds) is not Verdict.UNDECIDED:
            return ()
        return found_untested(whole(), seconds, reading)

    return Judgement.of(
        (robustness, *bounds),
        reading,
        text_of(specification.formula),
        _verdict(*complete),
        untested,
        decided_at,
        evidence,
        tuple(unknown),
    )


_SHORT: Final = 8192
"""Samples up to which the machine is faster than columns; half as many for each unknown."""

_KEPT: Final = 1 << 16
"""Numbers that the machine may keep."""


def _is_short(program: Program, n: int) -> bool:
    """Whether the episode machine judges a trace faster than columns do, and takes the program."""
    unknowns = _unknowns(program)
    return unknowns is not None and n <= _SHORT >> unknowns


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def _unknowns(program: Program) -> int | None:
    """How many unknowns the episode machine has; None: it needs a pair, or does not fit."""
    try:
        placement = place(program)
    except SpecificationError:
        return None
    fits = not program.neutral and episode_numbers(placement).total() <= _KEPT
    return len(placement.unknowns) if fits else None


def _first_decided(whole: TraceBounds) -> int | None:
    """The first sample at which the open reading is decided, if it is at the last one."""
    low, high = 0, 1  # undecided after low samples, or none; decided after high samples

    def decided(n: int) -> bool:
        return _verdict(*whole.until(n).bounds("open")) is not Verdict.UNDECIDED

    if not decided(whole.n):
        return None
    while high < whole.n and not decided(high):
        low, high = high, 2 * high
    high = min(high, whole.n)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if decided(middle) else (middle, high)
    return high - 1


def _number(value: float) -> str:
    return f"{value + 0.0:.6g}"  # no -0: the verdict stands above


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(
        text,
        width=80,
        subsequent_indent="    ",
        break_on_hyphens=False,
        max_lines=3,
        placeholder=" ...",
    )
