"""Snapshots of the Python machines, by the names of their fields."""

from __future__ import annotations

from collections import deque
from typing import Any, ClassVar, NoReturn

from rtamt.errors import StateError


def refuse_stale() -> NoReturn:
    """Raise the error about an update of a machine whose monitor has another one."""
    msg = (
        "this update is of a monitor whose __init__ has run again since; take the monitor's "
        "update anew"
    )
    raise StateError(msg)


class Retiring:
    """A machine whose monitor may replace it while somebody still holds its update."""

    __slots__ = ()
    reader: Any

    def retire(self) -> None:
        """Refuse each further update."""
        self.reader = _Retired()

    def require_current(self) -> None:
        """Refuse an update if reading its values has run `retire`."""
        if isinstance(self.reader, _Retired):
            refuse_stale()


class _Retired:
    def __getattr__(self, name: str) -> NoReturn:
        refuse_stale()


class StateFields:
    """An object whose state is the fields that its class names.

    A field is a number, a tuple or array that never changes in place, a list or deque of such
    values, another such object, or a list of such objects, lists or deques. Snapshots share no list
    with the object, and `restore` keeps the objects in fields.

    Attributes:
        STATE: Names of the fields that change between calls; ``reset`` sets their first values.
    """

    __slots__ = ()
    STATE: ClassVar[tuple[str, ...]]

    def reset(self) -> None:
        raise NotImplementedError

    def state(self) -> list[Any]:
        return [_copied(getattr(self, name)) for name in self.STATE]

    def restore(self, state: list[Any]) -> None:
        for name, saved in zip(self.STATE, state, strict=True):
            value = getattr(self, name) if type(saved) is list else None
            if isinstance(value, StateFields):
                value.restore(saved)
            elif value and isinstance(value[0], StateFields):
                for part, part_state in zip(value, saved, strict=True):
                    part.restore(part_state)
            else:
                setattr(self, name, _copied(saved))


def _copied(value: Any) -> Any:  # noqa: ANN401 - whatever a field holds
    if isinstance(value, list | deque):
        if value and isinstance(value[0], StateFields | list | deque):
            return [_copied(part) for part in value]
        return value.copy()
    return value.state() if isinstance(value, StateFields) else value
