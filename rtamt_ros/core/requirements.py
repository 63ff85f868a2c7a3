"""The requirements of a node, and the topics that they read and publish."""

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
        origin: The index of its specification.
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

    Requirements that read the same fields of a topic share an input. Other requirements have their
    own, so an unreadable field affects only them. Equal names get a number: ``out``, ``out_2``.

    Raises:
        SpecificationError: If a topic has no message class, or two.
        InputError: If a setting names a topic that nothing reads.
    """
    requirements: dict[str, SubscribedRequirement] = {}
    for origin, specification in enumerate(specifications):
        for title, part in specification.requirements.items():
            numbered = (f"{title}_{count}" for count in itertools.count(2))
            candidates = itertools.chain((title,), numbered)
            name = next(candidate for candidate in candidates if candidate not in requirements)
            cells = _cells(part, settings)
            read = tuple(dict.fromkeys(source for source, _ in cells.values()))
            requirements[name] = SubscribedRequirement(name, part, cells, read, origin)
    _check(
        [source for requirement in requirements.values() for source in requirement.inputs], settings
    )
    return _sharing(requirements.values())


def _sharing(requirements: Iterable[SubscribedRequirement]) -> tuple[SubscribedRequirement, ...]:
    """Return the requirements with one input for all that read the same fields of a topic."""
    known: dict[object, Input] = {}

    def shared(source: Input) -> Input:
        fields = tuple((field.variable, field.path) for field in source.fields)
        return known.setdefault((source.name, source.topic, source.default, fields), source)

    return tuple(
        replace(
            requirement,
            cells={name: (shared(of), place) for name, (of, place) in requirement.cells.items()},
            inputs=tuple(map(shared, requirement.inputs)),
        )
        for requirement in requirements
    )


def _cells(specification: Specification, settings: Settings) -> dict[str, tuple[Input, int]]:
    """Return the input of each variable, and its place among the values of the input."""
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
    """Return "always" or "eventually" if the formula is it without bounds; otherwise ""."""
    formula = specification.formula if formula is None else formula
    begin, end = specification.bounds(formula.interval)
    single = formula.op is not None and formula.op.name in ("always", "eventually")
    return formula.op.name if formula.op and single and begin == 0 and end is None else ""


def _check(inputs: Collection[Input], settings: Settings) -> None:
    """Refuse topics without a class or with two, and settings of topics that nothing reads."""
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
                f"expected the class of the message '{source.name}', got none; declare it: "
                f"from PACKAGE.msg import CLASS, then input CLASS {source.name}"
            )
    for topic in settings.stale_of:
        if topic not in first:
            hint = nearest(topic, first) or f"; the topics are {', '.join(first)}"
            raise InputError(f"stale speaks of the topic {topic}, which nothing reads{hint}")


def _default(specification: Specification, subscription: Subscription) -> float | None:
    """Return the value before the first message, which a plain variable may declare."""
    values = {specification.defaults.get(field.variable) for field in subscription.fields}
    return values.pop() if len(values) == 1 else None


def _agree(source: Input, package: str | None, message: str | None, name: str) -> None:
    """Give an input the message class of the variable ``name``; refuse a second class."""
    if message is None:
        return
    if source.message is None:
        source.package, source.message = package, message
    name_of_first, other = f"{source.package}/{source.message}", f"{package}/{message}"
    if name_of_first != other:
        raise SpecificationError(
            f"expected one class of messages on the topic {source.topic}, got {name_of_first} as "
            f"'{source.name}' and {other} as '{name}'"
        )


@dataclass(slots=True)
class Output:
    """A topic, and the formulas whose robustness its messages carry.

    Attributes:
        topic: The topic, as in the specification or derived from a name.
        package: The package of the message class.
        message: The name of the message class.
        formulas: For each requirement and formula the path to its field; the result is the formula
            ``""``.
    """

    topic: str
    package: str = "std_msgs"
    message: str = "Float64"
    formulas: dict[tuple[str, str], tuple[str, ...]] = dataclasses.field(default_factory=dict)


def outputs_of(
    requirements: Sequence[SubscribedRequirement], *, dense: bool = False
) -> list[Output]:
    """Return the topics of requirements, and of the named formulas that they use.

    Formulas that are named after fields of one message, ``out.value`` and ``out.part``, share the
    topic of ``out``. A default topic that is taken gets a number: ``rtamt/out_2``.

    Raises:
        SpecificationError: If two results, or formulas of two texts, have one topic, if a result
            has the topic of an input of its text, if a formula has the name of a message; in dense
            time, if formulas are named after several fields of one message.
    """
    outputs: dict[tuple[int, str], Output] = {}
    taken = {
        topic for publication in requirements for topic in publication.specification.topics.values()
    }
    for requirement in requirements:
        publications = requirement.specification.publications(requirement.name)
        for publication in publications:
            key = (requirement.origin, publication.variable)
            if key not in outputs:
                topic = publication.topic or _free(publication.default, taken)
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


def _free(topic: str, taken: set[str]) -> str:
    """Return a default topic, with a number if it is taken."""
    numbered = (f"{topic}_{count}" for count in itertools.count(2))
    free = next(name for name in itertools.chain((topic,), numbered) if name not in taken)
    taken.add(free)
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
                f"expected a topic for '{name}' that nothing else is published on, got {topic}; "
                f"write another: @ topic({name}, PATH)"
            )


def _refuse_several(variable: str, output: Output) -> None:
    if len(output.formulas) > 1:
        fields = [".".join((variable, *path)) for path in output.formulas.values()]
        raise SpecificationError(
            f"expected one field of the message '{variable}' in dense time, got "
            f"{' and '.join(fields)}, whose values change at times of their own; declare a message "
            "for each, or sample"
        )


def _refuse_loop(topic: str, requirement: SubscribedRequirement, name: str) -> None:
    for source in requirement.inputs:
        if source.topic == topic:
            raise SpecificationError(
                f"expected a topic for '{name}' that is not the one of '{source.name}', which it "
                f"reads, got {topic}; write another: @ topic({name}, PATH)"
            )
