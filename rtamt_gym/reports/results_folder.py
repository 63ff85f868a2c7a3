"""The section of a folder of results of ``rtamt monitor --results``, with its worst files."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, get_args

from rtamt import Verdict
from rtamt_gym.reports.episodes import in_words_of
from rtamt_gym.reports.model import Cell, Column, Row, Section, Table, Text
from rtamt_gym.reports.requirements import judged, requirement_of, trials_of
from rtamt_gym.reports.traces import matrix_row
from rtamt_gym.results.folder import IDENTITY, RESULTS
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.outcome import Failure, Outcome, Word
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted

_LISTED: Final = 1000
"""The files of the table, the worst of all."""

_GROUPS: Final = 100
"""The folders of the table, the worst of all."""


def holds_results(path: Path) -> bool:
    """Return whether a path is a folder of results, or its Parquet file."""
    folder = path if path.is_dir() else path.parent
    own = path.is_dir() or path.name == RESULTS
    return own and (folder / IDENTITY).is_file() and (folder / RESULTS).is_file()


def of_results(path: Path) -> Section:
    """Return the section of a folder of results.

    Args:
        path: The folder, or its Parquet file.
    """
    import pyarrow.parquet as pq

    folder = path if path.is_dir() else path.parent
    identity = json.loads((folder / IDENTITY).read_text(encoding="utf-8"))
    formulas: Mapping[str, str] = identity["specification"]
    columns = pq.read_table(folder / RESULTS).to_pydict()
    there = [i for i, gone in enumerate(columns["gone"]) if not gone]
    matrix = Matrix([_trial(columns, i, formulas) for i in there], formulas)
    facts = [("files", str(len(matrix)))]
    if gone := len(columns["gone"]) - len(there):
        facts.append(("gone", str(gone)))
    facts += [(name, str(identity[name])) for name in _OPTIONS if identity.get(name) not in _UNSET]
    requirements = [
        replace(
            requirement_of(
                *(name, in_words_of(formula, 1, step=identity.get("view") == "step"), formula),
                trials_of(matrix.rows, judged(matrix, name), lambda _, row: row.name),
                noun="trace",
            ),
            figures=(),  # the script that draws them is larger than the page
        )
        for name, formula in formulas.items()
    ]
    return Section(
        kind="matrix",
        title=f"{counted(len(matrix), 'recorded trace')} under "
        f"{counted(len(formulas), 'requirement')}",
        facts=tuple(facts),
        requirements=tuple(requirements),
        blocks=tuple(_blocks(matrix, folder / RESULTS)),
    )


_OPTIONS: Final = ("end", "view", "semantics", "align", "period")
_UNSET: Final = (None, "None")


def _trial(columns: Mapping[str, list[Any]], i: int, formulas: Mapping[str, str]) -> Trial:
    """Return a row of the Parquet file."""
    cells: dict[str, Outcome | Failure] = {}
    for name in formulas:
        verdict = columns[f"verdict({name})"][i]
        if verdict in (None, "ERROR"):
            cells[name] = Failure(columns["error"][i] or "not judged")
            continue
        robustness, lower, upper = (
            columns[f"{kind}({name})"][i] for kind in ("robustness", "lower", "upper")
        )
        cells[name] = Outcome(robustness, lower, upper, Verdict[verdict], None)
    path, notes = columns["path"][i], columns["notes"][i]
    return Trial.of_trace(path, columns["described"][i], cells, notes.split("\n") if notes else ())


def _blocks(matrix: Matrix, file: Path) -> Iterator[Table | Text]:
    """Yield the worst files, the folders, and the command for all files."""
    words, names = get_args(Word), [*matrix.requirements]

    def badness(row: Trial) -> tuple[int, float]:
        values = (outcome.robustness for outcome in row.outcomes.values())
        return words.index(row.word), min(values, default=0.0)

    worst = sorted(matrix.rows, key=badness)[:_LISTED]
    yield _groups(matrix)
    yield Table(
        (Column("trace"), Column("verdict"), *(Column(name, "n", name) for name in names)),
        tuple(matrix_row(row, names) for row in worst),
        "Traces and requirements",
        "Robustness of each requirement on the worst traces",
        "matrix",
    )
    if len(worst) < len(matrix):
        more = counted(len(matrix) - len(worst), "trace")
        yield Text(f"{more} more not listed.", "muted left-out")
    code = (
        f"import pandas; table = pandas.read_parquet({json.dumps(str(file))}); "
        'print(table[table.verdict == "violated"].path.to_string())'
    )
    command = f"python -c {shlex.quote(code)}"
    yield Text(f"All rows are in `{file}`. To list the violated files: `{command}`")


def _groups(matrix: Matrix) -> Table:
    """Return the verdicts of the files in each folder, the worst folders first."""
    groups: dict[str, Counter[str]] = {}
    for row in matrix:
        groups.setdefault(row.name.rpartition("/")[0] or ".", Counter())[row.word] += 1
    words = get_args(Word)
    ordered = sorted(groups.items(), key=lambda item: [-item[1][word] for word in words])
    rows = (
        Row((name, *(Cell(str(n), "n") for n in (*(counts[w] for w in words), counts.total()))))
        for name, counts in ordered[:_GROUPS]
    )
    label = "Verdicts in each folder"
    if len(ordered) > _GROUPS:
        label += f", the worst {_GROUPS} of {len(ordered)}"
    head = (Column("folder"), *(Column(word, "n") for word in words), Column("files", "n"))
    return Table(head, tuple(rows), label, label)
