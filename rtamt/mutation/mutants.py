"""`mutants`: a requirement with one change, as many as there are."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING

from rtamt.errors import InputError, SpecificationError, alternatives, is_one_of, nearest
from rtamt.language.formula import Formula
from rtamt.language.parser import as_specification, parse_as
from rtamt.language.specification import Specification
from rtamt.mutation.mutations import MUTATIONS, Mutation
from rtamt.program.timing import Period, as_period

if TYPE_CHECKING:  # it loads the parser
    from rtamt.mutation.places import Change

__all__ = ["Mutant", "mutants"]


@dataclass(frozen=True, slots=True)
class Mutant:
    """A requirement with one change.

    Attributes:
        kind: The kind of the change, a name in `MUTATIONS`.
        line: The line of the text that is changed, from 1.
        column: The column, from 1.
        before: What stands there.
        after: What stands there after the change; empty if nothing is left.
        requirement: The requirement.
        specification: The requirement with the change.
    """

    kind: str
    line: int
    column: int
    before: str
    after: str
    requirement: Specification
    specification: Specification

    @property
    def apart(self) -> Specification:
        """``requirement iff mutant``, which a trace violates where one holds and the other fails.

        Its robustness on such a trace is below 0 by the lesser of the two margins, and on others
        above 0 by it, so that a search for its least robustness finds traces that tell them apart.
        """
        changed = self.specification.standalone()
        return self.requirement.with_result(self.requirement.standalone().iff(changed))

    def __str__(self) -> str:
        return f"{self.line}:{self.column} {self.before} -> {self.after or 'nothing'}"


def mutants(
    spec: str | Formula | Specification,
    period: Period | None = None,
    *,
    kinds: Collection[str] | None = None,
    most: int | None = None,
) -> tuple[Mutant, ...]:
    """The requirement with one change each: of a bound, a threshold, an operator, a part.

    A suite of traces tests what is changed if one of its traces has another verdict then. A change
    is at one place of the text: a formula that is named twice is changed for both. Changes that
    leave the formula as it was, that are no specification or that others have made are left out.

    Args:
        spec: Text, a formula, or a parsed specification, of which the result is changed.
        period: Seconds between samples, by which bounds move. None: they move by one of their last
            digit, which is a sample where bounds count samples.
        kinds: The kinds of changes, names in `MUTATIONS`; None: all.
        most: The most mutants: the first of each kind in turn. None: all.

    Returns:
        The mutants, in the order of the text.

    Raises:
        InputError: If a kind is unknown, or the most is below 1.

    Example:
        >>> import rtamt
        >>> for each in rtamt.mutants("always[0:5](v < 35)", kinds=["window", "direction"]):
        ...     print(f"{each}: {each.specification}")
        1:10 [0:5] -> [0:2]: always[0:2](v < 35)
        1:10 [0:5] -> [0:10]: always[0:10](v < 35)
        1:10 [0:5] -> [0:50]: always[0:50](v < 35)
        1:15 v < 35 -> v > 35: always[0:5](v > 35)

    References:
        `rtamt.mutation.mutations` names them.
    """
    from rtamt.mutation.places import RequirementText

    rows = _rows(kinds)
    if most is not None and most < 1:
        msg = f"most: expected 1 mutant or more, got {most}"
        raise InputError(msg)
    spec = _as_read(as_specification(spec))
    text = RequirementText(spec, as_period(period))
    found: dict[Formula, Mutant] = {}
    for kind, change in _in_turn([(row, row.changes(text)) for row in rows]):
        if len(found) == most:
            break
        changed = _changed(spec, change)
        if changed is None or changed.formula in (spec.formula, *found):
            continue
        where = change.line, change.column
        mutant = Mutant(kind, *where, change.before, change.after, spec, changed)
        found[changed.formula] = mutant
    ranks = [*MUTATIONS]
    order = [(each.line, each.column, ranks.index(each.kind)) for each in found.values()]
    ordered = sorted(zip(order, found.values(), strict=True), key=lambda pair: pair[0])
    return tuple(mutant for _, mutant in ordered)


def _rows(kinds: Collection[str] | None) -> Sequence[Mutation]:
    for kind in kinds or ():
        if not is_one_of(kind, MUTATIONS):
            known = nearest(kind, MUTATIONS) or f"; they are {alternatives(MUTATIONS)}"
            msg = f"expected a kind of mutants, got {kind!r}{known}"
            raise InputError(msg)
    return [row for name, row in MUTATIONS.items() if kinds is None or name in kinds]


def _as_read(spec: Specification) -> Specification:
    """The specification as its text says it; one that was made in Python has a text of its own."""
    found = _read(spec, spec.text)
    if found == spec:
        return _alone(found)
    made = spec.with_result(spec.formula)
    return _alone(_read(made, made.text) or made)


def _alone(spec: Specification) -> Specification:
    """The result without other requirements of the text: what it no longer names is one."""
    parts = spec.requirements.values()
    return next((part for part in parts if part.formula is spec.formula), spec)


def _read(
    spec: Specification, text: str, given: tuple[str, Fraction] | None = None
) -> Specification | None:
    """What a changed text says of the requirement; None if it is no specification."""
    values = dict(spec.given) | dict([given] if given else [])
    try:
        whole = parse_as(text, spec.unit, values, None, chains=spec.chains)
    except SpecificationError:
        return None
    if spec.requirement is not None:
        whole = whole.requirements[spec.requirement]
    return replace(whole, types=spec.types)


def _changed(spec: Specification, change: Change) -> Specification | None:
    text = spec.text[: change.begin] + change.new + spec.text[change.end :]
    changed = _read(spec, text, change.given)
    return None if changed is None else _alone(changed)


def _in_turn(
    rows: Sequence[tuple[Mutation, Iterator[Change]]],
) -> Iterator[tuple[str, Change]]:
    """The first of each, the second of each, and so on."""
    left = [*rows]
    while left:
        going = []
        for row, changes in left:
            change = next(changes, None)
            if change is not None:
                yield row.name, change
                going.append((row, changes))
        left = going
