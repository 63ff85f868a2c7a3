"""On which topics, and as which messages, the robustness of requirements is published."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from rtamt import Specification, SpecificationError
from rtamt_ros.core.requirements import Requirement

__all__ = ["Output", "bound_topics", "outputs_of"]


@dataclass(slots=True)
class Output:
    """A topic, and the formulas whose robustness its messages hold.

    Attributes:
        topic: The topic, as written in the specification or made of a name.
        package: The package of the class of its messages.
        message: The name of the class.
        formulas: For each requirement and formula of it the path to its field; the result of a
            requirement is the formula ``""``.
    """

    topic: str
    package: str = "std_msgs"
    message: str = "Float64"
    formulas: dict[tuple[str, str], tuple[str, ...]] = field(default_factory=dict)


def outputs_of(requirements: Sequence[Requirement]) -> list[Output]:
    """The topics of requirements, and of the formulas with names that they use.

    Formulas that are named after fields of one message, ``out.value`` and ``out.part``, are on one
    topic, that of ``out``. A default topic that is taken gets a number: ``rtamt/out_2``.

    Raises:
        SpecificationError: If two results, or formulas of two texts, were given one topic, a
            result the topic of an input of its text, or a formula the name of a whole message.
    """
    made: dict[tuple[int, str], Output] = {}
    taken = {topic for each in requirements for topic in each.specification.topics.values()}
    for requirement in requirements:
        spec = requirement.specification
        for name in _names(spec):
            result = name == _result(spec)
            owner, path = _message(spec, name)
            key = (requirement.origin, owner or name or requirement.name)
            if key not in made:
                package, message = _class(spec, owner)
                stem = owner or (requirement.name if result else name)
                topic = spec.topics.get(owner or name) or _free(stem, taken)
                _refuse_twice(topic, made.values(), key[1])
                _refuse_loop(topic, requirement, key[1])
                made[key] = Output(topic, package, message)
            known = {formula for _, formula in made[key].formulas}
            if result or name not in known:
                made[key].formulas[requirement.name, "" if result else name] = path
    return list(made.values())


def bound_topics(outputs: Sequence[Output]) -> dict[str, str]:
    """For each requirement the topic below which its bounds and its verdict are."""
    topics = {}
    for output in outputs:
        results = {name: path for (name, formula), path in output.formulas.items() if not formula}
        for name, path in results.items():
            topics[name] = output.topic
            if len(results) > 1:
                topics[name] = "/".join((output.topic, *path))
    return topics


def _names(spec: Specification) -> Iterator[str]:
    yield from spec.formulas
    if _result(spec) == "":
        yield ""


def _result(spec: Specification) -> str:
    """The name of the result; empty if it has none."""
    named = [name for name, formula in spec.formulas.items() if formula is spec.formula]
    return named[-1] if named else ""


def _message(spec: Specification, name: str) -> tuple[str, tuple[str, ...]]:
    """The declared message that a formula names a field of, and the path to it."""
    steps = name.split(".")
    for end in range(len(steps), 0, -1):
        owner = ".".join(steps[:end])
        declared = spec.declarations.get(owner)
        if declared is not None and declared.type in spec.imports:
            path = tuple(steps[end:])
            if path or _class(spec, owner)[0] == "std_msgs":
                return owner, path or ("data",)
            raise SpecificationError(
                f"expected a field of the message '{owner}' as the name of a formula, such as "
                f"{owner}.value, got '{owner}' itself; a {'/'.join(_class(spec, owner))} is no "
                "number"
            )
    return "", ("data",)


def _class(spec: Specification, owner: str) -> tuple[str, str]:
    if not owner:
        return "std_msgs", "Float64"
    kind = spec.declarations[owner].type
    return spec.imports[kind].removesuffix(".msg"), kind


def _free(stem: str, taken: set[str]) -> str:
    """A topic for a name that no other has; names of ROS have no dots."""
    base = f"rtamt/{stem.replace('.', '/')}"
    numbered = (f"{base}_{count}" for count in itertools.count(2))
    topic = next(each for each in itertools.chain((base,), numbered) if each not in taken)
    taken.add(topic)
    return topic


def _refuse_twice(topic: str, made: Iterable[Output], name: str) -> None:
    for other in made:
        if other.topic == topic:
            raise SpecificationError(
                f"expected a topic for '{name}' that nothing else is published on, got {topic}; "
                f"write another: @ topic({name}, PATH)"
            )


def _refuse_loop(topic: str, requirement: Requirement, name: str) -> None:
    for source in requirement.inputs:
        if source.topic == topic:
            raise SpecificationError(
                f"expected a topic for '{name}' that is not the one of '{source.name}', which it "
                f"reads, got {topic}; write another: @ topic({name}, PATH)"
            )
