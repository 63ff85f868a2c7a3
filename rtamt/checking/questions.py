"""What questions about requirements have in common: a search for traces, and assumptions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from fractions import Fraction

from rtamt.checking.limits import ValueRange, VariableLimits, checked_rates
from rtamt.checking.search import SearchAnswer, WitnessSearch
from rtamt.checking.witness import Goal
from rtamt.errors import InputError, InputTypeError
from rtamt.language.parser import as_specification
from rtamt.language.ranges import is_whole, range_text
from rtamt.language.specification import Specification
from rtamt.machines.protocols import End
from rtamt.monitors.options import Spec, checked_end
from rtamt.program.lowering import compile_program, refuse_rates
from rtamt.program.timing import Period, as_period

__all__ = ["impossible", "named_requirements", "prepared"]


def prepared(
    specs: Spec | Mapping[str, Spec],
    period: Period | None,
    end: End,
    assume: Spec | None,
    horizon: int,
    timeout: float,
    rates: Mapping[str, ValueRange] | None = None,
) -> tuple[dict[str, Specification], Fraction | None, WitnessSearch, list[Goal]]:
    """The requirements by name, the period in seconds, a search for traces, and what is assumed.

    Takes the arguments and raises the errors of `check`.
    """
    if horizon < 1:
        msg = f"horizon: expected 1 sample or more, got {horizon}"
        raise InputError(msg)
    if not timeout > 0:
        msg = f"timeout: expected seconds, more than 0, got {timeout}"
        raise InputError(msg)
    named = named_requirements(specs)
    seconds = as_period(period)
    assumed = None if assume is None else as_specification(assume)
    every = [*named.values(), *([assumed] if assumed else [])]
    for spec in every:
        refuse_rates(spec, "symbolic checking")
    whole = {
        name
        for spec in every
        for name, declared in spec.declarations.items()
        if is_whole(declared.type)
    }
    checked = checked_rates(rates, (name for spec in every for name in spec.variables))
    limits = VariableLimits(_ranges(every), checked, seconds)
    search = WitnessSearch(seconds, checked_end(end), horizon, timeout, frozenset(whole), limits)
    given = [Goal(compile_program(assumed, seconds), holds=True)] if assumed else []
    if assumed and impossible(search.find(given)):
        msg = f"assume: expected what some trace fulfils, got {assumed.formula}, which none does"
        raise InputError(msg)
    return named, seconds, search, given


def named_requirements(specs: Spec | Mapping[str, Spec]) -> dict[str, Specification]:
    """Each requirement by its name."""
    if not isinstance(specs, Mapping):
        return {**as_specification(specs).requirements}
    if not specs:
        msg = "expected one specification or more, got an empty mapping"
        raise InputError(msg)
    named: dict[str, Specification] = {}
    for name, spec in specs.items():
        if not isinstance(name, str):
            msg = f"expected names of specifications as text, got {type(name).__name__}"
            raise InputTypeError(msg)
        parts = as_specification(spec).requirements
        named |= {f"{name}.{part}" if len(parts) > 1 else name: s for part, s in parts.items()}
    return named


def _ranges(specs: Iterable[Specification]) -> dict[str, tuple[float, float]]:
    """The values of each variable that all specifications allow."""
    ranges: dict[str, tuple[float, float]] = {}
    for spec in specs:
        for name, (lower, upper) in spec.ranges.items():
            known = ranges.get(name, (-math.inf, math.inf))
            ranges[name] = max(lower, known[0]), min(upper, known[1])
            if ranges[name][0] > ranges[name][1]:
                said = f"{range_text(known)} and {range_text((lower, upper))}"
                msg = f"'{name}' has no value: specifications declare the ranges {said}"
                raise InputError(msg)
    return ranges


def impossible(found: SearchAnswer) -> bool:
    """Whether there is no trace, as far as was asked."""
    return found.none or bool(found.samples)
