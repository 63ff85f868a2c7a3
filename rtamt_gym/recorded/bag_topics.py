"""The topics and fields of a bag that specifications read."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import rtamt
from rtamt import InputError
from rtamt.errors import near_name, nearest
from rtamt.language import SubscribedField, Subscription
from rtamt_gym.checks.names import listing
from rtamt_gym.recorded.columns import Columns, FieldError, FieldPath, path_text, read_source
from rtamt_gym.recorded.names import starts_of

if TYPE_CHECKING:
    from rtamt_gym.recorded.bag_reader import Bag


@dataclass(frozen=True, slots=True)
class TopicFields:
    """A topic of a bag, and the fields that specifications read.

    Attributes:
        topic: The name of the topic in the bag.
        fields: The variables that are fields of its messages.
    """

    topic: str
    fields: tuple[SubscribedField, ...]


@dataclass(frozen=True, slots=True)
class _Wish:
    """The declaration of a message or a plain variable in a specification.

    Attributes:
        topic: The topic in the text, or None.
        kind: The declared class, or None.
        default: The topic if no text names a topic.
    """

    topic: str | None = None
    kind: str | None = None
    default: str = ""

    @property
    def whole(self) -> str:
        """The topic in the text, or the default."""
        return self.topic or self.default

    def joined(self, other: _Wish, name: str) -> _Wish:
        """Return the combined declaration of two texts."""
        wishes: dict[str, tuple[object, object]] = {
            "topic": (self.topic, other.topic),
            "class": (self.kind, other.kind),
        }
        for phrase, (here, there) in wishes.items():
            if here is not None and there is not None and here != there:
                raise InputError(
                    f"expected one {phrase} for '{name}', which two specifications read, got "
                    f"{here} and {there}; rename one variable, or judge the specifications "
                    "separately"
                )
        return _Wish(self.topic or other.topic, self.kind or other.kind, self.default)


def topic_fields(
    bag: Bag, specs: Mapping[str, rtamt.Specification], columns: Columns
) -> list[TopicFields]:
    """Return the topics of a bag that specifications read, each with its variables.

    A variable with a default is omitted if its topic is missing or empty.
    """
    fields_of: dict[str, list[SubscribedField]] = {}
    wishes, parts = _wishes(specs)
    starts = starts_of(specs, columns)
    for variable, (message, path) in parts.items():
        wish = wishes[message]
        unnamed = variable not in columns.signals
        if (variable in starts and unnamed) or variable in columns.starts:
            where, _ = read_source(columns.signals.get(variable) or wish.whole)
            if not any(bag.counts[topic] for topic in _alike(bag, where)):
                named = where if wish.topic else where.rpartition("/")[2]
                _check_near(bag, variable, named, wishes, columns)
                continue
        topic, full_path = _placed(bag, variable, message, path, wish, columns)
        fields = bag.fields(topic)
        if full_path == _DATA and fields and "data" not in fields:
            raise InputError(
                f"{bag.source}: expected a field of the messages on {topic}, each a "
                f"{bag.types[topic]}, for '{variable}', got none; give --signal "
                f"{variable}={topic}.FIELD; its fields are {', '.join(fields)}"
            )
        try:
            _check_number(bag, topic, full_path, variable)
        except FieldError as error:
            if variable in columns.signals or message in columns.signals:
                raise
            spec = next(spec for spec in specs.values() if variable in spec.variables)
            part = error.depth - len(full_path)
            raise spec.name_error(variable, error.reason, error.hint, part=part) from None
        fields_of.setdefault(topic, []).append(SubscribedField(variable, full_path))
    heard = {field.variable for fields in fields_of.values() for field in fields}
    for spec in specs.values():
        if spec.variables and heard.isdisjoint(spec.variables):
            raise InputError(
                f"{bag.source}: expected messages with {listing(spec.variables)}, got none: "
                f"defaults alone are not a trace; the topics are {_listed(bag.types)}"
            )
    return [TopicFields(topic, tuple(fields)) for topic, fields in fields_of.items()]


def _check_number(bag: Bag, topic: str, path: FieldPath, variable: str) -> None:
    """Raise FieldError if a path does not lead to a number in the messages of a topic."""
    if message := bag.class_at(topic, path):
        reason = (
            f"{bag.source}: expected a number for '{variable}', got '{path_text(path)}' of "
            f"{topic}, a {message}"
        )
        raise FieldError(len(path) - 1, reason, "write a field of it")


def _check_near(
    bag: Bag, variable: str, where: str, wishes: Mapping[str, _Wish], columns: Columns
) -> None:
    """Raise InputError if a topic may be a misspelt name of a variable with a default."""
    if variable in columns.defaults:
        return
    others = {columns.signals.get(name, wish.whole) for name, wish in wishes.items()}
    read = {topic for source in others for topic in _alike(bag, read_source(source)[0])}
    free = [topic for topic in bag.types if bag.counts[topic] and topic not in read]
    parts = 1 + where.strip("/").count("/")  # a text may omit the start of a topic
    ends = {"/".join(topic.split("/")[-parts:]): topic for topic in free}
    near = near_name(where, ends)
    if near is not None:
        raise InputError(
            f"{bag.source}: no topic '{where}', which '{variable}' has a default for, but "
            f"'{ends[near]}'; give --signal {variable}={ends[near]}.FIELD to read it, or --default "
            f"{variable} to take the default"
        )


def check_topics(specs: Mapping[str, rtamt.Specification]) -> None:
    """Raise an error if specifications declare a shared topic differently."""
    _wishes(specs)


def columns_of(specs: Mapping[str, rtamt.Specification], columns: Columns) -> Columns:
    """Return the columns with the topic and field of each variable that the texts name.

    These columns also serve formulas without the declarations, such as mutants.
    """
    wishes, parts = _wishes(specs)
    signals = dict(columns.signals)
    for variable, (message, path) in parts.items():
        if variable not in signals and message not in signals:
            signals[variable] = f"{wishes[message].whole}.{path_text(path)}"
    return replace(columns, signals=signals)


_DATA: FieldPath = ("data",)
"""Where the messages of ``std_msgs`` hold their number."""


def _wishes(
    specs: Mapping[str, rtamt.Specification],
) -> tuple[dict[str, _Wish], dict[str, tuple[str, FieldPath]]]:
    """Return the declaration of each message, and the message and path of each variable."""
    wishes: dict[str, _Wish] = {}
    parts: dict[str, tuple[str, FieldPath]] = {}
    for spec in specs.values():
        for subscription in spec.subscriptions():
            name = subscription.variable
            wish = _Wish(spec.topics.get(name), _class_of(subscription, spec), subscription.topic)
            wishes[name] = wish if name not in wishes else wishes[name].joined(wish, name)
            parts |= {field.variable: (name, field.path) for field in subscription.fields}
    return wishes, parts


def _class_of(subscription: Subscription, spec: rtamt.Specification) -> str | None:
    """Return the class that a text declares; None for a variable without a declaration."""
    return (
        f"{subscription.package}/{subscription.message}"
        if subscription.variable in spec.declarations
        else None
    )


def _placed(
    bag: Bag, variable: str, message: str, path: FieldPath, wish: _Wish, columns: Columns
) -> tuple[str, FieldPath]:
    """Return the topic of a variable in the bag, and its path there."""
    source = columns.signals.get(variable)
    if source is not None and variable != message:
        wish, path = _Wish(), ()  # a field with its own source
    else:
        source = columns.signals.get(message)
    where, prefix = read_source(source or wish.whole)
    topic = _topic(
        bag, where, message, None if prefix else wish.kind, named=bool(source or wish.topic)
    )
    if prefix and variable == message:
        wish, path = _Wish(), ()  # the number itself, not a message that holds it
    _check_class(bag, topic, prefix, wish, message)
    return topic, (*prefix, *path) or _DATA


def _alike(bag: Bag, written: str) -> list[str]:
    """Return the topics of a bag that match a name."""
    known = {f"/{topic.lstrip('/')}": topic for topic in bag.types}
    full_name = f"/{written.lstrip('/')}"
    if full_name in known:
        return [known[full_name]]
    if written.startswith("/"):
        return []
    return [topic for name, topic in known.items() if name.endswith(full_name)]


def _topic(bag: Bag, written: str, variable: str, kind: str | None, *, named: bool) -> str:
    """Return the only topic of a bag that matches a name."""
    similar, full_name = _alike(bag, written), f"/{written.lstrip('/')}"
    if not similar:
        known = {f"/{topic.lstrip('/')}" for topic in bag.types}
        raise InputError(
            f"{bag.source}: no topic '{written}', which '{variable}' reads; the topics are "
            f"{_listed(known)}{_hint(bag, full_name, variable, kind, named=named)}"
        )
    if len(similar) > 1:
        raise InputError(
            f"{bag.source}: expected one topic that ends in '{full_name}', which '{variable}' "
            f"reads, got {_listed(similar)}; give --signal {variable}=TOPIC"
        )
    (topic,) = similar
    if not bag.counts[topic]:
        raise InputError(
            f"{bag.source}: expected messages on {topic}, which '{variable}' reads, got none"
        )
    return topic


def _hint(bag: Bag, full_name: str, variable: str, kind: str | None, *, named: bool) -> str:
    """Return advice for a missing topic."""
    known = {f"/{topic.lstrip('/')}": message_class for topic, message_class in bag.types.items()}
    near = nearest(full_name, known)
    if near and named:
        return near
    last = variable.rpartition(".")[2]
    message = kind is not None and not kind.startswith("std_msgs/")
    similar = (
        [name for name, message_class in known.items() if message_class == kind] if message else []
    )
    candidates = [name for name in known if name.endswith(f"/{last}")] or similar
    source = "TOPIC" if message else "TOPIC.FIELD"
    return f"; give --signal {variable}={candidates[0] if len(candidates) == 1 else source}"


_MOST = 12
"""Names of topics in a message."""


def _listed(topics: Collection[str]) -> str:
    names = sorted(topics)
    more = f" and {len(names) - _MOST} more" if len(names) > _MOST else ""
    return f"{', '.join(names[:_MOST])}{more}" or "none"


def _check_class(bag: Bag, topic: str, prefix: FieldPath, wish: _Wish, message: str) -> None:
    """Check that messages have the declared class.

    All messages of ``std_msgs`` with a number are equivalent, because their values become doubles.
    """
    got = bag.class_at(topic, prefix)
    if wish.kind is None or got == wish.kind:
        return
    if f"{got}".startswith("std_msgs/") and wish.kind.startswith("std_msgs/"):
        return
    held = f"'{path_text(prefix)}' of {topic}" if prefix else topic
    raise InputError(
        f"{bag.source}: expected {wish.kind} on {held}, as '{message}' is declared, got {got}"
    )
