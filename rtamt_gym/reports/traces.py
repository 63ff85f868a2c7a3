"""The sections of recorded traces: results of ``rtamt monitor --json`` and ``rtamt mine --json``.

A result names its traces, and its author could name any path: a secret, a device, or a pipe without
a writer. So only regular files below some folders are read.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np

import rtamt
from rtamt import EpisodeMonitor
from rtamt.monitors import BodyOccurrences, Occurrences
from rtamt_gym.judging.monitors import EXACT
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.recorded.parts import split_name
from rtamt_gym.recorded.ruled import read_ruled
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.reports.episodes import PlayedEpisode, in_words_of
from rtamt_gym.reports.model import (
    Cell,
    Column,
    Figure,
    Requirement,
    Row,
    Section,
    ShownEpisode,
    Table,
    Text,
    numbers_table,
    plain,
)
from rtamt_gym.reports.numbers import aligned, number, percent, six, time
from rtamt_gym.reports.requirements import (
    DIGITS,
    TRIALS,
    judged,
    made_of,
    requirement_of,
    trials_of,
)
from rtamt_gym.results.codec import number_of
from rtamt_gym.results.codec import trials_of as read_trials
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.mutation import MutationScore
from rtamt_gym.results.outcome import Outcome, Word, word
from rtamt_gym.results.provenance import file_hash, provenance_of
from rtamt_gym.results.table import Results
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted
from rtamt_gym.tables import number as plain_number

_RUNS = 500
"""Runs that a timeline shows of each body."""

_ROWS = 100
"""Violations in the table next to a timeline."""


def occurrence_figures(rows: Sequence[Trial], name: str) -> list[Figure | Table]:
    """Return the statistics of a requirement over traces, and the timeline of one trace.

    The timeline shows the trace with the longest violated time. The list is empty if no trace has
    occurrences.

    Args:
        rows: The traces.
        name: The name of the requirement.
    """
    found = [
        (row, outcome.occurrences)
        for row in rows
        if (outcome := row.outcomes.get(name)) is not None and outcome.occurrences is not None
    ]
    if not found:
        return []
    shown = max(found, key=lambda pair: sum(body.violated for body in pair[1].bodies))
    if not len(shown[1]):
        return [_statistics([each for _, each in found])]
    return [_statistics([each for _, each in found]), _timeline(*shown)]


def _statistics(found: Sequence[Occurrences]) -> Table:
    """Return a row for each body, over all traces."""
    head = ("body", "violations", "share of time", "an hour", "triggers", "answer time, median")
    rows = []
    for bodies in zip(*(each.bodies for each in found), strict=True):
        length, violated = (sum(getattr(body, part) for body in bodies) for part in _SPANS)
        if len({body.unit for body in bodies}) > 1:  # some traces have no times
            length = 0.0
        count = sum(len(body.violations) for body in bodies)
        timed = bodies[0].unit == "s" and length > 0
        triggers = sum(len(body.responses) for body in bodies)
        answers = np.concatenate([body.answer_times for body in bodies])
        cells = (
            Cell(str(count), "n"),
            Cell(f"{percent(violated / length)} %" if length else "", "n"),
            Cell(number(3600 * count / length) if timed else "", "n"),
            Cell(str(triggers) if triggers else "", "n"),
            Cell(_duration(float(np.median(answers)), bodies[0]) if len(answers) else "", "n"),
        )
        rows.append(Row((Cell(codes=(bodies[0].text,)), *cells)))
    columns = (Column(head[0]), *(Column(text, "n") for text in head[1:]))
    what = f"All violations in {counted(len(found), 'trace')}"
    return Table(columns, tuple(rows), "Violations of each body", what)


_SPANS = "length", "violated"


def _duration(value: float, body: BodyOccurrences) -> str:
    return f"{number(value)} {'s' if body.unit == 's' else 'samples'}"


def _timeline(row: Trial, found: Occurrences) -> Figure:
    """Return the chart of the violated and unknown runs of each body in a trace."""
    unit = "s" if found.unit == "s" else "steps"
    bodies, left_out = [], 0
    for body in found.bodies:
        runs = [*_runs(body, "violated"), *_runs(body, "undecided")]
        left_out += len(body.violations) + len(body.unknown) - len(runs)
        bodies.append({"text": body.text, "runs": tuple(run for _, run in sorted(runs))})
    extent = row.judged_extent
    drawn = [
        float(time)
        for body in found.bodies
        for table in (body.violations, body.unknown)
        for part in ("start", "end")
        for time in table.columns[part].tolist()
    ]
    span = [min(drawn), max(drawn)]
    if extent is not None and extent.begin is not None and extent.end is not None and unit == "s":
        span = [min(span[0], extent.begin), max(span[1], extent.end)]
    total = sum(violation.duration for violation in found)
    longest = max(found, key=lambda violation: violation.duration)
    summary = (
        f"{row.name}: {counted(len(found), 'violation')}, {number(total)} {found.unit} in all; the "
        f"longest starts at {time(six(float(longest.start)), unit)} and lasts "
        f"{number(longest.duration)} {found.unit}."
    )
    if left_out:
        summary += f" {counted(left_out, 'run')} not drawn."
    words: tuple[Word, ...] = tuple(
        word
        for word in ("violated", "undecided")
        if any(run[2] == word for body in bodies for run in body["runs"])
    )
    return Figure(
        "timeline",
        "All violations",
        summary,
        110 + 34 * len(bodies),
        plain({"bodies": tuple(bodies), "span": (six(span[0]), six(span[1])), "unit": unit}),
        _table(found),
        wide=True,
        words=words,
    )


def _runs(body: BodyOccurrences, word: Word) -> list[tuple[float, tuple[float, float, Word, str]]]:
    """Return start, end, verdict and robustness of runs, with the start first."""
    if word == "violated":
        texts = [number(six(run.robustness)) for run in body.violations[:_RUNS]]
        spans = [(float(run.start), float(run.end)) for run in body.violations[:_RUNS]]
    else:
        spans = [(float(run.start), float(run.end)) for run in body.unknown[:_RUNS]]
        texts = [""] * len(spans)
    return [
        (start, (six(start), six(end), word, text))
        for (start, end), text in zip(spans, texts, strict=True)
    ]


def _table(found: Occurrences) -> Table:
    rows: list[tuple[Any, ...]] = [
        (body.text, run) for body in found.bodies for run in body.violations[:_ROWS]
    ][:_ROWS]
    starts, ends, durations, worst = (
        aligned([six(float(getattr(run, part))) for _, run in rows])
        for part in ("start", "end", "duration", "robustness")
    )
    texts = [text for text, _ in rows]
    unit = "s" if found.unit == "s" else "samples"
    head = ("body", f"start ({unit})", f"end ({unit})", f"lasts ({unit})", "minimum robustness")
    return numbers_table(head, tuple(zip(texts, starts, ends, durations, worst, strict=True)))


_LONGEST: Final = 20_000
"""The most samples of a trace whose bounds are shown: they are made sample by sample."""

_RULES: Final = ("period", "time", "end", "view", "semantics", "align")


def of_matrix(
    kept: Mapping[str, Any], folder: Path, room: int, *, traces: Sequence[Path] = ()
) -> Section:
    """Return the section of recorded traces, with the worst of each requirement in full.

    Args:
        kept: A result of the kind ``"traces"``, as ``rtamt monitor --json`` writes it.
        folder: The folder of the result: traces are read below the present folder and below it.
        room: How many numbers all episodes together may have.
        traces: Further folders below which they are read.

    Raises:
        KeyError: If the result lacks something.
    """
    matrix = Matrix(read_trials(kept), kept["requirements"], provenance=provenance_of(kept))
    reading = kept["reading"]
    formulas = matrix.requirements
    facts = [("traces", str(len(matrix)))]
    facts += [(name, str(reading[name])) for name in _RULES if name in reading]
    constants = {k: v for k, v in reading.items() if k.startswith("constant:")}
    facts += [(name.replace(":", " "), str(value)) for name, value in constants.items()]
    share = room // len(formulas)
    below = TraceFolders((Path.cwd(), folder.absolute()), tuple(traces))
    requirements = [_requirement(matrix, reading, name, below, share) for name in formulas]
    mutants = kept.get("mutants")
    scores = {} if mutants is None else mutants["requirements"]
    return Section(
        kind="matrix",
        title=f"{counted(len(matrix), 'recorded trace')} under "
        f"{counted(len(formulas), 'requirement')}",
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


def _period(matrix: Matrix) -> object:
    """Return None if bounds count samples, according to the descriptions of the traces."""
    return None if any(row.described.endswith("bounds count samples") for row in matrix) else 1


def _blocks(matrix: Matrix) -> Iterator[Table | Text]:
    """Yield the table of the traces under the requirements, the worst 500 of more."""
    words, names = get_args(Word), list(matrix.requirements)
    places = sorted(range(len(matrix)), key=lambda i: words.index(matrix[i].word))[:TRIALS]
    yield Table(
        (Column("trace"), Column("verdict"), *(Column(name, "n", name) for name in names)),
        tuple(matrix_row(matrix[i], names) for i in sorted(places)),
        "Traces and requirements",
        "Robustness of each requirement on each trace",
        "matrix",
    )
    if len(places) < len(matrix):
        yield Text(f"{counted(len(matrix) - len(places), 'trace')} more not listed.", "muted")


def matrix_row(row: Trial, names: Iterable[str]) -> Row:
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
    formula, outcomes = matrix.requirements[name], judged(matrix, name)
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
    known_id = matrix.provenance.ids.get(name)
    unit = "s" if _period(matrix) else "steps"
    return requirement_of(
        *(name, words, formula, trials, worst),
        noun="trace",
        unit=unit,
        figures=occurrence_figures(matrix.rows, name),
        note=note,
        id=known_id,
    )


def _path_of(name: str, hashes: Mapping[str, str], below: TraceFolders) -> Path:
    """Return the path of a trace, or the name of a trace in a file that holds several."""
    file, part = (name, "") if name in hashes else split_name(name)
    return Path(f"{below.found(file, hashes.get(file, ''))}{part}")


def _episode(
    name: str,
    outcome: Outcome,
    kept: Mapping[str, Any],
    formula: str,
    path: Path,
    room: int,
) -> ShownEpisode:
    """Return a trace in full.

    Raises:
        NotShownError: If it cannot be read again, or is of another kind.
    """
    if kept["time"] == "dense" or kept["semantics"] not in EXACT:
        raise NotShownError("this page shows samples under the standard or the boolean semantics")
    period = Fraction(kept["period"]) if "period" in kept else None
    parts = {item: kept[item] for item in ("view", "semantics", "align") if item in kept}
    reading = EvaluationOptions(period=period, **parts)
    spec = rtamt.parse(formula)
    columns = Columns(**kept.get("columns", {}))
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
    whole = viewed(spec, reading.view)
    start = trace.start if period is not None else 0.0
    times = np.arange(float(trace.samples)) * float(period or 1) + start
    curves = _curves(whole, trace, period, reading)
    played = PlayedEpisode(
        label=name,
        spec=whole,
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


def of_mined(kept: Mapping[str, Any]) -> Section:
    """Return the section of a result of ``rtamt mine --json``.

    Args:
        kept: The result, of the kind ``"mined"``.

    Raises:
        KeyError: If something is not in it.
    """
    results = Results(read_trials(kept), kept["requirements"])
    name, traces = kept["parameter"], counted(kept["traces"], "trace")
    value, fails_at, low, high = (
        plain_number(number_of(kept[item])) for item in ("value", "fails_at", "low", "high")
    )
    facts = {
        name: f"{value}, the {kept['side']}",
        "fails at": fails_at,
        "tried": f"{low} to {high}, {kept['probes']} values on every trace",
        "traces": str(kept["traces"]),
        "evaluations": str(kept["evaluations"]),
    }
    requirements = [
        requirement_of(
            requirement,
            in_words_of(formula, 1),
            formula,
            trials_of(results.rows, judged(results, requirement), lambda _, row: row.name),
            noun="trace",
            note=f"The traces that let no tighter value pass, at {name} = {value}.",
        )
        for requirement, formula in results.requirements.items()
    ]
    return Section(
        kind="matrix",
        title=f"{name} = {value} for {kept['requirement']}",
        facts=tuple(facts.items()),
        notes=(
            f"{value} is the {kept['side']} for which {traces} satisfy `{kept['requirement']}`.",
            *kept["notes"],
        ),
        requirements=tuple(requirements),
    )


class NotShownError(Exception):
    """Why a trace is not shown, in words that repeat nothing of a file."""


@dataclass(frozen=True, slots=True)
class TraceFolders:
    """The folders below which traces are read.

    Attributes:
        own: The folders for full paths: the current folder and the folder of the result.
        traces: Further folders, where the end of a trace's path is enough.
    """

    own: tuple[Path, ...]
    traces: tuple[Path, ...] = ()

    def found(self, name: str, sha256: str) -> Path:
        """Return the file of a trace.

        Args:
            name: The path of the trace, as it was judged.
            sha256: The hash of the trace when it was judged; empty if it is not known.

        Raises:
            NotShownError: If no regular file of this name lies below the folders, or none is as it
                was.
        """
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
        whole = path.resolve(strict=True)
        if not any(whole.is_relative_to(root) for root in roots):
            return False
        mode = whole.stat().st_mode
        if stat.S_ISREG(mode):
            return True
        return stat.S_ISDIR(mode) and _holds_regular_files(whole)
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
