"""The topics from which a specification's variables come.

To add a type that a topic without a declared message may have, add the class of ``std_msgs`` to
`_STD`. Nodes and bags both use `subscriptions`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter, itemgetter
from typing import Any

from rtamt.errors import SpecificationError
from rtamt.language.formula import Formula
from rtamt.language.names import PathStep, joined, lineage, steps
from rtamt.language.parser import as_specification
from rtamt.language.specification import PRIMITIVES, Specification

__all__ = ["SubscribedField", "Subscription", "declared_class", "subscriptions"]


@dataclass(frozen=True, slots=True)
class SubscribedField:
    """A variable of a specification as a field of a message.

    Attributes:
        variable: Its name in the specification, ``scan.ranges[0]``.
        path: The fields and elements that lead to it in the message, ``("ranges", 0)``.
        read: Gives its value in a message with attributes and sequences, such as ROS and `rosbags`
            make. It raises AttributeError, IndexError or TypeError if there is none.
    """

    variable: str
    path: tuple[PathStep, ...]
    read: Callable[[Any], Any] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make the reader, once."""
        object.__setattr__(self, "read", _reader(self.path))


@dataclass(frozen=True, slots=True)
class Subscription:
    """A topic that a specification reads, and what it reads of each message.

    Attributes:
        variable: The name of the message, or of the plain variable, in the text: ``cmd``.
        package: The package of the message's class, ``geometry_msgs``; None if the text does not
            say which class it is.
        message: The name of the class, ``Twist``; None with `package`.
        topic: The topic as it is written: one that begins with ``/`` is absolute, another is
            relative to the namespace of who subscribes.
        fields: The variables of the specification that a message has, in their order there.
    """

    variable: str
    package: str | None
    message: str | None
    topic: str
    fields: tuple[SubscribedField, ...]


def subscriptions(specification: str | Formula | Specification) -> tuple[Subscription, ...]:
    """The topics that a specification reads: one for each message, and for each plain variable.

    Declaration and import say the class of a message: ``from geometry_msgs.msg import Twist`` and
    ``input Twist cmd`` make ``cmd`` a ``geometry_msgs/Twist``. A plain variable reads the field
    ``data`` of the message of ``std_msgs`` that is called like its type: a ``float64`` reads a
    ``std_msgs/Float64``, and so does a variable that is not declared. A variable whose declared
    type is such a message reads ``data`` too: after ``from std_msgs.msg import Float64`` and
    ``input Float64 x``, both ``x`` and ``x.data`` may be written. The text names the topic, ``@
    topic(cmd, /robot0/cmd_vel)``; else it is ``rtamt/`` and the name of the variable. Variables
    that no formula uses are left out; formulas are no variables.

    Args:
        specification: Text, a formula, or a parsed specification.

    Returns:
        One subscription for each message or plain variable, in the order of the variables.

    Raises:
        SpecificationError: If the specification is refused, or compares a whole message to a number
            as in ``cmd > 0`` for a Twist.

    Example:
        >>> for s in subscriptions('''
        ...     from geometry_msgs.msg import Twist
        ...     input Twist cmd
        ...     input float64 limit
        ...     @ topic(cmd, /robot0/cmd_vel)
        ...     always(cmd.linear.x <= limit and abs(cmd.angular.z) < 1)
        ... '''):
        ...     fields = ", ".join(f.variable for f in s.fields)
        ...     print(f"{s.topic} ({s.package}/{s.message}): {fields}")
        /robot0/cmd_vel (geometry_msgs/Twist): cmd.linear.x, cmd.angular.z
        rtamt/limit (std_msgs/Float64): limit
    """
    spec = as_specification(specification)
    fields: dict[str, list[SubscribedField]] = {}
    for variable in spec.variables:
        message = _message(spec, variable)
        path = steps(variable)[len(steps(message)) :]
        fields.setdefault(message, []).append(
            SubscribedField(variable, path or _whole(spec, message))
        )
    made = []
    for name, found in fields.items():
        package, kind = _class(spec, name, found) or (None, None)
        made.append(Subscription(name, package, kind, _topic(spec, name), tuple(found)))
    return tuple(made)


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
_DATA = ("data",)


def _message(spec: Specification, variable: str) -> str:
    """The declared message or variable that a name belongs to; without one, its first step."""
    names = [*lineage(variable)]
    return next((name for name in names if name in spec.declarations), names[-1])


def declared_class(spec: Specification, name: str) -> tuple[str, str] | None:
    """The package and the class of a declared message."""
    declared = spec.declarations.get(name)
    if declared is None or declared.type in PRIMITIVES:
        return None
    return spec.imports[declared.type].removesuffix(".msg"), declared.type


def _whole(spec: Specification, name: str) -> tuple[PathStep, ...]:
    """The path to the number that a name without fields stands for."""
    declared = declared_class(spec, name)
    if declared is None or (declared[0] == "std_msgs" and declared[1] in _STD.values()):
        return _DATA
    raise SpecificationError(
        f"expected a field of the message '{name}', such as {name}.x, got '{name}' as a number; "
        f"a {'/'.join(declared)} is none"
    )


def _class(spec: Specification, name: str, fields: list[SubscribedField]) -> tuple[str, str] | None:
    declared = spec.declarations.get(name)
    if declared is None:
        plain = any(f.variable == name for f in fields)
        return ("std_msgs", "Float64") if plain else None
    return declared_class(spec, name) or ("std_msgs", _STD[declared.type])


def _topic(spec: Specification, name: str) -> str:
    # A name of ROS has no dots or brackets.
    return spec.topics.get(name) or "/".join(map(str, ("rtamt", *steps(name))))


def _reader(path: tuple[PathStep, ...]) -> Callable[[Any], Any]:
    """A function that follows a path: one call in C for fields in a row, one for each element."""
    count = 1
    first: Callable[[Any], Any] = itemgetter(path[0])
    if isinstance(path[0], str):
        count = next((i for i, step in enumerate(path) if isinstance(step, int)), len(path))
        first = attrgetter(joined(path[:count]))
    if count == len(path):
        return first
    rest = _reader(path[count:])
    return lambda message: rest(first(message))
