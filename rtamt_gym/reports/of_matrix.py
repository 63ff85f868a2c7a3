"""The section of recorded traces under requirements: what ``rtamt monitor --json`` has written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np

import rtamt
from rtamt import EpisodeMonitor
from rtamt_gym.judging.monitors import EXACT
from rtamt_gym.options.evaluation import Reading
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.recorded.ruled import read_ruled
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.reports.episodes import PlayedEpisode, in_words_of
from rtamt_gym.reports.model import Fact, Section, ShownEpisode, ShownRequirement
from rtamt_gym.reports.rows import TRIALS, judged, made_of, requirement_of, trials_of
from rtamt_gym.reports.series import six
from rtamt_gym.reports.trace_folders import NotShownError, TraceFolders
from rtamt_gym.reports.views import Cell, MutantView, TraceLine, TraceTable
from rtamt_gym.results.codec import trials_of as read_trials
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.mutation import MutationScore
from rtamt_gym.results.outcome import Outcome, Word, word
from rtamt_gym.results.provenance import provenance_of
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted

__all__ = ["of_matrix"]

_LONGEST: Final = 20_000
"""The most samples of a trace whose bounds are shown: they are made sample by sample."""

_RULES: Final = ("period", "time", "end", "view", "semantics", "align")


def of_matrix(
    kept: Mapping[str, Any], folder: Path, room: int, *, traces: Sequence[Path] = ()
) -> Section:
    """The section of recorded traces; the worst of each requirement is read again, if it is there.

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
    facts = [Fact("traces", str(len(matrix)))]
    facts += [Fact(name, str(reading[name])) for name in _RULES if name in reading]
    constants = {k: v for k, v in reading.items() if k.startswith("constant:")}
    facts += [Fact(name.replace(":", " "), str(value)) for name, value in constants.items()]
    share = room // len(formulas)
    below = TraceFolders((Path.cwd(), folder.absolute()), tuple(traces))
    requirements = [_requirement(matrix, reading, name, below, share) for name in formulas]
    words = get_args(Word)
    places = sorted(range(len(matrix)), key=lambda i: words.index(matrix[i].word))[:TRIALS]
    return Section(
        kind="matrix",
        title=f"{counted(len(matrix), 'recorded trace')} under "
        f"{counted(len(formulas), 'requirement')}",
        unit="s" if _period(matrix) else "steps",
        facts=tuple(facts),
        requirements=tuple(requirements),
        matrix=TraceTable(
            tuple(formulas),
            tuple(_line(matrix[i], formulas) for i in sorted(places)),
            len(matrix) - len(places),
        ),
        mutants=_mutants(kept),
        **made_of(matrix.provenance),
    )


def _mutants(kept: Mapping[str, Any]) -> MutantView | None:
    """What the traces notice of mutants, if some were made."""
    said = kept.get("mutants")
    if said is None:
        return None
    scores = {name: MutationScore.read(each) for name, each in said["requirements"].items()}
    return MutantView(scores, said["least"])


def _period(matrix: Matrix) -> object:
    """None if bounds count samples, as the descriptions of the traces say."""
    return None if any(row.described.endswith("bounds count samples") for row in matrix) else 1


def _line(row: Trial, names: Iterable[str]) -> TraceLine:
    return TraceLine(
        name=row.name,
        verdict=row.word,
        described=row.described,
        cells=tuple(Cell(word(row.cell(name)), _robustness(row.judged(name))) for name in names),
        notes=row.notes,
    )


def _robustness(outcome: Outcome | None) -> float | None:
    return None if outcome is None else six(outcome.robustness)


def _requirement(
    matrix: Matrix, reading: Mapping[str, Any], name: str, below: TraceFolders, room: int
) -> ShownRequirement:
    """A requirement with its worst trace in full, or a note that says why it has none."""
    formula, outcomes = matrix.requirements[name], judged(matrix, name)
    trials = trials_of(matrix.rows, outcomes, lambda _, row: row.name)
    known = [trial.label for trial in trials if trial.robustness is not None]
    worst, note = [], ""
    if known:
        row = next(row for row in matrix if row.name == known[0] and row.judged(name))
        try:
            path = below.found(row.name, matrix.provenance.files.get(row.name, ""))
            worst = [_episode(row.name, row.outcomes[name], reading, formula, path, room)]
        except NotShownError as error:
            note = f"The worst trace, `{row.name}`, is not shown in full: {error}."
    words = in_words_of(formula, _period(matrix), step=reading.get("view") == "step")
    known_id = matrix.provenance.ids.get(name)
    return requirement_of(name, words, formula, trials, worst, note=note, id=known_id)


def _episode(
    name: str,
    outcome: Outcome,
    kept: Mapping[str, Any],
    formula: str,
    path: Path,
    room: int,
) -> ShownEpisode:
    """A trace in full.

    Raises:
        NotShownError: If it cannot be read again, or is of another kind.
    """
    if kept["time"] == "dense" or kept["semantics"] not in EXACT:
        raise NotShownError("this page shows samples under the standard or the boolean semantics")
    period = Fraction(kept["period"]) if "period" in kept else None
    said = {each: kept[each] for each in ("view", "semantics", "align") if each in kept}
    reading = Reading(period=period, **said)
    spec = rtamt.parse(formula)
    columns = Columns(**kept.get("columns", {}))
    try:
        trace, period = read_ruled(str(path), {"": spec}, reading, columns)
    except (rtamt.RtamtError, OSError):
        # What a reader says of a file may repeat what stands in it.
        raise NotShownError(
            "it cannot be read as it was when it was judged; rtamt monitor says why"
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
    spec: rtamt.Specification, trace: Trace, period: Fraction | None, reading: Reading
) -> dict[str, Any]:
    """Robustness and bounds at every sample; nothing of a long trace."""
    if trace.samples > _LONGEST:
        return {}
    monitor = EpisodeMonitor(spec, period, semantics=reading.semantics, align=reading.align)
    names = ("robustness", "lower", "upper")
    rows = []
    for i in range(trace.samples):
        monitor.update({name: trace.columns[name][i] for name in monitor.variables})
        rows.append([getattr(monitor, each) for each in names])
    return dict(zip(names, np.array(rows).T, strict=True))
