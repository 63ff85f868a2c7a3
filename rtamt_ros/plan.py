"""The specifications of a node, checked before it starts."""

from __future__ import annotations

from collections.abc import Sequence

from rtamt import InputError, Specification, parse
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.judges import Judges
from rtamt_ros.core.publishing import BOUNDS
from rtamt_ros.core.requirements import bound_topics, outputs_of
from rtamt_ros.core.settings import Settings
from rtamt_ros.messages import check_input, check_output
from rtamt_ros.middleware import Middleware

COMBINED = ("diagnostic_msgs", "DiagnosticArray")


class Plan:
    """Everything that a node needs before it starts, checked."""

    def __init__(
        self,
        middleware: Middleware,
        specifications: Sequence[str | Specification],
        settings: Settings,
    ) -> None:
        self.settings = settings
        self.specifications = tuple(
            parse(specification) if isinstance(specification, str) else specification
            for specification in specifications
        )
        if not self.specifications:
            raise InputError("expected a specification or more, got none")
        judges = self.judges()
        self.outputs = outputs_of(judges.requirements, dense=self.settings.dense)
        self.lateness = judges.lateness
        self.bounds = bound_topics(self.outputs)
        self.topics = {name: topic.inputs[0] for name, topic in judges.topics.items()}
        self.formulas = {
            requirement.name: str(requirement.specification.formula)
            for requirement in judges.requirements
        }
        wanted = {("std_msgs", message) for message in BOUNDS.values()}
        wanted |= {(each.package, each.message) for each in self.outputs}
        wanted |= {class_of(each) for each in judges.inputs}
        wanted |= {COMBINED} if self.settings.combined else set()
        self.classes = {each: middleware.message_class(*each) for each in sorted(wanted)}
        parts = {each.name: each.specification for each in judges.requirements}
        for requirement in judges.requirements:
            for subscription in requirement.specification.subscriptions():
                for field in subscription.fields:
                    key = class_of(requirement.cells[field.variable][0])
                    check_input(requirement.specification, field, self.classes[key], "/".join(key))
        for output in self.outputs:
            key = output.package, output.message
            for (name, formula), path in output.formulas.items():
                title = formula or parts[name].publications(name)[-1].formula
                check_output(parts[name], title, path, self.classes[key], "/".join(key))

    def judges(self) -> Judges:
        """Return new judges."""
        return Judges(self.specifications, self.settings)

    def of(self, source: Input) -> type:
        """Return the message class of an input."""
        return self.classes[class_of(source)]

    def refuse_two_types(self, middleware: Middleware) -> None:
        """Refuse topics that remappings join if their message classes differ."""
        known: dict[str, tuple[str, str]] = {}
        topics = [(name, class_of(source)) for name, source in self.topics.items()]
        topics += [(output.topic, (output.package, output.message)) for output in self.outputs]
        if combined := self.settings.combined:
            topics.append((combined, COMBINED))
            if middleware.resolve(combined) == "/diagnostics":
                raise InputError(
                    "combined: expected a topic of its own, got /diagnostics, where all nodes say "
                    "their states; write another, such as rtamt/all"
                )
        for topic, kind in topics:
            full = middleware.resolve(topic)
            other = known.setdefault(full, kind)
            if other != kind:
                raise InputError(
                    f"expected one type of messages on {full}, got {'/'.join(other)} and "
                    f"{'/'.join(kind)}"
                )


def class_of(source: Input) -> tuple[str, str]:
    """Return the package and the name of the message class of an input."""
    return source.package or "", source.message or ""
