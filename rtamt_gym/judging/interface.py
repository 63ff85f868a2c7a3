"""The semantics of specifications, with the inputs and outputs of the system."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, TypedDict

import rtamt
from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing

__all__ = [
    "EXACT",
    "STANDARD",
    "Interface",
    "InterfaceOptions",
    "Names",
    "Semantics",
    "described",
    "robustness_text",
]

Semantics = Literal[
    "standard",
    "boolean",
    "output-robustness",
    "input-vacuity",
    "input-robustness",
    "output-vacuity",
]
"""How predicates count; `rtamt.Monitor` says what each means."""

EXACT: tuple[Semantics, ...] = ("standard", "boolean")
"""The semantics under which every predicate counts, so that the sign of a robustness decides."""

Names = Iterable[str]
"""Variables of specifications; the name of a message means all its fields."""


class InterfaceOptions(TypedDict, total=False):
    """The keyword arguments of monitors that say how predicates count; see `rtamt.Monitor`."""

    semantics: Semantics
    inputs: Names | None
    outputs: Names | None


def robustness_text(
    value: float, semantics: Semantics, verdict: rtamt.Verdict, form: str = ".6g"
) -> str:
    """Writes a robustness; one of 0 with what its sign says, unless that is not known.

    Example:
        >>> undecided = rtamt.Verdict.UNDECIDED
        >>> [robustness_text(value, "standard", undecided) for value in (0.5, 0.0, -0.0)]
        ['0.5', '0, holds', '0, violated']
        >>> robustness_text(0.0, "input-vacuity", undecided)
        '0'
    """
    if value != 0.0:
        return format(value, form)
    if verdict == 0 and semantics not in EXACT:
        return "0"
    return "0, holds" if rtamt.holds(value) else "0, violated"


def described(spec: rtamt.Specification, judge: rtamt.EpisodeMonitor) -> str:
    """The formula of a judge, with its semantics unless that is the standard one."""
    interface = judge.interface
    if interface.semantics == "standard":
        return str(spec.formula)
    words = [str(interface.semantics)]
    words += [f"input {name}" for name in interface.inputs]
    words += [f"output {name}" for name in interface.outputs]
    return f"{spec.formula} under {', '.join(words)}"


def _names(names: Names | None) -> Names | None:
    """The names as a tuple; what is no collection of names stays, for the monitors to refuse."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        return names
    return tuple(names)


@dataclass(frozen=True, slots=True)
class Interface:
    """One semantics for several specifications, of which each reads some of the variables.

    Attributes:
        semantics: How predicates count: ``"standard"``, ``"boolean"`` or interface-aware.
        inputs: Variables that the system reads; None: those that a text declares ``input``.
        outputs: Variables that the system sets; None: those that a text declares ``output``.
    """

    semantics: Semantics = "standard"
    inputs: Names | None = None
    outputs: Names | None = None

    def __post_init__(self) -> None:
        """Keeps the names as tuples, which can be read twice and written as JSON."""
        object.__setattr__(self, "inputs", _names(self.inputs))
        object.__setattr__(self, "outputs", _names(self.outputs))

    def options(self, specs: Mapping[str, rtamt.Specification]) -> dict[str, InterfaceOptions]:
        """The keyword arguments of the monitors of each specification: the names that it knows.

        Raises:
            InputError: On a name that no specification knows.
        """
        if self == STANDARD:
            return {name: {} for name in specs}
        known = {name: _known(spec) for name, spec in specs.items()}
        return {
            name: {
                "semantics": self.semantics,
                "inputs": _chosen("inputs", self.inputs, name, known),
                "outputs": _chosen("outputs", self.outputs, name, known),
            }
            for name in specs
        }


STANDARD = Interface()
"""The semantics in which every predicate counts its usual value."""


def _chosen(
    argument: str, names: Names | None, spec: str, known: Mapping[str, frozenset[str]]
) -> Names | None:
    """The names that a specification knows; all, if it is the only one or they are no names."""
    if len(known) == 1 or not isinstance(names, tuple):
        return names
    everywhere = frozenset().union(*known.values())
    for name in names:
        if isinstance(name, str) and name not in everywhere:
            hint = nearest(name, everywhere) or f"; they read {listing(sorted(everywhere))}"
            raise InputError(f"{name!r} in {argument} is a variable of no specification{hint}")
    return tuple(name for name in names if name in known[spec] or not isinstance(name, str))


def _known(spec: rtamt.Specification) -> frozenset[str]:
    """The variables of a specification, declared ones too, and the messages they are fields of."""
    names = {*spec.variables, *spec.declarations} - {*spec.formulas}
    ends = ((name, each.start()) for name in names for each in re.finditer(r"[.\[]|$", name))
    return frozenset(name[:end] for name, end in ends)
