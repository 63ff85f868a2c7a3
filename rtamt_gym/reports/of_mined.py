"""The section of a constant that was mined: its value, and the traces that decided it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rtamt_gym.reports.episodes import in_words_of
from rtamt_gym.reports.model import Fact, Section
from rtamt_gym.reports.rows import judged, requirement_of, trials_of
from rtamt_gym.results.codec import number_of
from rtamt_gym.results.codec import trials_of as read_trials
from rtamt_gym.results.table import Results
from rtamt_gym.tables import counted, number

__all__ = ["of_mined"]


def of_mined(kept: Mapping[str, Any]) -> Section:
    """The section of what ``rtamt mine --json`` has written.

    Args:
        kept: The result, of the kind ``"mined"``.

    Raises:
        KeyError: If something is not in it.
    """
    results = Results(read_trials(kept), kept["requirements"])
    name, traces = kept["parameter"], counted(kept["traces"], "trace")
    value, fails_at, low, high = (
        number(number_of(kept[each])) for each in ("value", "fails_at", "low", "high")
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
            each,
            in_words_of(formula, 1),
            formula,
            trials_of(results.rows, judged(results, each), lambda _, row: row.name),
            note=f"The traces that let no tighter value pass, at {name} = {value}.",
        )
        for each, formula in results.requirements.items()
    ]
    return Section(
        kind="matrix",
        title=f"{name} = {value} for {kept['requirement']}",
        facts=tuple(Fact(*each) for each in facts.items()),
        notes=(
            f"{value} is the {kept['side']} for which {traces} satisfy `{kept['requirement']}`.",
            *kept["notes"],
        ),
        requirements=tuple(requirements),
    )
