"""`--stage`: names the stages of requirements for their progress."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from rtamt import InputError, Specification
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.options.command_line import Option

if TYPE_CHECKING:
    from rtamt_gym.commands.traces import TracesAsked


STAGE = Option(
    "--stage [NAME:] FORMULA",
    "a stage of the requirement for its progress, in order; of several requirements with "
    "the name: --stage 'task: near > 0' --stage 'task: lifted > 0'",
    default=argparse.SUPPRESS,
    usual="the stages of a requirement that is in order",
    repeat=True,
    dest="stages",
)


def with_stages(asked: TracesAsked) -> TracesAsked:
    """What is asked for, with the stages by the names of their requirements.

    Raises:
        InputError: If stages are not of one requirement each, or do not fit it.
        SpecificationError: If one is wrong.
    """
    from rtamt_gym.judging.stages import stages_of

    texts = asked.reading.stages
    if texts is None or isinstance(texts, Mapping):
        return asked
    named: dict[str, list[str]] = {}
    for text in map(str, texts):
        name, stage = _divided(text, asked.specs)
        named.setdefault(name, []).append(stage)
    reading = asked.reading.having(stages=named)
    found = stages_of(asked.specs, reading)
    for name in named:
        if reading.dense and found[name].deciders:
            raise InputError(
                f"--stage: stages of {name!r} look at other times, such as those of operators with "
                "an interval; in dense time a stage is reached at an event, by what holds then; "
                "leave out such operators, or --dense"
            )
    return replace(asked, reading=reading)


def _divided(text: str, specs: Mapping[str, Specification]) -> tuple[str, str]:
    """The requirement of a stage, and its formula."""
    name, colon, stage = (part.strip() for part in text.partition(":"))
    if colon and name in specs:
        return name, stage
    if colon and re.fullmatch(r"[\w.-]+", name):  # not the colon of an interval
        raise InputError(
            f"--stage: expected the name of a requirement, {listing(specs)}, got {name!r}"
            f"{nearest(name, specs)}"
        )
    if len(specs) == 1:
        return next(iter(specs)), text
    raise InputError(
        "--stage: expected the name of a requirement before the formula, as in "
        f"'{next(iter(specs))}: {text}', for there are several: {listing(specs)}"
    )
