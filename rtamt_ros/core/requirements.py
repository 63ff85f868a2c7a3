"""The requirements of a node, and their topics."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from rtamt import Formula, InputError, Specification, SpecificationError
from rtamt.errors import nearest
from rtamt.language import Publication, Subscription
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.settings import Settings


@dataclass(frozen=True, slots=True)
class SubscribedRequirement:
    """A requirement of a specification, and the inputs of its variables.

    Attributes:
        name: Its name, unique in the node.
        specification: The requirement alone, with the formulas that it uses.
        cells: For each variable an input, and the place in its values.
        inputs: The inputs that it reads.
        origin: The index of its specification in the node.
    """

    name: str
    specification: Specification
    cells: Mapping[str, tuple[Input, int]]
    inputs: tuple[Input, ...]
    origin: int


def requirements_of(
    specifications: Iterable[Specification], settings: Settings
) -> tuple[SubscribedRequirement, ...]:
    """Return the requirements of specifications, with the inputs that they read.

    Requirements that read the same fields of a topic share an input. Otherwise, each has its own
    input, so an unreadable field affects no others. Equal names get a number: ``out``, ``out_2``.

    Raises:
        SpecificationError: If a topic has two message classes, or no class.
        InputError: If a setting names a topic that no requirement reads.
    """
    requirements: dict[str, SubscribedRequirement] = {}
    for origin, specification in enumerate(specifications):
        for title, part in specification.requirements.items():
            numbered = (f"{title}_{count}" for count in itertools.count(2))
            candidates = itertools.chain((title,), numbered)
            name = next(candidate for candidate in candidates if candidate not in requirements)
            cells = _cells(part, settings)
            inputs = tuple(dict.fromkeys(source for source, _ in cells.values()))
            requirements[name] = SubscribedRequirement(name, part, cells, inputs, origin)
    _check(
        [source for requirement in requirements.values() for source in requirement.inputs], settings
    )
    return _sharing(requirements.values())


def _sharing(requirements: Iterable[SubscribedRequirement]) -> tuple[SubscribedRequirement, ...]:
    """Return the requirements; those that read the same fields of a topic share an input."""
    known: dict[object, Input] = {}

    def shared(source: Input) -> Input:
        fields = tuple((field.variable, field.path) for field in source.fields)
        return known.setdefault((source.name, source.topic, source.default, fields), source)

    return tuple(
        replace(
            requirement,
            cells={
                name: (shared(source), index) for name, (source, index) in requirement.cells.items()
            },
            inputs=tuple(map(shared, requirement.inputs)),
        )
        for requirement in requirements
    )


def _cells(specification: Specification, settings: Settings) -> dict[str, tuple[Input, int]]:
    """Return the input of each variable, and its place among the values of the input."""
    inputs: dict[tuple[str, float | None], Input] = {}
    cells = {}
    for subscription in specification.subscriptions():
        topic, variable = subscription.topic, subscription.variable
        default = _default(specification, subscription)
        source = inputs.setdefault((topic, default), Input(variable, topic, settings, default))
        _agree(source, subscription.package, subscription.message, variable)
        for field in subscription.fields:
            cells[field.variable] = (source, source.add(field))
    return cells


def unbounded(specification: Specification, formula: Formula | None = None) -> str:
    """Return "always" or "eventually" if that is the unbounded outer operator; otherwise ""."""
    formula = specification.formula if formula is None else formula
    begin, end = specification.bounds(formula.interval)
    single = formula.op is not None and formula.op.name in ("always", "eventually")
    return formula.op.name if formula.op and single and begin == 0 and end is None else ""


def _check(inputs: Collection[Input], settings: Settings) -> None:
    """Raise an error for a topic without one class, or for a setting of an unread topic."""
    first: dict[str, Input] = {}
    for source in inputs:  # prefer an input with a known class
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
                f"The message '{source.name}' has no class. Declare one: from PACKAGE.msg "
                f"import CLASS, then input CLASS {source.name}"
            )
    for topic in settings.stale_of:
        if topic not in first:
            hint = nearest(topic, first) or f"; the topics are {', '.join(first)}"
            raise InputError(f"stale: no specification reads the topic {topic}{hint}")


def _default(specification: Specification, subscription: Subscription) -> float | None:
    """Return the value before the first message, if a plain variable declares one."""
    values = {specification.defaults.get(field.variable) for field in subscription.fields}
    return values.pop() if len(values) == 1 else None


def _agree(source: Input, package: str | None, message: str | None, name: str) -> None:
    """Set the message class of an input from the variable ``name``; a second class is an error."""
    if message is None:
        return
    if source.message is None:
        source.package, source.message = package, message
    first, second = f"{source.package}/{source.message}", f"{package}/{message}"
    if first != second:
        raise SpecificationError(
            f"expected one class of messages on the topic {source.topic}, got {first} as "
            f"'{source.name}' and {second} as '{name}'"
        )


@dataclass(slots=True)
class Output:
    """A topic, and the formulas whose robustness is published on it.

    Attributes:
        topic: The topic, as in the specification or derived from a name.
        package: The package of the message class.
        message: The name of the message class.
        formulas: The path to the field of each requirement and formula; the formula ``""`` is the
            result.
    """

    topic: str
    package: str = "std_msgs"
    message: str = "Float64"
    formulas: dict[tuple[str, str], tuple[str, ...]] = dataclasses.field(default_factory=dict)


def outputs_of(
    requirements: Sequence[SubscribedRequirement], *, dense: bool = False
) -> list[Output]:
    """Return the topics of requirements and of the named formulas that they use.

    Formulas that are named after fields of one message, ``out.value`` and ``out.part``, share the
    topic of ``out``. A default topic that exists gets a number: ``rtamt/out_2``.

    Raises:
        SpecificationError: If two results, or formulas of two texts, have one topic; if a result
            has the topic of its own input; if a formula has the name of a message; in dense time,
            if formulas are named after several fields of one message.
    """
    outputs: dict[tuple[int, str], Output] = {}
    topics = {
        topic for requirement in requirements for topic in requirement.specification.topics.values()
    }
    for requirement in requirements:
        publications = requirement.specification.publications(requirement.name)
        for publication in publications:
            key = (requirement.origin, publication.variable)
            if key not in outputs:
                topic = publication.topic or _free(publication.default, topics)
                _refuse_no_number(requirement.specification, publication)
                _refuse_twice(topic, outputs.values(), publication.variable)
                _refuse_loop(topic, requirement, publication.variable)
                outputs[key] = Output(topic, publication.package, publication.message)
            is_result = publication is publications[-1]
            formulas = {formula for _, formula in outputs[key].formulas}
            if is_result or publication.formula not in formulas:
                name = "" if is_result else publication.formula
                outputs[key].formulas[requirement.name, name] = publication.path
    for (_, variable), output in outputs.items():
        if dense:
            _refuse_several(variable, output)
    return list(outputs.values())


def bound_topics(outputs: Sequence[Output]) -> dict[str, str]:
    """Return the topic below which the bounds and the verdict of each requirement are published."""
    topics = {}
    for output in outputs:
        results = {name: path for (name, formula), path in output.formulas.items() if not formula}
        for name, path in results.items():
            topics[name] = output.topic
            if len(results) > 1:
                topics[name] = "/".join((output.topic, *path))
    return topics


def _free(topic: str, topics: set[str]) -> str:
    """Add a default topic to topics and return it, with a number if it exists."""
    numbered = (f"{topic}_{count}" for count in itertools.count(2))
    free = next(name for name in itertools.chain((topic,), numbered) if name not in topics)
    topics.add(free)
    return free


def _refuse_no_number(specification: Specification, publication: Publication) -> None:
    if not publication.path:
        name = publication.variable
        kind = f"{publication.package}/{publication.message}"
        reason = f"the formula '{name}' has the name of a message, but a {kind} is not a number"
        hint = f"name the formula after a field, such as {name}.value"
        raise specification.name_error(name, reason, hint)


def _refuse_twice(topic: str, outputs: Iterable[Output], name: str) -> None:
    for other in outputs:
        if other.topic == topic:
            raise SpecificationError(
                f"expected a topic for '{name}' on which nothing else is published, got {topic}; "
                f"write another: @ topic({name}, PATH)"
            )


def _refuse_several(variable: str, output: Output) -> None:
    if len(output.formulas) > 1:
        fields = [".".join((variable, *path)) for path in output.formulas.values()]
        raise SpecificationError(
            f"expected one field of the message '{variable}' in dense time, got "
            f"{' and '.join(fields)}, whose values change at different times; declare a message "
            "for each, or sample"
        )


def _refuse_loop(topic: str, requirement: SubscribedRequirement, name: str) -> None:
    for source in requirement.inputs:
        if source.topic == topic:
            raise SpecificationError(
                f"'{name}' is published on {topic}, the topic of its own input '{source.name}'. "
                f"Write another topic: @ topic({name}, PATH)"
            )
