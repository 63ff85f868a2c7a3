"""The ROS topics of a specification: of its variables, and of the robustness of its formulas.

To add a type that a topic without a declared message may have, add the class of ``std_msgs`` to
`_STD`. To change where robustness is published, change `publications`; if two requirements name the
same topic, ``outputs_of`` of `rtamt_ros` and ``rtamt_gym/recorded/bag_output.py`` handle it. Nodes
and bags use both functions.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter, itemgetter
from typing import Any

from rtamt.language.declarations import PRIMITIVES, PathStep, joined, lineage, steps
from rtamt.language.formula import Formula
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification

_STD = {
    "bool": "Bool",
    **dict.fromkeys(("int", "long", "int64"), "Int64"),
    **dict.fromkeys(("uint", "uint64"), "UInt64"),
    **dict.fromkeys(("float", "double", "float64"), "Float64"),
    "float32": "Float32",
    **{f"int{bits}": f"Int{bits}" for bits in (8, 16, 32)},
    **{f"uint{bits}": f"UInt{bits}" for bits in (8, 16, 32)},
}
"""The messages of ``std_msgs`` whose field ``data`` is a number, by the type of a variable."""


@dataclass(frozen=True, slots=True)
class SubscribedField:
    """A variable of a specification as a field of a message.

    Attributes:
        variable: Its name in the specification, ``scan.ranges[0]``.
        path: The fields and elements that lead to it in the message, ``("ranges", 0)``.
        read: Returns its value in a message with attributes and sequences, such as the messages of
            ROS and `rosbags`. Raises AttributeError, IndexError or TypeError if it is missing.
    """

    variable: str
    path: tuple[PathStep, ...]
    read: Callable[[Any], Any] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make the reader, once."""
        object.__setattr__(self, "read", _reader(self.path))


@dataclass(frozen=True, slots=True)
class Subscription:
    """A topic that a specification reads, and the variables that its messages carry.

    Attributes:
        variable: The name of the message, or of the plain variable, in the text: ``cmd``.
        package: The package of the message's class, ``geometry_msgs``; None if the text does not
            state the class.
        message: The name of the class, ``Twist``; None with `package`.
        topic: The topic as it is written. It is absolute if it starts with ``/``; otherwise, it is
            relative to the namespace of the subscriber.
        fields: The variables of the specification in a message, in their order there.
    """

    variable: str
    package: str | None
    message: str | None
    topic: str
    fields: tuple[SubscribedField, ...]


@dataclass(frozen=True, slots=True)
class Publication:
    """A formula of a specification as a field of a message.

    Attributes:
        formula: Its name; empty for a result without a name.
        variable: The name in ``@ topic``: the declared message if the formula is its field, ``out``
            of ``out.value``; otherwise, the name of the formula.
        package: The package of the message's class.
        message: The name of the class.
        path: The fields that lead to the robustness in the message; empty if the formula has the
            name of a message that is not a number.
        topic: The topic as it is written; None if the text does not state it.
        default: The topic for a text that does not state it, ``rtamt/`` and the variable.
    """

    formula: str
    variable: str
    package: str
    message: str
    path: tuple[str, ...]
    topic: str | None
    default: str


def subscriptions(specification: str | Formula | Specification) -> tuple[Subscription, ...]:
    """Return the topics of the variables, as `Specification.subscriptions`."""
    spec = as_specification(specification)
    fields: dict[str, list[SubscribedField]] = {}
    for variable in spec.variables:
        names = [*lineage(variable)]
        message = next((name for name in names if name in spec.declarations), names[-1])
        path = steps(variable)[len(steps(message)) :] or _number_path(spec, message)
        fields.setdefault(message, []).append(SubscribedField(variable, path))
    return tuple(_subscription(spec, *item) for item in fields.items())


def _subscription(spec: Specification, name: str, fields: list[SubscribedField]) -> Subscription:
    package: str | None
    message: str | None
    package, message = _message_class(spec, name) or (None, None)
    declared = spec.declarations.get(name)
    if declared is not None and package is None:
        package, message = "std_msgs", _STD[declared.type]
    elif any(field.variable == name for field in fields) and package is None:
        package, message = "std_msgs", "Float64"
    # A name of ROS has no dots or brackets.
    topic = spec.topics.get(name) or "/".join(map(str, ("rtamt", *steps(name))))
    return Subscription(name, package, message, topic, tuple(fields))


def publications(
    specification: str | Formula | Specification, name: str | None = None
) -> tuple[Publication, ...]:
    """Return the topics of the formulas, as `Specification.publications`."""
    spec = as_specification(specification)
    named = [key for key, formula in spec.formulas.items() if formula is spec.formula]
    result = named[-1] if named else ""
    parts = [_publication(spec, key, key) for key in spec.formulas if key != result]
    return (*parts, _publication(spec, result, name or result or spec.title or "spec"))


def _publication(spec: Specification, formula: str, name: str) -> Publication:
    variable = next((key for key in lineage(formula) if _message_class(spec, key)), None)
    package, message = (variable and _message_class(spec, variable)) or ("std_msgs", "Float64")
    path = tuple(formula.split(".")[variable.count(".") + 1 :]) if variable else ()
    if not path and package == "std_msgs":
        path = ("data",)
    topic = spec.topics.get(variable or formula)
    default = _default_topic(variable or name)
    return Publication(formula, variable or formula or name, package, message, path, topic, default)


def _default_topic(name: str) -> str:
    """Return a topic with the characters of ROS names; no part of it starts with a digit."""
    parts = (re.sub(r"\W", "_", part, flags=re.ASCII) for part in name.split("."))
    return "/".join(["rtamt", *(f"_{part}" if part[:1].isdigit() else part for part in parts)])


def _message_class(spec: Specification, name: str) -> tuple[str, str] | None:
    """Return the package and the class of a declared message; None for other names."""
    declared = spec.declarations.get(name)
    if declared is None or declared.type in PRIMITIVES:
        return None
    return spec.imports[declared.type].removesuffix(".msg"), declared.type


def _number_path(spec: Specification, name: str) -> tuple[PathStep, ...]:
    """Return the path to the number that a name without fields stands for."""
    declared = _message_class(spec, name)
    if declared is None or (declared[0] == "std_msgs" and declared[1] in _STD.values()):
        return ("data",)
    reason = f"expected a field of the message '{name}', got '{name}' as a number"
    hint = f"write a field, such as {name}.x: a {'/'.join(declared)} is not a number"
    raise spec.name_error(name, reason, hint)


def _reader(path: tuple[PathStep, ...]) -> Callable[[Any], Any]:
    """Return a function that follows a path: one C call for adjacent fields, one per element."""
    count = 1
    first: Callable[[Any], Any] = itemgetter(path[0])
    if isinstance(path[0], str):
        count = next((i for i, step in enumerate(path) if isinstance(step, int)), len(path))
        first = attrgetter(joined(path[:count]))
    if count == len(path):
        return first
    remainder = _reader(path[count:])
    return lambda message: remainder(first(message))
