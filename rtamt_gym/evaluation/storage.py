"""Evaluations as strict JSON: numbers that are not finite are the texts "inf", "-inf", "nan"."""

from __future__ import annotations

import math
from base64 import b64decode, b64encode
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

import rtamt
from rtamt import Verdict
from rtamt_gym.evaluation.frames import Frame
from rtamt_gym.evaluation.json_files import read_fields
from rtamt_gym.inputs.case import Case
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.runs.record import Record
from rtamt_gym.search.runs.report import strict_json
from rtamt_gym.simulation.record import CURVES, Course
from rtamt_gym.simulation.run import Run

__all__ = ["read", "written"]

_FORMAT: Final = "rtamt evaluation 1"

_OF_RUN: Final = (
    *("system", "ended", "violated_by", "view", "stop", "limit", "seed", "label", "wall_time"),
    *("align", "first_sample", "reward"),
)
"""The fields of a run that JSON holds as they are."""

_OF_COURSE: Final = ("formula", "final", "decided_at", "unit", "semantics", "inputs", "outputs")
"""The fields of a course that JSON holds as they are."""

_COUNTS: Final = ("episodes", "satisfied", "violated", "undecided", "failed", "rate", "interval")


def written(evaluation: Any) -> str:  # noqa: ANN401 - that module imports this one
    """The text of an evaluation; `read` reads it.

    What follows from the episodes is there for other programs: ``read`` makes it anew.
    """
    runs: list[Run] = []
    places: dict[str, list[int]] = {}
    for name, worst in evaluation.worst_runs.items():
        for run in worst:
            if all(run is not each for each in runs):
                runs.append(run)
        places[name] = [next(i for i, each in enumerate(runs) if each is run) for run in worst]
    results = {**evaluation.requirements, evaluation.success.name: evaluation.success}
    return strict_json(
        {
            "format": _FORMAT,
            "rtamt": rtamt.__version__,
            "system": evaluation.system,
            "policy": evaluation.policy,
            "period": None if evaluation.period is None else str(evaluation.period),
            "limit": _finite(evaluation.limit),
            "seed": evaluation.seed,
            "decision": None if evaluation.decision is None else dict(evaluation.decision),
            "reading": evaluation.reading,
            "requirements": dict(evaluation.record.requirements),
            "results": {name: _result(result) for name, result in results.items()},
            "episodes": _finite(evaluation.record.columns()),
            "runs": [
                {**_run(run), "frames": _frames(evaluation.frames.get(run.seed, ()))}
                for run in runs
            ],
            "worst_runs": places,
        }
    )


def read(path: Path) -> dict[str, Any]:
    """Reads the fields of an evaluation from a file with the text that `written` has made.

    Raises:
        InputError: If the file does not hold an evaluation.
    """
    return read_fields(path, "evaluation", _FORMAT, _fields)


def _fields(kept: Mapping[str, Any]) -> dict[str, Any]:
    requirements = kept["requirements"]
    columns = {
        name: cells
        if name in _TEXTS or name.startswith(("verdict(", "decided_sample("))
        else _numbers(cells)
        for name, cells in kept["episodes"].items()
    }
    cells = zip(*columns.values(), strict=True)
    rows = [
        Trial.read(dict(zip(columns, each, strict=True)), Case({}), requirements) for each in cells
    ]
    runs = [_read_run(each) for each in kept["runs"]]
    frames = {
        each["seed"]: tuple(
            Frame(_number(frame["time"]), b64decode(frame["webp"])) for frame in each["frames"]
        )
        for each in kept["runs"]
        if each.get("frames")
    }
    return {
        "record": Record(rows, requirements, kept["system"]),
        "period": _period(kept["period"]),
        "limit": _number(kept["limit"]),
        "worst_runs": {
            name: tuple(runs[i] for i in places) for name, places in kept["worst_runs"].items()
        },
        "frames": frames,
        "reading": kept.get("reading"),  # files of older versions have none
        **{name: kept[name] for name in ("system", "policy", "seed", "decision")},
    }


_TEXTS: Final = ("seed", "ended", "error")
"""The columns of a record whose cells are no floats."""


def _result(result: Any) -> dict[str, Any]:  # noqa: ANN401 - see `written`
    found = {name: getattr(result, name) for name in _COUNTS}
    found["quantiles"] = {str(share): value for share, value in result.quantiles.items()}
    found["first_violations"] = result.first_violations.tolist()
    found |= {"saved": result.saved, "worst": [list(each) for each in result.worst]}
    kept: dict[str, Any] = _finite(found)
    return kept


def _run(run: Run) -> dict[str, Any]:
    kept: dict[str, Any] = _finite({name: getattr(run, name) for name in _OF_RUN})
    kept["period"] = None if run.period is None else str(run.period)
    kept["signals"] = {name: _finite(values.tolist()) for name, values in run.signals.items()}
    kept["courses"] = {
        name: _finite({each: getattr(course, each) for each in _OF_COURSE})
        | {curve: _finite(getattr(course, curve).tolist()) for curve in CURVES}
        | {"verdict": course.verdict.name, "deciding": _deciding(run, name)}
        for name, course in run.courses.items()
    }
    return kept


def _frames(frames: Sequence[Frame]) -> list[dict[str, Any]]:
    return [{"time": frame.time, "webp": b64encode(frame.webp).decode("ascii")} for frame in frames]


def _deciding(run: Run, name: str) -> dict[str, Any] | None:
    """The predicate that decided a robustness, where, and what its variables were there.

    None: a window that lies outside of the run decided.
    """
    explanation = run.explain(name)
    if explanation.predicate is None:
        return None
    last = explanation.steps[-1]
    values = {cause.variable: cause.value for cause in explanation.causes}
    kept: dict[str, Any] = _finite(
        {"predicate": last.text, "sample": last.sample, "time": last.time, "values": values}
    )
    return kept


def _read_run(kept: Mapping[str, Any]) -> Run:
    fields = {name: kept[name] for name in _OF_RUN}
    fields |= {name: _number(kept[name]) for name in ("wall_time", "reward")}
    fields["period"] = _period(kept["period"])
    fields["signals"] = {name: np.array(_numbers(each)) for name, each in kept["signals"].items()}
    fields["courses"] = {name: _course(each) for name, each in kept["courses"].items()}
    return Run(**fields)


def _course(kept: Mapping[str, Any]) -> Course:
    fields = {name: kept[name] for name in _OF_COURSE}
    fields |= {name: tuple(kept[name]) for name in ("inputs", "outputs")}
    fields |= {curve: np.array(_numbers(kept[curve]), np.float64) for curve in CURVES}
    return Course(**fields | {"final": _number(kept["final"]), "verdict": Verdict[kept["verdict"]]})


def _period(kept: str | None) -> Fraction | None:
    return None if kept is None else Fraction(kept)


def _numbers(kept: list[Any]) -> list[Any]:
    return [_number(each) for each in kept]


def _number(kept: float | str | None) -> Any:  # noqa: ANN401 - a float, or None
    return None if kept is None else float(kept)


def _finite(value: Any) -> Any:  # noqa: ANN401 - what JSON holds
    """A value with texts for the numbers that JSON cannot write."""
    if isinstance(value, Mapping):
        return {name: _finite(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else repr(float(value))
    return value
