"""The parameters of a monitor, for ROS 2 and as options of the command line.

An option is a parameter with ``-`` for ``_``; `rtamt_ros.command` lists the exceptions.

To add a parameter, add a row to `PARAMETERS`, read its value in `read`, and add an option of the
same name to `rtamt_ros.command`. Nodes of ROS 2 then declare it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

import rtamt
from rtamt import InputError, RtamtError, Specification
from rtamt.errors import alternatives, brief, is_one_of
from rtamt_ros.core.judges import Judges
from rtamt_ros.core.settings import Publishers, Settings, StaleAs

Qos = Literal["best_effort", "reliable"]
DEPTH = 100  # 0.1 s of a topic of 1 kHz
UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
"""The units of a period, in nanoseconds."""

PARAMETERS: dict[str, tuple[object, str]] = {
    "spec": ("", "a specification, or a list of specifications"),
    "spec_file": (
        "",
        "a specification file, or a list of files; set it again to read it again",
    ),
    "period": (100, "time between samples, in `unit`"),
    "unit": ("ms", "unit of `period`: s, ms, us or ns"),
    "dense": (False, "monitor in dense time: each message is an event at its time"),
    "stamps": (False, "take the time of a message from its header"),
    "stale": (
        None,
        "seconds until an input is stale, or a list of TOPIC=SECONDS",
    ),
    "stale_as": (
        "restart",
        "effect of a stale input: restart ends the run, unknown continues with unknown values",
    ),
    "semantics": ("standard", "robustness of predicates, as in rtamt.Monitor"),
    "align": ("", "rounding of bounds between samples: outward, inward or nearest"),
    "record": ("", "CSV file for the samples and their robustness"),
    "combined": (
        "",
        "topic for one message per sample with all requirements",
    ),
    "publishers": (
        "any",
        "several publishers of a topic: any warns, one waits until one is left",
    ),
    "qos": (
        "best_effort",
        "subscriptions: best_effort or reliable; set it while the node is inactive",
    ),
    "depth": (DEPTH, "messages of a topic that wait; set it while the node is inactive"),
    "autostart": (True, "configure and activate the node at its start"),
}
"""The default and the meaning of every parameter, by name."""


def read(
    values: Mapping[str, Any], *, runnable: bool = True
) -> tuple[list[Specification], Settings]:
    """Return the specifications and settings of a node.

    Args:
        values: A value for each of `PARAMETERS`, by name.
        runnable: Whether a monitor must be able to run them. Until there is a monitor, parameters
            that are set one by one may not fit together.

    Raises:
        InputError: If a value is wrong, a file cannot be read, or ``stale`` names an unread topic.
        SpecificationError: If a text is wrong, or no monitor can run it; a note names its file.
    """
    choices = {
        "unit": UNITS,
        "qos": get_args(Qos),
        "stale_as": get_args(StaleAs),
        "publishers": get_args(Publishers),
    }
    for name, known in choices.items():
        if not is_one_of(values[name], known):
            raise InputError(f"{name}: expected {alternatives(known)}, got {brief(values[name])}")
    if values["depth"] < 1:
        raise InputError(f"depth: expected 1 message or more, got {values['depth']}")
    stale, stale_of = _stale(values["stale"])
    settings = Settings(
        period=_period(values["period"], values["unit"]),
        dense=values["dense"],
        stamps=values["stamps"],
        stale=stale,
        stale_of=stale_of,
        stale_as=values["stale_as"],
        semantics=values["semantics"],
        align=values["align"] or None,
        record=Path(values["record"]) if values["record"] else None,
        combined=values["combined"],
        publishers=values["publishers"],
    )
    paths = _texts(values, "spec_file")
    specifications = [_loaded(path, settings if runnable else None) for path in paths]
    specifications += [rtamt.parse(text) for text in _texts(values, "spec")]
    if specifications and runnable:
        Judges(specifications, settings)  # raises an error if no monitor can run them
    return specifications, settings


def _loaded(path: str, settings: Settings | None) -> Specification:
    """Return the specification of a file; with settings, check that a monitor can run it."""
    try:
        specification = rtamt.load(path)
    except OSError as error:
        raise InputError(f"spec_file: cannot read {path}: {error.strerror}") from error
    if settings is None:
        return specification
    try:
        Judges([specification], replace(settings, stale_of={}, record=None))
    except RtamtError as error:
        note = f"in {path}"
        if note not in getattr(error, "__notes__", ()):
            error.add_note(note)
        raise
    return specification


def _texts(values: Mapping[str, Any], name: str) -> list[str]:
    """Return the texts of a parameter: one text or a list of texts."""
    value = values[name]
    texts = [value] if isinstance(value, str) else value
    if not isinstance(texts, Sequence) or not all(isinstance(text, str) for text in texts):
        raise InputError(f"{name}: expected a text or a list of texts, got {brief(value)}")
    return [text for text in texts if text]


def _period(value: object, unit: str) -> int:
    """Return the nanoseconds of a period."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise InputError(f"period: expected a number above 0, got {brief(value)}")
    return round(value * UNITS[unit])


def _stale(value: object) -> tuple[float | None, dict[str, float]]:
    """Return the seconds for all topics, and those of single topics."""
    if value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
        return value, {}
    if not isinstance(value, str | Sequence):
        raise InputError(f"stale: expected seconds, or a list of TOPIC=SECONDS, got {brief(value)}")
    by_topic: dict[str, float] = {}
    for item in [value] if isinstance(value, str) else value:
        try:
            topic, _, seconds = item.rpartition("=")
            by_topic[topic] = float(seconds)
        except (AttributeError, ValueError):
            raise InputError(
                f"stale: expected seconds or TOPIC=SECONDS, got {brief(item)}"
            ) from None
    return by_topic.pop("", None), by_topic
