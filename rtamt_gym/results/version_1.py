"""Files of version 1, of which every kind had a form of its own, as version 2 writes them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from typing import Any, Final

__all__ = ["documented", "upgraded"]

Kept = Mapping[str, Any]


def upgraded(kept: Kept) -> dict[str, Any] | None:
    """The result of version 2 that a file of version 1 holds; None if it holds none.

    What version 1 did not say is not there: the samples at which verdicts of episodes were certain,
    the bounds of simulations of a search.

    Raises:
        KeyError, TypeError, ValueError, AttributeError: If something is not as version 1 wrote it.
    """
    found = _FORMATS.get(str(kept.get("format", "")))
    if found is None and "format" not in kept:
        found = next((each for keys, each in _UNNAMED if keys <= set(kept)), None)
    if found is None:
        return None
    kind, make = found
    head = {"format": "rtamt result", "version": 2, "kind": kind}
    return {**head, "rtamt": kept.get("rtamt"), **make(kept)}


def documented(traces: Iterable[Kept]) -> list[dict[str, Any]]:
    """The trials of ``rtamt monitor --json`` under the names that version 1 documents.

    They are written beside the names of version 2 for as long as this version lasts.
    """
    return [
        {
            "trace": trace["name"],
            "verdict": trace["verdict"],
            "described": trace.get("described"),
            "notes": trace.get("notes", []),
            "requirements": {name: _named(each) for name, each in trace["outcomes"].items()},
        }
        for trace in traces
    ]


_NEWER = {
    "decided_at",
    "ended_at",
    "text",
    "asked",
    "vacuous",
    "never_asked",
    "defaults",
    "unknown",
    "progress",
    "late_start",
}


def _named(outcome: Kept) -> dict[str, Any]:
    found = {name: each for name, each in outcome.items() if name not in _NEWER}
    if "decided_at" in outcome:
        at = outcome["decided_at"]
        seconds = at and at["seconds"]
        found["certain_from"] = at and (at["sample"] if seconds is None else seconds)
    return found


def _moment(sample: int | None, seconds: float | str | None) -> dict[str, Any] | None:
    return None if sample is None and seconds is None else {"sample": sample, "seconds": seconds}


def _at_sample(sample: int | None, period: Fraction | None) -> dict[str, Any] | None:
    if sample is None:
        return None
    return _moment(sample, None if period is None else float(sample * period))


def _trial(cells: Kept, requirements: Iterable[str], case: Kept) -> dict[str, Any]:
    """A trial from the cells of a row."""
    outcomes = {}
    for name in requirements:
        if cells[f"verdict({name})"] is not None:
            names = ("verdict", "robustness", "lower", "upper")
            outcomes[name] = {each: cells[f"{each}({name})"] for each in names}
            outcomes[name]["decided_at"] = _moment(None, cells[f"decided_at({name})"])
    own = {name: cells[name] for name in _OF_TRIAL if cells.get(name) is not None}
    return {"case": dict(case), **own, "outcomes": outcomes}


_OF_TRIAL: Final = ("seed", "ended", "simulated", "return", "wall", "error")


def _evaluation(kept: Kept) -> dict[str, Any]:
    columns, requirements = kept["episodes"], kept["requirements"]
    rows = [dict(zip(columns, each, strict=True)) for each in zip(*columns.values(), strict=True)]
    runs = [
        {
            **run,
            "courses": {
                name: {
                    **course,
                    "decided_at": _at_sample(course["decided_at"], _fraction(run["period"])),
                }
                for name, course in run["courses"].items()
            },
        }
        for run in kept["runs"]
    ]
    left = {name: each for name, each in kept.items() if name not in {"episodes", "runs", "format"}}
    return {**left, "trials": [_trial(row, requirements, {}) for row in rows], "runs": runs}


def _fraction(period: str | None) -> Fraction | None:
    return None if period is None else Fraction(period)


def _comparison(kept: Kept) -> dict[str, Any]:
    compared = kept["requirements"]
    texts = {each["name"]: each["formula"] for each in compared}
    left = {name: each for name, each in kept.items() if name != "format"}
    return {**left, "requirements": texts, "compared": compared}


def _record(kept: Kept) -> dict[str, Any]:
    trials = []
    for cells in kept["simulations"]:
        # A waveform is a number for each of its control points.
        names = list(cells)[: list(cells).index("seed")]
        case = {name: cells[name] for name in names if cells[name] is not None}
        trials.append(_trial(cells, kept["requirements"], case))
    left = {name: each for name, each in kept.items() if name not in {"simulations", "format"}}
    return {**left, "trials": trials}


def _search(kept: Kept) -> dict[str, Any]:
    heights: Mapping[str, list[Any]] = kept["robustness_of_simulations"]
    count = len(next(iter(heights.values())))
    trials = []
    for place in range(count):
        last = kept["falsified"] and place == count - 1
        outcomes = {
            name: _of_height(each[place], violated=last and name == kept["requirement"])
            for name, each in heights.items()
            if each[place] is not None
        }
        failed = {} if outcomes else {"error": "an error, which version 1 did not say"}
        trials.append({"ended": "duration", "simulated": 0.0, **failed, "outcomes": outcomes})
    left = {name: each for name, each in kept.items() if name not in _OF_SEARCH}
    return {**left, "trials": trials}


_OF_SEARCH: Final = {"format", "robustness_of_simulations"}


def _of_height(height: float | str, *, violated: bool) -> dict[str, Any]:
    """What a requirement became in a simulation of a search, which ends at the first violation."""
    holds = math.copysign(1.0, float(height)) > 0
    verdict = "VIOLATED" if violated else "SATISFIED" if holds else "UNDECIDED"
    bounds = {"lower": height, "upper": height} if verdict != "UNDECIDED" else _OPEN
    return {"verdict": verdict, "robustness": height, **bounds, "decided_at": None}


_OPEN: Final = {"lower": "-inf", "upper": "inf"}


def _case(kept: Kept) -> dict[str, Any]:
    return {name: each for name, each in kept.items() if name != "format"}


_RULES: Final = ("end", "view", "semantics", "align", "period", "time", "columns")


def _traces(kept: Kept) -> dict[str, Any]:
    trials = []
    for trace in kept["traces"]:
        untimed = (trace["described"] or "").endswith("bounds count samples")
        outcomes = {}
        for name, cell in trace["requirements"].items():
            at = cell.get("certain_from")
            found = {each: value for each, value in cell.items() if each != "certain_from"}
            if cell["verdict"] != "ERROR":
                found["decided_at"] = _moment(at, None) if untimed else _moment(None, at)
            outcomes[name] = found
        own = {each: trace[each] for each in ("described", "notes") if trace[each]}
        ended = {"name": trace["trace"], "ended": "recorded", "verdict": trace["verdict"]}
        trials.append({**ended, **own, "outcomes": outcomes})
    left = {name: each for name, each in kept.items() if name not in {*_RULES, "traces", "format"}}
    reading = {name: kept[name] for name in _RULES if name in kept}
    return {**left, "system": "", "reading": reading, "trials": trials}


_ENDS: Final = ("on_violation", "at_termination", "at_truncation")


def _runs(kept: Kept) -> dict[str, Any]:
    # Version 1 writes a period as a float, which mostly stands for a simple fraction.
    period = kept["period"]
    exact = None if period is None else Fraction(period).limit_denominator(10**6)
    trials = [
        {
            "seed": run["seed"],
            "ended": run["ended"],
            "simulated": float(run["steps"] * (exact or 1)),
            "outcomes": {
                name: {**each, "decided_at": _at_sample(each["decided_at"], exact)}
                for name, each in run["specs"].items()
            },
        }
        for run in kept["episodes"]
    ]
    limit = kept["time_limit"]
    return {
        "system": kept["environment"],
        "period": None if exact is None else str(exact),
        "limit": None if limit is None else float(limit * (exact or 1)),
        "reading": {name: kept[name] for name in _ENDS if name in kept},
        "requirements": kept["specs"],
        "trials": trials,
    }


def _mined(kept: Kept) -> dict[str, Any]:
    name, formula = kept["parameter"], kept["formula"]
    trials = [
        {
            "name": each["trace"],
            "ended": "recorded",
            "outcomes": {name: _of_height(each["robustness"], violated=False)},
        }
        for each in kept["witnesses"]
    ]
    left = {each: value for each, value in kept.items() if each != "witnesses"}
    return {**left, "system": "", "requirements": {name: formula}, "trials": trials}


_FORMATS: Final[Mapping[str, tuple[str, Callable[[Kept], dict[str, Any]]]]] = {
    "rtamt evaluation 1": ("evaluation", _evaluation),
    "rtamt comparison 1": ("comparison", _comparison),
    "rtamt record 1": ("record", _record),
    "rtamt search 1": ("search", _search),
    "rtamt case 1": ("case", _case),
    "rtamt outcomes 1": ("traces", _traces),
}

_UNNAMED: Final = (
    ({"environment", "time_limit", "specs", "episodes"}, ("runs", _runs)),
    ({"parameter", "witnesses", "fails_at"}, ("mined", _mined)),
)
"""What version 1 wrote without a format, by keys that it has."""
