"""Interface-aware semantics: robustness with respect to one side of a system's interface.

Only predicates change. The robustness with respect to the variables U, relative to the variables V,
of a predicate over the variables Y is

* 0 if Y has a variable outside U and V: it is of no concern;
* +inf if the predicate holds and -inf if not, if Y lies inside V: it is given;
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
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

from rtamt.errors import InputError, InputTypeError, nearest
from rtamt.language.node import Node
from rtamt.language.specification import Specification

__all__ = ["STANDARD", "Interface", "Names", "Reading", "Semantics", "as_interface"]

Semantics = Literal[
    "standard", "output-robustness", "input-vacuity", "input-robustness", "output-vacuity"
]
Names = Iterable[str]
Reading = Literal["value", "sign", "zero"]
"""The usual value; +-inf by whether the predicate holds; 0."""

Role = Literal["input", "output"]

_MEANINGS: Mapping[Semantics, tuple[Role, bool]] = {
    "output-robustness": ("output", True),
    "input-vacuity": ("input", False),
    "input-robustness": ("input", True),
    "output-vacuity": ("output", False),
}
"""The role of U, and whether V is all the rest; else V is empty."""


@dataclass(frozen=True, slots=True)
class Interface:
    """A semantics, and which variables a system reads and sets.

    Made by `as_interface`, which checks names against a specification.

    Attributes:
        semantics: Which robustness is meant.
        inputs: Variables, or messages all of whose fields are meant.
        outputs: Likewise.
    """

    semantics: Semantics = "standard"
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    def role(self, variable: str) -> Role | None:
        """What a variable is to the system; the innermost name that says so decides."""
        for name in _with_messages(variable):
            if name in self.inputs:
                return "input"
            if name in self.outputs:
                return "output"
        return None

    def reading(self, predicate: Node) -> Reading:
        """What a predicate counts."""
        if self.semantics == "standard":
            return "value"
        role, relative = _MEANINGS[self.semantics]
        concerned = [self.role(v) == role for v in predicate.variables]
        if not relative and not all(concerned):
            return "zero"
        return "value" if any(concerned) else "sign"


STANDARD = Interface()
"""Every predicate counts its usual value."""


def as_interface(
    spec: Specification,
    semantics: Semantics = "standard",
    inputs: Names | None = None,
    outputs: Names | None = None,
) -> Interface:
    """The interface that a monitor of a specification was given.

    Args:
        spec: Declares inputs and outputs, where they are not given.
        semantics: Which robustness is meant.
        inputs: Variables that the system reads; the name of a message stands for its fields. None:
            those that the text declares ``input``; empty: there are none.
        outputs: Variables that the system sets, likewise.

    Raises:
        InputError: On an unknown semantics, a name that is no variable of the specification or
            that is both input and output, or if the semantics is about inputs (outputs) and
            neither text nor argument says which.
        InputTypeError: On names that are no texts.

    Example:
        >>> from rtamt.language.parser import parse
        >>> spec = parse("input float req; output float gnt; req > 3 implies gnt > 3")
        >>> as_interface(spec, "output-robustness").outputs
        ('gnt',)
    """
    if semantics == "standard" and inputs is None and outputs is None:
        return STANDARD  # monitors are made at every episode: this is all that most of them need
    *others, last = get_args(Semantics)
    if semantics not in (*others, last):
        choices = f"{', '.join(map(repr, others))} or {last!r}"
        msg = f"expected semantics={choices}, got {semantics!r}"
        raise InputError(msg + nearest(str(semantics), (*others, last)))
    reads = _declared(spec, "input") if inputs is None else _checked(spec, "inputs", inputs)
    sets = _declared(spec, "output") if outputs is None else _checked(spec, "outputs", outputs)
    for name in reads:
        if name not in sets:
            continue
        msg = f"'{name}' is in inputs= and in outputs="
        if outputs is None:
            msg = f"'{name}' is in inputs= and declared output in the text; give outputs= as well"
        elif inputs is None:
            msg = f"'{name}' is in outputs= and declared input in the text; give inputs= as well"
        raise InputError(msg)
    if semantics != "standard":
        role, _ = _MEANINGS[semantics]
        said, found = (inputs, reads) if role == "input" else (outputs, sets)
        if said is None and not found:
            free = (v for v in spec.variables if v not in (*reads, *sets))
            some = next(free, "x")
            msg = (
                f"semantics='{semantics}' is about {role}s, and there are none; declare them in "
                f"the text ({role} float {some}) or name them: {role}s=('{some}',)"
            )
            raise InputError(msg)
    return Interface(semantics, reads, sets)


def _declared(spec: Specification, role: Role) -> tuple[str, ...]:
    # A declaration of what a formula computes is of no variable.
    return tuple(n for n, d in spec.declarations.items() if d.io == role and n not in spec.formulas)


def _checked(spec: Specification, argument: str, names: Names) -> tuple[str, ...]:
    given: object = names
    if isinstance(given, str) or not isinstance(given, Iterable):
        msg = f"expected names of variables as {argument}, got {given!r}"
        hint = f"; write {argument}=('{given}',)" if isinstance(given, str) else ""
        raise InputTypeError(msg + hint)
    known = {n for v in spec.variables for n in _with_messages(v)}
    known |= spec.declarations.keys() - spec.formulas.keys()
    checked = tuple(dict.fromkeys(names))
    for name in checked:
        if not isinstance(name, str):
            msg = f"expected names of variables as {argument}, got {name!r} among them"
            raise InputTypeError(msg)
        if name not in known:
            listed = "; the formula has no variables"
            if spec.variables:
                listed = f"; the variables are {', '.join(spec.variables)}"
            what = "names a formula, not a variable" if name in spec.formulas else "is no variable"
            msg = f"'{name}' in {argument} {what}{nearest(name, known) or listed}"
            raise InputError(msg)
    return checked


def _with_messages(variable: str) -> Iterator[str]:
    """A variable, and the messages of which it is a field, from the innermost."""
    yield variable
    while "." in variable:
        variable = variable.rpartition(".")[0]
        yield variable
