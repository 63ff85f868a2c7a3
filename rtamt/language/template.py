"""`SpecificationTemplate`: one parsed text for many values of its constants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from typing import cast

from rtamt.errors import InputTypeError, SpecificationError, brief
from rtamt.language.declarations import Declaration
from rtamt.language.formula import Formula, make, number
from rtamt.language.interval import Exact, Traced, TracedInterval, exact
from rtamt.language.node import Node
from rtamt.language.parser import as_specification, no_constant
from rtamt.language.specification import Specification


class SpecificationTemplate:
    """A specification for any values of its constants; its text is parsed once.

    The constructor parses the text, and `at` replaces the constants in terms and bounds by numbers.

    Args:
        spec: Text, formula or specification. Constants passed to `rtamt.parse` count as well.

    Raises:
        SpecificationError: If the text is not a specification.

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
        from rtamt.language.grammar.reader import TextReader

        self._spec = specification = as_specification(spec)
        self._reader = TextReader(
            specification.text,
            specification.overrides,
            chains=specification.chains,
            traced=True,
            traced_bounds=True,
        )
        self._traced = self._reader.specification(specification.unit)
        self._dependent = _dependent(self._traced)

    def __reduce__(self) -> tuple[Callable[..., SpecificationTemplate], tuple[Specification]]:
        return SpecificationTemplate, (self._spec,)

    @cached_property
    def names(self) -> frozenset[str]:
        """The names of the constants that formulas or ranges of the text use."""
        used = {*self._reader.ranging}
        for node in self._dependent:
            for part in (node.leaf, node.interval):
                if isinstance(part, Traced | TracedInterval):
                    used |= part.constants
        return frozenset(used)

    def at(self, constants: Mapping[str, Exact]) -> Specification:
        """Return the specification with these values; the other constants keep theirs.

        It equals the result of `rtamt.parse` for the text and the values.

        Raises:
            SpecificationError: If the text does not define or use a constant, or if a value is not
                a number or leads to a wrong interval or range.
            InputTypeError: If the values are not a mapping.
        """
        if not isinstance(constants, Mapping):
            msg = f"expected values of constants by name, got {brief(constants)}"
            raise InputTypeError(f'{msg}; write {{"limit": 0.3}}')
        for name in constants:
            if name not in self._reader.constants:
                raise no_constant(name, self._spec)
            if name not in self.names:
                msg = f"nothing in the text uses the constant '{name}'"
                raise SpecificationError(msg)
        new = {name: exact(value, f"the constant '{name}'") for name, value in constants.items()}
        overrides = {**self._spec.overrides, **new}
        others = {n: v for n, v in self._reader.constants.items() if n not in overrides}
        specification = self._filled(overrides, {**overrides, **others})
        part = self._spec.requirement
        if part is None:
            return specification
        if part not in specification.requirements:
            msg = (
                f"with these constants the requirement '{part}' equals another one: "
                f"{specification.formula}"
            )
            raise SpecificationError(msg)
        return specification.requirements[part]

    def _filled(
        self, overrides: Mapping[str, Fraction], values: Mapping[str, Fraction]
    ) -> Specification:
        traced, new = self._traced, dict[Node, Node]()
        for node in self._dependent:
            new[node] = self._replaced(node, new, values)
        positions: dict[Node, tuple[int, int]] = {}
        for node, position in traced.positions.items():
            positions.setdefault(new.get(node, node), position)
        declarations: dict[str, Declaration] = dict(traced.declarations)
        for name, range_of in self._reader.ranges.items():
            declarations[name] = replace(declarations[name], range=range_of(values))
        return replace(
            traced,
            formula=cast("Formula", new.get(traced.formula, traced.formula)),
            formulas={n: cast("Formula", new.get(f, f)) for n, f in traced.formulas.items()},
            declarations=declarations,
            constants={name: float(value) for name, value in values.items()},
            overrides=overrides,
            types=self._spec.types,
            positions=positions,
            path=self._spec.path,
        )

    def _replaced(
        self, node: Node, new: Mapping[Node, Node], values: Mapping[str, Fraction]
    ) -> Node:
        """Return a node with numbers in place of the constants; `new` has its operands."""
        if node.op is None:
            return number(float(values[cast("Traced", node.leaf).source]))
        interval, traced = node.interval, node.interval
        if isinstance(traced, TracedInterval):
            try:
                interval = traced.at(values)
            except SpecificationError as error:
                names = sorted(traced.constants)
                bounds = ", ".join(f"{name} = {float(values[name]):g}" for name in names)
                raise self._traced.error(node, str(error), f"with {bounds}") from None
        return make(node.op.name, tuple(new.get(arg, arg) for arg in node.args), interval)


def _dependent(traced: Specification) -> list[Node]:
    """Return the nodes that depend on constants, operands before their operator."""
    dependent: dict[Node, None] = {}
    nodes = (*traced.nodes(), *(node for root in traced.positions for node in root.nodes()))
    for node in dict.fromkeys(nodes):
        own = isinstance(node.leaf, Traced) or isinstance(node.interval, TracedInterval)
        if own or any(arg in dependent for arg in node.args):
            dependent[node] = None
    return list(dependent)
