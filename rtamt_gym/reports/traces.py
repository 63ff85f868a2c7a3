"""The sections of recorded traces: files of ``rtamt monitor`` and ``rtamt mine``.

The author of a result names the paths of its traces, and could name a secret, a device or a pipe
without a writer. Therefore, only regular files below some folders are read.
"""

from __future__ import annotations

import json
import os
import shlex
import stat
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np

import rtamt
from rtamt import EpisodeMonitor, Verdict
from rtamt_gym.judging.monitors import EXACT
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.recorded.parts import split_name
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.recorded.trace_files import read_ruled
from rtamt_gym.reports.episodes import PlayedEpisode, in_words_of
from rtamt_gym.reports.figures import occurrence_figures
from rtamt_gym.reports.model import (
    TRIALS,
    Cell,
    Column,
    Requirement,
    Row,
    Section,
    ShownEpisode,
    Table,
    Text,
)
from rtamt_gym.reports.numbers import number, six
from rtamt_gym.reports.requirements import (
    DIGITS,
    made_of,
    trials_of,
)
from rtamt_gym.results.codec import number_of, provenance_of
from rtamt_gym.results.codec import trials_of as read_trials
from rtamt_gym.results.matrix import IDENTITY, RESULTS, Matrix
from rtamt_gym.results.mutation import MutationScore
from rtamt_gym.results.outcome import Failure, Outcome, Word, word
from rtamt_gym.results.provenance import file_hash
from rtamt_gym.results.statistics import Results
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted
from rtamt_gym.tables import number as plain_number

_LONGEST: Final = 20_000
"""The maximum number of samples of a trace with bounds, which are computed sample by sample."""

_RULES: Final = ("period", "time", "end", "view", "semantics", "align")


def of_matrix(
    stored: Mapping[str, Any], folder: Path, room: int, *, traces: Sequence[Path] = ()
) -> Section:
    """Return the section of recorded traces, with the worst of each requirement in full."""
    matrix = Matrix(read_trials(stored), stored["requirements"], provenance=provenance_of(stored))
    reading = stored["reading"]
    formulas = matrix.requirements
    facts = [("traces", str(len(matrix)))]
    facts += [(name, str(reading[name])) for name in _RULES if name in reading]
    constants = {k: v for k, v in reading.items() if k.startswith("constant:")}
    facts += [(name.replace(":", " "), str(value)) for name, value in constants.items()]
    share = room // len(formulas)
    below = TraceFolders((Path.cwd(), folder.absolute()), tuple(traces))
    requirements = [_requirement(matrix, reading, name, below, share) for name in formulas]
    mutants = stored.get("mutants")
    scores = {} if mutants is None else mutants["requirements"]
    return Section(
        kind="matrix",
        title=_title(matrix),
        unit="s" if _period(matrix) else "steps",
        facts=tuple(facts),
        requirements=tuple(requirements),
        blocks=tuple(_blocks(matrix)),
        mutants=None
        if mutants is None
        else {name: MutationScore.read(score) for name, score in scores.items()},
        min_share=None if mutants is None else mutants["least"],
        **made_of(matrix.provenance),
    )


def _title(matrix: Matrix) -> str:
    requirements = counted(len(matrix.requirements), "requirement")
    return f"{counted(len(matrix), 'recorded trace')} under {requirements}"


def _period(matrix: Matrix) -> object:
    """Return None if bounds count samples, according to the descriptions of the traces."""
    return None if any(row.described.endswith("bounds count samples") for row in matrix) else 1


def _blocks(matrix: Matrix) -> Iterator[Table | Text]:
    """Yield the table of the traces under the requirements, at most the worst 500."""
    words = get_args(Word)
    places = sorted(range(len(matrix)), key=lambda i: words.index(matrix[i].word))[:TRIALS]
    rows = [matrix[i] for i in sorted(places)]
    yield _traces_table(matrix, rows, "Robustness of each requirement on each trace")
    yield from _unlisted(matrix, rows, "muted")


def _traces_table(matrix: Matrix, rows: Iterable[Trial], caption: str) -> Table:
    names = list(matrix.requirements)
    return Table(
        (Column("trace"), Column("verdict"), *(Column(name, "n", name) for name in names)),
        tuple(_matrix_row(row, names) for row in rows),
        "Traces and requirements",
        caption,
        "matrix",
    )


def _unlisted(matrix: Matrix, rows: Sequence[Trial], style: str) -> Iterator[Text]:
    if len(rows) < len(matrix):
        yield Text(f"{counted(len(matrix) - len(rows), 'trace')} more not listed.", style)


def _matrix_row(row: Trial, names: Iterable[str]) -> Row:
    """Return a trace as a row of the table of all requirements."""
    described = [row.described.removeprefix(f"{row.name}: ")] if row.described else []
    cells = []
    for name in names:
        verdict, outcome = word(row.cell(name)), row.judged(name)
        value = "" if outcome is None else number(six(outcome.robustness))
        cells.append(Cell(value, f"n cell {verdict}", verdict=verdict))
    first = Cell(row.name, muted=(*described, *row.notes))
    return Row((first, Cell(verdict=row.word), *cells), verdict=row.word)


def _requirement(
    matrix: Matrix, reading: Mapping[str, Any], name: str, below: TraceFolders, room: int
) -> Requirement:
    """Return a requirement with its worst trace in full, or a note with the reason."""
    formula, outcomes = matrix.requirements[name], matrix.outcomes(name)
    trials = trials_of(matrix.rows, outcomes, lambda _, row: row.name)
    known = [trial.label for trial in trials if trial.robustness is not None]
    worst, note = [], ""
    if known:
        row = next(row for row in matrix if row.name == known[0] and row.judged(name))
        try:
            path = _path_of(row.name, matrix.provenance.files, below)
            worst = [_episode(row.name, row.outcomes[name], reading, formula, path, room)]
        except NotShownError as error:
            note = f"The worst trace, `{row.name}`, is not shown in full: {error}."
    words = in_words_of(formula, _period(matrix), step=reading.get("view") == "step")
    return Requirement(
        *(name, words, formula, trials),
        worst=tuple(worst),
        figures=tuple(occurrence_figures(matrix.rows, name)),
        note=note,
        id=matrix.provenance.ids.get(name),
    )


def _path_of(name: str, hashes: Mapping[str, str], below: TraceFolders) -> Path:
    """Return the path of a trace, with its name in a file of several traces."""
    file, part = (name, "") if name in hashes else split_name(name)
    return Path(f"{below.found(file, hashes.get(file, ''))}{part}")


def _episode(
    name: str,
    outcome: Outcome,
    stored: Mapping[str, Any],
    formula: str,
    path: Path,
    room: int,
) -> ShownEpisode:
    """Return a trace in full."""
    if stored["time"] == "dense" or stored["semantics"] not in EXACT:
        raise NotShownError("this page shows samples under the standard or the boolean semantics")
    period = Fraction(stored["period"]) if "period" in stored else None
    parts = {item: stored[item] for item in ("view", "semantics", "align") if item in stored}
    reading = EvaluationOptions(period=period, **parts)
    spec = rtamt.parse(formula)
    columns = Columns(**stored.get("columns", {}))
    read = {*spec.variables, *(part.variable for part in spec.subscriptions())}
    signals = {key: place for key, place in columns.signals.items() if key in read}
    columns = replace(columns, signals=signals)
    try:
        trace, period = read_ruled(str(path), {"": spec}, reading, columns)
    except (rtamt.RtamtError, OSError):
        # an error of a reader may repeat content of the file
        raise NotShownError(
            "it can no longer be read as before; rtamt monitor reports the reason"
        ) from None
    assert isinstance(trace, Trace), "it is not dense"  # noqa: S101 - for mypy
    if unknown := [name for name in spec.variables if name in trace.unknown]:
        raise NotShownError(f"values of {', '.join(unknown)} are not known")
    judged_spec = viewed(spec, reading.view)
    start = trace.start if period is not None else 0.0
    times = np.arange(float(trace.samples)) * float(period or 1) + start
    curves = _curves(judged_spec, trace, period, reading)
    played = PlayedEpisode(
        label=name,
        spec=judged_spec,
        interface={"semantics": reading.semantics},
        signals=trace.columns,
        times=times,
        period=period,
        align=reading.align,
        outcome=outcome,
        curves=curves,
    )
    return played.episode(room, 1)


def _curves(
    spec: rtamt.Specification, trace: Trace, period: Fraction | None, reading: EvaluationOptions
) -> dict[str, Any]:
    """Return robustness and bounds at every sample; an empty mapping for a long trace."""
    if trace.samples > _LONGEST:
        return {}
    monitor = EpisodeMonitor(spec, period, semantics=reading.semantics, align=reading.align)
    names = ("robustness", "lower", "upper")
    rows = []
    for i in range(trace.samples):
        monitor.update({name: trace.columns[name][i] for name in monitor.variables})
        rows.append([getattr(monitor, name) for name in names])
    return dict(zip(names, np.array(rows).T, strict=True))


def of_mined(stored: Mapping[str, Any]) -> Section:
    """Return the section of a result of ``rtamt mine --json``."""
    results = Results(read_trials(stored), stored["requirements"])
    name, traces = stored["parameter"], counted(stored["traces"], "trace")
    value, fails_at, low, high = (
        plain_number(number_of(stored[item])) for item in ("value", "fails_at", "low", "high")
    )
    side = {"least": "smallest", "greatest": "largest"}[stored["side"]]
    facts = {
        name: f"{value}, the {side}",
        "fails at": fails_at,
        "tried": f"{low} to {high}, {stored['probes']} values on every trace",
        "traces": str(stored["traces"]),
        "evaluations": str(stored["evaluations"]),
    }
    requirements = [
        Requirement(
            requirement,
            in_words_of(formula, 1),
            formula,
            trials_of(results.rows, results.outcomes(requirement), lambda _, row: row.name),
            note=f"The traces that let no tighter value pass, at {name} = {value}.",
        )
        for requirement, formula in results.requirements.items()
    ]
    return Section(
        kind="matrix",
        title=f"{name} = {value} for {stored['requirement']}",
        facts=tuple(facts.items()),
        notes=(
            f"{value} is the {side} for which {traces} satisfy `{stored['requirement']}`.",
            *stored["notes"],
        ),
        requirements=tuple(requirements),
    )


class NotShownError(Exception):
    """Why a trace is not shown, in words without content of the file."""


@dataclass(frozen=True, slots=True)
class TraceFolders:
    """The folders below which traces are read."""

    own: tuple[Path, ...]
    traces: tuple[Path, ...] = ()

    def found(self, name: str, sha256: str) -> Path:
        """Return the file of a trace."""
        folders = list(dict.fromkeys([*self.own, *self.traces]))
        roots = [folder.resolve() for folder in folders]
        files = [path for path in self._places(name) if _is_below(path, roots)]
        if not files:
            below = " or ".join(map(str, folders))
            raise NotShownError(
                f"no regular file of this name lies below {below}; rtamt report --traces DIR reads "
                "below another folder"
            )
        for path in files:
            if not sha256 or file_hash(path) in {sha256, ""}:
                return path
        raise NotShownError(
            f"{files[0]} has changed since it was judged: its SHA-256 began with "
            f"{sha256[:DIGITS]}, now {file_hash(files[0])[:DIGITS]}; judge it again"
        )

    def _places(self, name: str) -> Iterator[Path]:
        yield from (folder / name for folder in self.own)
        steps = Path(name).parts
        for folder in self.traces:
            yield from (folder.joinpath(*steps[i:]) for i in range(len(steps)))


def _is_below(path: Path, roots: list[Path]) -> bool:
    """Return whether a path, after links, is a regular file or a folder of them below a folder."""
    try:
        resolved = path.resolve(strict=True)
        if not any(resolved.is_relative_to(root) for root in roots):
            return False
        mode = resolved.stat().st_mode
        if stat.S_ISREG(mode):
            return True
        return stat.S_ISDIR(mode) and _holds_regular_files(resolved)
    except (OSError, ValueError):  # ValueError: a path with a null character
        return False


def _holds_regular_files(folder: Path) -> bool:
    """Return whether all files below a folder are regular; a link may lead anywhere."""
    with os.scandir(folder) as entries:
        return all(
            entry.is_file(follow_symlinks=False)
            or (entry.is_dir(follow_symlinks=False) and _holds_regular_files(Path(entry.path)))
            for entry in entries
        )


_LISTED: Final = 1000
"""The maximum number of files in the table, the worst first."""

_GROUPS: Final = 100
"""The maximum number of folders in the table, the worst first."""


def holds_results(path: Path) -> bool:
    """Return whether a path is a folder of results, or its Parquet file."""
    folder = path if path.is_dir() else path.parent
    own = path.is_dir() or path.name == RESULTS
    return own and (folder / IDENTITY).is_file() and (folder / RESULTS).is_file()


def of_results(path: Path) -> Section:
    """Return the section of a folder of results."""
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
    facts += [
        (name, str(identity[name])) for name in _FOLDER_OPTIONS if identity.get(name) not in _UNSET
    ]
    requirements = [
        Requirement(
            *(name, in_words_of(formula, 1, step=identity.get("view") == "step"), formula),
            trials_of(matrix.rows, matrix.outcomes(name), lambda _, row: row.name),
        )
        for name, formula in formulas.items()
    ]
    return Section(
        kind="matrix",
        title=_title(matrix),
        facts=tuple(facts),
        requirements=tuple(requirements),
        blocks=tuple(_folder_blocks(matrix, folder / RESULTS)),
        charts=False,  # the script that draws them is larger than the page
    )


_FOLDER_OPTIONS: Final = ("end", "view", "semantics", "align", "period")
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


def _folder_blocks(matrix: Matrix, file: Path) -> Iterator[Table | Text]:
    """Yield the worst files, the folders, and the command for all files."""
    words = get_args(Word)

    def badness(row: Trial) -> tuple[int, float]:
        values = (outcome.robustness for outcome in row.outcomes.values())
        return words.index(row.word), min(values, default=0.0)

    worst = sorted(matrix.rows, key=badness)[:_LISTED]
    yield _groups(matrix)
    yield _traces_table(matrix, worst, "Robustness of each requirement on the worst traces")
    yield from _unlisted(matrix, worst, "muted left-out")
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
