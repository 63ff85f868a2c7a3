"""The section of recorded traces under requirements: what ``rtamt monitor --json`` has written."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

import rtamt
from rtamt import EpisodeMonitor, InputError, Verdict
from rtamt_gym.judging.interface import EXACT
from rtamt_gym.judging.reading import Reading
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.recorded.ruled import read_ruled
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.reports.episodes import Played, in_words_of
from rtamt_gym.reports.model import Fact, Section, ShownEpisode, ShownRequirement, ShownTrial
from rtamt_gym.reports.rows import TRIALS, requirement_of, worst_first
from rtamt_gym.reports.series import six
from rtamt_gym.reports.views import Cell, TraceLine, TraceTable, Word
from rtamt_gym.tables import counted

__all__ = ["of_matrix"]

_LONGEST: Final = 20_000
"""The most samples of a trace whose bounds are shown: they are made sample by sample."""

_WORDS: Final[Mapping[str, Word]] = {
    "SATISFIED": "satisfied",
    "VIOLATED": "violated",
    "UNDECIDED": "undecided",
    "ERROR": "failed",
}

_RULES: Final = ("period", "time", "end", "view", "semantics", "align")


def of_matrix(outcomes: Mapping[str, Any], folder: Path, room: int) -> Section:
    """The section of outcomes; the worst trace of each requirement is read again, if it is there.

    Args:
        outcomes: What ``rtamt monitor --json`` has written, read as JSON.
        folder: Where traces are looked for that are not in the present folder.
        room: How many numbers all episodes together may have.

    Raises:
        KeyError: If the outcomes lack something.
    """
    formulas, traces = outcomes["requirements"], outcomes["traces"]
    facts = [Fact("traces", str(len(traces)))]
    facts += [Fact(name, str(outcomes[name])) for name in _RULES if name in outcomes]
    requirements, notes = [], []
    for name, formula in formulas.items():
        found, note = _requirement(outcomes, name, formula, folder, room // len(formulas))
        requirements.append(found)
        notes += [note] if note and note not in notes else []
    lines = sorted(
        (_line(trace, formulas) for trace in traces),
        key=lambda line: ("failed", "violated", "undecided", "satisfied").index(line.verdict),
    )
    kept = {line.name for line in lines[:TRIALS]}
    return Section(
        kind="matrix",
        title=f"{counted(len(traces), 'recorded trace')} under "
        f"{counted(len(formulas), 'requirement')}",
        unit="s" if _period(outcomes) else "steps",
        facts=tuple(facts),
        notes=tuple(notes),
        requirements=tuple(requirements),
        matrix=TraceTable(
            tuple(formulas),
            tuple(_line(each, formulas) for each in traces if each["trace"] in kept),
            max(0, len(traces) - TRIALS),
        ),
    )


def _period(outcomes: Mapping[str, Any]) -> object:
    """None if bounds count samples, as the descriptions of the traces say."""
    described = (trace["described"] or "" for trace in outcomes["traces"])
    return None if any(text.endswith("bounds count samples") for text in described) else 1


def _line(trace: Mapping[str, Any], formulas: Mapping[str, str]) -> TraceLine:
    cells = [trace["requirements"][name] for name in formulas]
    return TraceLine(
        name=trace["trace"],
        verdict=_WORDS[trace["verdict"]],
        described=trace["described"] or "",
        cells=tuple(Cell(_WORDS[each["verdict"]], _robustness(each)) for each in cells),
        notes=tuple(trace["notes"]),
    )


def _robustness(cell: Mapping[str, Any]) -> float | None:
    return None if "robustness" not in cell else six(float(cell["robustness"]))


def _requirement(
    outcomes: Mapping[str, Any], name: str, formula: str, folder: Path, room: int
) -> tuple[ShownRequirement, str]:
    """A requirement with its worst trace in full, and why it has none."""
    trials = []
    for trace in outcomes["traces"]:
        cell = trace["requirements"][name]
        word = _WORDS[cell["verdict"]]
        certain = cell.get("certain_from") if word == "violated" else None
        text = cell.get("error") or cell.get("way_out") or ""
        at = None if certain is None else six(float(certain))
        trials.append(ShownTrial(trace["trace"], word, _robustness(cell), at, text=text))
    trials.sort(key=worst_first)
    judged = [each for each in trials if each.robustness is not None]
    worst, note = [], ""
    if judged:
        try:
            worst = [_episode(outcomes, judged[0], formula, folder, room)]
        except (rtamt.RtamtError, OSError) as error:
            message = str(error).partition("\n")[0]
            note = f"The worst trace of {name} is not shown in full: {message}."
    words = in_words_of(formula, _period(outcomes), step=outcomes.get("view") == "step")
    return requirement_of(name, words, formula, trials, worst), note


def _episode(
    outcomes: Mapping[str, Any], trial: ShownTrial, formula: str, folder: Path, room: int
) -> ShownEpisode:
    """A trace in full.

    Raises:
        RtamtError: If it cannot be read again, or is of another kind.
        OSError: If it is not there.
    """
    if outcomes["time"] == "dense" or outcomes["semantics"] not in EXACT:
        raise InputError("this page shows samples under the standard or the boolean semantics")
    period = Fraction(outcomes["period"]) if "period" in outcomes else None
    said = {name: outcomes[name] for name in ("view", "semantics", "align") if name in outcomes}
    reading = Reading(period=period, **said)
    path = Path(trial.label)
    path = path if path.exists() else folder / path
    spec = rtamt.parse(formula)
    columns = Columns(**outcomes.get("columns", {}))
    trace, period = read_ruled(str(path), {"": spec}, reading, columns)
    if not isinstance(trace, Trace):
        raise InputError("this page shows samples")
    whole = viewed(spec, reading.view)
    start = trace.start if period is not None else 0.0
    times = np.arange(float(trace.samples)) * float(period or 1) + start
    curves = _curves(whole, trace, period, reading)
    verdict = next(v for v in Verdict if _WORDS[v.name] == trial.verdict)
    at = None
    if trial.violated_at is not None:
        at = int(np.abs(times - trial.violated_at).argmin())
    played = Played(
        label=trial.label,
        spec=whole,
        interface={"semantics": reading.semantics},
        signals=trace.columns,
        times=times,
        period=period,
        align=reading.align,
        verdict=verdict,
        final=float(trial.robustness or 0.0),
        curves=curves,
        violated_at=at,
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
