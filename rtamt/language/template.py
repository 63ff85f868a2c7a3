"""`SpecificationTemplate`: a text that was read once, for any values of its constants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from typing import cast

from rtamt.errors import InputTypeError, SpecificationError, brief
from rtamt.language.formula import Formula, make, number
from rtamt.language.interval import Exact, exact
from rtamt.language.node import Node
from rtamt.language.parser import as_specification, no_constant
from rtamt.language.specification import Declaration, Specification
from rtamt.language.traced import Traced, TracedInterval

__all__ = ["SpecificationTemplate"]


class SpecificationTemplate:
    """A specification for any values of its constants, whose text is read once.

    Its text is read again at construction, and never after: `at` puts numbers in the places of the
    constants, in terms and in the bounds of intervals.

    Args:
        spec: Text, formula or specification. What was given to `rtamt.parse` as a constant is one.

    Raises:
        SpecificationError: If the text is no specification.

    Example:
        >>> from rtamt.language import SpecificationTemplate
        >>> template = SpecificationTemplate(
        ...     "const float w = 2; always(x > w or eventually[0:w](y > 0))"
        ... )
        >>> print(template.at({"w": 3}))
        const float w = 3
        always(x > 3 or eventually[0:3](y > 0))
        >>> sorted(template.names)
        ['w']
    """

    def __init__(self, spec: str | Formula | Specification) -> None:
        from rtamt.language.grammar.statements import read_traced

        self._spec = given = as_specification(spec)
        read = read_traced(given.text, given.unit, given.overrides, chains=given.chains)
        self._traced, self._ranges, self._ranging, self._values = read
        self._dependent = _dependent(self._traced)

    def __reduce__(self) -> tuple[Callable[..., SpecificationTemplate], tuple[Specification]]:
        return SpecificationTemplate, (self._spec,)

    @cached_property
    def names(self) -> frozenset[str]:
        """The names of the constants that formulas or ranges of the text use."""
        used = {*self._ranging}
        for node in self._dependent:
            for part in (node.leaf, node.interval):
                if isinstance(part, Traced | TracedInterval):
                    used |= part.constants
        return frozenset(used)

    def at(self, constants: Mapping[str, Exact]) -> Specification:
        """The specification with these values; constants that are not named keep theirs.

        It is what `rtamt.parse` gives for the text and the values.

        Raises:
            SpecificationError: If the text has none of the constants, or none that it uses;
                if a value is no number, or makes no interval or range.
            InputTypeError: If the values are no mapping.
        """
        if not isinstance(constants, Mapping):
            msg = f"expected values of constants by name, got {brief(constants)}"
            raise InputTypeError(f'{msg}; write {{"limit": 0.3}}')
        spec = self._spec
        for name in constants:
            if name not in self._values:
                raise no_constant(name, spec)
            if name not in self.names:
                msg = f"nothing in the text uses the constant '{name}'"
                raise SpecificationError(msg)
        new = {name: exact(value, f"the constant '{name}'") for name, value in constants.items()}
        given = {**spec.overrides, **new}
        values = {**given, **{n: v for n, v in self._values.items() if n not in given}}
        return self._part(self._whole(given, values))

    def _whole(
        self, given: Mapping[str, Fraction], values: Mapping[str, Fraction]
    ) -> Specification:
        traced, made = self._traced, dict[Node, Node]()
        for node in self._dependent:
            made[node] = self._made(node, made, values)
        positions: dict[Node, tuple[int, int]] = {}
        for node, place in traced.positions.items():
            positions.setdefault(made.get(node, node), place)
        formulas = {n: cast("Formula", made.get(f, f)) for n, f in traced.formulas.items()}
        return replace(
            traced,
            formula=cast("Formula", made.get(traced.formula, traced.formula)),
            formulas=formulas,
            declarations=self._declarations(values),
            constants={name: float(value) for name, value in values.items()},
            overrides=given,
            types=self._spec.types,
            positions=positions,
        )

    def _made(self, node: Node, made: Mapping[Node, Node], values: Mapping[str, Fraction]) -> Node:
        """The node with numbers in the places of the constants, as its operands are made.

        Raises:
            SpecificationError: If a value makes no interval.
        """
        if node.op is None:
            return number(float(values[cast("Traced", node.leaf).source]))
        interval, traced = node.interval, node.interval
        if isinstance(traced, TracedInterval):
            try:
                interval = traced.at(values)
            except SpecificationError as error:
                names = sorted(traced.constants)
                said = ", ".join(f"{name} = {float(values[name]):g}" for name in names)
                raise self._traced.error(node, str(error), f"with {said}") from None
        return make(node.op.name, tuple(made.get(each, each) for each in node.args), interval)

    def _declarations(self, values: Mapping[str, Fraction]) -> dict[str, Declaration]:
        found = dict(self._traced.declarations)
        for name, range_of in self._ranges.items():
            found[name] = replace(found[name], range=range_of(values))
        return found

    def _part(self, whole: Specification) -> Specification:
        """The requirement of the text that the template is of."""
        name = self._spec.requirement
        if name is None:
            return whole
        if name not in whole.requirements:
            msg = f"with these constants the requirement '{name}' is {whole.formula}, as another is"
            raise SpecificationError(msg)
        return whole.requirements[name]


def _dependent(traced: Specification) -> list[Node]:
    """The nodes that depend on constants, operands before what uses them."""
    found: dict[Node, None] = {}
    every = (*traced.nodes(), *(each for root in traced.positions for each in root.nodes()))
    for node in dict.fromkeys(every):
        own = isinstance(node.leaf, Traced) or isinstance(node.interval, TracedInterval)
        if own or any(each in found for each in node.args):
            found[node] = None
    return list(found)
