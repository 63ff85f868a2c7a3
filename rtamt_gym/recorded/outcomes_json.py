"""JSON of judged traces: all outcomes, and the violated episodes of a LeRobot data set.

The list of episodes has the format of the editing tool of LeRobot.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from fractions import Fraction
from types import MappingProxyType
from typing import Any

from rtamt import InputError, Verdict
from rtamt.errors import shown
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import part_of
from rtamt_gym.recorded.readers import format_of
from rtamt_gym.results.codec import document_parts, plain, plain_results, plain_trial
from rtamt_gym.results.matrix import Matrix, label
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted


def json_parts(
    matrix: Matrix,
    rules: Mapping[str, Any],
    columns: Columns,
    exit_code: int,
    *,
    least: Fraction | None = None,
    mutants: Mapping[str, Any] | None = None,
    groups: Mapping[str, Mapping[str, object]] = MappingProxyType({}),
) -> Iterator[str]:
    """Yield the traces as a result of the kind ``"traces"``, in parts.

    Args:
        matrix: The outcomes.
        rules: The evaluation options, by name.
        columns: The column options; the document contains only values that are not the default.
        exit_code: The exit code of the command.
        least: The minimum length of each trace in seconds; None: any length.
        mutants: The `MutationScore` of each requirement as ``scores``, and the required share as
            ``least``; None without mutants.
        groups: The key values of each trace in its file, by its name.
    """
    requirement, trace = matrix.worst_requirement(), matrix.worst_trace()
    default = Columns()
    options: dict[str, Any] = {
        option.name: getattr(columns, option.name) for option in fields(columns)
    }
    other = {name: value for name, value in options.items() if value != getattr(default, name)}
    trials = (
        {
            **plain_trial(row),
            **(
                {"group": {name: plain(_plain(value)) for name, value in keys.items()}}
                if (keys := groups.get(row.name))
                else {}
            ),
            "verdict": label(row.word),
        }
        for row in matrix.rows
    )
    counts = {label(word).lower(): count for word, count in matrix.counts().items()}
    return document_parts(
        "traces",
        {
            "reading": {**rules, "columns": other},
            "verdict": label(matrix.word),
            "exit_code": exit_code,
            **({} if least is None else {"shorter": matrix.shorter(least)}),
            "counts": counts,
            "worst_requirement": requirement and requirement[0],
            "worst_trace": trace and trace[0],
            **({} if mutants is None else {"mutants": _mutants(mutants)}),
            **plain_results(matrix, rates=False),
        },
        plain_rows=trials,
    )


def _plain(value: object) -> object:
    """Return a number, a text or a truth value; a date as text."""
    return value if isinstance(value, bool | int | float | str) else str(value)


def _mutants(scored: Mapping[str, Any]) -> dict[str, Any]:
    scores = {name: score.written() for name, score in scored["scores"].items()}
    return {"least": scored["least"], "requirements": scores}


def data_set_of(paths: Sequence[str]) -> str:
    """Return the data set of some episodes.

    Raises:
        InputError: If a trace is not an episode, or the episodes are from several data sets.
    """
    files: dict[str, None] = {}
    for path in paths:
        part = part_of(path)
        if part is None or format_of(path).name != "LeRobot data set":
            raise InputError(
                f"--violated-episodes: expected episodes of a LeRobot data set, got {shown(path)}"
            )
        files[part.file] = None
    if len(files) > 1:
        raise InputError(
            "--violated-episodes: expected one LeRobot data set, got "
            f"{', '.join(map(shown, files))}; judge one at a time"
        )
    return next(iter(files))


def violated_episodes(rows: Sequence[Trial], paths: Sequence[str]) -> tuple[str, str]:
    """Return the indices of the violated episodes as JSON, and a summary for the report.

    The list omits undecided episodes and episodes with errors; the summary counts them.

    Args:
        rows: The outcomes of each episode.
        paths: The name of each episode, in the same order.
    """
    violated, undecided, errors = [], 0, 0
    for row, path in zip(rows, paths, strict=True):
        part = part_of(path)
        verdicts = {outcome.verdict for outcome in row.outcomes.values()}
        if Verdict.VIOLATED in verdicts and part is not None:
            violated.append(int(part.value))
        elif row.failures or row.error:
            errors += 1
        elif Verdict.UNDECIDED in verdicts:
            undecided += 1
    summary = f"{len(violated)} of {counted(len(rows), 'episode')}"
    others = [f"{undecided} undecided"] * bool(undecided) + [f"{errors} with errors"] * bool(errors)
    if others:
        summary += f"; not in it: {' and '.join(others)}"
    return json.dumps(sorted(violated)), summary
