"""The requirements that a node judges, and the topics that they read."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from rtamt import Formula, InputError, Specification, SpecificationError
from rtamt.errors import nearest
from rtamt.language import Subscription
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.settings import Settings

__all__ = ["SubscribedRequirement", "requirements_of", "unbounded"]


@dataclass(frozen=True, slots=True)
class SubscribedRequirement:
    """A requirement of a specification, and where its variables come from.

    Attributes:
        name: Its name, which no other requirement of the node has.
        specification: The requirement alone, with the formulas that it uses.
        cells: For each variable an input and the place in its values.
        inputs: The inputs that it reads.
        origin: The number of its specification among those given, from 0.
    """

    name: str
    specification: Specification
    cells: Mapping[str, tuple[Input, int]]
    inputs: tuple[Input, ...]
    origin: int


def requirements_of(
    specifications: Iterable[Specification], settings: Settings
) -> tuple[SubscribedRequirement, ...]:
    """The requirements of specifications, with the inputs that they read.

    Requirements that read the same of a topic share its input, which is read once then; a field
    that one cannot read concerns no other. Requirements of one name are told apart by a number:
    ``out``, ``out_2``.

    Raises:
        SpecificationError: If a topic is read as messages of two classes, or of none.
        InputError: If the settings speak of a topic that is not read.
    """
    requirements: dict[str, SubscribedRequirement] = {}
    for origin, specification in enumerate(specifications):
        for title, part in specification.requirements.items():
            numbered = (f"{title}_{count}" for count in itertools.count(2))
            candidates = itertools.chain((title,), numbered)
            name = next(each for each in candidates if each not in requirements)
            cells = _cells(part, settings)
            read = tuple(dict.fromkeys(source for source, _ in cells.values()))
            requirements[name] = SubscribedRequirement(name, part, cells, read, origin)
    _check([source for each in requirements.values() for source in each.inputs], settings)
    return _sharing(requirements.values())


def _sharing(requirements: Iterable[SubscribedRequirement]) -> tuple[SubscribedRequirement, ...]:
    """The requirements with one input for all that read the same of a topic."""
    known: dict[object, Input] = {}

    def shared(source: Input) -> Input:
        fields = tuple((each.variable, each.path) for each in source.fields)
        return known.setdefault((source.name, source.topic, source.default, fields), source)

    return tuple(
        replace(
            each,
            cells={name: (shared(of), place) for name, (of, place) in each.cells.items()},
            inputs=tuple(map(shared, each.inputs)),
        )
        for each in requirements
    )


def _cells(specification: Specification, settings: Settings) -> dict[str, tuple[Input, int]]:
    """Makes the inputs; maps each variable to its input and its place among the input's values."""
    inputs: dict[tuple[str, float | None], Input] = {}
    cells = {}
    for each in specification.subscriptions():
        key = each.topic, _default(specification, each)
        source = inputs.setdefault(key, Input(each.variable, each.topic, settings, key[1]))
        _agree(source, each.package, each.message, each.variable)
        for field in each.fields:
            cells[field.variable] = (source, source.add(field))
    return cells


def unbounded(specification: Specification, formula: Formula | None = None) -> str:
    """The operator of ``always p`` and ``eventually p`` that have no bounds; else nothing.

    Args:
        specification: The requirement.
        formula: A part of it; None: all of it.
    """
    formula = specification.formula if formula is None else formula
    begin, end = specification.bounds(formula.interval)
    single = formula.op is not None and formula.op.name in ("always", "eventually")
    return formula.op.name if formula.op and single and begin == 0 and end is None else ""


def _check(inputs: Collection[Input], settings: Settings) -> None:
    """Refuse topics without a class or with two, and settings of topics that nothing reads."""
    first: dict[str, Input] = {}
    for source in inputs:  # of a topic, one whose class is known
        known = first.setdefault(source.topic, source)
        if known.message is None:
            first[source.topic] = source
    for source in inputs:
        known = first[source.topic]
        if source.message is None:
            source.package, source.message = known.package, known.message
        _agree(known, source.package, source.message, source.name)
        if source.message is None:
            raise SpecificationError(
                f"expected the class of the message '{source.name}', got none; declare it: "
                f"from PACKAGE.msg import CLASS, then input CLASS {source.name}"
            )
    for topic in settings.stale_of:
        if topic not in first:
            hint = nearest(topic, first) or f"; the topics are {', '.join(first)}"
            raise InputError(f"stale speaks of the topic {topic}, which nothing reads{hint}")


def _default(specification: Specification, subscription: Subscription) -> float | None:
    """The value before the first message, which the declaration of a plain variable may have."""
    values = {specification.defaults.get(field.variable) for field in subscription.fields}
    return values.pop() if len(values) == 1 else None


def _agree(source: Input, package: str | None, message: str | None, name: str) -> None:
    """Give an input the class of messages that the variable ``name`` has; refuse a second one."""
    if message is None:
        return
    if source.message is None:
        source.package, source.message = package, message
    of, other = f"{source.package}/{source.message}", f"{package}/{message}"
    if of != other:
        raise SpecificationError(
            f"expected one class of messages on the topic {source.topic}, got {of} as "
            f"'{source.name}' and {other} as '{name}'"
        )
