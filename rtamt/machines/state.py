"""Snapshots of the Python machines: a class names the fields that are its state."""

from __future__ import annotations

from collections import deque
from typing import Any, ClassVar

__all__ = ["StateFields"]


class StateFields:
    """Copies the fields that a class names into a snapshot and back.

    A field holds a number, a tuple or array that is never changed in place, a list or deque of
    such values, a part with state fields of its own, or a list of parts or deques. Parts stay the
    same objects when they are restored.

    Attributes:
        STATE: Names of the fields that change from one call to the next.
    """

    __slots__ = ()
    STATE: ClassVar[tuple[str, ...]]

    def state(self) -> list[Any]:
        return [_copied(getattr(self, name)) for name in self.STATE]

    def restore(self, state: list[Any]) -> None:
        for name, saved in zip(self.STATE, state, strict=True):
            match getattr(self, name):
                case StateFields() as part:
                    part.restore(saved)
                case [StateFields(), *_] as parts:
                    for part, its in zip(parts, saved, strict=True):
                        part.restore(its)
                case _:
                    setattr(self, name, _copied(saved))


def _copied(value: Any) -> Any:  # noqa: ANN401 - whatever a field holds
    match value:
        case StateFields():
            return value.state()
        case [StateFields() | deque(), *_]:
            return [_copied(part) for part in value]
        case list() | deque():
            return value.copy()
        case _:
            return value
