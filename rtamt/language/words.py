"""Requirements in plain English, from their formulas.

A sentence consists of clauses. A clause without a comma and without "and" or "or" can stand
anywhere. A clause that joins others has brackets inside another clause. A clause that starts with a
phrase and a comma reaches up to the end of the sentence, or of the brackets. A part that would need
two pairs of brackets, or would follow three phrases, is a separate numbered clause. These rules
make every sentence unambiguous; the tests read sentences back to formulas.

To add the words of an operator or a function, add an entry to one of the tables, and the same words
to ``tests/support/words_reader.py``, which reads sentences back to formulas.
``tests/rtamt/language/test_words.py`` names a row without words.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Final, NamedTuple, cast

from rtamt.errors import InputTypeError, brief
from rtamt.language.formula import Formula
from rtamt.language.interval import Interval, decimal_text
from rtamt.language.node import Node, node_text
from rtamt.language.operators import OPERATORS
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification

ADJECTIVES: Final = {
    ">=": "at least",
    ">": "above",
    "<=": "at most",
    "<": "below",
    "==": "equal to",
    "!=": "different from",
    "value": "nonnegative",
}
"""Predicates, after a verb: "x is at least 3"."""

EVENTUAL: Final = {">=": "reaches", "<=": "reaches"}
"""The verbs of predicates that hold at some time; the others have "gets"."""

FUNCTIONS: Final = {
    "abs": "the absolute value of {}",
    "sqrt": "the square root of {}",
    "exp": "the exponential of {}",
    "ln": "the natural logarithm of {}",
    "pow": "{} to the power of {}",
    "log": "the logarithm of {} to base {}",
    "min": "the smallest of {}",
    "max": "the largest of {}",
    "neg": "minus {}",
    "rate": "the rate of {}",
}
"""Functions. Lists, and operands other than variables and numbers, have brackets. Inside arithmetic
a function is written as in the formula."""

ARITHMETIC: Final = ("+", "-", "*", "/")
"""Operators that stay as in the formula."""

CONSTANTS: Final = ("true", "false")
"""Formulas with the same words as in the text."""

NEGATIONS: Final = {
    "not": ("is not", "does not hold", "it is not true that "),
    "rise": ("becomes", "begins to hold", "it becomes true that "),
    "fall": ("stops being", "ceases to hold", "it stops being true that "),
}
"""Operators that change a verb: the verb of predicates, of names, and the words before clauses."""

CHANGES: Final = ("rise", "fall")
"""Operators that compare a sample with the previous one."""

FIRST_SAMPLE: Final = "the first sample counts as changed"
"""At the first sample, which has no previous one, ``rise(p)`` and ``fall(p)`` are ``p`` and
``not p``."""

INFIX: Final = {
    "and": ("", " and ", ""),
    "or": ("", " or ", ""),
    "iff": ("", " exactly when ", ""),
    "xor": ("either ", " or ", " but not both"),
}
"""The words before, between and after the operands."""

CONDITIONS: Final = {"implies": ("if ", ", then "), "always implies": ("whenever ", ", ")}
"""The words before and after a condition."""

NEIGHBOURS: Final = {
    "next": "at the next sample if there is one",
    "s_next": "at the next sample",
    "prev": "at the previous sample if there is one",
    "s_prev": "at the previous sample",
}

MOMENTS: Final = {
    "until": " until, ",
    "since": " ever since, ",
    "unless": ", or only until, ",
}
"""The words between the left operand and the phrase for the moment of the right one."""

START: Final = "at the start"
"""Starts a sentence if part of it is only about the start of the trace."""

VERBS: Final = {
    "always": "stays",
    "eventually": "gets",
    "historically": "has been",
    "once": "was",
}
"""The verbs of predicates before a window."""

NEVER: Final = {"always": "is never", "historically": "has never been"}
"""The verbs of predicates that hold at no time of a window."""

WINDOWS: Final = {
    "always at first": (
        *("at all times", "from {} on", "during the first {}", "from {} to {}"),
        "at {} if the trace lasts",
    ),
    "always": (
        *("from then on", "from {} later on", "for the next {}", "from {} to {} later"),
        "{} later if the trace lasts",
    ),
    "eventually at first": (
        *("at some time", "at some time from {} on", "within the first {}"),
        *("at some time from {} to {}", "at {}"),
    ),
    "eventually": (
        *("at some time from then on", "at some time from {} later on", "within {}"),
        *("at some time from {} to {} later", "{} later"),
    ),
    "historically": (
        *("at all times so far", "at all times up to {} earlier", "for the last {}"),
        *("from {} to {} earlier", "{} earlier if the trace had begun"),
    ),
    "once": (
        *("at some time so far", "at some time up to {} earlier", "within the last {}"),
        *("at some time from {} to {} earlier", "{} earlier"),
    ),
}
"""Windows without an end, from a time on, up to a time, between two, and a single time; "at first"
if the operator is about the start of the trace."""

VOCABULARY: Final = frozenset(
    word
    for texts in (
        *(
            "is holds means that where",
            START,
            FIRST_SAMPLE,
            *ADJECTIVES.values(),
            *EVENTUAL.values(),
        ),
        *(*FUNCTIONS.values(), *NEIGHBOURS.values(), *MOMENTS.values()),
        *(*VERBS.values(), *NEVER.values()),
        *(text for table in (NEGATIONS, INFIX, CONDITIONS, WINDOWS) for text in table.values()),
    )
    for word in re.findall("[a-z]+", " ".join([texts] if isinstance(texts, str) else texts))
)
"""Every word of the phrases. A variable with one as its name is written in quotation marks."""

_LONGEST: Final = 120
"""The most characters in brackets; a longer text is a numbered clause."""

_PHRASES: Final = 3
"""The most consecutive phrases with a comma."""

_JOINTS: Final = {"not", "implies", *INFIX}
"""Operators about the same moment as their operands."""

_FROM_START: Final = {"always", "eventually", "until", "unless", *CONSTANTS}
"""Operators whose own phrase states the start of the trace, or that need none."""


def in_words(
    spec: str | Formula | Specification,
    names: Mapping[str, str] | None = None,
    *,
    unit: str | None = None,
) -> str:
    """Return the result of a specification in plain English, as `Specification.in_words`."""
    specification = as_specification(spec)
    for name, shown in (names or {}).items():
        if not isinstance(shown, str):
            raise InputTypeError(f"expected names= with a text for {name!r}, got {brief(shown)}")
    text = _Text(specification, dict(names or {}), unit or specification.unit)
    return text.written()


class _Named(NamedTuple):
    """The place of the name of a formula, or of a term."""

    name: str
    term: bool = False


_Pieces = tuple[str | _Named | Node, ...]
"""Parts of a text; a node is the place of a numbered clause."""


class _Clause(NamedTuple):
    """A part of a sentence."""

    pieces: _Pieces  # texts, names, and formulas that are numbered clauses
    standalone: bool = True  # whether it can stand anywhere: no comma, nothing joined
    # the number of consecutive phrases with a comma; 0 if another clause may follow
    phrases: int = 0
    bracketed: bool = False  # whether it contains brackets


class _Text:
    """The sentence of a specification and the clauses after it."""

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
        for pieces, inside in pending:  # the loop appends to this list
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
    """The clauses of one formula of a specification, with the names of others in it."""

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
        """Return the clause of a formula at the start of a trace (True) and at any time (False)."""
        if formula not in self._clauses:
            for node in formula.nodes():  # operands before their operator: no recursion
                if isinstance(node, Formula) and node not in self._clauses:
                    self._clauses[node] = {
                        first: self._clause(node, first=first) for first in (False, True)
                    }
        return self._clauses[formula]

    def of_start(self, formula: Formula) -> bool:
        """Return whether part of a formula is about the start of the trace without stating it.

        That is true of predicates, names, the past and neighbours, joined or negated, but not of
        the future.
        """
        pending: list[Node] = [formula]
        for node in pending:  # the loop appends to this list
            if self._inner(node) in _JOINTS:
                pending += node.args
            elif self._inner(node) not in _FROM_START:
                return True
        return False

    def term(self, term: Node) -> _Pieces:
        """Return a function of variables and numbers in words, other terms as they are written."""
        name = term.op.name if term.op else ""
        if term in self._names or name not in FUNCTIONS:
            return self._notation(term)
        operands = [self._notation(arg) for arg in term.args]
        begin, *remainder = FUNCTIONS[name].split("{}")
        if term.op and term.op.arity[1] is None:
            operands = [("(", *_joined(operands, ", "), ")")]
        else:
            operands = [
                pieces if arg.op is None or arg in self._names else ("(", *pieces, ")")
                for arg, pieces in zip(term.args, operands, strict=True)
            ]
        parts = zip(operands, remainder, strict=True)
        return (begin, *(piece for operand, text in parts for piece in (*operand, text)))

    def _notation(self, term: Node) -> _Pieces:
        """Return a term as it is written, with the names in it."""
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
            parts = [self._closed(arg, first=first) for arg in node.args]
            pieces = _joined([part.pieces for part in parts], between)
            bracketed = any(part.bracketed for part in parts)
            return _Clause((before, *pieces, behind), standalone=False, bracketed=bracketed)
        if name in CONDITIONS:
            return self._conditional(name, node, first=first)
        if name in NEIGHBOURS:
            return self._after((NEIGHBOURS[name], ", "), node.args[0])
        if name in MOMENTS:
            return self._moment(name, node, first=first)
        return self._windowed(name, node, first=first)

    def _windowed(self, name: str, node: Formula, *, first: bool) -> _Clause:
        """Return an operator over a window: after a predicate's verb, or before other clauses."""
        bounds, operand = self._window(node), node.args[0]
        when = self._when(name, bounds, first=first)
        of_many, inner = bounds.begin != bounds.end, self._inner(operand)
        if of_many and inner in ADJECTIVES:
            verb = EVENTUAL.get(inner, VERBS[name]) if name == "eventually" else VERBS[name]
            return _Clause((*self._predicate(operand, verb), f" {when}"))
        negated = operand.args[0] if inner == "not" else operand
        if of_many and name in NEVER and self._inner(negated) in ADJECTIVES:
            remainder = when.removeprefix("at all times").strip()
            return _Clause(
                (*self._predicate(negated, NEVER[name]), f" {remainder}" if remainder else "")
            )
        if of_many and inner == "implies" and name == "always":
            everywhere = first and not bounds.begin and bounds.end is None
            rule = self._conditional("always implies", operand, first=False)
            return rule if everywhere else _Clause((when, ", ", *rule.pieces), *rule[1:])
        return self._after((when, ", "), operand)

    def _moment(self, name: str, node: Formula, *, first: bool) -> _Clause:
        """Return until, since or unless: the left operand holds up to, or from, the right one."""
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
        behind = self._after((*held.pieces, MOMENTS[name], when, ", "), right)
        return behind._replace(bracketed=behind.bracketed or held.bracketed)

    def _conditional(self, name: str, node: Node, *, first: bool) -> _Clause:
        """Return a condition, which ends at its comma, and its consequence."""
        before, behind = CONDITIONS[name]
        left, right = node.args
        condition = self._clauses[left][first]
        if condition.phrases:
            condition = self._closed(left, first=first)
        clause = self._after((before, *condition.pieces, behind), right, first=first)
        return clause._replace(bracketed=clause.bracketed or condition.bracketed)

    def _negated(self, name: str, operand: Node, *, first: bool) -> _Clause:
        verb, holding, before = NEGATIONS[name]
        if self._inner(operand) in ADJECTIVES:
            return _Clause(self._predicate(operand, verb))
        if holder := self._holder(operand):
            return _Clause((*holder, f" {holding}"))
        held = self._bracketed(operand, self._clauses[operand][first], f" {holding}")
        return held._replace(pieces=(before, *held.pieces)) if held.bracketed else held

    def _after(self, before: _Pieces, body: Node, *, first: bool = False) -> _Clause:
        """Return a phrase with a comma and its clause, which reaches to the end of the sentence."""
        clause = self._clauses[body][first]
        if clause.phrases >= _PHRASES:
            clause = _Clause((body, " holds"))
        return clause._replace(
            pieces=(*before, *clause.pieces), standalone=False, phrases=clause.phrases + 1
        )

    def _closed(self, node: Node, *, first: bool) -> _Clause:
        """Return a clause that may stand between others."""
        clause = self._clauses[node][first]
        return clause if clause.standalone else self._bracketed(node, clause, " holds")

    def _bracketed(self, node: Node, clause: _Clause, holding: str) -> _Clause:
        """Return a clause in brackets; numbered, with its verb, if it is long or has brackets."""
        length = sum(len(piece) if isinstance(piece, str) else 4 for piece in clause.pieces)
        if clause.bracketed or length > _LONGEST:
            return _Clause((node, holding))
        return _Clause(("(", *clause.pieces, ")"), bracketed=True)

    def _holder(self, node: Node) -> _Pieces:
        """Return the subject of "holds": a name, true or false; empty for other formulas."""
        if node in self._names:
            return (self._names[node],)
        return (_name(node),) if _name(node) in CONSTANTS else ()

    def _predicate(self, node: Node, verb: str) -> _Pieces:
        left, *right = (self.term(arg) for arg in node.args)
        behind = (" ", *right[0]) if right else ()
        return (*left, f" {verb} {ADJECTIVES[_name(node)]}", *behind)

    def _inner(self, node: Node) -> str:
        """Return the name of a formula's operator; empty if the formula is shown by its name."""
        return "" if node in self._names else _name(node)

    def _window(self, node: Node) -> Interval:
        return node.interval or Interval(Fraction(0), None)

    def _when(self, name: str, interval: Interval, *, first: bool) -> str:
        unit = interval.unit or self._unit
        return window(name, interval.begin, interval.end, unit, at_first=first)


def _name(node: Node) -> str:
    return node.op.name if node.op else ""


def _joined(parts: Iterable[_Pieces], between: str) -> _Pieces:
    pieces: list[str | _Named | Node] = []
    for i, part in enumerate(parts):
        pieces += [between, *part] if i else part
    return tuple(pieces)


def _quoted(name: str) -> str:
    """Return a name, in quotation marks if it is a word of the sentences."""
    return f'"{name}"' if name in VOCABULARY else name


def window(name: str, begin: Fraction, end: Fraction | None, unit: str, *, at_first: bool) -> str:
    """Return the phrase for the interval of a temporal operator.

    Example:
        >>> window("once", Fraction(0), Fraction(5), "s", at_first=False)
        'within the last 5 s'
    """
    phrases = WINDOWS.get(f"{name} at first" if at_first else name, WINDOWS[name])
    endless, from_on, up_to, between, single = phrases
    if end is None:
        return from_on.format(amount(begin, unit)) if begin else endless
    if begin == end:
        return single.format(amount(begin, unit))
    if not begin:
        return up_to.format(amount(end, unit))
    first, last = amount(begin, unit), amount(end, unit)
    past = name in ("historically", "once")
    return between.format(last, first) if past else between.format(first, last)


def amount(value: Fraction, unit: str) -> str:
    """Return a time with its unit; a unit that is a word has a singular.

    Example:
        >>> amount(Fraction(1), "steps"), amount(Fraction(1, 2), "s")
        ('1 step', '0.5 s')
    """
    one = value == 1 and len(unit) > 2
    return f"{decimal_text(value)} {unit.removesuffix('s') if one else unit}"
