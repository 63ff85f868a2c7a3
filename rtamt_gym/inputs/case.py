"""`Case`: the inputs of one simulation, by name."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from numbers import Real
from typing import Any

from rtamt import InputError, InputTypeError
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.waveform import Waveform

__all__ = ["Case"]


class Case(Mapping[str, float | Waveform]):
    """The inputs of one simulation: a number or a waveform for each name; immutable.

    Args:
        entries: Numbers, infinite ones too, and waveforms by name.

    Raises:
        InputError: If a number is nan.
        InputTypeError: If a name is not a text, or an entry neither a number nor a `Waveform`.

    Example:
        >>> case = Case({"mass": 1.5, "throttle": Waveform([0, 5], [80, 20])})
        >>> case["mass"], case["throttle"](7.0)
        (1.5, 20.0)
        >>> case.columns()
        {'mass': 1.5, 'throttle[0]': 80.0, 'throttle[1]': 20.0}
        >>> Case.from_json(case.to_json()) == case
        True
    """

    __slots__ = ("_entries",)

    def __init__(self, entries: Mapping[str, float | Waveform]) -> None:
        if not isinstance(entries, Mapping):
            way_out = "; space.case(point) gives one" if hasattr(entries, "case") else ""
            raise InputTypeError(
                f'expected a case as a mapping such as {{"mass": 1.5}}, got {entries!r}{way_out}'
            )
        self._entries = {_name(name): _entry(name, value) for name, value in entries.items()}

    def __getitem__(self, name: str) -> float | Waveform:
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __hash__(self) -> int:
        return hash(frozenset(self._entries.items()))

    def __repr__(self) -> str:
        return f"Case({self._entries!r})"

    def columns(self) -> dict[str, float]:
        """The case as a row of a table: its numbers, and the values at its control points.

        The columns have the same names as in the `Space` of the case.
        """
        columns: dict[str, float] = {}
        for name, entry in self._entries.items():
            if isinstance(entry, Waveform):
                columns |= {f"{name}[{i}]": value for i, value in enumerate(entry.values)}
            else:
                columns[name] = entry
        return columns

    def to_json(self) -> str:
        """The case as text in JSON; infinite numbers are the texts ``"inf"`` and ``"-inf"``."""
        return json.dumps({name: _written(value) for name, value in self._entries.items()})

    @classmethod
    def from_json(cls, text: str) -> Case:
        """Read the text that `to_json` has written.

        Raises:
            InputError: If it is not JSON, or not a case.
            InputTypeError: If it is not a text; as for a case.
        """
        if not isinstance(text, str):
            raise InputTypeError(f"expected a case as text in JSON, got {text!r}")
        try:
            entries = json.loads(text)
        except json.JSONDecodeError as error:
            raise InputError(f"expected a case in JSON, got {text!r}: {error}") from error
        if not isinstance(entries, dict):
            raise InputError(f'expected a case in JSON such as {{"mass": 1.5}}, got {text!r}')
        return cls({name: _read(name, value) for name, value in entries.items()})


_WAVEFORM = ("times", "values", "interpolation")
"""The keys of a waveform in JSON."""


def _name(name: object) -> str:
    if not isinstance(name, str) or not name:
        raise InputTypeError(f"expected the names of a case as texts, got {name!r}")
    return name


def _entry(name: str, value: object) -> float | Waveform:
    if isinstance(value, Waveform):
        return value
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputTypeError(
            f"expected {name!r} of a case as a number or a waveform such as "
            f"Waveform([0, 5], [1, 2]), got {value!r}"
        )
    if math.isnan(value):
        raise InputError(f"expected {name!r} of a case as a number, got nan")
    return float(value)


def _written(entry: float | Waveform) -> Any:  # noqa: ANN401 - what JSON holds
    if isinstance(entry, Waveform):
        return {key: getattr(entry, key) for key in _WAVEFORM}
    return entry if math.isfinite(entry) else repr(entry)


def _read(name: str, value: Any) -> Any:  # noqa: ANN401 - what JSON holds
    if value in ("inf", "-inf"):
        return float(value)
    if not isinstance(value, dict):
        return value
    if set(value) != set(_WAVEFORM):
        raise InputError(
            f"expected {name!r} in JSON with {listing(_WAVEFORM)}, got {listing(value)}"
        )
    return Waveform(**value)
