"""Interface-aware semantics: robustness with respect to one side of a system's interface.

Only predicates change. The robustness with respect to the variables U, relative to the variables V,
of a predicate over the variables Y is

* 0 if Y has a variable outside U and V: such a predicate is neutral, and neither holds nor fails;
* +inf or -inf, by whether the predicate holds, if Y lies inside V;
* the usual value otherwise.

======================  =======  ==============
semantics               U        V
======================  =======  ==============
``output-robustness``   outputs  all but U
``input-vacuity``       inputs   none
``input-robustness``    inputs   all but U
``output-vacuity``      outputs  none
======================  =======  ==============

Source: Ferrere, Nickovic, Donze, Ito and Kapinski, "Interface-Aware Signal Temporal Logic",
HSCC 2019; Nickovic and Yamaguchi, "RTAMT: Online Robustness Monitors from STL", ATVA 2020.

Under the semantics ``boolean`` every predicate is +inf or -inf, whatever its variables are.

Averages over time (AGM robustness) are not a semantics of predicates: see `rtamt.program.algebra`.

To add a semantics, add its name to `SemanticsName` and the value of its predicates to `Interface`.
A value other than the three of `PredicateValue` needs an instruction in `rtamt.program.lowering`.
If every predicate has a truth value, add the name to ``EXACT`` of `rtamt_gym.judging.monitors`.
Describe it in the option ``semantics`` of `rtamt.monitors.options` and of
`rtamt_gym.options.evaluation`, and in both tables of ``docs/language.md``.
``tests/support/interface_oracle.py`` defines each semantics again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from rtamt.errors import (
    Advice,
    Argument,
    InputError,
    InputTypeError,
    alternatives,
    brief,
    is_one_of,
    nearest,
)
from rtamt.language.declarations import lineage
from rtamt.language.node import Node
from rtamt.language.specification import Specification

SemanticsName = Literal[
    "standard",
    "boolean",
    "output-robustness",
    "input-vacuity",
    "input-robustness",
    "output-vacuity",
]
"""Semantics of predicates: standard, boolean, or interface-aware (IA-STL)."""
Names = Iterable[str]
"""Names of variables, or of messages for all their fields."""
PredicateValue = Literal["value", "sign", "zero"]
"""The usual value of a predicate, +inf or -inf by whether it holds, or a neutral 0."""

Role = Literal["input", "output"]

_MEANINGS: Mapping[SemanticsName, tuple[Role, bool]] = {
    "output-robustness": ("output", True),
    "input-vacuity": ("input", False),
    "input-robustness": ("input", True),
    "output-vacuity": ("output", False),
}
"""The role of the variables U, and whether V is all other variables; else V is empty."""


@dataclass(frozen=True, slots=True)
class Interface:
    """A semantics, and the variables that a system reads and sets; see `as_interface`."""

    semantics: SemanticsName = "standard"  # the name of the semantics
    # variables that the system reads; the name of a message means all its fields
    inputs: tuple[str, ...] = ()
    # variables that the system sets; the name of a message means all its fields
    outputs: tuple[str, ...] = ()

    def role(self, variable: str) -> Role | None:
        """Return the role of a variable; the role of a field overrides that of its message."""
        for name in lineage(variable):
            if name in self.inputs:
                return "input"
            if name in self.outputs:
                return "output"
        return None

    def reading(self, predicate: Node) -> PredicateValue:
        """Return the value of a predicate, by the roles of its variables."""
        if self.semantics == "standard":
            return "value"
        if self.semantics == "boolean":
            return "sign"
        role, relative = _MEANINGS[self.semantics]
        concerned = [self.role(v) == role for v in predicate.variables]
        if not relative and not all(concerned):
            return "zero"
        return "value" if any(concerned) else "sign"


STANDARD = Interface()
"""The standard semantics, in which every predicate has its usual value."""


def as_interface(
    spec: Specification,
    semantics: SemanticsName = "standard",
    inputs: Names | None = None,
    outputs: Names | None = None,
) -> Interface:
    """Return the interface of a monitor, from its arguments and its specification.

    Example:
        >>> from rtamt.language.parser import parse
        >>> spec = parse("input float req; output float gnt; req > 3 implies gnt > 3")
        >>> as_interface(spec, "output-robustness").outputs
        ('gnt',)
    """
    if is_one_of(semantics, ("standard",)) and inputs is None and outputs is None:
        return STANDARD  # most monitors; some are made at every episode
    known = get_args(SemanticsName)
    if not is_one_of(semantics, known):
        msg = f"expected semantics={alternatives(known)}, got {brief(semantics)}"
        raise InputError(msg + nearest(brief(semantics), known))
    reads = _declared(spec, "input") if inputs is None else _checked(spec, "inputs", inputs)
    sets = _declared(spec, "output") if outputs is None else _checked(spec, "outputs", outputs)
    for name in (name for name in reads if name in sets):
        msg = f"'{name}' is in inputs= and in outputs="
        if outputs is None:
            msg = f"'{name}' is in inputs= and declared output in the text; give outputs= as well"
        elif inputs is None:
            msg = f"'{name}' is in outputs= and declared input in the text; give inputs= as well"
        raise InputError(msg)
    if semantics in _MEANINGS:
        role, _ = _MEANINGS[semantics]
        names, roles = (inputs, reads) if role == "input" else (outputs, sets)
        if names is None and not roles:
            some = next((v for v in spec.variables if v not in (*reads, *sets)), "x")
            raise InputError(
                Argument("semantics", str(semantics)),
                f" needs {role} variables, and none are declared; declare them in the text "
                f"({role} float {some})",
                Advice(" or name them: ", Argument(f"{role}s", (some,))),
            )
    return Interface(semantics, reads, sets)


def _declared(spec: Specification, role: Role) -> tuple[str, ...]:
    # A declared name that a formula computes is not a variable.
    return tuple(n for n, d in spec.declarations.items() if d.io == role and n not in spec.formulas)


def _checked(spec: Specification, argument: str, names: Names) -> tuple[str, ...]:
    value: object = names
    if isinstance(value, str) or not isinstance(value, Iterable):
        msg = f"expected names of variables as {argument}, got {brief(value)}"
        hint = f"; write {argument}=('{value}',)" if isinstance(value, str) else ""
        raise InputTypeError(msg + hint)
    known = {n for v in spec.variables for n in lineage(v)}
    known |= spec.declarations.keys() - spec.formulas.keys()
    try:
        checked = tuple(value)
    except TypeError:  # an array without an axis
        raise InputTypeError(
            f"expected names of variables as {argument}, got {brief(value)}"
        ) from None
    for name in checked:
        if not isinstance(name, str):
            msg = f"expected names of variables as {argument}, got {brief(name)} among them"
            raise InputTypeError(msg)
        if name not in known:
            listed = "; the formula has no variables"
            if spec.variables:
                listed = f"; the variables are {', '.join(spec.variables)}"
            phrase = (
                "names a formula, not a variable" if name in spec.formulas else "is no variable"
            )
            msg = f"'{name}' in {argument} {phrase}{nearest(name, known) or listed}"
            raise InputError(msg)
    return tuple(dict.fromkeys(checked))
