"""The violated episodes of a LeRobot data set, in the format of its editing tool."""

from __future__ import annotations

import json
from collections.abc import Sequence

from rtamt import InputError, Verdict
from rtamt.errors import shown
from rtamt_gym.recorded.parts import part_of
from rtamt_gym.recorded.readers import format_of
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted


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
