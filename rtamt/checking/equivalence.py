"""`equivalent`: whether two requirements are satisfied by the same traces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Literal, cast

from rtamt.checking.answers import Equivalence
from rtamt.checking.limits import ValueRange
from rtamt.checking.questions import impossible, named_requirements, prepared
from rtamt.checking.search import WitnessSearch
from rtamt.checking.witness import Goal
from rtamt.errors import Argument, InputError
from rtamt.language.formula import Formula
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification
from rtamt.machines.protocols import End
from rtamt.monitors.options import Spec
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Period

__all__ = ["equivalent", "paired", "same"]

_WAYS: tuple[Literal["one", "other"], ...] = ("one", "other")


def equivalent(
    one: Spec,
    other: Spec,
    period: Period | None = None,
    *,
    end: End = "cut",
    assume: Spec | None = None,
    rates: Mapping[str, ValueRange] | None = None,
    horizon: int = 10_000,
    timeout: float = 10.0,
) -> Equivalence:
    """Whether two requirements are satisfied by the same traces.

    They are not if a trace satisfies one and violates the other, for certain; it is shown, and the
    monitors have judged it. The ranges that either declares are taken to hold. See `check`.

    Args:
        one: A requirement.
        other: Another.
        period: Seconds between samples; None: bounds are numbers of samples.
        end: How the end of a trace is read, as in `judge`.
        assume: What is taken to hold of every trace.
        rates: How fast variables change, as for `check`.
        horizon: The most samples of a trace. What needs more is unknown.
        timeout: The most seconds for each of the two ways in which they may differ.

    Raises:
        ModuleNotFoundError: If Z3 is not installed, which the extra ``check`` does.
        SpecificationError: If one cannot be compiled.
        InputError: If one has several requirements, or as `check` does.

    Example:
        >>> import rtamt
        >>> str(rtamt.equivalent("not eventually[0:3](x > 3)", "always[0:3](x <= 3)"))
        'yes'
        >>> apart = rtamt.equivalent("always(x < 3)", "always(x <= 3)")
        >>> str(apart), dict(apart.trace.columns)
        ('no, in 1 sample: other is satisfied, one is violated', {'x': (3.0,)})
    """
    specs = {"one": as_specification(one), "other": as_specification(other)}
    for name, spec in specs.items():
        if len(spec.requirements) > 1:
            names = ", ".join(spec.requirements)
            msg = f"{name}: expected one requirement, got {names}; give spec.requirements[NAME]"
            raise InputError(msg)
    _, seconds, search, given = prepared(specs, period, end, assume, horizon, timeout, rates)
    return _answer(specs["one"], specs["other"], seconds, search, given)


def paired(
    specs: Spec | Mapping[str, Spec], others: Spec | Mapping[str, Spec]
) -> dict[str, tuple[Specification, Specification]]:
    """Requirements with their namesakes; one and one are a pair, whatever their names.

    Raises:
        InputError: If a name is on one side only.
    """
    ones, twos = named_requirements(specs), named_requirements(others)
    if len(ones) == len(twos) == 1:
        (other,) = twos.values()
        return {name: (one, other) for name, one in ones.items()}
    alone = [name for name in (*ones, *twos) if not (name in ones and name in twos)]
    if alone:
        raise InputError(
            Argument("same_as"),
            f" expected requirements of the same names, or one and one; {', '.join(alone)} "
            f"{'is' if len(alone) == 1 else 'are'} on one side only",
        )
    return {name: (one, twos[name]) for name, one in ones.items()}


def same(
    pairs: Mapping[str, tuple[Specification, Specification]],
    period: Fraction | None,
    search: WitnessSearch,
    given: Sequence[Goal],
) -> dict[str, Equivalence]:
    """Whether the two of each pair are satisfied by the same traces."""
    return {
        name: _answer(one, other, period, search, given) for name, (one, other) in pairs.items()
    }


def _answer(
    one: Specification,
    other: Specification,
    period: Fraction | None,
    search: WitnessSearch,
    given: Sequence[Goal],
) -> Equivalence:
    """Whether two are satisfied by the same traces; of wholes without end by what differs in them.

    A suffix of a trace is a trace. So what is the same on all traces is the same at each instant,
    if it does not look back, and wholes that differ in it alone are the same too.
    """
    found = _compared(compile_program(one, period), compile_program(other, period), search, given)
    if found.says != "yes" or not found.samples:
        return found
    for pair in _differing(one.formula, other.formula):
        if any(map(_looks_back, pair)):
            continue
        first, second = (
            compile_program(spec.with_result(part), period)
            for spec, part in zip((one, other), pair, strict=True)
        )
        parts = _compared(first, second, search, ())
        if parts.says == "yes" and not parts.samples:
            return parts
        if parts.says == "no":  # then parts of them differ too
            break
    return found


def _differing(one: Formula, other: Formula) -> Iterator[tuple[Formula, Formula]]:
    """The parts in which alone two formulas differ, the greatest first, without the wholes."""
    while one.op is other.op and one.interval == other.interval:
        if len(one.args) != len(other.args):
            return
        sides = [(a, b) for a, b in zip(one.args, other.args, strict=True) if a != b]
        if len(sides) != 1 or not all(isinstance(each, Formula) for each in sides[0]):
            return
        one, other = cast("tuple[Formula, Formula]", sides[0])
        yield one, other


def _looks_back(formula: Formula) -> bool:
    """Whether a formula has an operator of the past."""
    operators = (node.op for node in formula.nodes())
    return any(op is not None and (op.timed or op.sampled) and not op.future for op in operators)


def _compared(
    one: Program, other: Program, search: WitnessSearch, given: Sequence[Goal]
) -> Equivalence:
    """Whether two programs are satisfied by the same traces, of those that a search takes."""
    samples, why = 0, ""
    for satisfied, (holds, fails) in zip(_WAYS, ((one, other), (other, one)), strict=True):
        found = search.find_short([Goal(holds, holds=True), Goal(fails, holds=False), *given])
        if found.trace is not None:
            return Equivalence("no", found.trace, satisfied)
        if not impossible(found):
            why = why or found.why or "no trace was found, and none was ruled out"
        samples = max(samples, found.samples)
    return Equivalence("unknown", why=why) if why else Equivalence("yes", samples=samples)
