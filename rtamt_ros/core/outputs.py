"""On which topics, and as which messages, the robustness of requirements is published."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from rtamt import SpecificationError
from rtamt.language import Publication
from rtamt_ros.core.requirements import SubscribedRequirement

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


def outputs_of(
    requirements: Sequence[SubscribedRequirement], *, dense: bool = False
) -> list[Output]:
    """The topics of requirements, and of the formulas with names that they use.

    Formulas that are named after fields of one message, ``out.value`` and ``out.part``, are on one
    topic, which ``out`` names. A default topic that is taken gets a number: ``rtamt/out_2``.

    Raises:
        SpecificationError: If two results, or formulas of two texts, were given one topic, a
            result the topic of an input of its text, or a formula the name of a whole message; in
            dense time, if formulas are named after several fields of one message.
    """
    made: dict[tuple[int, str], Output] = {}
    taken = {topic for each in requirements for topic in each.specification.topics.values()}
    for requirement in requirements:
        found = requirement.specification.publications(requirement.name)
        for each in found:
            key = (requirement.origin, each.variable)
            if key not in made:
                topic = each.topic or _free(each.default, taken)
                _refuse_no_number(each)
                _refuse_twice(topic, made.values(), each.variable)
                _refuse_loop(topic, requirement, each.variable)
                made[key] = Output(topic, each.package, each.message)
            is_result = each is found[-1]
            known = {formula for _, formula in made[key].formulas}
            if is_result or each.formula not in known:
                name = "" if is_result else each.formula
                made[key].formulas[requirement.name, name] = each.path
    for (_, variable), output in made.items():
        if dense:
            _refuse_several(variable, output)
    return list(made.values())


def bound_topics(outputs: Sequence[Output]) -> dict[str, str]:
    """The topic of each requirement below which its bounds and its verdict are published."""
    topics = {}
    for output in outputs:
        results = {name: path for (name, formula), path in output.formulas.items() if not formula}
        for name, path in results.items():
            topics[name] = output.topic
            if len(results) > 1:
                topics[name] = "/".join((output.topic, *path))
    return topics


def _free(topic: str, taken: set[str]) -> str:
    """A default topic, with a number if it is taken."""
    numbered = (f"{topic}_{count}" for count in itertools.count(2))
    free = next(each for each in itertools.chain((topic,), numbered) if each not in taken)
    taken.add(free)
    return free


def _refuse_no_number(found: Publication) -> None:
    if not found.path:
        name = found.variable
        raise SpecificationError(
            f"expected a field of the message '{name}' as the name of a formula, such as "
            f"{name}.value, got '{name}' itself; a {found.package}/{found.message} is no number"
        )


def _refuse_twice(topic: str, made: Iterable[Output], name: str) -> None:
    for other in made:
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
