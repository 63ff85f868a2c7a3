"""Requirements in plain English, from their formulas.

A sentence is made of clauses. A clause without a comma and without "and" or "or" can stand
anywhere. One that joins such clauses stands in brackets where it is joined again. One that begins
with a phrase and a comma reaches up to the end of the sentence, or of the brackets. What would
stand in two pairs of brackets, or behind three phrases, is a numbered clause of its own. So a
sentence can be read in one way only, which the tests show by reading it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Final, NamedTuple, cast

from rtamt.errors import InputTypeError, brief
from rtamt.language.formula import Formula
from rtamt.language.interval import Interval
from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS
from rtamt.language.parser import as_specification
from rtamt.language.phrases import (
    ADJECTIVES,
    CHANGES,
    CONDITIONS,
    CONSTANTS,
    EVENTUAL,
    FIRST_SAMPLE,
    FUNCTIONS,
    INFIX,
    MOMENTS,
    NEGATIONS,
    NEIGHBOURS,
    NEVER,
    START,
    VERBS,
    VOCABULARY,
    window,
)
from rtamt.language.printing import node_text
from rtamt.language.specification import Specification

__all__ = ["in_words"]

_LONGEST: Final = 120
"""The most characters in brackets; more are a numbered clause."""

_PHRASES: Final = 3
"""The most phrases with a comma one after the other."""

_JOINTS: Final = {"not", "implies", *INFIX}
"""What is about the same moment as its operands."""

_FROM_START: Final = {"always", "eventually", "until", "unless", *CONSTANTS}
"""What at the begin of the trace has a phrase of its own, or needs none."""


def in_words(
    spec: str | Formula | Specification,
    names: Mapping[str, str] | None = None,
    *,
    unit: str | None = None,
) -> str:
    """The requirement in plain English, in one sentence that can be read in one way only.

    The formula is judged at the first sample. Where that is not said by its windows, as it is by
    "at all times" and "within the first 5 s", the sentence begins with "at the start": the words of
    ``speed < 30`` are not those of the standing rule ``always(speed < 30)``. A monitor that judges
    the formula anew at each sample (``view="step"``) demands ``formula.always()``.

    Two formulas have the same words only if they are the same; but a bound without a unit is said
    in the unit of the specification. What is nested too deep for one sentence is said in
    numbered clauses behind it, and so are formulas and terms that have a name in the specification.
    The last clause of a formula with ``rise`` or ``fall`` says what these are at the first sample.
    "p until q" and "p ever since q" are as the operators are: at the moment of q itself p need not
    hold.

    Args:
        spec: A text, a formula or a specification. Several requirements give the words of the last,
            which monitors judge too; `Specification.requirements` has them all.
        names: What to write for a variable, by its name; None: the name.
        unit: The unit of bounds that have none, such as ``"steps"`` for traces without a period.
            None: the unit of the specification, which is seconds unless it says otherwise.

    Raises:
        SpecificationError: If a text is wrong.

    Example:
        >>> from rtamt.language.words import in_words
        >>> in_words("always(req >= 3 implies eventually[0:5](gnt >= 3))")
        'whenever req is at least 3, gnt reaches at least 3 within 5 s'
        >>> in_words("always(speed < 120)", {"speed": "the speed"})
        'the speed stays below 120 at all times'
        >>> in_words("eventually[0:20] always(abs(e) < 0.1)", unit="steps")
        'within the first 20 steps, the absolute value of e stays below 0.1 from then on'
        >>> in_words("speed < 30 and always(speed < 120)")
        'at the start, speed is below 30 and speed stays below 120 at all times'
        >>> in_words("slow = v < 9; always(once[0:5](x > 2) implies slow)")
        'whenever x was above 2 within the last 5 s, slow holds; where slow means that v is below 9'
    """
    specification = as_specification(spec)
    for name, shown in (names or {}).items():
        if not isinstance(shown, str):
            raise InputTypeError(f"expected names= with a text for {name!r}, got {brief(shown)}")
    text = _Text(specification, dict(names or {}), unit or specification.unit)
    return text.written()


class _Named(NamedTuple):
    """The place of a name of the specification: of a formula, or of the term that is one."""

    name: str
    term: bool = False


_Pieces = tuple[str | _Named | Node, ...]
"""Parts of a text; a node is the place of a numbered clause."""


class _Clause(NamedTuple):
    """A part of a sentence.

    Attributes:
        pieces: Texts, names, and formulas that are numbered clauses.
        alone: Whether it can stand anywhere: no comma, nothing joined.
        phrases: How many phrases with a comma are in it one after the other; 0: it is closed, so
            that something may follow.
        bracketed: Whether brackets are in it.
    """

    pieces: _Pieces
    alone: bool = True
    phrases: int = 0
    bracketed: bool = False


class _Text:
    """The sentence of a specification and the clauses behind it."""

    def __init__(self, specification: Specification, shown: Mapping[str, str], unit: str) -> None:
        self.specification = specification
        self.shown = shown
        self.unit = unit
        self._writers: dict[str, _Writer] = {}

    def written(self) -> str:
        specification = self.specification
        formulas = specification.formulas.items()
        named = [name for name, formula in formulas if formula is specification.formula]
        root = "" if "" in specification.uses or not named else named[-1]
        clause = self._writer(root).clauses(specification.formula)[True]
        before = (f"{START}, ",) if self._writer(root).of_start(specification.formula) else ()
        pending: list[tuple[_Pieces, str]] = [((*before, *clause.pieces), root)]
        labels: dict[object, str] = {}
        sentences: list[str] = []
        numbered = 0
        for pieces, inside in pending:  # it grows
            text = ""
            for piece in pieces:
                if isinstance(piece, str):
                    text += piece
                    continue
                key: object = piece if isinstance(piece, _Named) else (inside, piece)
                if key not in labels:
                    if isinstance(piece, _Named):
                        labels[key] = _quoted(piece.name)
                        pending.append(self._definition(piece))
                    else:
                        numbered += 1
                        labels[key] = f"[{numbered}]"
                        meaning = self._writer(inside).clauses(cast("Formula", piece))[False]
                        pending.append(((labels[key], " means that ", *meaning.pieces), inside))
                text += labels[key]
            sentences.append(text)
        if any(node.op and node.op.name in CHANGES for node in specification.formula.nodes()):
            sentences.append(FIRST_SAMPLE)
        return "; where ".join([sentences[0], *["; ".join(sentences[1:])][: len(sentences) - 1]])

    def _definition(self, named: _Named) -> tuple[_Pieces, str]:
        formula = self.specification.formulas[named.name]
        writer = self._writer(named.name)
        label = _quoted(named.name)
        if named.term:
            return (f"{label} is ", *writer.term(formula.args[0])), named.name
        return (f"{label} means that ", *writer.clauses(formula)[False].pieces), named.name

    def _writer(self, name: str) -> _Writer:
        if name not in self._writers:
            self._writers[name] = _Writer(self.specification, name, self.shown, self.unit)
        return self._writers[name]


class _Writer:
    """The clauses of one formula of a specification, in which those with a name are that name."""

    def __init__(
        self, specification: Specification, name: str, shown: Mapping[str, str], unit: str
    ) -> None:
        self._unit = unit
        root = specification.formulas.get(name, specification.formula)
        named = {
            specification.formulas[used]: used
            for used in reversed(specification.uses.get(name, ()))
            if specification.formulas[used] is not root
        }
        self._names: dict[Node, _Named] = {node: _Named(used) for node, used in named.items()}
        for node, used in named.items():
            if node.op is OPERATORS["value"]:
                self._names[node.args[0]] = _Named(used, term=True)
        self._shown = {
            node: shown.get(node.leaf, _quoted(node.leaf))
            for node in root.nodes()
            if isinstance(node.leaf, str)
        }
        self._clauses: dict[Node, dict[bool, _Clause]] = {}

    def clauses(self, formula: Formula) -> dict[bool, _Clause]:
        """The clause of a formula at the begin of the trace (True), and at any time (False)."""
        if formula not in self._clauses:
            for node in formula.nodes():  # operands before what uses them: no recursion
                if isinstance(node, Formula) and node not in self._clauses:
                    self._clauses[node] = {
                        first: self._clause(node, first=first) for first in (False, True)
                    }
        return self._clauses[formula]

    def of_start(self, formula: Formula) -> bool:
        """Whether a part of a formula is about the begin of the trace, with no phrase that says so.

        Such are predicates, names, the past and neighbours, joined or negated; no bare future.
        """
        pending: list[Node] = [formula]
        for node in pending:  # it grows
            if self._inner(node) in _JOINTS:
                pending += node.args
            elif self._inner(node) not in _FROM_START:
                return True
        return False

    def term(self, term: Node) -> _Pieces:
        """A term: a function of variables and numbers in words, all else as it is written."""
        name = term.op.name if term.op else ""
        if term in self._names or name not in FUNCTIONS:
            return self._notation(term)
        operands = [self._notation(each) for each in term.args]
        begin, *rest = FUNCTIONS[name].split("{}")
        if term.op and term.op.arity[1] is None:
            operands = [("(", *_joined(operands, ", "), ")")]
        else:
            operands = [
                pieces if each.op is None or each in self._names else ("(", *pieces, ")")
                for each, pieces in zip(term.args, operands, strict=True)
            ]
        parts = zip(operands, rest, strict=True)
        return (begin, *(piece for operand, text in parts for piece in (*operand, text)))

    def _notation(self, term: Node) -> _Pieces:
        """A term as it is written, with the names in it."""
        marks = {node: f"\0{i}\0" for i, node in enumerate(self._names)}
        named = list(self._names.values())
        parts = node_text(term, {**self._shown, **marks}).split("\0")
        return tuple(named[int(part)] if i % 2 else part for i, part in enumerate(parts))

    def _clause(self, node: Formula, *, first: bool) -> _Clause:
        name = _name(node)
        if holder := self._holder(node):
            return _Clause((*holder, " holds"))
        if name in ADJECTIVES:
            return _Clause(self._predicate(node, "is"))
        if name in NEGATIONS:
            return self._negated(name, node.args[0], first=first and name == "not")
        if name in INFIX:
            before, between, behind = INFIX[name]
            parts = [self._closed(each, first=first) for each in node.args]
            pieces = _joined([part.pieces for part in parts], between)
            bracketed = any(part.bracketed for part in parts)
            return _Clause((before, *pieces, behind), alone=False, bracketed=bracketed)
        if name in CONDITIONS:
            return self._conditional(name, node, first=first)
        if name in NEIGHBOURS:
            return self._behind((NEIGHBOURS[name], ", "), node.args[0])
        if name in MOMENTS:
            return self._moment(name, node, first=first)
        return self._windowed(name, node, first=first)

    def _windowed(self, name: str, node: Formula, *, first: bool) -> _Clause:
        """An operator over a window: behind the verb of a predicate, else before all."""
        bounds, operand = self._window(node), node.args[0]
        when = self._when(name, bounds, first=first)
        of_many, inner = bounds.begin != bounds.end, self._inner(operand)
        if of_many and inner in ADJECTIVES:
            verb = EVENTUAL.get(inner, VERBS[name]) if name == "eventually" else VERBS[name]
            return _Clause((*self._predicate(operand, verb), f" {when}"))
        negated = operand.args[0] if inner == "not" else operand
        if of_many and name in NEVER and self._inner(negated) in ADJECTIVES:
            rest = when.removeprefix("at all times").strip()
            return _Clause((*self._predicate(negated, NEVER[name]), f" {rest}" if rest else ""))
        if of_many and inner == "implies" and name == "always":
            whole = first and not bounds.begin and bounds.end is None
            rule = self._conditional("always implies", operand, first=False)
            return rule if whole else _Clause((when, ", ", *rule.pieces), *rule[1:])
        return self._behind((when, ", "), operand)

    def _moment(self, name: str, node: Formula, *, first: bool) -> _Clause:
        """An operator whose left operand holds up to, or from, the moment of the right one."""
        bounds, (left, right) = self._window(node), node.args
        when = self._when("once" if name == "since" else "eventually", bounds, first=first)
        held = self._closed(left, first=False)
        if name == "unless":
            as_long = self._when("always", replace(bounds, begin=Fraction(0)), first=first)
            if self._inner(left) in ADJECTIVES:
                held = _Clause(self._predicate(left, "stays"))
            elif not self._holder(left):
                held = self._bracketed(left, self._clauses[left][False], " holds")
            held = held._replace(pieces=(*held.pieces, f" {as_long}"))
        behind = self._behind((*held.pieces, MOMENTS[name], when, ", "), right)
        return behind._replace(bracketed=behind.bracketed or held.bracketed)

    def _conditional(self, name: str, node: Node, *, first: bool) -> _Clause:
        """A condition, which ends at its comma, and what follows from it."""
        before, behind = CONDITIONS[name]
        left, right = node.args
        condition = self._clauses[left][first]
        if condition.phrases:
            condition = self._closed(left, first=first)
        clause = self._behind((before, *condition.pieces, behind), right, first=first)
        return clause._replace(bracketed=clause.bracketed or condition.bracketed)

    def _negated(self, name: str, operand: Node, *, first: bool) -> _Clause:
        verb, holding, before = NEGATIONS[name]
        if self._inner(operand) in ADJECTIVES:
            return _Clause(self._predicate(operand, verb))
        if holder := self._holder(operand):
            return _Clause((*holder, f" {holding}"))
        held = self._bracketed(operand, self._clauses[operand][first], f" {holding}")
        return held._replace(pieces=(before, *held.pieces)) if held.bracketed else held

    def _behind(self, before: _Pieces, body: Node, *, first: bool = False) -> _Clause:
        """A clause behind a phrase with a comma; it reaches up to the end of the sentence."""
        clause = self._clauses[body][first]
        if clause.phrases >= _PHRASES:
            clause = _Clause((body, " holds"))
        return clause._replace(
            pieces=(*before, *clause.pieces), alone=False, phrases=clause.phrases + 1
        )

    def _closed(self, node: Node, *, first: bool) -> _Clause:
        """A clause that may stand between others."""
        clause = self._clauses[node][first]
        return clause if clause.alone else self._bracketed(node, clause, " holds")

    def _bracketed(self, node: Node, clause: _Clause, holding: str) -> _Clause:
        """A clause in brackets; as a numbered one, with its verb, if it has brackets or is long."""
        length = sum(len(each) if isinstance(each, str) else 4 for each in clause.pieces)
        if clause.bracketed or length > _LONGEST:
            return _Clause((node, holding))
        return _Clause(("(", *clause.pieces, ")"), bracketed=True)

    def _holder(self, node: Node) -> _Pieces:
        """The subject of "holds": the name of a formula, or true or false; empty for others."""
        if node in self._names:
            return (self._names[node],)
        return (_name(node),) if _name(node) in CONSTANTS else ()

    def _predicate(self, node: Node, verb: str) -> _Pieces:
        left, *right = (self.term(each) for each in node.args)
        behind = (" ", *right[0]) if right else ()
        return (*left, f" {verb} {ADJECTIVES[_name(node)]}", *behind)

    def _inner(self, node: Node) -> str:
        """The name of the operator of a formula, none if it is shown by its name."""
        return "" if node in self._names else _name(node)

    def _window(self, node: Node) -> Interval:
        return node.interval or Interval(Fraction(0), None)

    def _when(self, name: str, interval: Interval, *, first: bool) -> str:
        unit = interval.unit or self._unit
        return window(name, interval.begin, interval.end, unit, at_first=first)


def _name(node: Node) -> str:
    return node.op.name if node.op else ""


def _joined(parts: Iterable[_Pieces], between: str) -> _Pieces:
    found: list[str | _Named | Node] = []
    for i, part in enumerate(parts):
        found += [between, *part] if i else part
    return tuple(found)


def _quoted(name: str) -> str:
    """A name; in quotation marks if it is a word of the sentences."""
    return f'"{name}"' if name in VOCABULARY else name
