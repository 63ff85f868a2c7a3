"""Variables that are fields of messages: reading from the messages of callers, and writing.

``cmd.linear.x`` is the field ``x`` of the field ``linear`` of the message ``cmd``, and
``scan.ranges[0]`` the first element of a list. A message is any object with attributes, or a
mapping; its fields may be either.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import (
    Callable,
    Collection,
    Iterable,
    Iterator,
    Mapping,
    MutableMapping,
    Sequence,
    Sized,
)
from dataclasses import dataclass
from inspect import getattr_static
from typing import Any, TypeVar, cast

from rtamt.errors import InputError, InputTypeError, name_text, nearest
from rtamt.language.declarations import PathStep, is_field, joined, lineage, steps
from rtamt.language.specification import Specification

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Field:
    """A variable as a field of a message.

    Attributes:
        variable: Its dotted name.
        message: The first part of the name: the message.
        path: The other parts: the fields and elements that lead to the value.
        type: The class of the message; None: any. A mapping is accepted instead.
    """

    variable: str
    message: str
    path: tuple[PathStep, ...]
    type: type | None

    def of(self, message: object, place: object, unit: str = "sample") -> Any:  # noqa: ANN401
        """Return the value of the field; errors name the place: a sample or a time."""
        return self._follow(message, self.path, f" at {unit} {place}")

    def holder(self, message: object) -> object:
        """Return the object or mapping in which the field can be set; a mapping may lack it."""
        *path, last = self.path
        holder = self._follow(message, path, "")
        if not isinstance(holder, MutableMapping) and not hasattr(holder, str(last)):
            raise self._absent(holder, len(path), "")
        return holder

    def column(self, message: Mapping[str, object], sample: int) -> object:
        """Return the values of the field in a message whose fields are columns.

        The column of a list has a list per sample: an array of shape (n, elements), or n sequences.
        Errors name the sample; ``sample`` is the number of the first row.
        """
        index = next(
            (i for i, step in enumerate(self.path) if isinstance(step, int)), len(self.path)
        )
        where = f" at sample {sample}"
        column = self._follow(message, self.path[:index], where)
        if index == len(self.path):
            return column
        if isinstance(column, str | bytes) or not isinstance(column, Iterable):
            return self._follow(column, self.path[index:], where, index)
        return [
            self._follow(elements, self.path[index:], f" at sample {i}", index)
            for i, elements in enumerate(column, sample)
        ]

    def _follow(
        self, message: object, path: Iterable[PathStep], where: str, begin: int = 0
    ) -> object:
        value = message
        mapping = isinstance(value, Mapping)
        if not begin and self.type is not None and not mapping and not isinstance(value, self.type):
            raise InputTypeError(
                f"expected a {self.type.__name__} or a mapping for '{self.message}'{where}, "
                f"got {type(value).__name__}"
            )
        for depth, step in enumerate(path, begin):
            try:
                if isinstance(step, int):
                    value = cast("Sequence[object]", value)[step]
                else:
                    value = value[step] if isinstance(value, Mapping) else getattr(value, step)
            except (KeyError, AttributeError, IndexError, TypeError):
                raise self._absent(value, depth, where) from None
        return value

    def _absent(self, holder: object, depth: int, where: str) -> InputError:
        name, step = joined((self.message, *self.path[:depth])), self.path[depth]
        if isinstance(step, int):
            kind = f"'{name}'{where} ({type(holder).__name__})"
            if isinstance(holder, Sized) and hasattr(holder, "__getitem__"):
                return InputError(f"{kind} has {_elements(len(holder))}, none of them [{step}]")
            return InputError(f"{kind} has no elements, expected a list with [{step}]")
        known: list[str] = []
        if isinstance(holder, Mapping):
            known = [name_text(key) for key in holder]
        elif not hasattr(holder, "__float__"):
            methods = {
                n for n in dir(type(holder)) if callable(getattr_static(type(holder), n, None))
            }
            known = [n for n in dir(holder) if n not in methods and not n.startswith("_")]
        near = nearest(step, known)
        if not near and known and len(", ".join(known)) <= _LONG:
            near = f"; its fields are {', '.join(known)}"
        msg = f"'{name}'{where} ({type(holder).__name__}) has no field '{step}'{near}"
        return InputError(msg)


_LONG = 60


def _elements(count: int) -> str:
    return f"{count} element{'' if count == 1 else 's'}"


class Messages:
    """The fields of messages among names, such as the variables of a specification.

    Attributes:
        names: The messages that a caller can pass: ``cmd.linear`` and ``cmd`` for ``cmd.linear.x``,
            unless they are variables themselves; a list too.
    """

    __slots__ = ("_fields", "names")

    def __init__(self, specification: Specification, names: Collection[str]) -> None:
        self._fields = {
            name: tuple(_fields(name, specification)) for name in names if is_field(name)
        }
        self.names: frozenset[str] = frozenset()
        if self._fields:
            messages = {f.message for fields in self._fields.values() for f in fields}
            self.names = frozenset(messages.difference(names))

    def spread(
        self, named: Mapping[str, _T], split: Callable[[Field, _T], object]
    ) -> dict[str, object]:
        """Return the mapping with the fields of its messages in place of the messages.

        A field is split from the innermost of its messages that is present.
        """
        spread: dict[str, object] = {n: v for n, v in named.items() if n not in self.names}
        for variable, fields in self._fields.items():
            if variable not in named:
                for field in fields:
                    if field.message in named:
                        spread[variable] = split(field, named[field.message])
                        break
        return spread

    def under(self, message: str) -> Iterator[Field]:
        """Yield the fields of a message."""
        for fields in self._fields.values():
            yield from (field for field in fields if field.message == message)


def _fields(variable: str, specification: Specification) -> Iterator[Field]:
    """Yield a variable as a field of each of its messages, the innermost first."""
    path = steps(variable)
    for message in itertools.islice(lineage(variable), 1, None):
        declared = specification.declarations.get(message)
        cls = None if declared is None else specification.types.get(declared.type)
        yield Field(variable, message, path[len(steps(message)) :], cls)


def write_fields(
    specification: Specification,
    values: Mapping[str, float],
    messages: Mapping[str, object] | None,
    named: Mapping[str, object],
) -> bool:
    """Set fields of messages to the values of the formulas with their names.

    Nothing is written if a message is refused.

    Returns:
        Whether every written value is a number.
    """
    if not isinstance(messages, Mapping | None):
        raise InputTypeError(
            f"expected messages by name, as in write(out=message), got {type(messages).__name__}"
        )
    fields = Messages(specification, values)
    targets: list[tuple[Field, object]] = []
    for name, message in {**(messages or {}), **named}.items():
        here = [(field, field.holder(message)) for field in fields.under(name)]
        if not here:
            shown = name_text(name)
            known = f"; write {shown}.value = FORMULA"
            if fields.names:
                known = f"; they name fields of {', '.join(sorted(fields.names))}"
            raise InputError(f"no formula names a field of '{shown}'{known}")
        targets += here
    for field, holder in targets:
        try:
            if isinstance(holder, MutableMapping):
                holder[field.path[-1]] = values[field.variable]
            else:
                setattr(holder, str(field.path[-1]), values[field.variable])
        except (AttributeError, TypeError) as error:
            raise InputTypeError(f"'{field.variable}' cannot be set: {error}") from error
    return not any(math.isnan(values[field.variable]) for field, _ in targets)
