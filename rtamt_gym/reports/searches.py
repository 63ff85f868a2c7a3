"""The section of a search for a violation: its course, the case that it found, and its replay."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from rtamt import Verdict
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.record import Record
from rtamt_gym.play.run import Run
from rtamt_gym.play.saved_case import SavedCase
from rtamt_gym.reports.episodes import case_texts, episode_of_run, in_words_of, rounded_moment
from rtamt_gym.reports.figures import convergence_figure
from rtamt_gym.reports.model import Figure, Section, TrialRow
from rtamt_gym.reports.numbers import six
from rtamt_gym.reports.records import requirements_of, unit_of
from rtamt_gym.reports.requirements import (
    TRIALS,
    cases_of,
    judged,
    made_of,
    requirement_of,
    reuse_notes,
)
from rtamt_gym.results.codec import trials_of
from rtamt_gym.results.fingerprint import ChangedModelError
from rtamt_gym.results.outcome import WORDS, Outcome, word
from rtamt_gym.results.provenance import provenance_of
from rtamt_gym.search.falsification.effects import Effects
from rtamt_gym.search.falsification.falsification import Falsification
from rtamt_gym.tables import counted, number


def of_search(found: Falsification, room: int) -> Section:
    """Return the section of a search; the case that it found, or the closest, is played again.

    Args:
        found: The result of the search.
        room: How many numbers the episode may have.
    """
    record, name = found.record, found.requirement
    runs: dict[str, list[Run]] = {}
    if name in found.row.outcomes:
        runs[name] = [found.replay()]
    unit = unit_of(runs)
    facts = {
        "simulations": f"{found.simulations} of at most {found.budget}",
        "optimizer": found.optimizer,
        "seed": str(found.seed),
        "simulated": f"{found.simulated_time:.6g} {unit}",
        "robustness": number(found.robustness),
    }
    notes = [
        f"{name} is violated in simulation {found.simulations}."
        if found.falsified
        else f"No simulation violates a requirement; {name} came closest.",
        f"Input: {'; '.join(case_texts(found.input))}.",
    ]
    if found.reductions:
        notes.append(
            f"The input was made simpler by {counted(found.reductions, 'more simulation')}."
        )
    notes.append(f"Coverage (not a proof): {found.coverage}.")
    if found.effects.without:
        notes.append(f"Note: {found.effects}.")
    notes += reuse_notes(record.provenance, "simulation")
    return Section(
        kind="search",
        title=f"Search for a violation by {record.system}",
        system=record.system,
        unit=unit,
        facts=tuple(facts.items()),
        notes=tuple(notes),
        requirements=requirements_of(record, runs, room, unit=unit, figures=convergence_of(record)),
        cases=None if (cases := cases_of(record)) is None else cases[0],
        **made_of(record.provenance),
    )


def convergence_of(record: Record) -> dict[str, Figure]:
    """Return the chart of the robustness over the simulations, for each requirement.

    Where there are more than 2000 simulations, it shows each that is less than all before it, and
    evenly spaced others.
    """
    return {name: _convergence(name, judged(record, name)) for name in record.requirements}


def _convergence(name: str, outcomes: Sequence[Outcome | None]) -> Figure:
    heights = [None if outcome is None else outcome.robustness for outcome in outcomes]
    least: list[float | None] = []
    for height in heights:
        known = [item for item in (*least[-1:], height) if item is not None]
        least.append(min(known) if known else None)
    steps = {i for i in range(len(least)) if i == 0 or least[i] != least[i - 1]}
    spacing = max(1, math.ceil(len(least) / (4 * TRIALS)))
    places = sorted({*steps, *range(0, len(least), spacing), len(least) - 1})
    robustness, least_so_far = (
        tuple(None if item[i] is None else six(item[i]) for i in places)
        for item in (heights, least)
    )
    words = tuple(word(outcomes[i]) for i in places)
    return convergence_figure(name, [i + 1 for i in places], robustness, words, least_so_far)


def of_case(saved: SavedCase, room: int, *, play: bool = False) -> Section:
    """Return the section of a saved case.

    Args:
        saved: The case.
        room: How many numbers the episode may have.
        play: Whether it is played again, which runs the code that it names, if its system can be
            made here.
    """
    formula = str(saved.requirement.formula)
    run, note = _played(saved) if play else (None, _unplayed(saved))
    name, unit = saved.name, "steps" if run is not None and run.period is None else "s"
    worst = [] if run is None else [episode_of_run(run, name, "the case found", room, 1)]
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
    requirement = requirement_of(
        name,
        in_words_of(
            formula, None if unit == "steps" else 1, unit=saved.requirement.unit, step=step
        ),
        formula,
        [trial],
        worst,
        noun="simulation",
        unit=unit,
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
    except Exception as error:  # noqa: BLE001 - the rest of the file is shown all the same
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


def of_search_json(kept: Mapping[str, Any]) -> Section:
    """Return the section of a result of ``rtamt falsify --json``: the course of the search.

    Args:
        kept: The result, of the kind ``"search"``.

    Raises:
        KeyError: If something is not in it.
    """
    record = Record(trials_of(kept), kept["requirements"], kept["system"], provenance_of(kept))
    name, falsified = kept["requirement"], kept["falsified"]
    case = case_texts(Case.from_json(json.dumps(kept["input"])))
    facts = ("simulations", "budget", "optimizer", "seed", "robustness", "reductions")
    unit = "s" if record.has_times else "steps"
    effects = Effects(tuple(kept.get("without_effect", ())), int(kept.get("effect_simulations", 0)))
    return Section(
        kind="search",
        title=f"Search for a violation by {kept['system']}",
        system=kept["system"],
        unit=unit,
        facts=tuple((name, str(kept[name])) for name in facts),
        notes=(
            f"{name} is violated in simulation {kept['simulations']}."
            if falsified
            else f"No simulation violates a requirement; {name} came closest.",
            f"Input: {'; '.join(case)}.",
            *([f"Note: {effects}."] if effects.without else []),
            *reuse_notes(record.provenance, "simulation"),
        ),
        requirements=requirements_of(record, {}, 0, unit=unit, figures=convergence_of(record)),
        cases=None if (cases := cases_of(record)) is None else cases[0],
        **made_of(record.provenance),
    )
