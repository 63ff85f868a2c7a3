"""`mutants` changes a requirement in one place; `killed` tests which mutants a trace kills."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final, Unpack, cast

from rtamt.errors import (
    InputError,
    RtamtError,
    SpecificationError,
    alternatives,
    is_one_of,
    nearest,
)
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import Formula, conjunction
from rtamt.language.grammar.diagnosis import Token
from rtamt.language.grammar.generated.StlParser import StlParser
from rtamt.language.grammar.tokens import read
from rtamt.language.operators import OPERATORS, Notation, Operator
from rtamt.language.parser import as_specification, parse_as
from rtamt.language.specification import Specification
from rtamt.machines.backend import BACKENDS
from rtamt.machines.bounds import TraceBounds
from rtamt.machines.protocols import End
from rtamt.machines.state import verdict_of
from rtamt.monitors.evaluation import trace_between
from rtamt.monitors.judgement import judge
from rtamt.monitors.options import SampleOptions, checked_end, compiled, listed_in_signature
from rtamt.monitors.verdict import Verdict
from rtamt.mutation.mutations import MUTATIONS, Mutation
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Period, as_period
from rtamt.renamed import OldName, old_keywords

_DECIDED = {Verdict.SATISFIED, Verdict.VIOLATED}


@dataclass(frozen=True, slots=True)
class Mutant:
    """A requirement with one change.

    Attributes:
        kind: The kind of the change, a name in `MUTATIONS`.
        line: The line of the change in the text, from 1.
        column: The column, from 1.
        before: The text before the change.
        after: The text after the change; empty if nothing is left.
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

    apart = OldName("distance")

    @property
    def distance(self) -> Specification:
        """``requirement iff mutant``, which a trace violates if one holds and the other fails.

        The absolute value of its robustness is the smaller of the two margins, so a search for the
        minimum robustness finds traces that kill the mutant.
        """
        changed = self.specification.standalone()
        return self.requirement.with_result(self.requirement.standalone().iff(changed))

    def __str__(self) -> str:
        return f"{self.line}:{self.column} {self.before} -> {self.after or 'nothing'}"


@old_keywords
def mutants(
    spec: str | Formula | Specification,
    period: Period | None = None,
    *,
    kinds: Collection[str] | None = None,
    limit: int | None = None,
) -> tuple[Mutant, ...]:
    """Return versions of a requirement with one change of a bound, threshold, operator or part.

    A suite of traces tests a place of the text if the change alters the verdict of at least one
    trace. A change is in one place: a formula that is named twice changes for both uses. Changes
    that keep the formula, give no specification or repeat another mutant are left out.

    Args:
        spec: Text, a formula, or a parsed specification; the changes are in its result.
        period: Seconds between samples; bounds move by a sample. None: bounds move by one unit of
            their last digit, which is a sample if bounds count samples.
        kinds: The kinds of changes, names in `MUTATIONS`; None: all.
        limit: The maximum number of mutants, taken from each kind in turn. None: all.

    Returns:
        The mutants, in the order of the text.

    Raises:
        InputError: If a kind is unknown, or ``limit`` is below 1.

    Example:
        >>> import rtamt
        >>> for mutant in rtamt.mutants("always[0:5](v < 35)", kinds=["window", "direction"]):
        ...     print(f"{mutant}: {mutant.specification}")
        1:10 [0:5] -> [0:2]: always[0:2](v < 35)
        1:10 [0:5] -> [0:10]: always[0:10](v < 35)
        1:10 [0:5] -> [0:50]: always[0:50](v < 35)
        1:15 v < 35 -> v > 35: always[0:5](v > 35)

    References:
        See `rtamt.mutation.mutations`.
    """
    rows = _rows(kinds)
    if limit is not None and limit < 1:
        msg = f"limit: expected 1 mutant or more, got {limit}"
        raise InputError(msg)
    spec = _as_read(as_specification(spec))
    text = RequirementText(spec, as_period(period))
    by_formula: dict[Formula, Mutant] = {}
    for kind, change in _in_turn([(row, row.changes(text)) for row in rows]):
        if len(by_formula) == limit:
            break
        changed = _changed(spec, change)
        if changed is None or changed.formula in (spec.formula, *by_formula):
            continue
        by_formula[changed.formula] = Mutant(
            kind, change.line, change.column, change.before, change.after, spec, changed
        )
    ranks = [*MUTATIONS]
    ordered = sorted(by_formula.values(), key=lambda m: (m.line, m.column, ranks.index(m.kind)))
    return tuple(ordered)


def _rows(kinds: Collection[str] | None) -> Sequence[Mutation]:
    for kind in kinds or ():
        if not is_one_of(kind, MUTATIONS):
            known = nearest(kind, MUTATIONS) or f"; they are {alternatives(MUTATIONS)}"
            msg = f"expected a kind of mutants, got {kind!r}{known}"
            raise InputError(msg)
    return [row for name, row in MUTATIONS.items() if kinds is None or name in kinds]


def _as_read(spec: Specification) -> Specification:
    """Return the specification that the text describes; a formula from Python gets a new text."""
    from_text = _read(spec, spec.text)
    if from_text == spec:
        return _single(from_text)
    printed = spec.with_result(spec.formula)
    return _single(_read(printed, printed.text) or printed)


def _single(spec: Specification) -> Specification:
    """Return the result without the other requirements of the text."""
    parts = spec.requirements.values()
    return next((part for part in parts if part.formula is spec.formula), spec)


def _read(
    spec: Specification, text: str, constant: tuple[str, Fraction] | None = None
) -> Specification | None:
    """Return the requirement that a changed text describes, or None if the text is wrong."""
    values = dict(spec.overrides) | dict([constant] if constant else [])
    try:
        changed = parse_as(text, spec.unit, values, None, chains=spec.chains)
    except SpecificationError:
        return None
    if spec.requirement is not None:
        changed = changed.requirements[spec.requirement]
    return replace(changed, types=spec.types)


def _changed(spec: Specification, change: Change) -> Specification | None:
    text = spec.text[: change.begin] + change.new + spec.text[change.end :]
    changed = _read(spec, text, change.constant)
    return None if changed is None else _single(changed)


def _in_turn(
    rows: Sequence[tuple[Mutation, Iterator[Change]]],
) -> Iterator[tuple[str, Change]]:
    """Yield the first change of each row, then the second of each, and so on."""
    while rows:
        remaining = []
        for row, changes in rows:
            change = next(changes, None)
            if change is not None:
                yield row.name, change
                remaining.append((row, changes))
        rows = remaining


@listed_in_signature(SampleOptions)
def killed(
    mutants: Sequence[Mutant],
    signals: TraceColumns,
    period: Period | None = None,
    end: End = "cut",
    *,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> tuple[bool, ...]:
    """Return whether a trace kills each mutant: it satisfies one of mutant and requirement only.

    The verdicts equal those of `judge` and cost less: shared comparisons are evaluated once, and
    only the verdict is computed. A mutant that cannot be judged is not killed.

    Args:
        mutants: Mutants, as `mutants` returns them.
        signals: As for `judge`.
        period: As for `judge`.
        end: As for `judge`.
        n: As for `judge`.
        **options: As for `judge`.

    Raises:
        SpecificationError: As for `judge` of the requirement.
        InputError: As for `judge` of the requirement.
        InputTypeError: As for `judge` of the requirement.

    Example:
        >>> import rtamt
        >>> several = rtamt.mutants("always[0:5](v < 35)", kinds=["window", "direction"])
        >>> trace = {"v": [9] * 8 + [40] * 43}
        >>> for mutant, killed in zip(several, rtamt.mutation.killed(several, trace), strict=True):
        ...     print(f"{mutant}: {'killed' if killed else 'survived'}")
        1:10 [0:5] -> [0:2]: survived
        1:10 [0:5] -> [0:10]: killed
        1:10 [0:5] -> [0:50]: killed
        1:15 v < 35 -> v > 35: killed
    """
    end = checked_end(end)
    killed = [False] * len(mutants)
    for requirement in dict.fromkeys(mutant.requirement for mutant in mutants):
        places = [i for i, mutant in enumerate(mutants) if mutant.requirement == requirement]
        specs = [mutants[i].specification for i in places]
        first, *others = _verdicts(requirement, specs, signals, period, end, n, options)
        for position, verdict in zip(places, others, strict=True):
            killed[position] = {verdict, first} == _DECIDED
    return tuple(killed)


def _verdicts(
    requirement: Specification,
    mutants: Sequence[Specification],
    signals: TraceColumns,
    period: Period | None,
    end: End,
    n: int | None,
    options: SampleOptions,
) -> list[Verdict | None]:
    """Return the verdicts of a requirement and its mutants; None for mutants without a verdict."""
    _, interface, backend, nan, seconds, align, program = compiled(
        killed, requirement, period, options, online=False
    )

    def program_of(spec: Specification) -> Program | None:
        try:
            return compile_program(spec, seconds, interface=interface, align=align)
        except SpecificationError:  # for instance, bounds that are not whole samples
            return None

    programs = [program, *map(program_of, mutants)]
    known = [s for s, p in zip((requirement, *mutants), programs, strict=True) if p is not None]
    together = replace(requirement, formula=conjunction([spec.formula for spec in known]))
    joint = compile_program(together, seconds, interface=interface, align=align)
    reader = SampleReader(joint, nan, bounds=True)
    lower, upper, length = trace_between(reader, signals, n, period)
    try:
        bounds = TraceBounds.of(joint, reader, BACKENDS[backend], (lower, upper), length)
        return [
            None if part is None else Verdict(verdict_of(*bounds.part(part).bounds(end)))
            for part in programs
        ]
    except RtamtError:  # a term is nan
        first = judge(requirement, signals, period, end, n=n, **options).verdict
        return [first, *(_verdict(mutant, signals, period, end, n, options) for mutant in mutants)]


def _verdict(
    spec: Specification,
    signals: TraceColumns,
    period: Period | None,
    end: End,
    n: int | None,
    options: SampleOptions,
) -> Verdict | None:
    try:
        return judge(spec, signals, period, end, n=n, **options).verdict
    except RtamtError:
        return None


_CONTEXT: Final = 40
"""The maximum number of characters to show around a change."""

_PREDICATE: Final = 9
"""The precedence of comparisons; operators below it join formulas."""

_NOTATIONS: Final[Mapping[int, Notation]] = {
    StlParser.TEMPORAL: "prefix",
    StlParser.PREFIX: "prefix",
    StlParser.BINDING: "infix",
    StlParser.INFIX: "infix",
    StlParser.SLASH: "infix",
    StlParser.FUNCTION: "call",
}
_OPERAND_ENDS: Final = frozenset(
    {StlParser.NAME, StlParser.ELEMENT, StlParser.NUMBER, StlParser.TRUTH, StlParser.CLOSE}
)


@dataclass(frozen=True, slots=True)
class Change:
    """One change of a text, or of the value of a constant."""

    line: int  # the line of the change, from 1
    column: int  # its column, from 1
    before: str  # the text before the change, with some context
    after: str  # the text after the change; empty if nothing is left
    begin: int  # the index of the first removed character
    end: int  # the index after the last removed character
    new: str  # the characters to insert
    # a constant with its new value if its value is not in the text; otherwise None
    constant: tuple[str, Fraction] | None = None


@dataclass(frozen=True, slots=True)
class Bound:
    """A bound of an interval."""

    index: int  # the index of its number or constant
    unit: str | None  # its unit, or None
    first: int  # the index of the opening bracket of the interval
    last: int  # the index of the closing bracket


class RequirementText:
    """The tokens of the formulas of a requirement, by index.

    Args:
        spec: The requirement; its text is read again.
        period: Seconds between samples, or None if unknown.
    """

    def __init__(self, spec: Specification, period: Fraction | None) -> None:
        self.spec, self.period, self.text = spec, period, spec.text
        statements, self.tokens = read(spec.text)
        self._declared = {const.name.text: const for const in statements.constants if const.name}
        self._spans: dict[int, tuple[int, int]] = {}
        needed = _needed(spec)
        for definition in statements.definitions:
            if (definition.name.text if definition.name else "") in needed:
                formula = definition.formula
                span = formula.start.tokenIndex, formula.stop.tokenIndex
                self._spans |= dict.fromkeys(range(span[0], span[1] + 1), span)
        self._partners = _partners(self.tokens)
        self.bounds = [bound for index in self._spans for bound in self._bounds(index)]
        # the tokens of intervals
        self._inside = {
            index for bound in self.bounds for index in range(bound.first, bound.last + 1)
        }

    def operators(self, *names: str) -> Iterator[int]:
        """Yield the indices of operators with certain names."""
        for index in self._spans:
            row = self.row(index)
            if row is not None and row.name in names:
                yield index

    def row(self, index: int) -> Operator | None:
        """Return the row of an operator, or None for another token."""
        token = self.tokens[index]
        notation = _NOTATIONS.get(token.type)
        if token.type == StlParser.MINUS and index not in self._inside:
            infix = self.tokens[index - 1].type in _OPERAND_ENDS and index - 1 not in self._inside
            notation = "infix" if infix and self._spans[index][0] < index else "prefix"
        return None if notation is None else OPERATORS.spellings[token.text, notation]

    def numbers(self) -> Iterator[int]:
        """Yield the indices of numbers in terms."""
        for index in self._spans:
            if self.tokens[index].type == StlParser.NUMBER and index not in self._inside:
                yield index

    def names(self) -> Iterator[int]:
        """Yield the indices of constants in terms."""
        for index in self._spans:
            token, free = self.tokens[index], index not in self._inside
            if free and token.type == StlParser.NAME and token.text in self.spec.constants:
                yield index

    def constants(self) -> Mapping[str, Bound | None]:
        """Return the constants of the requirement, each with the first bound that it sets."""
        bounds: dict[str, Bound | None] = {}
        for bound in self.bounds:
            token = self.tokens[bound.index]
            if token.type == StlParser.NAME:
                bounds.setdefault(token.text, bound)
        return bounds | {
            name: None for index in self.names() if (name := self.tokens[index].text) not in bounds
        }

    def left(self, index: int) -> int:
        """Return the index of the first token of the left operand of an infix operator."""
        row = cast("Operator", self.row(index))
        return self._first(index, row.precedence + (row.grouping == "flat"))

    def right(self, index: int) -> int:
        """Return the index of the last token of the right operand of an infix operator."""
        return self._last(index, cast("Operator", self.row(index)).precedence + 1)

    def starts_run(self, left: int, row: Operator) -> bool:
        """Return whether a left operand is the first of a run of one operator."""
        before = left - 1
        return before < self._spans[left][0] or self.row(before) is not row

    def between(self, first: int, last: int) -> str:
        """Return the text from one token to another."""
        return self.text[self.tokens[first].start : self.tokens[last].stop + 1]

    def bracketed(self, first: int, last: int) -> bool:
        """Return whether one pair of brackets encloses the tokens from first to last."""
        return self.tokens[first].type == StlParser.OPEN and self._partners[first] == last

    def swapped(self, index: int, new: str) -> Change:
        """Return the change of a token, shown with its predicate or interval."""
        row = self.row(index)
        first = last = index
        if row is None or row.operands == "term":
            first, last = self._first(index, _PREDICATE), self._last(index, _PREDICATE)
        elif self._has_interval(index):
            last = self._partners[index + 1]
        return self.change((index, index), new, (first, last))

    def change(self, changed: tuple[int, int], new: str, shown: tuple[int, int]) -> Change:
        """Return the change of tokens, with the tokens to show around them."""
        tokens = self.tokens
        begin, end = tokens[changed[0]].start, tokens[changed[1]].stop + 1
        low, high = tokens[shown[0]].start, tokens[shown[1]].stop + 1
        if high - low > _CONTEXT:
            low, high = begin, end
        after = self.text[low:begin] + new + self.text[end:high]
        first = tokens[changed[0]]
        texts = " ".join(self.text[low:high].split()), " ".join(after.split())
        return Change(first.line, first.column + 1, *texts, begin, end, new)

    def declared(self, name: str, value: str) -> Change:
        """Return the change of a constant, in its declaration or of its value."""
        statement = self._declared.get(name)
        if name not in self.spec.overrides and statement is not None and statement.default:
            token, end = statement.default.start, statement.default.stop.stop + 1
            begin, new, constant = token.start, value, None
            before = self.text[begin:end]
        else:
            token = next(self.tokens[i] for i in self._spans if self.tokens[i].text == name)
            begin, end, new, constant = 0, 0, "", (name, Fraction(value))
            before = self.constant_text(name)
        texts = f"{name} = {before}", f"{name} = {value}"
        return Change(token.line, token.column + 1, *texts, begin, end, new, constant)

    def constant_text(self, name: str) -> str:
        """Return the number of a constant as in the text; otherwise, its shortest text."""
        statement = self._declared.get(name)
        if name not in self.spec.overrides and statement is not None and statement.default:
            part = statement.default
            return self.text[part.start.start : part.stop.stop + 1].replace(" ", "")
        return str(self.spec.constants[name]).removesuffix(".0")

    def _first(self, index: int, minimum: int) -> int:
        """Return the start of the operand before an index; operators below ``minimum`` end it."""
        begin = self._spans[index][0]
        while index > begin:
            before = self._partners.get(index - 1, index - 1)
            if before >= index or self.tokens[before].type == StlParser.COMMA:
                return index  # after an opening bracket
            if self.tokens[before].type == StlParser.OPEN_INTERVAL:
                before -= 1
            row = self.row(before)
            if row is not None and row.notation != "call" and row.precedence < minimum:
                return index
            index = before
        return index

    def _last(self, index: int, minimum: int) -> int:
        """Return the end of the operand after an index; operators below ``minimum`` end it."""
        end = self._spans[index][1]
        while index < end:
            after = self._partners.get(index + 1, index + 1)
            if after <= index or self.tokens[after].type == StlParser.COMMA:
                return index  # before a closing bracket
            row = self.row(after)
            if row is not None and row.notation == "infix" and row.precedence < minimum:
                return index
            index = after
        return index

    def _has_interval(self, index: int) -> bool:
        is_operator = self.tokens[index].type in _NOTATIONS
        return is_operator and self.tokens[index + 1].type == StlParser.OPEN_INTERVAL

    def _bounds(self, first: int) -> Iterator[Bound]:
        """Yield the bounds of the interval that starts at an index."""
        if self.tokens[first].type != StlParser.OPEN_INTERVAL:
            return
        last, values = self._partners[first], (StlParser.NUMBER, StlParser.NAME)
        for index in range(first + 1, last):
            # A name after a number or a constant is its unit.
            if self.tokens[index].type in values and self.tokens[index - 1].type not in values:
                yield Bound(index, self._unit(index, last), first, last)

    def _unit(self, index: int, last: int) -> str | None:
        """Return the unit of a bound; otherwise, the unit of the end."""
        for position in (index + 1, last - 1):
            before = self.tokens[position - 1].type
            if self.tokens[position].type == StlParser.NAME and before in _OPERAND_ENDS:
                return self.tokens[position].text
        return None


def _partners(tokens: Sequence[Token]) -> dict[int, int]:
    """Return the index of the other bracket of each pair."""
    partners: dict[int, int] = {}
    opened: list[int] = []
    for index, token in enumerate(tokens):
        if token.type in (StlParser.OPEN, StlParser.OPEN_INTERVAL):
            opened.append(index)
        elif token.type in (StlParser.CLOSE, StlParser.CLOSE_INTERVAL):
            partners[index] = opened.pop()
            partners[partners[index]] = index
    return partners


def _needed(spec: Specification) -> set[str]:
    """Return the names of the formulas of a requirement; the last one may be ``""``."""
    names = [name for name, formula in spec.formulas.items() if formula is spec.formula]
    result = "" if "" in spec.uses else names[-1]
    needed, stack = set[str](), [result]
    while stack:
        name = stack.pop()
        if name not in needed:
            needed.add(name)
            stack += spec.uses.get(name, ())
    return needed
