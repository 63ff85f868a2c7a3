"""A specification: its formulas, declarations and constants, and what follows from them.

A specification never changes and does not know how it will be monitored. Two are equal if their
contents are, however they are spelt.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, cast

from rtamt.errors import ParseError, SpecificationError, hint_line
from rtamt.language.formula import Formula, make
from rtamt.language.ids import RequirementId
from rtamt.language.interval import UNITS, Interval
from rtamt.language.names import lineage
from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS
from rtamt.language.printing import node_text, number_text
from rtamt.language.ranges import range_of_type, range_text
from rtamt.language.table import Bounds
from rtamt.renamed import OldName

if TYPE_CHECKING:  # methods import these when they are called
    from rtamt.language.publications import Publication
    from rtamt.language.subscriptions import Subscription
    from rtamt.language.template import SpecificationTemplate

__all__ = ["PRIMITIVES", "Declaration", "Specification"]

PRIMITIVES = (
    *("bool", "int", "uint", "long", "float", "double", "float32", "float64"),
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
)
"""Types of variables and constants that need no import. All values are doubles in the end."""


@dataclass(frozen=True, slots=True)
class Declaration:
    """The declaration of a variable.

    Attributes:
        type: A primitive type or the name of an imported one.
        io: ``"input"`` if the system reads the variable, ``"output"`` if it sets it, else None.
        default: The value of the variable before the first sample that has one, or None.
        range: The least and the greatest value that the text declares, or None. Monitors do not
            look at it.
    """

    type: str
    io: Literal["input", "output"] | None = None
    default: float | None = None
    range: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Specification:
    """One formula or more, the last of which is the result.

    ``str`` gives a canonical text; under the same ``unit`` it parses to an equal specification. It
    has the same requirements too, unless a formula names two that are equal, or negates a number
    that has a name: the text then shows the first name, or the number, alone.

    Attributes:
        text: The text as it was given.
        formula: The result: the last formula.
        name: The name that the text gives to the whole, or None.
        formulas: The named formulas, in order; the result is among them only if it has a name.
        declarations: Variable to its declaration, used or not.
        constants: Values of the constants, as the text says them or as they were given to `parse`,
            which come first and may add constants.
        topics: Variable to the path of its topic.
        ids: Name of a formula to its id where requirements are kept; the id of a result without a
            name is under the name of the whole.
        imports: Imported type to its module.
        types: Imported type to its class, if the module was given and the type is a class.
        unit: Unit of the bounds that have none.
        overrides: Exact values of the text's constants that were given to `parse`.
        chains: Whether the text was read with operators that group to the left where they chain.
        positions: Line and column in the text of a node's interval, operator or name.
        uses: Formula to the names of the formulas that its text names; a result without a name is
            under ``""``.
        requirement: The name under which this is one of several `requirements` of the text; None
            if it is the whole.
        bounding: Names of the constants that are bounds of intervals.
    """

    text: str
    formula: Formula
    name: str | None = None
    formulas: Mapping[str, Formula] = field(default_factory=dict)
    declarations: Mapping[str, Declaration] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    topics: Mapping[str, str] = field(default_factory=dict)
    ids: Mapping[str, RequirementId] = field(default_factory=dict)
    imports: Mapping[str, str] = field(default_factory=dict)
    types: Mapping[str, type] = field(default_factory=dict)
    unit: str = "s"
    overrides: Mapping[str, Fraction] = field(default_factory=dict)
    chains: bool = False
    positions: Mapping[Node, tuple[int, int]] = field(default_factory=dict)
    uses: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    requirement: str | None = None
    bounding: frozenset[str] = frozenset()

    given = OldName("overrides")

    def __post_init__(self) -> None:
        """Make the mappings read-only."""
        for attribute in _MAPPINGS:
            given = getattr(self, attribute)
            if not isinstance(given, MappingProxyType):  # else shared with another specification
                object.__setattr__(self, attribute, MappingProxyType(dict(given)))

    @classmethod
    def of(cls, formula: Formula) -> Specification:
        """The specification of a formula that was made in Python."""
        return cls(str(formula), formula)

    def always(self) -> Specification:
        """The same requirement on every instant: ``always`` of the result."""
        return self.with_result(self.formula.always())

    def standalone(self) -> Formula:
        """The result with the unit of every bound in it, so that its text reads alike anywhere.

        Seconds, the unit of a text that names none, stay unsaid.

        Example:
            >>> from rtamt import parse
            >>> print(parse("always[0:100](x < 1)", unit="ms").standalone())
            always[0:100ms](x < 1)
        """
        if self.unit == "s":
            return self.formula
        made: dict[Node, Node] = {}
        for node in self.formula.nodes():
            interval = node.interval
            if interval is not None and interval.unit is None:
                interval = replace(interval, unit=self.unit)
            args = tuple(made[each] for each in node.args)
            made[node] = make(node.op.name, args, interval) if node.op else node
        return cast("Formula", made[self.formula])

    def with_result(self, formula: Formula) -> Specification:
        """The same declarations and formulas with another result, such as a part of this one.

        Its text is the canonical one, so that errors name the node and show no place.

        Example:
            >>> from rtamt import parse
            >>> spec = parse("input float x; always(x > 0) and always(x < 9)")
            >>> print(spec.with_result(spec.formula.args[1]))
            input float x
            always(x < 9)
        """
        uses, named = dict(self.uses), self._result_name
        if self.formula not in formula.nodes():
            uses.pop("", None)
        elif named is not None:
            uses[""] = (named,)
        ids = {each: found for each, found in self.ids.items() if each in self.formulas}
        other = replace(self, formula=formula, positions={}, uses=uses, ids=ids, requirement=None)
        return replace(other, text=str(other))

    def in_words(self, names: Mapping[str, str] | None = None, *, unit: str | None = None) -> str:
        """Return the requirement in plain English.

        The sentence is about the first sample. `always` gives the standing rule.

        Args:
            names: Words for variables; the others keep their names.
            unit: The word for bounds that have no unit; default: the unit of the text.

        Example:
            >>> from rtamt import parse
            >>> parse("always(req >= 3 implies eventually[0:5](gnt >= 3))").in_words()
            'whenever req is at least 3, gnt reaches at least 3 within 5 s'
        """
        from rtamt.language.words import in_words

        return in_words(self, names, unit=unit)

    def predicates(self) -> tuple[Formula, ...]:
        """Return the comparisons, and the terms that are formulas, once each, in text order.

        Example:
            >>> from rtamt import parse
            >>> spec = parse("always(rpm < 3000) implies always(v < 35 and rpm < 3000)")
            >>> spec.predicates()
            (<Formula rpm < 3000>, <Formula v < 35>)
        """
        from rtamt.language.scaling import predicates

        return predicates(self.formula)

    def scaled(self, scales: Mapping[Formula, float]) -> Specification:
        """Return the specification with the robustness of predicates divided by scales.

        In a formula over several units, the predicate with the smallest numbers decides the
        robustness: a speed in m/s rather than a rotation in rpm. Scales make predicates comparable.
        They do not change whether the formula holds, unless a division rounds to 0.

        Args:
            scales: Positive, finite numbers for some of `predicates`; the others stay as they are.

        Raises:
            SpecificationError: If a scale is not positive and finite, or belongs to no predicate.
            InputTypeError: If a scale is not a number.

        Example:
            >>> from rtamt import parse
            >>> spec = parse("always(rpm < 3000) implies eventually(v > 35)")
            >>> rpm, v = spec.predicates()
            >>> print(spec.scaled({rpm: 1000, v: 10}))
            always((rpm - 3000) / 1000 < 0) implies eventually((v - 35) / 10 > 0)
        """
        from rtamt.language.scaling import scaled

        return self.with_result(scaled(self.formula, scales))

    def template(self) -> SpecificationTemplate:
        """Return a template that gives the constants of the text other values.

        Example:
            >>> from rtamt import parse
            >>> template = parse("const float w = 2; always(x > w)").template()
            >>> print(template.at({"w": 3}))
            const float w = 3
            always(x > 3)
        """
        from rtamt.language.template import SpecificationTemplate

        return SpecificationTemplate(self)

    def publications(self, name: str | None = None) -> tuple[Publication, ...]:
        """Return the ROS topics of every named formula and, last, of the result.

        Args:
            name: The name of the result in a default topic; default: its own name, or the name of
                the text, or ``"spec"``.
        """
        from rtamt.language.publications import publications

        return publications(self, name)

    def subscriptions(self) -> tuple[Subscription, ...]:
        """Return the ROS topics that carry the variables."""
        from rtamt.language.subscriptions import subscriptions

        return subscriptions(self)

    def export_fmu(self, path: str | os.PathLike[str], **options: Any) -> None:  # noqa: ANN401
        """Write a functional mock-up unit (FMU) that monitors the specification in another tool.

        Args:
            path: The file to write; its name ends in ``.fmu``.
            **options: ``period``, seconds between samples or text with a unit, or ``dense=True``;
                ``fmi``, 2 or 3; ``stop_on_violation``, the start value of the parameter that ends
                the simulation at a violation; ``semantics``, ``inputs``, ``outputs`` and ``align``
                as for `Monitor`; ``resolution`` as for `rtamt.dense.Monitor`.

        Raises:
            SpecificationError: If a name of the specification is one of the monitor's own, such as
                ``lower``, or as for `EpisodeMonitor`.
            InputError: If an option has a wrong value, if neither a period nor ``dense`` is given,
                or if the C++ library is missing.
            OSError: If the file cannot be written.
        """
        from rtamt.export.fmu import export_fmu

        export_fmu(self, path, **options)

    @cached_property
    def title(self) -> str | None:
        """The name that the text gives to the whole, else the name of the result, else None."""
        return self.name or self._result_name

    @cached_property
    def id(self) -> RequirementId | None:
        """The id of the result where requirements are kept; None if the text gives none.

        Example:
            >>> from rtamt import parse
            >>> spec = parse('@ id(slow, "SYS-REQ-7", "https://reqs.example/{id}"); slow = v < 5')
            >>> spec.id
            RequirementId(id='SYS-REQ-7', link='https://reqs.example/SYS-REQ-7')
        """
        return self.ids.get(self._result_name or self.name or "")

    @cached_property
    def requirements(self) -> Mapping[str, Specification]:
        """The requirements of the text, by name, in order.

        A requirement is a formula that no other formula uses, or that has an id. A formula uses
        those whose names stand in its text. In ``a = x > 0; b = a`` only ``b`` is a requirement; in
        ``a = x > 0; b = always(x > 0)`` both are, for ``b`` does not name ``a``.

        Each is the result of a specification of its own, with the formulas that it uses and with
        the declarations and constants of the text; its errors show their place in the whole text.
        A requirement alone is this specification, under its `title`, else ``"spec"``. One of
        several has the name of its formula; a last formula without a name takes the name of the
        whole, else ``"spec"``.

        A monitor of this package judges the result, which is the last formula, alone. For another
        requirement give it that specification: ``Monitor(spec.requirements["slow"])``.

        Example:
            >>> from rtamt import parse
            >>> spec = parse("gap = x - y; apart = always(gap > 1); slow = always(v < 5)")
            >>> for name, requirement in spec.requirements.items():
            ...     print(f"{name}: {requirement.formula} of {requirement.variables}")
            apart: always(x - y > 1) of ('x', 'y')
            slow: always(v < 5) of ('v',)
        """
        used = {name for names in self.uses.values() for name in names}
        roots = {name: name for name in self.formulas if name not in used or name in self.ids}
        if all(self.formulas[name] is not self.formula for name in roots):
            wanted = (self._result_name or self.name or "spec", "spec")
            numbered = (f"spec{count}" for count in itertools.count(2))
            names = itertools.chain(wanted, numbered)
            roots[next(name for name in names if name not in roots)] = ""
        if len(roots) == 1:
            return MappingProxyType({self.title or "spec": self})
        parts = {name: self._requirement(name, root) for name, root in roots.items()}
        return MappingProxyType(parts)

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """Names used in any formula: the declared ones in order of declaration, then the others."""
        used = [n.leaf for n in self.nodes() if n.op is None and isinstance(n.leaf, str)]
        order = {name: rank for rank, name in enumerate(self.declarations)}
        return tuple(sorted(used, key=lambda v: order.get(self._declared(v), len(order))))

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """The used variables that are declared ``input``, by themselves or as a whole message."""
        return self._declared_as("input")

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """The used variables that are declared ``output``, by themselves or as a whole message."""
        return self._declared_as("output")

    @cached_property
    def defaults(self) -> Mapping[str, float]:
        """The used plain variables whose declaration gives them a value, with it.

        They have it before the first sample or message with a value of theirs. Where the variable
        is a message, it is the number in the field ``data``.
        """
        return MappingProxyType(
            {v: d.default for v, d in self._plain.items() if d.default is not None}
        )

    @cached_property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """The used plain variables that have a range, with their least and greatest value.

        A declaration says it, ``input float x in [0, 120]``, or the type does: ``bool``, ``uint8``
        and so on. `check` takes it for granted; monitors judge any value, and ``rtamt monitor``
        compares recordings with it. Where the variable is a message, it is the number in the field
        ``data``.

        Example:
            >>> from rtamt import parse
            >>> spec = parse("input float x in [0, 120]; uint8 gear; float y; x > gear + y")
            >>> dict(spec.ranges)
            {'x': (0.0, 120.0), 'gear': (0.0, 255.0)}
        """
        found = {v: d.range or range_of_type(d.type) for v, d in self._plain.items()}
        return MappingProxyType({v: each for v, each in found.items() if each is not None})

    @cached_property
    def declared_ranges(self) -> Mapping[str, tuple[float, float]]:
        """Those of `ranges` that a declaration says itself."""
        found = {v: d.range for v, d in self._plain.items()}
        return MappingProxyType({v: each for v, each in found.items() if each is not None})

    @cached_property
    def horizon(self) -> float:
        """The longest time after t that the robustness at t can depend on, in `unit`.

        inf if there is none; `next` counts as one. With a period and until or prev, a monitor may
        need a sample less: its ``latency`` is exact.
        """
        horizons = _Horizons()
        registers: dict[Node, int] = {}
        for node in self.formula.nodes():
            if node.op is None:
                registers[node] = horizons.constant(0.0)
                continue
            operands = [registers[a] for a in node.args]
            if node.op.timed:
                registers[node] = node.op.meaning(horizons, self.bounds(node.interval), *operands)
            else:
                registers[node] = node.op.meaning(horizons, *operands)
        return float(horizons.values[registers[self.formula]])

    @cached_property
    def looks_ahead(self) -> bool:
        """Whether the result has an operator of the future."""
        return any(n.op is not None and n.op.future for n in self.formula.nodes())

    @cached_property
    def timed(self) -> bool:
        """Whether any formula has an interval or a rate of change."""
        return any(
            n.interval is not None or (n.op is not None and n.op.name == "rate")
            for n in self.nodes()
        )

    def nodes(self) -> Iterator[Node]:
        """Every different node of all formulas, operands before what uses them."""
        formulas = (*self.formulas.values(), self.formula)
        return iter(dict.fromkeys(node for formula in formulas for node in formula.nodes()))

    def bounds(self, interval: Interval | None) -> tuple[Fraction, Fraction | None]:
        """The begin and the end of an interval in `unit`; the end is None if it is unbounded."""
        if interval is None:
            return Fraction(0), None
        scale = UNITS[interval.unit or self.unit] / UNITS[self.unit]
        end = None if interval.end is None else interval.end * scale
        return interval.begin * scale, end

    def declaration(self, variable: str) -> Declaration | None:
        """The declaration of a variable or of the message of which it is a field, or None."""
        return self.declarations.get(self._declared(variable))

    def error(self, node: Node, reason: str, hint: str = "") -> SpecificationError:
        """The error about a node: with its place in the text, or with the node if it has none."""
        if node in self.positions:
            return ParseError(reason, self.text, *self.positions[node], hint)
        return SpecificationError(f"{reason}\n  in {node}", hint_line(hint))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Specification):
            return NotImplemented
        return self._content == other._content

    def __hash__(self) -> int:
        return hash((self.formula, self.name, self.unit, *self.formulas))

    def __str__(self) -> str:
        lines = [] if self.name is None else [f"specification {self.name}"]
        lines += [f"from {module} import {name}" for name, module in self.imports.items()]
        lines += [f"const float {n} = {number_text(v)}" for n, v in self.constants.items()]
        for name, d in self.declarations.items():
            words = [d.io, d.type, name] if d.io else [d.type, name]
            words += [] if d.range is None else ["in", range_text(d.range)]
            words += [] if d.default is None else ["=", number_text(d.default)]
            lines.append(" ".join(words))
        lines += [f"@ topic({name}, {path})" for name, path in self.topics.items()]
        for name, said in self.ids.items():
            link = f', "{said.link}"' if said.link else ""
            lines.append(f'@ id({name}, "{said.id}"{link})')
        for name, formula in self.formulas.items():
            names = self._named_in(name)
            lines.append(f"{name} = {node_text(formula, names, names)}")
        if [self.formula] != list(self.formulas.values())[-1:] or self.uses.get(""):
            names = self._named_in("")
            lines.append(node_text(self.formula, names, names))
        text = lines[0]
        for before, line in itertools.pairwise(lines):
            # "-" would continue the line before it, and "(" make a call of a variable named "min".
            calls = line[0] == "(" and before.split()[-1].lstrip("-") in OPERATORS.words
            text += (";\n" if line[0] == "-" or calls else "\n") + line
        return text

    def __repr__(self) -> str:
        return f"<Specification {self}>"

    @cached_property
    def _plain(self) -> Mapping[str, Declaration]:
        """The used variables that a declaration is about by itself, with it."""
        said = {v: (self._declared(v), self.declaration(v)) for v in self.variables}
        return {v: d for v, (name, d) in said.items() if d and v in (name, f"{name}.data")}

    @cached_property
    def _content(self) -> tuple[object, ...]:
        said = (self.declarations, self.constants, self.topics, self.ids, self.imports)
        formulas = tuple(self.formulas.items())
        return (self.formula, self.name, formulas, self.unit, *map(dict, said))

    @cached_property
    def _result_name(self) -> str | None:
        """The name of the last formula, or the name that it consists of."""
        last = (*self.formulas,)[-1:]
        candidates = (*last, *self.uses.get("", ()))
        return next((n for n in candidates if self.formulas[n] is self.formula), None)

    def _named_in(self, name: str) -> dict[Node, str]:
        """The formulas that a formula uses; of several names for one formula, the first.

        A formula that is the value of a term is that term where it is an operand.
        """
        named: dict[Node, str] = {}
        for used in reversed(self.uses.get(name, ())):
            formula = self.formulas[used]
            named[formula] = used
            if formula.op is OPERATORS["value"]:
                named[formula.args[0]] = used
        return named

    def _requirement(self, name: str, root: str) -> Specification:
        """One of several requirements; its root is a key of `uses`."""
        needed, found = {root}, [root]
        while found:
            used = {*self.uses.get(found.pop(), ())} - needed
            needed |= used
            found += used
        part = replace(
            self,
            formula=self.formulas.get(root, self.formula),
            name=None if name in self.formulas else name,
            formulas={each: f for each, f in self.formulas.items() if each in needed},
            ids={each: found for each, found in self.ids.items() if each in {root, name}},
            uses={each: names for each, names in self.uses.items() if each in needed},
            requirement=name,
        )
        known = {*part.declarations, *part.variables, *part.formulas}
        topics = {each: path for each, path in self.topics.items() if each in known}
        return replace(part, topics=topics)

    def _declared(self, variable: str) -> str:
        names = [*lineage(variable)]
        return next((name for name in names if name in self.declarations), names[-1])

    def _declared_as(self, io: str) -> tuple[str, ...]:
        return tuple(v for v in self.variables if (d := self.declaration(v)) and d.io == io)


_MAPPINGS = tuple(f.name for f in fields(Specification) if f.default_factory is dict)


class _Horizons:
    """A builder of the table's meanings whose registers are horizons."""

    def __init__(self) -> None:
        self.values: list[Fraction | float] = []

    def constant(self, value: float) -> int:  # noqa: ARG002 - a horizon does not depend on it
        return self._new(0)

    def map(self, function: str, *args: int) -> int:  # noqa: ARG002
        return self._new(max(self.values[a] for a in args))

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:  # noqa: ARG002
        reach = max(self.values[a] for a in args)
        return self._new(math.inf if hi is None else max(0, hi + reach))

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        return q if bounds[1] == 0 else self.window("until", *bounds, p, q)

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        if bounds[1] == 0:
            return q
        return self._new(max(self.values[p], self.values[q] - bounds[0], 0))

    def _new(self, horizon: Fraction | float) -> int:
        self.values.append(horizon)
        return len(self.values) - 1
