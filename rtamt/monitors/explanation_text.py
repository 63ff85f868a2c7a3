"""The table that an explanation prints, over samples and over dense time."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

from rtamt.monitors.circumstances import ShareRole
from rtamt.monitors.holds import holds, zero_text
from rtamt.program.interface import PredicateValue

__all__ = ["as_text"]

_MOST = 20
"""As many circumstances are shown."""

_P = TypeVar("_P")
_P_co = TypeVar("_P_co", covariant=True)


class _Circumstance(Protocol[_P_co]):
    """What the table shows of a circumstance."""

    @property
    def name(self) -> str | None: ...
    @property
    def text(self) -> str: ...
    @property
    def role(self) -> ShareRole: ...
    @property
    def value(self) -> float: ...
    @property
    def outside(self) -> tuple[_P_co | None, _P_co | None] | None: ...


class _Step(Protocol[_P_co]):
    """What the table shows of a step; a place is a sample or a time."""

    @property
    def name(self) -> str | None: ...
    @property
    def text(self) -> str: ...
    @property
    def value(self) -> float: ...
    @property
    def witness(self) -> _P_co | None: ...
    @property
    def outside(self) -> tuple[_P_co | None, _P_co | None] | None: ...
    @property
    def reading(self) -> PredicateValue: ...


def as_text(
    steps: Sequence[_Step[_P]],
    places: Sequence[_P],
    causes: Sequence[tuple[str, _P, float]],
    at: Callable[[_P], str],
    circumstances: Sequence[tuple[_Circumstance[_P], _P, tuple[_P, _P]]] = (),
    *,
    aligned: Sequence[str | None] | None = None,
    end: _P | None = None,
) -> str:
    """The table of an explanation, in at most 80 columns.

    Args:
        steps: From the specification down to what decided.
        places: Where each of them was evaluated.
        causes: The variables that decided, with place and value.
        at: The text of a place.
        circumstances: What else a violation stands on, the place of its value, and its first and
            last place.
        aligned: What the interval of each step became, if bounds were rounded.
        end: Where the trace ends, if a window that begins there counts as one outside.
    """
    last = steps[-1]

    def robustness(value: float, then: str = "") -> str:
        """A robustness; of 0 also whether the formula holds, which the sign bit says."""
        if value or last.reading == "zero":
            return _number(value)
        return f"{zero_text(held=holds(value))}{then}"

    cause = last.text if last.outside is None else "a window outside the trace"
    head = f"robustness {robustness(steps[0].value, ',')} at {at(places[0])}, decided by "
    rows = [("at", "value", "formula")]
    for step, place, note in zip(steps, places, aligned or [None] * len(steps), strict=True):
        rows.append((at(place), robustness(step.value), _shown(step)))
        # A 0 that hangs on a predicate left out neither holds nor fails.
        held = holds(step.value) and (step.value != 0 or last.reading != "zero")
        notes = [*filter(None, [note]), *_notes(step, at, end, held=held)]
        rows += [("", "", f"  {note}") for note in notes]
    rows += [(at(place), _number(value), variable) for variable, place, value in causes]
    for part, place, window in circumstances[:_MOST]:
        rows.append((at(place), _number(part.value), f"{part.role}: {_shown(part)}"))
        if window[0] != window[1]:
            where, this = ("nowhere", "nearest") if part.role == "missing" else ("always", "least")
            span = f"from {at(window[0])} to {at(window[1])}"
            rows.append(("", "", f"  {where} {span}; this is the {this}"))
        if part.outside is not None:
            rows.append(("", "", f"  {_outside(part.outside, at, end)}"))
    if len(circumstances) > _MOST:
        rows.append(("", "", f"and {len(circumstances) - _MOST} more"))
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    when = at(places[-1])
    when = when if when.startswith("after ") else f"at {when}"
    lines = [*_wrapped("", f"{head}{cause} {when}"), ""]
    for where, value, shown in rows:
        lines += _wrapped(f"{where:>{widths[0]}}  {value:>{widths[1]}}  ", shown)
    return "\n".join(lines)


def _notes(
    step: _Step[_P], at: Callable[[_P], str], end: _P | None, *, held: bool
) -> Iterator[str]:
    if step.witness is not None:
        what = "witness" if held else "nearest"
        yield f"{what}: the right side at {at(step.witness)}"
    if step.outside is not None:
        yield _outside(step.outside, at, end)
    if step.reading == "sign":
        yield "counts only whether it holds"
    elif step.reading == "zero":
        yield "of no concern: counts 0"


def _outside(outside: tuple[_P | None, _P | None], at: Callable[[_P], str], end: _P | None) -> str:
    first, last = (None if place is None else at(place) for place in outside)
    window = f"{first} to {last}" if first != last else first
    if first is None:
        window = f"up to {last}"
    elif last is None:
        window = f"from {first} on"
    after = "right after that time, " if end is not None and outside[0] == end else ""
    return f"{after}its window lies outside the trace: {window}"


def _shown(step: _Step[_P] | _Circumstance[_P]) -> str:
    return step.text if step.name is None else f"{step.name} = {step.text}"


def _number(value: float) -> str:
    return f"{value + 0.0:.6g}"  # no -0


def _wrapped(margin: str, text: str) -> list[str]:
    return textwrap.wrap(
        text,
        width=80,
        initial_indent=margin,
        subsequent_indent=" " * (len(margin) + 4),
        break_on_hyphens=False,
        max_lines=3,
        placeholder=" ...",
    )
