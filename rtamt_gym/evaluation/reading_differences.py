"""Options of two evaluations of recordings that read variables differently."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

from rtamt_gym.evaluation.recording_changes import RecordingSet

_UNREAD: Final = ("sorted",)
"""Options that change no value."""

_NAMED: Final = {"signals": "--signal {}", "starts": "the default of {}", "where": "--where {}"}
"""The options with a value for each name."""

_FLAGS: Final = {"defaults": "--default"}
"""The options with another name than their attribute."""


def reading_differences(a: RecordingSet, b: RecordingSet) -> Iterator[str]:
    """Yield each option with which A and B read columns differently, with both values.

    A column or a default of a variable that only one side reads counts if a requirement of both
    has that variable, or if that side has no requirement of its own.
    """
    one, two = (side.reading.get("columns") or {} for side in (a, b))
    for key in dict.fromkeys([*one, *two]):
        if key in _UNREAD or one.get(key) == two.get(key):
            continue
        if key in _NAMED:
            yield from _named_differences(key, one.get(key) or {}, two.get(key) or {}, a, b)
        else:
            option = _FLAGS.get(key, f"--{key.replace('_', '-')}")
            yield _difference(option, one.get(key), two.get(key))


def _named_differences(
    key: str, one: Mapping[str, Any], two: Mapping[str, Any], a: RecordingSet, b: RecordingSet
) -> Iterator[str]:
    for name in dict.fromkeys([*one, *two]):
        usual = name if key == "signals" else None
        values = one.get(name, usual), two.get(name, usual)
        alone = key != "where" and ((name in one) != (name in two))
        own = (a, b) if name in one else (b, a)
        if values[0] != values[1] and not (alone and _of_own_requirement(name, *own)):
            yield _difference(_NAMED[key].format(name), *values)


def _of_own_requirement(name: str, side: RecordingSet, other: RecordingSet) -> bool:
    """Return whether only requirements that the other side lacks can read a variable."""
    texts, others = side.matrix.requirements, other.matrix.requirements
    word = re.compile(rf"(?<![\w.]){re.escape(name)}(?!\w)")
    return not texts.keys() <= others.keys() and not any(
        word.search(text) for requirement, text in texts.items() if requirement in others
    )


def _difference(option: str, one: object, two: object) -> str:
    texts = [_text(value) for value in (one, two)]
    return f"{option} is {texts[0]} of A and {texts[1]} of B"


def _text(value: object) -> str:
    if value is None:
        return "not set"
    if isinstance(value, list | tuple):
        return " ".join(map(str, value)) or "not set"
    return f"{value:.12g}" if isinstance(value, float) else str(value)
