"""What checkers of specifications read of the released library's syntax tree."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rtamt.language.specification import Specification

__all__ = ["ParsedFormula", "ParsedFormulas"]


@dataclass(frozen=True, slots=True)
class ParsedFormula:
    """A formula of a specification.

    Attributes:
        name: The text of the formula.
        horizon: The longest time after t that the robustness at t can depend on, in the unit of
            the specification; inf if there is none. `next` counts as one.
        in_vars: Its variables that are inputs, by their declared names.
        out_vars: Its variables that are outputs.
    """

    name: str
    horizon: float
    in_vars: tuple[str, ...]
    out_vars: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ParsedFormulas:
    """The formulas of a specification.

    Attributes:
        specs: Each of them in the order of the text, the result last; none before `parse`.
    """

    specs: tuple[ParsedFormula, ...] = ()

    @classmethod
    def of(
        cls, spec: Specification, source: Callable[[str], str], roles: Mapping[str, str]
    ) -> ParsedFormulas:
        """The formulas of a specification.

        Args:
            spec: The specification.
            source: Gives the declared name of a variable: the message's name if it is a field.
            roles: Declared name to ``"input"``, ``"output"`` (the default) or another role.
        """
        specs = []
        for formula in dict.fromkeys((*spec.formulas.values(), spec.formula)):
            names = dict.fromkeys(map(source, formula.variables))
            ins, outs = (
                tuple(name for name in names if roles.get(name, "output") == role)
                for role in ("input", "output")
            )
            horizon = spec.with_result(formula).horizon
            specs.append(ParsedFormula(str(formula), horizon, ins, outs))
        return cls(tuple(specs))
