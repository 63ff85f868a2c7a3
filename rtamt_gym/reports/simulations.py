"""The sections of simulations: sweeps, other records, runs, searches and saved cases."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from types import MappingProxyType
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import NDArray

from rtamt import Verdict
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.space import Parameter, Space
from rtamt_gym.play.record import Record
from rtamt_gym.play.run import Run
from rtamt_gym.play.saved_case import SavedCase
from rtamt_gym.play.summaries import failures
from rtamt_gym.reports.episodes import case_texts, episode_of_run, in_words_of, rounded_moment
from rtamt_gym.reports.figures import cases_figure, convergence_figure, map_figure
from rtamt_gym.reports.model import (
    TRIALS,
    Figure,
    Requirement,
    Section,
    SectionKind,
    ShownEpisode,
    TrialRow,
)
from rtamt_gym.reports.numbers import rounded, six
from rtamt_gym.reports.requirements import (
    at_stop,
    cases_of,
    labelled,
    made_of,
    reuse_notes,
    trials_of,
)
from rtamt_gym.results.codec import provenance_of
from rtamt_gym.results.codec import trials_of as read_trials
from rtamt_gym.results.outcome import WORDS, Outcome, Word, word
from rtamt_gym.results.provenance import ChangedModelError
from rtamt_gym.search.falsification.falsification import Falsification
from rtamt_gym.search.falsification.points import Effects
from rtamt_gym.search.sweeps.effects import RobustnessMap, map_of
from rtamt_gym.search.sweeps.sweep import Sweep
from rtamt_gym.tables import counted, number, sample_text

Floats = NDArray[np.float64]

_COLUMNS: Final = 4
"""The maximum number of columns with a map for every two; of more, the first columns."""

_CELLS: Final = 2500
"""The maximum number of cells of a map."""


def of_record(
    result: Sweep | Record,
    room: int,
    facts: Mapping[str, str] | None = None,
    kind: SectionKind = "sweep",
    unit: str | None = None,
) -> Section:
    """Return the section of a sweep, or of the record of any simulations.

    The worst simulation of each requirement is played again if the result has its system, which a
    file does not have.
    """
    sweep = result if isinstance(result, Sweep) else None
    record = result if isinstance(result, Record) else result.record
    worst: dict[str, list[Run]] = {}
    notes = [" ".join(line.strip() for line in failures(record))] if record.failed() else []
    notes += reuse_notes(record.provenance, "simulation")
    if sweep is not None and sweep.playable:
        for name in record.requirements:
            if any(name in row.outcomes for row in record):
                worst[name] = [sweep.replay(sweep.worst(name))]
    else:
        notes.append(
            "The result holds no system, so that no simulation was played again for this page."
        )
    unit = unit or (unit_of(worst) if worst or record.has_times else "steps")
    parts = dict(facts or {})
    if sweep is not None:
        parts = {"sampler": sweep.sampler, "seed": str(sweep.seed)} | parts
    simulated = math.fsum(row.simulated for row in record)
    parts = {"simulations": str(len(record)), "simulated": f"{simulated:.6g} {unit}", **parts}
    return Section(
        kind=kind,
        title=f"{counted(len(record), 'simulation')} of {record.system or 'a system'}",
        system=record.system,
        unit=unit,
        facts=tuple(parts.items()),
        notes=tuple(notes),
        requirements=requirements_of(
            record, worst, room, unit=unit, kind=kind, space=None if sweep is None else sweep.space
        ),
        returns=rounded(sorted(row.reward for row in record if row.reward is not None)),
        durations=rounded(sorted(row.simulated for row in record)),
        cases=None if (cases := cases_of(record)) is None else cases[0],
        **made_of(record.provenance),
    )


def unit_of(runs: Mapping[str, list[Run]]) -> str:
    """Return the unit of times in runs; seconds without runs."""
    every = [run for some in runs.values() for run in some]
    return "steps" if every and every[0].period is None else "s"


def requirements_of(
    record: Record,
    worst: Mapping[str, list[Run]],
    room: int,
    *,
    unit: str,
    kind: SectionKind = "search",
    space: Space | None = None,
    figures: Mapping[str, Figure] = MappingProxyType({}),
) -> tuple[Requirement, ...]:
    """Return the requirements of a record, with some runs in full.

    Rates are shown only if trials differ by the seed only: otherwise, they would describe the
    sampler, not the system.
    """
    episodes = sum(map(len, worst.values()))
    match, results = [], record.results()
    cases, maps = cases_of(record), {} if kind == "search" else maps_of(record, space)
    for name, formula in record.requirements.items():
        trials = trials_of(record, record.outcomes(name))
        runs = worst.get(name, [])
        step = any(run.view == "step" for run in runs)
        period = None if unit == "steps" else 1
        result = None if record.has_cases or not trials else results[name]
        match.append(
            Requirement(
                name,
                in_words_of(formula, period, step=step),
                formula,
                trials,
                worst=tuple(_episode(record, run, name, room, episodes) for run in runs),
                figures=(
                    *([figures[name]] if name in figures else []),
                    *maps.get(name, ()),
                    *([] if cases is None else [cases_figure(cases[0], name, cases[1])]),
                ),
                rate=None if result is None else result.rate,
                interval=None if result is None else result.interval,
                note=at_stop(record, name, "simulation"),
                id=record.provenance.ids.get(name),
            )
        )
    return tuple(match)


def _episode(record: Record, run: Run, name: str, room: int, episodes: int) -> ShownEpisode:
    """Return the run of a row, under the label of the row."""
    numbers = (i for i, row in enumerate(record) if row.case == run.case and row.seed == run.seed)
    number = next(numbers, None)
    label = "the case found" if number is None else labelled(number, record[number])
    return episode_of_run(run, name, label, room, episodes)


def maps_of(record: Record, space: Space | None) -> dict[str, list[Figure]]:
    """Return the maps of each requirement over every two columns that are a grid."""
    columns = {name: record.numbers(name) for name in record.case_columns}
    varied = [
        name
        for name, cells in columns.items()
        if np.isfinite(cells).all() and 1 < len(set(cells.tolist())) <= _CELLS**0.5
    ]
    if len(varied) < 2:
        return {}
    units = {item.name: item.unit for item in space or () if isinstance(item, Parameter)}
    grid = Space([Parameter(name, columns[name].min(), columns[name].max()) for name in varied])
    maps: dict[str, list[Figure]] = {}
    for name in record.requirements:
        if all(name not in row.outcomes for row in record):
            continue
        for y, x in combinations(varied[:_COLUMNS], 2):
            heights = map_of(record, grid, x, y, name)
            if heights.cells is None:
                continue
            cells = tuple(
                tuple(None if math.isnan(cell) else six(cell) for cell in row)
                for row in heights.cells.tolist()
            )
            right, up = (f"{item} [{units[item]}]" if units.get(item) else item for item in (x, y))
            figure = map_figure(
                name,
                (right, up),
                (rounded(heights.xs), rounded(heights.ys)),
                cells,
                _words_of(record, name, (columns[x], columns[y]), heights),
                folded=heights.folded,
            )
            maps.setdefault(name, []).append(figure)
    return maps


def _words_of(
    record: Record, name: str, at: tuple[Floats, Floats], heights: RobustnessMap
) -> tuple[tuple[Word, ...], ...]:
    """Return the worst word of each cell of a map; a failure counts only without other words."""
    worst: dict[tuple[float, float], Word] = {}
    order = get_args(Word)[1:]
    for x, y, outcome in zip(*(item.tolist() for item in at), record.outcomes(name), strict=True):
        both = {word(outcome), worst.get((x, y), "failed")}
        worst[x, y] = next((item for item in order if item in both), "failed")
    return tuple(tuple(worst[x, y] for x in heights.xs.tolist()) for y in heights.ys.tolist())


def of_runs(stored: Mapping[str, Any], room: int) -> Section:
    """Return the section of episodes in a file of ``rtamt run --json``."""
    record = record_of(stored)
    parts = {"period": stored["period"], **stored["reading"]}
    facts = {name: str(value) for name, value in parts.items() if value is not None}
    title = f"{counted(len(record), 'episode')} of {record.system}"
    unit = "s" if stored["period"] else "steps"
    section = of_record(record, room, facts, "evaluation", unit)
    return replace(section, title=title, notes=())


def of_run(run: Run, room: int) -> Section:
    """Return the section of one run with its samples."""
    trial, label = run.trial(), run.label or labelled(0, run.trial())
    unit = "s" if run.period is not None else "steps"
    requirements = []
    for name, history in run.histories.items():
        words = in_words_of(history.formula, run.period, unit=history.unit, step=run.view == "step")
        requirements.append(
            Requirement(
                name,
                words,
                history.formula,
                trials_of([trial], [trial.judged(name)], lambda *_: label),
                worst=(episode_of_run(run, name, label, room, len(run.histories)),),
                id=history.specification.id,
            )
        )
    last = sample_text(run.last_sample, run.period)
    facts = {"ended": f"{run.ended} at {last}", "samples": str(run.steps + 1)}
    return Section(
        kind="evaluation",
        title=f"A run of {run.system}",
        system=run.system,
        unit=unit,
        facts=tuple(facts.items()),
        requirements=tuple(requirements),
    )


def of_search(search: Falsification, room: int) -> Section:
    """Return the section of a search; the case that it found, or the closest, is played again."""
    record, name = search.record, search.requirement
    runs: dict[str, list[Run]] = {}
    if name in search.row.outcomes:
        runs[name] = [search.replay()]
    unit = unit_of(runs)
    facts = {
        "simulations": f"{search.simulations} of at most {search.budget}",
        "optimizer": search.optimizer,
        "seed": str(search.seed),
        "simulated": f"{search.simulated_time:.6g} {unit}",
        "robustness": number(search.robustness),
    }
    notes = [
        _answer(name, search.simulations, falsified=search.falsified),
        f"Input: {'; '.join(case_texts(search.input))}.",
    ]
    if search.reductions:
        notes.append(
            f"The input was made simpler by {counted(search.reductions, 'more simulation')}."
        )
    notes.append(f"Coverage (not a proof): {search.coverage}.")
    if search.effects.without:
        notes.append(f"Note: {search.effects}.")
    return _search_section(record, runs, room, unit, facts, notes)


def convergence_of(record: Record) -> dict[str, Figure]:
    """Return the chart of the robustness over the simulations, for each requirement.

    For more than 2000 simulations, it shows each new minimum and evenly spaced others.
    """
    return {name: _convergence(name, record.outcomes(name)) for name in record.requirements}


def _convergence(name: str, outcomes: Sequence[Outcome | None]) -> Figure:
    heights = [None if outcome is None else outcome.robustness for outcome in outcomes]
    minima: list[float | None] = []
    for height in heights:
        known = [item for item in (*minima[-1:], height) if item is not None]
        minima.append(min(known) if known else None)
    steps = {i for i in range(len(minima)) if i == 0 or minima[i] != minima[i - 1]}
    spacing = max(1, math.ceil(len(minima) / (4 * TRIALS)))
    places = sorted({*steps, *range(0, len(minima), spacing), len(minima) - 1})
    robustness, minima_so_far = (
        tuple(None if item[i] is None else six(item[i]) for i in places)
        for item in (heights, minima)
    )
    words = tuple(word(outcomes[i]) for i in places)
    return convergence_figure(name, [i + 1 for i in places], robustness, words, minima_so_far)


def of_case(saved: SavedCase, room: int, *, play: bool = False) -> Section:
    """Return the section of a saved case."""
    formula = str(saved.requirement.formula)
    run, note = _played(saved) if play else (None, _unplayed(saved))
    name, unit = saved.name, "steps" if run is not None and run.period is None else "s"
    worst = () if run is None else (episode_of_run(run, name, "the case found", room, 1),)
    step = saved.evaluation_options.get("view") == "step"
    # the evidence for another verdict is not evidence for this one
    stands_on = run.outcomes[name] if run is not None and saved.gives(run) else None
    violated = None if run is None else run.outcomes[name].violated
    trial = TrialRow(
        "the case found",
        WORDS[saved.verdict],
        six(saved.robustness),
        None if violated is None else rounded_moment(violated),
        None if run is None else six(run.duration),
        seed=saved.seed,
        case=case_texts(saved.case),
        asked=None if stands_on is None else stands_on.trigger_count,
        vacuous=stands_on is not None and stands_on.vacuous,
        progress=None if stands_on is None else stands_on.progress,
    )
    system = _system_text(saved.system)
    requirement = Requirement(
        name,
        in_words_of(
            formula, None if unit == "steps" else 1, unit=saved.requirement.unit, step=step
        ),
        formula,
        (trial,),
        worst=worst,
        id=saved.requirement.id,
    )
    verb = {Verdict.VIOLATED: "violates", Verdict.SATISFIED: "satisfies"}
    title = f"A case that {verb.get(saved.verdict, 'leaves open')} {name}"
    return Section(
        kind="search",
        title=title,
        system=system,
        policy=saved.policy or "",
        unit=unit,
        facts=(("robustness", number(saved.robustness)),),
        notes=(f"The case was not run: {note}" if run is None else note,),
        requirements=(requirement,),
        versions=dict(saved.versions),
        not_played=note if run is None else "",
    )


def _unplayed(saved: SavedCase) -> str:
    """Return why a case is shown without a run."""
    code = ", ".join(saved.imports) or "nothing"
    return f"a report only reads; --play runs the case, which imports {code}"


def _played(saved: SavedCase) -> tuple[Run | None, str]:
    """Return the run of a case and a note; None and the error if it cannot be replayed."""
    try:
        run = saved.replay()
    except ChangedModelError as error:
        return None, error.message.worded(lambda _: "rtamt replay --accept-changed")
    except Exception as error:  # noqa: BLE001 - the section shows the rest of the file
        message = str(error).partition("\n")[0]
        return None, f"{type(error).__name__}: {message}"
    if saved.repeats(run):
        return run, "Played again for this page, the case gave the same robustness."
    got = number(run.histories[saved.name].final)
    return run, f"Played again for this page, the case gave another robustness: {got}."


def _system_text(system: Any) -> str:  # noqa: ANN401 - an object of JSON
    """Return the name of a system, for a title."""
    if "environment" in system or "object" in system:
        return str(system.get("environment", system.get("object")))
    return ", ".join(system.get("fmus", {})) or json.dumps(system)


def of_search_json(stored: Mapping[str, Any]) -> Section:
    """Return the section of a result of ``rtamt falsify --json``."""
    record = record_of(stored)
    case = case_texts(Case.from_json(json.dumps(stored["input"])))
    facts = ("simulations", "budget", "optimizer", "seed", "robustness", "reductions")
    without = tuple(stored.get("without_effect", ()))
    effects = Effects(without, int(stored.get("effect_simulations", 0)))
    notes = [
        _answer(stored["requirement"], stored["simulations"], falsified=stored["falsified"]),
        f"Input: {'; '.join(case)}.",
        *([f"Note: {effects}."] if effects.without else []),
    ]
    unit = "s" if record.has_times else "steps"
    return _search_section(record, {}, 0, unit, {name: str(stored[name]) for name in facts}, notes)


def record_of(stored: Mapping[str, Any]) -> Record:
    """Return the record in a stored result."""
    provenance = provenance_of(stored)
    return Record(read_trials(stored), stored["requirements"], stored["system"], provenance)


def _answer(name: str, simulations: int, *, falsified: bool) -> str:
    if falsified:
        return f"{name} is violated in simulation {simulations}."
    return f"No simulation violates a requirement; {name} came closest."


def _search_section(
    record: Record,
    runs: Mapping[str, list[Run]],
    room: int,
    unit: str,
    facts: Mapping[str, str],
    notes: Sequence[str],
) -> Section:
    """Return the section of a search from its record and the runs that are shown in full."""
    return Section(
        kind="search",
        title=f"Search for a violation by {record.system}",
        system=record.system,
        unit=unit,
        facts=tuple(facts.items()),
        notes=(*notes, *reuse_notes(record.provenance, "simulation")),
        requirements=requirements_of(record, runs, room, unit=unit, figures=convergence_of(record)),
        cases=None if (cases := cases_of(record)) is None else cases[0],
        **made_of(record.provenance),
    )
