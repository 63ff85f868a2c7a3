"""The topics on which the robustness of a specification's formulas is published.

To change where robustness is published, change `publications`, which nodes and copies of bags both
use. ``rtamt_ros/core/outputs.py`` and ``rtamt_gym/recorded/bag_output.py`` handle two requirements
that name the same topic.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from rtamt.language.formula import Formula
from rtamt.language.names import lineage
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification
from rtamt.language.subscriptions import declared_class

__all__ = ["Publication", "publications"]


@dataclass(frozen=True, slots=True)
class Publication:
    """A formula of a specification as a field of a message.

    Attributes:
        formula: Its name; empty for a result that has none.
        variable: What ``@ topic`` speaks of: the declared message that the name is a field of,
            ``out`` of ``out.value``, else the name.
        package: The package of the message's class.
        message: The name of the class.
        path: The fields that lead to the robustness in the message; empty where the name stands
            for a whole message that is no number.
        topic: The topic as it is written; None if the text does not say it.
        default: The topic without one, ``rtamt/`` and the variable.
    """

    formula: str
    variable: str
    package: str
    message: str
    path: tuple[str, ...]
    topic: str | None
    default: str


def publications(
    specification: str | Formula | Specification, name: str | None = None
) -> tuple[Publication, ...]:
    """The topics of every formula with a name and, last, of the result.

    The message is a ``std_msgs/Float64``, unless the name is a field of a declared message: after
    ``from rtamt_msgs.msg import FloatStamped`` and ``output FloatStamped out``, ``out.value`` is
    the field ``value`` of ``out``. The text names the topic, ``@ topic(out, monitor/out)``; else
    it is ``rtamt/`` and the name, with a ``/`` for a dot and a ``_`` for what names of topics
    cannot have.

    Args:
        specification: Text, a formula, or a parsed specification.
        name: The name of the result, for a default topic; None: its own name, else the name of the
            text, else ``"spec"``.

    Raises:
        SpecificationError: If the specification is refused.

    Example:
        >>> for p in publications('''
        ...     from rtamt_msgs.msg import FloatStamped
        ...     output FloatStamped out
        ...     @ topic(out, monitor/out)
        ...     near = abs(x - y) < 1
        ...     out.value = always(near)
        ... '''):
        ...     print(p.topic or p.default, f"({p.package}/{p.message})", *p.path)
        rtamt/near (std_msgs/Float64) data
        monitor/out (rtamt_msgs/FloatStamped) value
    """
    spec = as_specification(specification)
    named = [each for each, formula in spec.formulas.items() if formula is spec.formula]
    result = named[-1] if named else ""
    parts = [each for each in spec.formulas if each != result]
    made = [_publication(spec, each, each) for each in parts]
    made.append(_publication(spec, result, name or result or spec.title or "spec"))
    return tuple(made)


def _publication(spec: Specification, formula: str, name: str) -> Publication:
    variable = next((each for each in lineage(formula) if declared_class(spec, each)), None)
    package, message = (variable and declared_class(spec, variable)) or ("std_msgs", "Float64")
    path = tuple(formula.split(".")[variable.count(".") + 1 :]) if variable else ()
    if not path and package == "std_msgs":
        path = ("data",)
    topic = spec.topics.get(variable or formula)
    default = _default(variable or name)
    return Publication(formula, variable or formula or name, package, message, path, topic, default)


def _default(name: str) -> str:
    """A topic with letters that names of ROS have; no part of it begins with a digit."""
    parts = (re.sub(r"\W", "_", part, flags=re.ASCII) for part in name.split("."))
    return "/".join(["rtamt", *(f"_{part}" if part[:1].isdigit() else part for part in parts)])
