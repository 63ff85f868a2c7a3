"""A specification: its formulas, declarations and constants, and properties of these.

A specification is immutable and independent of monitors. Two specifications are equal if their
contents are equal, in any spelling.
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
from typing import TYPE_CHECKING, Any, cast

from rtamt.errors import ParseError, SpecificationError, hint_line
from rtamt.language.declarations import (
    Declaration,
    RequirementId,
    joined,
    lineage,
    range_of_type,
    range_text,
    steps,
)
from rtamt.language.formula import Formula, make, predicates, scaled
from rtamt.language.interval import UNITS, Interval, number_text
from rtamt.language.node import Node, node_text
from rtamt.language.operators import OPERATORS, Bounds
from rtamt.renamed import OldName

if TYPE_CHECKING:  # methods import these when they are called
    from rtamt.language.parser import SpecificationTemplate
    from rtamt.language.topics import Publication, Subscription


@dataclass(frozen=True, eq=False, repr=False)
class Specification:
    """One formula or more; the last one is the result.

    ``str`` returns a canonical text; with the same ``unit`` it parses to an equal specification. It
    has the same requirements too, unless a formula names two that are equal, or negates a number
    that has a name: the text then shows only the first name, or the number.

    Attributes:
        text: The text as it was written.
        formula: The result: the last formula.
        name: The name of the specification in the text, or None.
        formulas: The named formulas, in order; the result is among them only if it has a name.
        declarations: Variable to its declaration, used or not.
        constants: Values of the constants. Constants passed to `parse` come first; they override
            the text and may add constants.
        topics: Variable to the path of its topic.
        columns: Variable to the name of its column in recorded tables; commands that read traces
            use it, and ``--signal`` overrides it.
        ids: Name of a formula to the id of its requirement; the id of a result without a name is
            under the name of the specification.
        imports: Imported type to its module.
        types: Imported type to its class, if the module was passed and the type is a class.
        unit: Unit of bounds without a unit.
        overrides: Exact values of the text's constants that were passed to `parse`.
        chains: Whether operators that do not chain group to the left, as in `parse_as`.
        positions: Line and column in the text of a node's interval, operator or name.
        uses: Formula to the names of the formulas in its text; a result without a name is under
            ``""``.
        requirement: The name of this part among the `requirements` of the text; None for the whole
            text.
        bounding: Names of the constants that are bounds of intervals.
        path: The file that `load` read, for errors; None for other texts. Equality ignores it.
    """

    text: str
    formula: Formula
    name: str | None = None
    formulas: Mapping[str, Formula] = field(default_factory=dict)
    declarations: Mapping[str, Declaration] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)
    topics: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)
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
    path: str | None = None

    given = OldName("overrides")

    def __post_init__(self) -> None:
        """Make the mappings read-only."""
        for attribute in _MAPPINGS:
            value = getattr(self, attribute)
            if not isinstance(value, MappingProxyType):  # `replace` shares these
                object.__setattr__(self, attribute, MappingProxyType(dict(value)))

    @classmethod
    def of(cls, formula: Formula) -> Specification:
        """Return the specification of a formula from Python."""
        return cls(str(formula), formula)

    def always(self) -> Specification:
        """Return the same requirement for every instant: ``always`` of the result."""
        return self.with_result(self.formula.always())

    def standalone(self) -> Formula:
        """Return the result with a unit at every bound, so that its text needs no other unit.

        Bounds in seconds, the default unit, have no unit in the text.

        Example:
            >>> from rtamt import parse
            >>> print(parse("always[0:100](x < 1)", unit="ms").standalone())
            always[0:100ms](x < 1)
        """
        if self.unit == "s":
            return self.formula
        new: dict[Node, Node] = {}
        for node in self.formula.nodes():
            interval = node.interval
            if interval is not None and interval.unit is None:
                interval = replace(interval, unit=self.unit)
            args = tuple(new[arg] for arg in node.args)
            new[node] = make(node.op.name, args, interval) if node.op else node
        return cast("Formula", new[self.formula])

    def with_result(self, formula: Formula) -> Specification:
        """Return the same declarations and formulas with another result, such as a sub-formula.

        Its text is canonical, so errors show the node without a place in the original text.

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
        ids = {name: id_ for name, id_ in self.ids.items() if name in self.formulas}
        other = replace(self, formula=formula, positions={}, uses=uses, ids=ids, requirement=None)
        other = replace(other, columns=_columns_of(other))
        return replace(other, text=str(other), path=None)

    def in_words(self, names: Mapping[str, str] | None = None, *, unit: str | None = None) -> str:
        """Return the result in plain English, in one sentence that can be read in one way only.

        The sentence is about the first sample. If no phrase of its windows states that, it starts
        with "at the start": ``speed < 30`` differs from the standing rule ``always(speed < 30)``,
        which a monitor with ``view="step"`` demands. Clauses that are nested too deep for one
        sentence, and named formulas and terms, follow it. With ``rise`` or ``fall``, the last
        clause describes the first sample. In "p until q" and "p ever since q", p need not hold at
        the moment of q. Two formulas have the same words only if they are the same, apart from
        the unit of bounds without one.

        Args:
            names: Words for variables; the others keep their names.
            unit: The unit of bounds without one, such as ``"steps"``; default: the unit of the
                text.

        Example:
            >>> from rtamt import parse
            >>> parse("always(req >= 3 implies eventually[0:5](gnt >= 3))").in_words()
            'whenever req is at least 3, gnt reaches at least 3 within 5 s'
            >>> parse("always(speed < 120)").in_words({"speed": "the speed"})
            'the speed stays below 120 at all times'
            >>> parse("speed < 30 and always(speed < 120)").in_words()
            'at the start, speed is below 30 and speed stays below 120 at all times'
            >>> parse("slow = v < 9; always(x > 2 implies slow)").in_words()
            'whenever x is above 2, slow holds; where slow means that v is below 9'
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
        return predicates(self.formula)

    def scaled(self, scales: Mapping[Formula, float]) -> Specification:
        """Return the specification with the robustness of predicates divided by scales.

        In a formula over several units, the predicate with the smallest numbers decides the
        robustness: a speed in m/s rather than a rotation in rpm. Scales make predicates comparable.
        They do not change whether the formula holds, unless a division rounds to 0.

        Args:
            scales: Positive, finite numbers for some of `predicates`; the others stay as they are.

        Raises:
            SpecificationError: If a scale is not positive and finite, or is for a formula that is
                not a predicate.
            InputTypeError: If a scale is not a number.

        Example:
            >>> from rtamt import parse
            >>> spec = parse("always(rpm < 3000) implies eventually(v > 35)")
            >>> rpm, v = spec.predicates()
            >>> print(spec.scaled({rpm: 1000, v: 10}))
            always((rpm - 3000) / 1000 < 0) implies eventually((v - 35) / 10 > 0)
        """
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
        from rtamt.language.parser import SpecificationTemplate

        return SpecificationTemplate(self)

    def publications(self, name: str | None = None) -> tuple[Publication, ...]:
        """Return the ROS topics of every named formula and, last, of the result.

        The message is a ``std_msgs/Float64``, unless the name is a field of a declared message. The
        text states the topic, ``@ topic(out, monitor/out)``; otherwise, it is ``rtamt/`` and the
        name, with ``/`` for a dot and ``_`` for other characters that ROS names cannot have.

        Args:
            name: The name of the result in a default topic; default: its own name, or the name of
                the text, or ``"spec"``.

        Example:
            >>> from rtamt import parse
            >>> spec = parse('''
            ...     from rtamt_msgs.msg import FloatStamped
            ...     output FloatStamped out
            ...     @ topic(out, monitor/out)
            ...     near = abs(x - y) < 1
            ...     out.value = always(near)
            ... ''')
            >>> for p in spec.publications():
            ...     print(p.topic or p.default, f"({p.package}/{p.message})", *p.path)
            rtamt/near (std_msgs/Float64) data
            monitor/out (rtamt_msgs/FloatStamped) value
        """
        from rtamt.language.topics import publications

        return publications(self, name)

    def subscriptions(self) -> tuple[Subscription, ...]:
        """Return the ROS topics of the variables: one per message, and one per plain variable.

        Declaration and import state the class of a message. A plain variable reads the field
        ``data`` of the message of ``std_msgs`` with the name of its type; without a declaration it
        is a ``Float64``. A variable with such a message as its declared type reads ``data`` too.
        The text states the topic, ``@ topic(cmd, /robot0/cmd_vel)``; otherwise, it is ``rtamt/``
        and the name of the variable. Variables that no formula uses are left out.

        Raises:
            SpecificationError: If the text compares a whole message to a number, as ``cmd > 0``.

        Example:
            >>> from rtamt import parse
            >>> spec = parse('''
            ...     from geometry_msgs.msg import Twist
            ...     input Twist cmd
            ...     input float64 limit
            ...     @ topic(cmd, /robot0/cmd_vel)
            ...     always(cmd.linear.x <= limit and abs(cmd.angular.z) < 1)
            ... ''')
            >>> for s in spec.subscriptions():
            ...     fields = ", ".join(f.variable for f in s.fields)
            ...     print(f"{s.topic} ({s.package}/{s.message}): {fields}")
            /robot0/cmd_vel (geometry_msgs/Twist): cmd.linear.x, cmd.angular.z
            rtamt/limit (std_msgs/Float64): limit
        """
        from rtamt.language.topics import subscriptions

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
            SpecificationError: If the monitor uses a name of the specification itself, such as
                ``lower``, or as for `EpisodeMonitor`.
            InputError: If an option has a wrong value, if neither a period nor ``dense`` is passed,
                or if the C++ library is missing.
            OSError: If the file cannot be written.
        """
        from rtamt.export.fmu import export_fmu

        export_fmu(self, path, **options)

    @cached_property
    def title(self) -> str | None:
        """The name of the text, or the name of the result, or None."""
        return self.name or self._result_name

    @cached_property
    def id(self) -> RequirementId | None:
        """The id of the result's requirement; None if the text states none.

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

        A requirement is a formula that no other formula names, or that has an id. In
        ``a = x > 0; b = a`` only ``b`` is a requirement; in ``a = x > 0; b = always(x > 0)`` both
        are, because ``b`` does not name ``a``.

        Each one is the result of its own specification, with the formulas that it uses and with
        the declarations and constants of the text; its errors show their place in the whole text.
        A single requirement is this specification, under its `title` or ``"spec"``. A last formula
        without a name has the name of the text or ``"spec"``.

        A monitor judges only the result, the last formula. For another requirement, pass its
        specification: ``Monitor(spec.requirements["slow"])``.

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
        """The used variables that are declared as ``input``, or belong to such a message."""
        return self._declared_as("input")

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """The used variables that are declared as ``output``, or belong to such a message."""
        return self._declared_as("output")

    @cached_property
    def defaults(self) -> Mapping[str, float]:
        """The declared default values of the used plain variables.

        A variable has its default before the first sample or message with a value for it. For a
        message it is the number in the field ``data``.
        """
        return MappingProxyType(
            {v: d.default for v, d in self._plain.items() if d.default is not None}
        )

    @cached_property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """The minimum and maximum of the used plain variables that have a range.

        The range is declared, ``input float x in [0, 120]``, or follows from a type such as
        ``bool`` or ``uint8``. `check` assumes it; monitors judge any value, and ``rtamt monitor``
        compares recordings with it. For a message it is the range of the field ``data``.

        Example:
            >>> from rtamt import parse
            >>> spec = parse("input float x in [0, 120]; uint8 gear; float y; x > gear + y")
            >>> dict(spec.ranges)
            {'x': (0.0, 120.0), 'gear': (0.0, 255.0)}
        """
        ranges = {v: d.range or range_of_type(d.type) for v, d in self._plain.items()}
        return MappingProxyType({v: r for v, r in ranges.items() if r is not None})

    @cached_property
    def declared_ranges(self) -> Mapping[str, tuple[float, float]]:
        """The `ranges` from declarations, without the ranges of types."""
        plain = self._plain.items()
        return MappingProxyType({v: d.range for v, d in plain if d.range is not None})

    @cached_property
    def horizon(self) -> float:
        """The longest time after t that the robustness at t can depend on, in `unit`.

        inf without a bound; `next` counts as one. With a period and until or prev, a monitor may
        need one sample less: its ``latency`` is exact.
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
        """Return each node of all formulas once, operands before their operator."""
        formulas = (*self.formulas.values(), self.formula)
        return iter(dict.fromkeys(node for formula in formulas for node in formula.nodes()))

    def bounds(self, interval: Interval | None) -> tuple[Fraction, Fraction | None]:
        """Return the begin and the end of an interval in `unit`; the end is None if unbounded."""
        if interval is None:
            return Fraction(0), None
        scale = UNITS[interval.unit or self.unit] / UNITS[self.unit]
        end = None if interval.end is None else interval.end * scale
        return interval.begin * scale, end

    def declaration(self, variable: str) -> Declaration | None:
        """Return the declaration of a variable or of its message, or None."""
        return self.declarations.get(self._declared(variable))

    def error(self, node: Node, reason: str, hint: str = "") -> SpecificationError:
        """Return the error about a node, with its place if the node is in the text."""
        if node in self.positions:
            return ParseError(reason, self.text, *self.positions[node], hint)
        return SpecificationError(f"{reason}\n  in {node}", hint_line(hint))

    def name_error(
        self, name: str, reason: str, hint: str = "", *, part: int = 0
    ) -> SpecificationError:
        """Return the error about a name in the text, with its file, line and column.

        Args:
            name: The name of a formula or a variable; the error shows the definition of a formula,
                and the first use of a variable.
            reason: The reason, without the place.
            hint: How to correct the text; default: nothing.
            part: The index of the part of the name at the caret; negative values count from the
                end, so that -1 is ``x`` of ``cmd.linear.x``; default: the first.

        Returns:
            A `ParseError`; a `SpecificationError` if the text does not have the name.

        Example:
            >>> from rtamt import parse
            >>> print(parse("cmd.linaer.x > 0").name_error("cmd.linaer.x", "no such field", part=1))
            STL:1:5: no such field
              cmd.linaer.x > 0
                  ^
        """
        from rtamt.language.grammar.tokens import read

        statements, tokens = read(self.text)
        candidates = [d.name for d in statements.definitions if d.name is not None]
        for definition in statements.definitions:
            first, last = definition.formula.start, definition.formula.stop
            candidates += tokens[first.tokenIndex : last.tokenIndex + 1]
        token = next((token for token in candidates if token.text == name), None)
        if token is None:  # for instance, a formula from Python
            return SpecificationError(f"{name}: {reason}", hint_line(hint))
        parts = steps(name)
        before, step = joined(parts[:part]), parts[part]
        offset = len(before) + (bool(before) and isinstance(step, str))  # its dot
        error = ParseError(reason, self.text, token.line, token.column + offset + 1, hint)
        if self.path is not None:
            error.add_note(f"in {self.path}")
        return error

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
        lines += [f'@ column({name}, "{column}")' for name, column in self.columns.items()]
        for name, id_ in self.ids.items():
            link = f', "{id_.link}"' if id_.link else ""
            lines.append(f'@ id({name}, "{id_.id}"{link})')
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
        """The declarations of the used variables that are not fields, apart from ``data``."""
        names = {v: self._declared(v) for v in self.variables}
        declared = {v: self.declarations.get(name) for v, name in names.items()}
        return {v: d for v, d in declared.items() if d and v in (names[v], f"{names[v]}.data")}

    @cached_property
    def _content(self) -> tuple[object, ...]:
        texts = map(dict, (self.topics, self.columns, self.imports))
        formulas = tuple(self.formulas.items())
        declared = dict(self.declarations), dict(self.constants), dict(self.ids)
        return (self.formula, self.name, formulas, self.unit, *declared, *texts)

    @cached_property
    def _result_name(self) -> str | None:
        """The name of the last formula, or the only name in its text."""
        last = (*self.formulas,)[-1:]
        candidates = (*last, *self.uses.get("", ()))
        return next((n for n in candidates if self.formulas[n] is self.formula), None)

    def _named_in(self, name: str) -> dict[Node, str]:
        """Return the formulas that a formula uses, with their first name.

        A formula that is the value of a term stands for that term in operands.
        """
        named: dict[Node, str] = {}
        for used in reversed(self.uses.get(name, ())):
            formula = self.formulas[used]
            named[formula] = used
            if formula.op is OPERATORS["value"]:
                named[formula.args[0]] = used
        return named

    def _requirement(self, name: str, root: str) -> Specification:
        """Return one of several requirements; its root is a key of `uses`."""
        needed, pending = {root}, [root]
        while pending:
            used = {*self.uses.get(pending.pop(), ())} - needed
            needed |= used
            pending += used
        part = replace(
            self,
            formula=self.formulas.get(root, self.formula),
            name=None if name in self.formulas else name,
            formulas={key: f for key, f in self.formulas.items() if key in needed},
            ids={key: id_ for key, id_ in self.ids.items() if key in {root, name}},
            uses={key: names for key, names in self.uses.items() if key in needed},
            requirement=name,
        )
        known = {*part.declarations, *part.variables, *part.formulas}
        topics = {key: path for key, path in self.topics.items() if key in known}
        return replace(part, topics=topics, columns=_columns_of(part))

    def _declared(self, variable: str) -> str:
        names = [*lineage(variable)]
        return next((name for name in names if name in self.declarations), names[-1])

    def _declared_as(self, io: str) -> tuple[str, ...]:
        return tuple(v for v in self.variables if (d := self.declaration(v)) and d.io == io)


def _columns_of(spec: Specification) -> Mapping[str, str]:
    """Return the columns of the variables that formulas read."""
    if not spec.columns:
        return spec.columns
    formulas = (*spec.formulas.values(), spec.formula)
    read = {name for formula in formulas for name in formula.variables}
    return {name: column for name, column in spec.columns.items() if name in read}


_MAPPINGS = tuple(f.name for f in fields(Specification) if f.default_factory is dict)


class _Horizons:
    """A builder that computes the horizon of each register."""

    def __init__(self) -> None:
        self.values: list[Fraction | float] = []

    def constant(self, value: float) -> int:  # noqa: ARG002 - a horizon does not depend on it
        return self._new(0)

    def map(self, function: str, *args: int) -> int:  # noqa: ARG002
        return self._new(max(self.values[a] for a in args))

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:  # noqa: ARG002
        reach = max(self.values[a] for a in args)
        return self._new(math.inf if hi is None else max(0, hi + reach))

    def rate(self, x: int) -> int:
        return x  # it reads the sample before

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        return q if bounds[1] == 0 else self.window("until", *bounds, p, q)

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        if bounds[1] == 0:
            return q
        return self._new(max(self.values[p], self.values[q] - bounds[0], 0))

    def _new(self, horizon: Fraction | float) -> int:
        self.values.append(horizon)
        return len(self.values) - 1
