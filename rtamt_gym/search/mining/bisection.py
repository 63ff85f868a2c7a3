"""Bisection for the tightest value with which all traces satisfy a requirement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, NamedTuple

from rtamt import InputError, Verdict
from rtamt.errors import Advice, Argument, Message
from rtamt_gym.search.mining.values import Candidates, text_of
from rtamt_gym.tables import counted, number, shorten

__all__ = ["PROBES", "Found", "ValueVerdict", "tightest"]

PROBES: Final = 17
"""The values of the range at which every trace is judged, to see whether it is monotone."""


class ValueVerdict(NamedTuple):
    """The verdict and robustness of a trace at one value of the parameter."""

    verdict: Verdict
    robustness: float


@dataclass(frozen=True, slots=True)
class Found:
    """The tightest value, with its evidence.

    Attributes:
        place: The number of the value.
        tighter: The number of the neighbour, where the requirement does not hold.
        failing: The traces that do not satisfy it there, in ascending order of robustness.
        robustness: The robustness of each of them at the tightest value.
        evaluations: How many times a trace was judged.
        probes: At how many values every trace was judged.
    """

    place: int
    tighter: int
    failing: tuple[int, ...]
    robustness: tuple[float, ...]
    evaluations: int
    probes: int


class _Bisection:
    """Judges traces at values, each once."""

    def __init__(
        self,
        names: Sequence[str],
        values: Candidates,
        parameter: str,
        judge: Callable[[int, Fraction], ValueVerdict],
    ) -> None:
        self.names, self.values, self.parameter = names, values, parameter
        self._judge = judge
        self._known: dict[tuple[int, int], ValueVerdict] = {}
        parts = (Fraction(i, PROBES - 1) for i in range(PROBES))
        self.probes = sorted({values.near(part) for part in parts})

    @property
    def evaluations(self) -> int:
        return len(self._known)

    def judged(self, trace: int, place: int) -> ValueVerdict:
        if (trace, place) not in self._known:
            self._known[trace, place] = self._judge(trace, self.values.at(place))
        return self._known[trace, place]

    def holds(self, trace: int, place: int) -> bool:
        return self.judged(trace, place).verdict is Verdict.SATISFIED

    def text(self, place: int) -> str:
        return f"{self.parameter} = {text_of(self.values.at(place))}"

    def check_monotone(self, trace: int) -> None:
        """Refuse a trace that satisfies the requirement, then does not, and then does; or back."""
        places = sorted(position for each, position in self._known if each == trace)
        held = [self.holds(trace, position) for position in places]
        changes = [i for i in range(1, len(places)) if held[i] != held[i - 1]]
        if len(changes) < 2:
            return
        first, second = changes[:2]
        values = [places[first - 1], places[first], places[second]]
        verdicts = [self.judged(trace, position).verdict.name for position in values]
        shown = ", ".join(
            f"{verdict} at {self.text(position)}"
            for verdict, position in zip(verdicts, values, strict=True)
        )
        raise InputError(
            f"expected a requirement that is monotone in {self.parameter!r}; {self.names[trace]} "
            f"is {shown}; give a range with a single change"
        )


def tightest(
    names: Sequence[str],
    values: Candidates,
    parameter: str,
    judge: Callable[[int, Fraction], ValueVerdict],
    advance: Callable[[int], None],
) -> Found:
    """Return the tightest value with which all traces satisfy a requirement.

    Every trace is judged at `PROBES` values. Then each trace that does not satisfy the requirement
    at the tightest value so far is bisected. In the end all traces are judged at the resulting
    value and at its neighbour.

    Args:
        names: The names of the traces.
        values: The values.
        parameter: The name of the parameter.
        judge: Judges the trace of a number at a value.
        advance: A function that gets the number of traces judged at all probes.

    Raises:
        InputError: If a trace changes its verdict more than once over the values, two traces change
            in opposite directions, or the requirement holds at no value or at all of them.
    """
    search = _Bisection(names, values, parameter, judge)
    brackets: list[tuple[int, int, int]] = []  # the last that fails, the first that holds, trace
    never = []
    for trace in range(len(names)):
        held = [search.holds(trace, position) for position in search.probes]
        search.check_monotone(trace)
        advance(1)
        if not any(held):
            never.append(trace)
        elif not all(held):
            change = next(i for i in range(1, len(held)) if held[i] != held[i - 1])
            ends = search.probes[change - 1], search.probes[change]
            brackets.append((*(ends if held[change] else ends[::-1]), trace))
    _refuse_opposite(search, brackets)
    _refuse_never(search, never)
    if not brackets:
        raise _everywhere(search)
    rising = brackets[0][0] < brackets[0][1]
    # Those that need most come first, so that few others have to be bisected.
    brackets.sort(
        key=lambda each: (
            -each[0] if rising else each[0],
            search.judged(each[2], each[0]).robustness,
        )
    )
    best: int | None = None
    for last_fail, first_hold, trace in brackets:
        fail, hold = last_fail, first_hold
        if best is not None:
            if search.holds(trace, best):
                continue
            search.check_monotone(trace)
            fail = best
        while abs(hold - fail) > 1:
            middle = (fail + hold) // 2
            fail, hold = (fail, middle) if search.holds(trace, middle) else (middle, hold)
        best = hold
    assert best is not None  # noqa: S101 - there is a bracket
    tighter = best - 1 if rising else best + 1
    for trace in range(len(names)):
        search.holds(trace, best)
        search.holds(trace, tighter)
        search.check_monotone(trace)
    failing = [trace for trace in range(len(names)) if not search.holds(trace, tighter)]
    failing.sort(key=lambda trace: search.judged(trace, tighter).robustness)
    robustness = tuple(search.judged(trace, best).robustness for trace in failing)
    return Found(best, tighter, tuple(failing), robustness, search.evaluations, len(search.probes))


def _refuse_opposite(search: _Bisection, brackets: Sequence[tuple[int, int, int]]) -> None:
    """Raise InputError if traces need values in opposite directions."""
    rising = next((bracket for bracket in brackets if bracket[0] < bracket[1]), None)
    falling = next((bracket for bracket in brackets if bracket[0] > bracket[1]), None)
    if rising is None or falling is None:
        return
    raise InputError(
        f"expected a requirement that is monotone in {search.parameter!r}; "
        f"{search.names[rising[2]]} satisfies it at {search.text(rising[1])} and not at "
        f"{search.text(rising[0])}, {search.names[falling[2]]} at {search.text(falling[1])} and "
        f"not at {search.text(falling[0])}"
    )


def _refuse_never(search: _Bisection, never: Sequence[int]) -> None:
    """Refuse a requirement that some trace satisfies at no value."""
    if not never:
        return
    trace = never[0]
    nearest = max(
        search.probes,
        key=lambda place: (search.judged(trace, place).verdict, search.judged(trace, place)[1]),
    )
    there = search.judged(trace, nearest)
    if there.verdict is Verdict.UNDECIDED:
        way_out: str = Message(
            "what would decide it was not recorded; leave it out",
            Advice(", or take it for all there is with ", Argument("end", "complete")),
        )
    elif nearest in {search.probes[0], search.probes[-1]}:
        way_out = "give a wider range"
    else:
        way_out = "one between them might; give a narrower range around it"
    others = f", and {counted(len(never) - 1, 'other')} alike" * (len(never) > 1)
    raise InputError(
        f"none of the {len(search.probes)} tried values of {search.parameter!r} from "
        f"{_span(search)} satisfies the requirement on {_whole(search)}: "
        f"{shorten(search.names[trace], 60)} is nearest to it at {search.text(nearest)}, "
        f"{there.verdict.name} with robustness {number(there.robustness + 0.0)}{others}; ",
        way_out,
    )


def _everywhere(search: _Bisection) -> InputError:
    ends = search.probes[0], search.probes[-1]
    shown = []
    for position in ends:
        worst = min(range(len(search.names)), key=lambda i: search.judged(i, position).robustness)
        height = number(search.judged(worst, position).robustness)
        shown.append(f"{height} at {search.text(position)} ({shorten(search.names[worst], 60)})")
    return InputError(
        f"all {len(search.probes)} tried values of {search.parameter!r} from "
        f"{_span(search)} satisfy the requirement on {_whole(search)}; the least robustness is "
        f"{' and '.join(shown)}; give a wider range"
    )


def _whole(search: _Bisection) -> str:
    return "the trace" if len(search.names) == 1 else f"all {len(search.names)} traces"


def _span(search: _Bisection) -> str:
    low, high = (text_of(search.values.at(position)) for position in (0, search.values.last))
    return f"{low} to {high}"
