"""The outcomes of a record as lines for the terminal and as JSON for programs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from textwrap import wrap
from typing import Any, Final

from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.results.codec import document, plain_results
from rtamt_gym.results.statistics import columns_of
from rtamt_gym.results.trial import end_note
from rtamt_gym.search.runs.record import Record
from rtamt_gym.tables import counted, number, shorten, table

__all__ = ["case_lines", "failures", "summary", "to_json"]

_ERROR: Final = 200
"""The most letters of an error that are shown."""


def summary(record: Record) -> list[str]:
    """A table with a row for every requirement: its robustness over the record, and its verdicts.

    Below it stand what was simulated and how many failed.
    """
    results = list(record.results().values())
    columns = columns_of(results, rates=False)
    rows = [["requirement", *(each.heading for each in columns)]]
    rows += [[each.name, *(column.cell(each) for column in columns)] for each in results]
    simulated = math.fsum(row.simulated for row in record)
    took = f"{counted(len(record), 'simulation')}, {simulated:.6g} simulated seconds"
    below = [took, *end_note(record), *failures(record)]
    return [*table(rows, "<" + ">" * len(columns), 80), "", *below]


def failures(record: Record, *, rated: bool = True) -> list[str]:
    """How many simulations failed, and the error of the first; no lines if none did.

    They are lines of 80 columns. What the first was given stands before its error.

    Args:
        record: The simulations.
        rated: Whether rates of episodes stand above, in which those that failed count.
    """
    failed = record.failed()
    if not len(failed):
        return []
    first = failed[0]
    if record.chosen:
        columns = first.case.columns().items()
        given = ", ".join(f"{name}={value:.4g}" for name, value in columns)
        head = f"{len(failed)} of {counted(len(record), 'simulation')} failed, the first with "
    else:  # episodes
        given = f"seed {first.seed}"
        head = f"{len(failed)} of {counted(len(record), 'episode')} failed"
        head += ", which counts as not satisfied; the first with " if rated else "; the first, "
    error = shorten(" ".join(first.error.split()), _ERROR)
    others = len({row.error for row in failed}) - 1
    return [
        *wrap(f"{shorten(f'{head}{given}', 139)}:", 80),
        *wrap(error, 80, initial_indent="  ", subsequent_indent="  "),
        *([f"  and {counted(others, 'other error')}"] if others else []),
    ]


def to_json(record: Record, options: Mapping[str, Any]) -> str:
    """The record as a result of the kind ``"record"``.

    Args:
        record: The simulations.
        options: How they were chosen and run.
    """
    return document("record", {**options, **plain_results(record, rates=not record.chosen)})


def case_lines(case: Case) -> list[str]:
    """A case for the terminal: a line for each entry, and more for one of many control points."""
    return [line for each in case.items() for line in _entry(*each)]


def _entry(name: str, entry: float | Waveform) -> list[str]:
    """An entry of a case: a number, or the values of a waveform at its times."""
    if not isinstance(entry, Waveform):
        return [f"  {name} = {number(entry)}"]
    if len(set(entry.values)) == 1:
        return [f"  {name} = {number(entry.values[0])} throughout"]
    points = zip(entry.times, entry.values, strict=True)
    # Lines break behind a control point, not within: a blank that does not break is none to `wrap`.
    values = [f"{number(value)}\xa0at\xa0{number(time)}\xa0s" for time, value in points]
    how = {"hold": "steps"}.get(entry.interpolation, entry.interpolation)
    text = f"{name}, {how}: {', '.join(values)}"
    lines = wrap(text, 79, initial_indent="  ", subsequent_indent="    ")
    return [line.replace("\xa0", " ") for line in lines]
