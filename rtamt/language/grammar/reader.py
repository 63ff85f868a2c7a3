"""From a text to a `Specification`: statements, declarations, and the meaning of names.

To add an annotation, such as ``@ topic``: add its form to ``annotation`` in ``Stl.g4``, its meaning
here, and a field of `Specification`, which ``str`` writes and ``_requirement`` passes to the
requirements of a file. Add its errors to ``tests/rtamt/language/parse_errors.txt``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from fractions import Fraction
from functools import partial
from typing import Literal, cast

from rtamt.errors import Advice, Argument, SpecificationError
from rtamt.language.declarations import (
    PRIMITIVES,
    Declaration,
    RequirementId,
    is_whole,
    lineage,
    range_of_type,
    range_text,
)
from rtamt.language.formula import Formula, Term, number, variable
from rtamt.language.grammar.diagnosis import (
    ANNOTATION_HINT,
    COLUMN_HINT,
    ID_HINT,
    LINK_HINT,
    RANGE_HINT,
    Token,
    exact_number,
    fail,
    foreign_hint,
    no_formula,
    no_id,
    no_range,
    similar,
    similar_name,
)
from rtamt.language.grammar.expressions import TreeBuilder
from rtamt.language.grammar.generated.StlParser import StlParser
from rtamt.language.grammar.tokens import Limits, Span, Statement, read
from rtamt.language.interval import Traced, number_text
from rtamt.language.node import Node, interned
from rtamt.language.operators import OPERATORS
from rtamt.language.specification import Specification

_VALUE = OPERATORS["value"]

RangeOf = Callable[[Mapping[str, Fraction]], tuple[float, float]]
"""Returns the range of a declaration for values of the constants."""


class TextReader:
    """Reads a text; `parse_as` describes and has checked the arguments."""

    def __init__(
        self,
        text: str,
        overrides: Mapping[str, Fraction],
        modules: Mapping[str, object] | None = None,
        *,
        chains: bool,
        traced: bool = False,  # whether constants in terms become `Traced` numbers
        traced_bounds: bool = False,  # whether intervals with constants become `TracedInterval`
    ) -> None:
        self._statements, self._tokens = read(text)
        self._text = text
        self._traced = traced
        self._modules = modules
        names = {token.text for token in self._tokens}
        self._overrides = {name: value for name, value in overrides.items() if name in names}
        self._imports: dict[str, str] = {}
        self._types: dict[str, type] = {}
        self.constants = dict(self._overrides)  # exact values
        self._defined: set[str] = set()  # constants of the text itself
        self._declarations: dict[str, Declaration] = {}
        self.ranges: dict[str, RangeOf] = {}  # by variable
        self.ranging: set[str] = set()  # constants that are limits of ranges
        self._declared: set[str] = set()  # names that declare a variable
        self._all_declared = False  # whether a variable must be declared
        self._topics: dict[str, str] = {}
        self._columns: dict[str, str] = {}
        self._ids: dict[str, RequirementId] = {}
        self._formulas: dict[str, Formula] = {}
        self._used: set[str] = set()  # variables
        self._uses: dict[str, tuple[str, ...]] = {}
        self._named: dict[str, None] = {}  # formulas in the formula that is being read
        self._builder = TreeBuilder(
            self._tokens, self.constants, self._resolve, chains=chains, traced=traced_bounds
        )

    def specification(self, unit: str) -> Specification:
        """Return the specification of the text; call it once."""
        statements = self._statements
        if not statements.definitions:
            instead = "declarations only" if len(self._tokens) > 1 else "the end of the text"
            raise no_formula(self._tokens[-1], instead)
        for statement in statements.imports:
            self._import(statement)
        for statement in statements.constants:
            self._constant(statement)
        for statement in statements.declarations:
            self._declare(statement)
        # The declaration of a name that a formula defines declares no variable.
        named = {d.name.text for d in statements.definitions if d.name is not None}
        self._declared = self._declarations.keys() - named
        computed = {name.rpartition(".")[0] for name in named}
        self._all_declared = any(name not in computed for name in self._declared)
        *others, last = statements.definitions
        for statement in others:
            if statement.name is None:
                hint = "name it, p = ..., or remove it: the last formula is the result"
                token = statement.formula.start
                raise fail(token, "only the last formula may have no name", hint)
            self._define(statement)
        self._result = formula = self._define(last)
        is_named = formula in self._formulas.values()
        if formula.op is _VALUE and not formula.variables and is_named and not self._builder.chains:
            token = last.name or last.formula.start
            reason = f"the result '{token.text}' is the number {formula} and depends on no sample"
            hint = f"equality is written '==': {token.text} == {formula}"
            raise fail(token, reason, hint)
        kinds = {"id": self._identify, "column": self._name_column}
        for statement in statements.annotations:
            kinds.get(statement.kind.text, self._annotate)(statement)
        return Specification(
            text=self._text,
            formula=formula,
            name=None if statements.name is None else statements.name.text,
            formulas=self._formulas,
            declarations=self._declarations,
            constants={name: float(value) for name, value in self.constants.items()},
            topics=self._topics,
            columns=self._columns,
            ids=self._ids,
            imports=self._imports,
            types=self._types,
            unit=unit,
            overrides=self._overrides,
            chains=self._builder.chains,
            positions=self._builder.positions,
            uses=self._uses,
            bounding=frozenset(self._builder.bounding),
        )

    def _import(self, statement: Statement) -> None:
        module = statement.module.text
        for i, name in enumerate(statement.names):
            if any(name.text == earlier.text for earlier in statement.names[:i]):
                reason = f"'{name.text}' appears twice in this import"
                raise fail(name, reason, "write each type once")
            other = self._imports.setdefault(name.text, module)
            if other != module:
                reason = f"'{name.text}' is already imported from '{other}'"
                raise fail(name, reason, "a type has one module: remove an import")
        if self._modules is None:  # then a type is a name
            return
        if module not in self._modules:
            hint = similar(
                module, self._modules, Advice(Argument("modules", [module]), " imports it")
            )
            raise fail(statement.module, f"module '{module}' was not given", hint)
        known = dir(self._modules[module])
        for name in statement.names:
            if name.text not in known:
                reason = f"module '{module}' has no type '{name.text}'"
                raise fail(name, reason, similar(name.text, known))
            kind = getattr(self._modules[module], name.text)
            if isinstance(kind, type):
                self._types[name.text] = kind

    def _constant(self, statement: Statement) -> None:
        name = self._new(statement, PRIMITIVES, self._defined)
        value = self._value(cast("Span", statement.default))
        self.constants[name] = self._overrides.get(name, value)
        self._defined.add(name)

    def _declare(self, statement: Statement) -> None:
        name = self._new(statement, (*PRIMITIVES, *self._imports), self.constants)
        io = None if statement.io is None else cast("Literal['input', 'output']", statement.io.text)
        default = None if statement.default is None else float(self._value(statement.default))
        kind, values = statement.kind.text, None
        if statement.within is not None:
            self.ranges[name] = partial(self._range, statement, kind, default)
            values = self.ranges[name](self.constants)
            limits = cast("Limits", statement.bounds)
            texts = {limits.lower.stop.text, limits.upper.stop.text}
            self.ranging |= texts & self.constants.keys()
        self._declarations[name] = Declaration(kind, io, default, values)

    def _range(
        self,
        statement: Statement,
        kind: str,
        default: float | None,
        constants: Mapping[str, Fraction],
    ) -> tuple[float, float]:
        """Return the range of a declaration; raise if its type or its default does not fit."""
        word, limits = cast("Token", statement.within), cast("Limits", statement.bounds)
        if word.text != "in":
            raise no_range(word)
        lower, upper = self._limit(limits.lower, constants), self._limit(limits.upper, constants)
        values, first, last = (lower, upper), limits.lower.start, limits.upper.start
        if lower > upper:
            reason = f"expected {number_text(lower)} or more as the maximum"
            hint = "write the smaller limit first"
            raise fail(last, f"{reason}, got {number_text(upper)}", hint)
        if math.isinf(lower) and lower == upper:
            reason = f"expected a range that holds a number, got {range_text(values)}"
            raise fail(first, reason, RANGE_HINT)
        if is_whole(kind) and math.floor(min(upper, 2.0**63)) < max(lower, -(2.0**63)):
            reason = f"no whole number lies in {range_text(values)}, and {kind} has no others"
            raise fail(first, reason, RANGE_HINT)
        known = range_of_type(kind)
        if known is not None and (lower < known[0] or upper > known[1]):
            reason = f"{kind} has values in {range_text(known)}, got {range_text(values)}"
            hint = "write a range inside it, or use another type"
            raise fail(first if lower < known[0] else last, reason, hint)
        if default is not None and not lower <= default <= upper:
            span = cast("Span", statement.default)
            reason = f"expected a value in {range_text(values)}, got {number_text(default)}"
            hint = "a variable has this value before its first sample"
            raise fail(span.start, reason, hint)
        return values

    def _limit(self, part: Span, constants: Mapping[str, Fraction]) -> float:
        token, last = part.start, part.stop
        negative = token.type == StlParser.MINUS
        if last.type == StlParser.INF:
            return -math.inf if negative else math.inf
        if last.type == StlParser.NUMBER:
            exact = exact_number(last, last.text, "number")
        elif last.text in constants:
            exact = constants[last.text]
        elif last.text == "nan":
            reason = "expected a number as the limit of a range, got nan"
            raise fail(last, reason, "write a number, a constant or inf")
        else:
            hint = similar_name(last.text, constants, f"const float {last.text} = 5")
            raise fail(last, f"unknown constant '{last.text}'", hint)
        return float(-exact if negative else exact)

    def _new(self, statement: Statement, types: Iterable[str], constants: Collection[str]) -> str:
        token = cast("Token", statement.name)
        if statement.kind.text not in types:
            kind = statement.kind.text
            otherwise = f"use bool, int, float, float64, ... or: from MODULE import {kind}"
            foreign = foreign_hint(self._text, statement.kind.start)
            hint = foreign or similar(kind, types, otherwise)
            raise fail(statement.kind, f"unknown type '{kind}'", hint)
        if token.text in self._declarations or token.text in constants:
            override = token.text in self._overrides and token.text not in self._defined
            by = "passed as a constant" if override else "declared"
            raise fail(token, f"'{token.text}' is already {by}", "choose another name")
        return token.text

    def _value(self, part: Span) -> Fraction:
        value = self._tokens[part.start.tokenIndex : part.stop.tokenIndex + 1]
        digits = "".join(token.text for token in value)
        return exact_number(part.start, digits, "number")

    def _annotate(self, statement: Statement) -> None:
        if statement.kind.text != "topic":
            reason = f"unknown annotation '{statement.kind.text}'"
            raise fail(statement.kind, reason, ANNOTATION_HINT)
        if statement.location is None:
            token = cast("Token", statement.label)
            reason = f"expected the path of a topic, got {token.text}"
            raise fail(token, reason, "a path is names with '/' between them")
        name = statement.variable.text
        known = self._declarations.keys() | self._used | self._formulas.keys()
        if name not in known:
            hint = similar_name(name, known, f"float {name}")
            raise fail(statement.variable, f"unknown variable '{name}'", hint)
        first, last = statement.location.start.tokenIndex, statement.location.stop.tokenIndex
        steps = self._tokens[first : last + 1]
        for step in steps:
            if step.text[0] not in "/." and not step.text[0].isalnum() and step.text[0] != "_":
                reason = f"expected a name in the path, got '{step.text}'"
                raise fail(step, reason, "a path is names with '/' between them")
        self._topics[name] = "".join(step.text for step in steps)

    def _name_column(self, statement: Statement) -> None:
        token, label, link = statement.variable, statement.label, statement.link
        if label is None:
            start = cast("Span", statement.location).start
            reason = f"expected the name of a column in quotes, got '{start.text}'"
            raise fail(start, reason, COLUMN_HINT)
        if link is not None:
            raise fail(link, f"expected one column, got another, {link.text}", COLUMN_HINT)
        name, column = token.text, label.text[1:-1]
        if name not in self._used:
            reason = f"no formula reads '{name}'"
            otherwise = "a column belongs to a variable of a formula"
            raise fail(token, reason, similar(name, self._used, otherwise))
        if not column.strip():
            raise fail(label, "expected the name of a column, got none", COLUMN_HINT)
        if name in self._columns:
            reason = f"'{name}' already has the column '{self._columns[name]}'"
            raise fail(token, reason, "a variable has one column")
        self._columns[name] = column

    def _identify(self, statement: Statement) -> None:
        token, label, link = statement.variable, statement.label, statement.link
        if label is None:
            raise no_id(cast("Span", statement.location).start)
        name, title = token.text, self._statements.name
        if name not in self._formulas and title is not None and name == title.text:
            name = self._name_of_whole(token)
        elif name not in self._formulas:
            known = [*self._formulas, *([] if title is None else [title.text])]
            otherwise = f"an id belongs to a formula with a name: {name} = ..."
            raise fail(token, f"unknown formula '{name}'", similar(name, known, otherwise))
        if name in self._ids:
            reason = f"'{name}' already has the id {self._ids[name]}"
            raise fail(token, reason, "a requirement has one id")
        part, hint = label, ID_HINT
        try:
            id_ = RequirementId(label.text[1:-1])
            if link is not None:
                part, hint = link, LINK_HINT
                id_ = RequirementId(id_.id, link.text[1:-1])
        except SpecificationError as error:
            raise fail(part, str(error), hint) from None
        for other, other_id in self._ids.items():
            if other_id.id == id_.id:
                reason = f"'{other}' already has the id {id_}"
                raise fail(label, reason, "choose another id")
        self._check_judged(name, token)
        self._ids[name] = id_

    def _check_judged(self, name: str, token: Token) -> None:
        """Refuse the id of a formula that is a number in other formulas."""
        formula = self._formulas.get(name)
        if formula is None or formula.op is not _VALUE:
            return
        for user, names in self._uses.items():
            if name in names and formula not in self._formulas.get(user, self._result).nodes():
                where = f"'{user}'" if user else "the result"
                reason = f"'{name}' is a number in {where}, not a requirement"
                hint = f"pass the id to a formula that compares it, such as {name} > 0"
                raise fail(token, reason, hint)

    def _name_of_whole(self, token: Token) -> str:
        """Return the key of an id for a text with a single requirement."""
        used = {name for names in self._uses.values() for name in names}
        roots = [name for name in self._formulas if name not in used]
        if self._statements.definitions[-1].name is None:
            return token.text
        if len(roots) > 1:
            reason = f"'{token.text}' has several requirements"
            raise fail(token, reason, f"give each an id of its own: {', '.join(roots)}")
        return roots[0]

    def _define(self, statement: Statement) -> Formula:
        part, name = statement.formula, statement.name
        if name is not None:
            self._check_free(name)
        self._named = {}
        node = self._builder.build(part.start.tokenIndex, part.stop.tokenIndex)
        formula = node.formula() if isinstance(node, Term) else cast("Formula", node)
        if name is not None:
            if name.text in self._used:
                reason = f"'{name.text}' is used as a variable and cannot name a formula"
                hint = "choose another name, or use it in later formulas only"
                raise fail(name, reason, hint)
            self._formulas[name.text] = formula
        self._uses["" if name is None else name.text] = tuple(self._named)
        return formula

    def _check_free(self, name: Token) -> None:
        for phrase, names in (("formula", self._formulas), ("constant", self.constants)):
            if name.text in names:
                reason = f"'{name.text}' already names a {phrase}"
                raise fail(name, reason, "choose another name")
        self._check_field(name)

    def _resolve(self, token: Token) -> Node:
        name = token.text
        if name in self._formulas:
            self._named[name] = None
            return self._formulas[name]
        if name in self.constants:
            value = float(self.constants[name])
            return interned(Term, None, leaf=Traced(value, name)) if self._traced else number(value)
        if name not in self._used:
            self._check_declared(token)
            self._used.add(name)
        return variable(name)

    def _check_declared(self, token: Token) -> None:
        if self._all_declared and self._check_field(token) not in self._declared:
            known = (*self._declared, *self._formulas, *self.constants)
            hint = similar_name(token.text, known, f"float {token.text}")
            raise fail(token, f"'{token.text}' is not declared", hint)

    def _check_field(self, token: Token) -> str:
        """Return the declared message of a field; otherwise, the first part of the name."""
        names = [*lineage(token.text)]
        message = next((name for name in names if name in self._declared), names[-1])
        if message in self._declared and message != token.text:
            kind = self._declarations[message].type
            if kind in PRIMITIVES:
                remainder = token.text[len(message) :]
                phrase = "element" if remainder[0] == "[" else "field"
                reason = (
                    f"'{message}' is a {kind} and has no {phrase} '{remainder.removeprefix('.')}'"
                )
                hint = f"only variables of imported types have {phrase}s"
                raise fail(token, reason, hint)
        return message
