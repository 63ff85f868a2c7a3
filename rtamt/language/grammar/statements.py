"""From statements to a `Specification`: declarations, and what names stand for.

To add an annotation, such as ``@ topic``: add its form to ``annotation`` in ``Stl.g4``, its meaning
here, and a field of `Specification`, which ``str`` writes and ``_requirement`` passes to the
requirements of a file. Add its errors to ``tests/rtamt/language/parse_errors.txt``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Literal, NamedTuple, cast

from rtamt.errors import Advice, Argument, ParseError, SpecificationError
from rtamt.language.formula import Formula, Term, number, variable
from rtamt.language.grammar.diagnosis import (
    ID_HINT,
    LINK_HINT,
    Token,
    exact_number,
    fail,
    no_formula,
    no_id,
    similar,
    similar_name,
)
from rtamt.language.grammar.dialects import foreign_hint
from rtamt.language.grammar.expressions import TreeBuilder
from rtamt.language.grammar.ranges import RangeReader
from rtamt.language.grammar.tokens import Limits, Span, Statement, Statements, read
from rtamt.language.ids import RequirementId
from rtamt.language.names import lineage
from rtamt.language.node import Node, interned
from rtamt.language.operators import OPERATORS
from rtamt.language.specification import PRIMITIVES, Declaration, Specification
from rtamt.language.traced import Traced

__all__ = ["read_specification", "read_traced"]

_VALUE = OPERATORS["value"]


def read_specification(
    text: str,
    unit: str,
    given: Mapping[str, Fraction],
    modules: Mapping[str, object] | None,
    *,
    chains: bool,
    traced: bool = False,
) -> Specification:
    """Reads a text as a specification; `parse_as` has checked the arguments, and documents them.

    With ``traced``, its constants are `Traced` numbers where they stand in terms.

    Raises:
        ParseError: If the text is not a specification.
    """
    statements, tokens = read(text)
    reader = _Reader(text, tokens, given, modules, chains=chains, traced=traced)
    return reader.specification(statements, unit)


RangeOf = Callable[[Mapping[str, Fraction]], tuple[float, float]]
"""The range that a declaration says, for values of the constants."""


class TracedText(NamedTuple):
    """A text for any values of its constants.

    Attributes:
        spec: The specification with `Traced` numbers and `TracedInterval`.
        ranges: The ranges of its declarations, by variable.
        ranging: The constants that are limits of these.
        constants: The exact values of its constants.
    """

    spec: Specification
    ranges: dict[str, RangeOf]
    ranging: frozenset[str]
    constants: dict[str, Fraction]


def read_traced(text: str, unit: str, given: Mapping[str, Fraction], *, chains: bool) -> TracedText:
    """Reads a text for any values of its constants.

    Raises:
        ParseError: If the text is not a specification.
    """
    statements, tokens = read(text)
    reader = _Reader(text, tokens, given, None, chains=chains, traced=True)
    reader.builder.traced = True
    spec = reader.specification(statements, unit)
    return TracedText(spec, reader.ranges, frozenset(reader.ranging), reader.constants)


class _Reader:
    def __init__(
        self,
        text: str,
        tokens: Sequence[Token],
        given: Mapping[str, Fraction],
        modules: Mapping[str, object] | None,
        *,
        chains: bool,
        traced: bool,
    ) -> None:
        self.text = text
        self.traced = traced
        self.tokens = tokens
        names = {token.text for token in tokens}
        self.given = {name: value for name, value in given.items() if name in names}
        self.modules = modules
        self.imports: dict[str, str] = {}
        self.types: dict[str, type] = {}
        self.constants = dict(self.given)
        self.defined: set[str] = set()  # constants of the text itself
        self.declarations: dict[str, Declaration] = {}
        self.ranges: dict[str, RangeOf] = {}
        self.ranging: set[str] = set()  # constants that are limits of ranges
        self.declared: set[str] = set()
        self.all_declared = False  # whether a variable must be declared
        self.topics: dict[str, str] = {}
        self.ids: dict[str, RequirementId] = {}
        self.formulas: dict[str, Formula] = {}
        self.used: set[str] = set()  # variables
        self.uses: dict[str, tuple[str, ...]] = {}
        self.named: dict[str, None] = {}  # formulas that the formula being read names
        self.builder = TreeBuilder(text, tokens, self.constants, self._resolve, chains=chains)

    def specification(self, statements: Statements, unit: str) -> Specification:
        if not statements.definitions:
            instead = "declarations only" if len(self.tokens) > 1 else "the end of the text"
            raise no_formula(self.text, self.tokens[-1], instead)
        for statement in statements.imports:
            self._import(statement)
        for statement in statements.constants:
            self._constant(statement)
        for statement in statements.declarations:
            self._declare(statement)
        # The declaration of a name that a formula defines declares no variable.
        named = {d.name.text for d in statements.definitions if d.name is not None}
        self.declared = self.declarations.keys() - named
        computed = {name.rpartition(".")[0] for name in named}
        self.all_declared = any(name not in computed for name in self.declared)
        *others, last = statements.definitions
        for statement in others:
            if statement.name is None:
                hint = "name it, p = ..., or remove it: the last formula is the result"
                token = statement.formula.start
                raise self._fail(token, "only the last formula may stand without a name", hint)
            self._define(statement)
        self.result = formula = self._define(last)
        is_named = formula in self.formulas.values()
        if formula.op is _VALUE and not formula.variables and is_named and not self.builder.chains:
            token = last.name or last.formula.start
            reason = f"the result '{token.text}' is the number {formula}, whatever the samples"
            hint = f"equality is written '==': {token.text} == {formula}"
            raise self._fail(token, reason, hint)
        for statement in statements.annotations:
            if statement.kind.text == "id":
                self._identify(statement, statements)
            else:
                self._annotate(statement)
        return Specification(
            text=self.text,
            formula=formula,
            name=None if statements.name is None else statements.name.text,
            formulas=self.formulas,
            declarations=self.declarations,
            constants={name: float(value) for name, value in self.constants.items()},
            topics=self.topics,
            ids=self.ids,
            imports=self.imports,
            types=self.types,
            unit=unit,
            overrides=self.given,
            chains=self.builder.chains,
            positions=self.builder.positions,
            uses=self.uses,
            bounding=frozenset(self.builder.bounding),
        )

    def _import(self, statement: Statement) -> None:
        module, name = statement.module.text, cast("Token", statement.name)
        self.imports[name.text] = module
        if self.modules is None:  # then a type is a name
            return
        if module not in self.modules:
            hint = similar(
                module, self.modules, Advice(Argument("modules", [module]), " imports it")
            )
            raise self._fail(statement.module, f"module '{module}' was not given", hint)
        known = dir(self.modules[module])
        if name.text not in known:
            reason = f"module '{module}' has no type '{name.text}'"
            raise self._fail(name, reason, similar(name.text, known))
        kind = getattr(self.modules[module], name.text)
        if isinstance(kind, type):
            self.types[name.text] = kind

    def _constant(self, statement: Statement) -> None:
        name = self._new(statement, PRIMITIVES, self.defined)
        value = self._value(cast("Span", statement.default))
        self.constants[name] = self.given.get(name, value)
        self.defined.add(name)

    def _declare(self, statement: Statement) -> None:
        name = self._new(statement, (*PRIMITIVES, *self.imports), self.constants)
        io = None if statement.io is None else cast("Literal['input', 'output']", statement.io.text)
        default = None if statement.default is None else float(self._value(statement.default))
        kind, within = statement.kind.text, None
        if statement.within is not None:
            self.ranges[name] = partial(self._range, statement, kind, default)
            within = self.ranges[name](self.constants)
            limits = cast("Limits", statement.bounds)
            found = {limits.lower.stop.text, limits.upper.stop.text}
            self.ranging |= found & self.constants.keys()
        self.declarations[name] = Declaration(kind, io, default, within)

    def _range(
        self,
        statement: Statement,
        kind: str,
        default: float | None,
        constants: Mapping[str, Fraction],
    ) -> tuple[float, float]:
        return RangeReader(self.text, self.tokens, constants).read(statement, kind, default)

    def _new(self, statement: Statement, types: Iterable[str], constants: Collection[str]) -> str:
        token = cast("Token", statement.name)
        if statement.kind.text not in types:
            kind = statement.kind.text
            otherwise = f"take bool, int, float, float64, ... or: from MODULE import {kind}"
            foreign = foreign_hint(self.text, statement.kind.start)
            hint = foreign or similar(kind, types, otherwise)
            raise self._fail(statement.kind, f"unknown type '{kind}'", hint)
        if token.text in self.declarations or token.text in constants:
            given = token.text in self.given and token.text not in self.defined
            by = "given as a constant" if given else "declared"
            raise self._fail(token, f"'{token.text}' is already {by}", "choose another name")
        return token.text

    def _value(self, part: Span) -> Fraction:
        value = self.tokens[part.start.tokenIndex : part.stop.tokenIndex + 1]
        digits = "".join(token.text for token in value)
        return exact_number(self.text, part.start, digits, "number")

    def _annotate(self, statement: Statement) -> None:
        if statement.kind.text != "topic":
            reason = f"unknown annotation '{statement.kind.text}'"
            hint = f"write @ topic(VARIABLE, path) or {ID_HINT.removeprefix('write ')}"
            raise self._fail(statement.kind, reason, hint)
        if statement.location is None:
            token = cast("Token", statement.label)
            reason = f"expected the path of a topic, got {token.text}"
            raise self._fail(token, reason, "a path is names with '/' between them")
        name = statement.variable.text
        known = self.declarations.keys() | self.used | self.formulas.keys()
        if name not in known:
            hint = similar_name(name, known, f"float {name}")
            raise self._fail(statement.variable, f"unknown variable '{name}'", hint)
        first, last = statement.location.start.tokenIndex, statement.location.stop.tokenIndex
        steps = self.tokens[first : last + 1]
        for step in steps:
            if step.text[0] not in "/." and not step.text[0].isalnum() and step.text[0] != "_":
                reason = f"expected a name in the path, got '{step.text}'"
                raise self._fail(step, reason, "a path is names with '/' between them")
        self.topics[name] = "".join(step.text for step in steps)

    def _identify(self, statement: Statement, statements: Statements) -> None:
        token, label, link = statement.variable, statement.label, statement.link
        if label is None:
            raise no_id(self.text, cast("Span", statement.location).start)
        name, whole = token.text, statements.name
        if name not in self.formulas and whole is not None and name == whole.text:
            name = self._whole(token, statements.definitions[-1])
        elif name not in self.formulas:
            known = [*self.formulas, *([] if whole is None else [whole.text])]
            otherwise = f"an id belongs to a formula with a name: {name} = ..."
            raise self._fail(token, f"unknown formula '{name}'", similar(name, known, otherwise))
        if name in self.ids:
            reason = f"'{name}' already has the id {self.ids[name]}"
            raise self._fail(token, reason, "a requirement has one id")
        part, hint = label, ID_HINT
        try:
            found = RequirementId(label.text[1:-1])
            if link is not None:
                part, hint = link, LINK_HINT
                found = RequirementId(found.id, link.text[1:-1])
        except SpecificationError as error:
            raise self._fail(part, str(error), hint) from None
        for other, its in self.ids.items():
            if its.id == found.id:
                reason = f"'{other}' already has the id {found}"
                raise self._fail(label, reason, "choose another id")
        self._check_judged(name, token)
        self.ids[name] = found

    def _check_judged(self, name: str, token: Token) -> None:
        """Refuse an id of a formula that stands for a number in other formulas."""
        formula = self.formulas.get(name)
        if formula is None or formula.op is not _VALUE:
            return
        for user, names in self.uses.items():
            if name in names and formula not in self.formulas.get(user, self.result).nodes():
                where = f"'{user}'" if user else "the result"
                reason = f"'{name}' is a number in {where}, not a requirement"
                hint = f"give the id to a formula that compares it, such as {name} > 0"
                raise self._fail(token, reason, hint)

    def _whole(self, token: Token, last: Statement) -> str:
        """The name under which the id of the whole is kept; it requires one thing."""
        used = {each for names in self.uses.values() for each in names}
        roots = [name for name in self.formulas if name not in used]
        if last.name is None:
            return token.text
        if len(roots) > 1:
            reason = f"'{token.text}' has several requirements"
            raise self._fail(token, reason, f"give each an id of its own: {', '.join(roots)}")
        return roots[0]

    def _define(self, statement: Statement) -> Formula:
        part, name = statement.formula, statement.name
        if name is not None:
            self._check_free(name)
        self.named = {}
        node = self.builder.build(part.start.tokenIndex, part.stop.tokenIndex)
        formula = node.formula() if isinstance(node, Term) else cast("Formula", node)
        if name is not None:
            if name.text in self.used:
                reason = f"'{name.text}' is used as a variable and cannot name a formula"
                hint = "choose another name, or use it in later formulas only"
                raise self._fail(name, reason, hint)
            self.formulas[name.text] = formula
        self.uses["" if name is None else name.text] = tuple(self.named)
        return formula

    def _check_free(self, name: Token) -> None:
        for what, names in (("formula", self.formulas), ("constant", self.constants)):
            if name.text in names:
                reason = f"'{name.text}' already names a {what}"
                raise self._fail(name, reason, "choose another name")
        self._check_field(name)

    def _resolve(self, token: Token) -> Node:
        name = token.text
        if name in self.formulas:
            self.named[name] = None
            return self.formulas[name]
        if name in self.constants:
            value = float(self.constants[name])
            return interned(Term, None, leaf=Traced(value, name)) if self.traced else number(value)
        if name not in self.used:
            self._check_declared(token)
            self.used.add(name)
        return variable(name)

    def _check_declared(self, token: Token) -> None:
        if self.all_declared and self._check_field(token) not in self.declared:
            known = (*self.declared, *self.formulas, *self.constants)
            hint = similar_name(token.text, known, f"float {token.text}")
            raise self._fail(token, f"'{token.text}' is not declared", hint)

    def _check_field(self, token: Token) -> str:
        """The declared message that a name is a field of; if there is none, its first part."""
        names = [*lineage(token.text)]
        message = next((name for name in names if name in self.declared), names[-1])
        if message in self.declared and message != token.text:
            kind = self.declarations[message].type
            if kind in PRIMITIVES:
                rest = token.text[len(message) :]
                what = "element" if rest[0] == "[" else "field"
                reason = f"'{message}' is a {kind} and has no {what} '{rest.removeprefix('.')}'"
                hint = f"only variables of imported types have {what}s; '{message}' is the whole"
                raise self._fail(token, reason, hint)
        return message

    def _fail(self, token: Token, reason: str, hint: str = "") -> ParseError:
        return fail(self.text, token, reason, hint)
