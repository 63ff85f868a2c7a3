"""Which requirements a node judges, and which topics they read."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from rtamt import InputError, Specification, SpecificationError, Subscription, subscriptions
from rtamt.errors import nearest
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.settings import Settings

__all__ = ["Requirement", "requirements_of", "unbounded"]


@dataclass(frozen=True, slots=True)
class Requirement:
    """A requirement of a specification, and where its variables come from.

    Attributes:
        name: Its name, which no other requirement of the node has.
        specification: It alone, with the formulas that it uses.
        cells: For each variable an input and the place in its values.
        inputs: The inputs that it reads.
        origin: The number of the specification that it is of.
    """

    name: str
    specification: Specification
    cells: Mapping[str, tuple[Input, int]]
    inputs: tuple[Input, ...]
    origin: int


def requirements_of(
    specifications: Iterable[Specification], settings: Settings
) -> tuple[tuple[Input, ...], tuple[Requirement, ...]]:
    """The topics that specifications read, each once, and what they require.

    A topic with several declared values before its first message is read once for each of them.
    Requirements of one name are told apart by a number: ``out``, ``out_2``.

    Raises:
        SpecificationError: If a topic is read as messages of two classes, or of none.
        InputError: If the settings speak of a topic that is not read.
    """
    inputs: dict[tuple[str, float | None], Input] = {}
    requirements: dict[str, Requirement] = {}
    for origin, specification in enumerate(specifications):
        for title, part in specification.requirements.items():
            cells = {}
            for subscription in subscriptions(part):
                topic, default = subscription.topic, _default(part, subscription)
                source = inputs.setdefault(
                    (topic, default), Input(subscription.variable, topic, settings, default)
                )
                for each in inputs.values():
                    if each.topic == topic:
                        _agree(each, subscription)
                for field in subscription.fields:
                    cells[field.variable] = (source, source.add(field))
            numbered = (f"{title}_{count}" for count in itertools.count(2))
            candidates = itertools.chain((title,), numbered)
            name = next(each for each in candidates if each not in requirements)
            read = tuple(dict.fromkeys(source for source, _ in cells.values()))
            requirements[name] = Requirement(name, part, cells, read, origin)
    _check(inputs.values(), settings)
    return tuple(inputs.values()), tuple(requirements.values())


def unbounded(specification: Specification) -> str:
    """The operator of ``always p`` and ``eventually p`` that have no bounds; else nothing."""
    formula = specification.formula
    begin, end = specification.bounds(formula.interval)
    single = formula.op is not None and formula.op.name in ("always", "eventually")
    return formula.op.name if formula.op and single and begin == 0 and end is None else ""


def _check(inputs: Collection[Input], settings: Settings) -> None:
    """Refuse topics without a class, and settings of topics that nothing reads."""
    topics = dict.fromkeys(each.topic for each in inputs)
    for topic in settings.stale_of:
        if topic not in topics:
            hint = nearest(topic, topics) or f"; the topics are {', '.join(topics)}"
            raise InputError(f"stale speaks of the topic {topic}, which nothing reads{hint}")
    for source in inputs:
        if source.message is None:
            raise SpecificationError(
                f"expected the class of the message '{source.name}', got none; declare it: "
                f"from PACKAGE.msg import CLASS, then input CLASS {source.name}"
            )


def _default(specification: Specification, subscription: Subscription) -> float | None:
    """The value before the first message, which the declaration of a plain variable may have."""
    declared = specification.declaration(subscription.variable)
    plain = all(field.path == ("data",) for field in subscription.fields)
    return declared.default if declared is not None and plain else None


def _agree(source: Input, subscription: Subscription) -> None:
    """Take the class of a subscription for that of an input that has none yet."""
    if subscription.message is None:
        return
    if source.message is None:
        source.package, source.message = subscription.package, subscription.message
    known = f"{source.package}/{source.message}"
    other = f"{subscription.package}/{subscription.message}"
    if known != other:
        raise SpecificationError(
            f"expected one class of messages on the topic {source.topic}, got {known} as "
            f"'{source.name}' and {other} as '{subscription.variable}'"
        )
