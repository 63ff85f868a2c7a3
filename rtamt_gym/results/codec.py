"""The JSON form of stored results, written and read.

Files are strict JSON. The texts ``"inf"``, ``"-inf"`` and ``"nan"`` stand for numbers that are not
finite; missing values are null or left out. Every file has the keys ``"format"``, ``"version"`` and
``"kind"``.

To add a kind of result (the ``--json`` output of a new command): its name and writer in `KINDS`,
its text by `document`, a function in `rtamt_gym.reports` that makes a `Section` from the blocks of
`rtamt_gym.reports.model`, and a row of ``SECTIONS`` in `rtamt_gym.reports.write`. A class that
users save and load derives from `SavedResult`. List the kind in ``docs/results.md``, and its
command under "Reports" in ``docs/commands.md``. Write a file of it in ``written`` of
``tests/rtamt_gym/results/test_codec.py``, which checks the form of every kind. An error in
``tests/rtamt_gym/reports/test_results.py`` lists the writers of all kinds.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, ClassVar, Final, Self, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import InputError, Verdict
from rtamt.language import RequirementId
from rtamt.monitors import (
    BodyOccurrences,
    Occurrence,
    Occurrences,
    Response,
    RunTable,
    UnknownRun,
)
from rtamt.renamed import OldName
from rtamt_gym.inputs.case import Case
from rtamt_gym.results.extent import Extent, LateStart
from rtamt_gym.results.outcome import Failure, Moment, Outcome, triggers_of
from rtamt_gym.results.provenance import Fingerprint, Provenance
from rtamt_gym.results.statistics import STATISTICS, RequirementResult, Results
from rtamt_gym.results.trial import Trial

FORMAT: Final = "rtamt result"
VERSION: Final = 2

KINDS: Final[Mapping[str, str]] = {
    "runs": "rtamt run --json",
    "traces": "rtamt monitor --json",
    "record": "rtamt sweep --json",
    "search": "rtamt falsify --json",
    "case": "rtamt falsify --save and Falsification.save",
    "evaluation": "rtamt evaluate --save and Evaluation.save",
    "comparison": "rtamt compare --save and Comparison.save",
    "recordings": "rtamt compare --save of recordings",
    "methods": "MethodComparison.save",
    "mined": "rtamt mine --json",
    "examples": "rtamt examples --json",
}
"""The kinds of results, and the commands and methods that write them."""

_VERSION_1: Final = re.compile("rtamt (evaluation|comparison|record|search|case|outcomes) 1")
"""The formats of files that rtamt 0.5 wrote."""

_BROKEN: Final = (KeyError, TypeError, ValueError, AttributeError, IndexError)
"""The errors of reading a file with missing or wrong values."""

T = TypeVar("T")


def document(kind: str, fields: Mapping[str, Any], rows: str = "trials") -> str:
    """Return the text of a result: its head, and its fields in the form of `plain`.

    A list of numbers or texts is on one line, and so is each row.
    """
    return "".join(document_parts(kind, fields, rows))


def document_parts(
    kind: str,
    fields: Mapping[str, Any],
    rows: str = "trials",
    plain_rows: Iterable[object] | None = None,
) -> Iterator[str]:
    """Yield the text of `document` in parts; each row is a part."""
    head = {"format": FORMAT, "version": VERSION, "kind": kind, "rtamt": rtamt.__version__}
    written = map(plain, fields.get(rows, ())) if plain_rows is None else plain_rows
    texts = (json.dumps(row, allow_nan=False) for row in written)
    first = next(texts, None)
    listed = {rows: [_ROWS]} if first is not None else {}
    text = json.dumps(plain({**head, **fields, **listed}), indent=2, allow_nan=False)
    # No text of JSON holds a newline.
    text = re.sub(r"\[\n([^\[\]{}]*)\n *\]", lambda match: f"[{' '.join(match[1].split())}]", text)
    if first is None:
        yield text
        return
    before, _, after = text.partition(f'  "{rows}": ["{_ROWS}"]')
    yield f'{before}  "{rows}": [\n    {first}'
    for other in texts:
        yield f",\n    {other}"
    yield f"\n  ]{after}"


_ROWS: Final = "ROWS"
"""The placeholder of the rows."""


def plain(value: Any) -> Any:  # noqa: ANN401 - what a result holds
    """Return a value as dicts, lists, numbers and texts for strict JSON."""
    own = type(value)
    if own in _AS_IT_IS or (own is float and math.isfinite(value)):  # most are
        return value
    for kind, make in _PLAIN:
        if isinstance(value, kind):
            return make(value)
    return _plain_fields(value) if is_dataclass(value) else value


def _plain_fields(value: Any) -> dict[str, Any]:  # noqa: ANN401 - a dataclass
    """Return the fields of a dataclass, or the attributes that its ``json_keys`` name.

    A class with ``sparse`` leaves out defaults and empty objects.
    """
    keys, defaults = _form_of(type(value))  # type: ignore[arg-type]  # a class is hashable
    stored = {}
    for key in keys:
        attribute = getattr(value, key)
        text = plain(attribute)
        if defaults is None or not (text in (None, {}) or defaults.get(key, MISSING) == attribute):
            stored[key] = text
    return stored


@cache
def _form_of(kind: Any) -> tuple[tuple[str, ...], dict[str, Any] | None]:  # noqa: ANN401 - a class
    """Return the keys of a dataclass in JSON, and the defaults that it leaves out, if any."""
    keys = getattr(kind, "json_keys", tuple(field.name for field in fields(kind)))
    if not getattr(kind, "sparse", False):
        return keys, None
    return keys, {field.name: field.default for field in fields(kind)}


def plain_outcome(outcome: Outcome | Failure) -> dict[str, Any]:
    """Return an outcome as a JSON object."""
    if isinstance(outcome, Failure):
        return {"verdict": "ERROR", "error": outcome.message}
    texts = ("text", "not_recorded", "way_out", "explanation", "unknown")
    stored = {
        "verdict": outcome.verdict,
        "robustness": outcome.robustness,
        "lower": outcome.lower,
        "upper": outcome.upper,
        "decided_at": outcome.decided,
        **({} if outcome.ended is None else {"ended_at": outcome.ended}),
        **{name: getattr(outcome, name) for name in texts if getattr(outcome, name)},
    }
    if outcome.by_end:
        stored["by_end"] = True
    stored |= outcome.evidence or {}
    if outcome.defaults:
        stored["defaults"] = outcome.defaults
    if outcome.progress is not None:
        stored["progress"] = outcome.progress
    if outcome.late_start is not None:
        stored["late_start"] = outcome.late_start
    if outcome.occurrences is not None:
        stored["occurrences"] = plain_occurrences(outcome.occurrences)
    return {name: plain(value) for name, value in stored.items()}


def plain_trial(trial: Trial) -> dict[str, Any]:
    """Return a trial as a JSON object, without empty fields."""
    recorded = trial.ended == "recorded"
    stored = {
        "name": trial.name or None,
        "described": trial.described or None,
        "extent": trial.extent,
        "case": trial.case or None,
        "seed": trial.seed,
        "ended": trial.ended,
        "simulated": None if recorded else trial.simulated,
        "return": trial.reward,
        "is_success": trial.reported,
        "wall": None if recorded else trial.wall,
        "error": trial.error or None,
        "notes": trial.notes or None,
    }
    cells: dict[str, Outcome | Failure] = {**trial.outcomes, **trial.failures}
    return {name: plain(value) for name, value in stored.items() if value is not None} | {
        "outcomes": {name: plain_outcome(cell) for name, cell in cells.items()}
    }


def plain_result(result: RequirementResult, *, rates: bool = True) -> dict[str, Any]:
    """Return the statistics of a requirement; rates where trials differ by chance alone."""
    statistics = [row for row in STATISTICS if rates or row.where != "rates"]
    stored = {statistic.key: statistic.of(result) for statistic in statistics}
    stored |= {"interval_kind": result.kind} if rates else {}
    stored["quantiles"] = {str(share): value for share, value in result.quantiles.items()}
    stored |= {"first_violations": result.first_violations, "saved": result.saved}
    return {name: plain(value) for name, value in stored.items()} | {"worst": plain(result.worst)}


def plain_results(results: Results, *, rates: bool = True) -> dict[str, Any]:
    """Return the keys that all results of trials have: system, requirements, trials and others."""
    result = results.results()
    return {
        "system": results.system,
        "requirements": results.requirements,
        **plain(results.provenance),
        "results": {name: plain_result(value, rates=rates) for name, value in result.items()},
        "trials": results.rows,
    }


_AS_IT_IS: Final = frozenset({str, int, bool, type(None)})
"""The types that JSON has, too."""

_PLAIN: Final[tuple[tuple[type | tuple[type, ...], Callable[[Any], Any]], ...]] = (
    (
        (float, np.floating),
        lambda value: float(value) if math.isfinite(value) else repr(float(value)),
    ),
    (Fraction, str),
    (Verdict, lambda value: value.name),
    (RequirementId, lambda value: {"id": value.id, **({"link": value.link} if value.link else {})}),
    (Case, lambda value: plain(json.loads(value.to_json()))),
    (Trial, plain_trial),
    (RequirementResult, plain_result),
    (np.ndarray, lambda value: plain(value.tolist())),
    (Mapping, lambda value: {str(key): plain(item) for key, item in value.items()}),
    ((list, tuple), lambda value: [plain(item) for item in value]),
)
"""The functions that convert other types for JSON; the first type that fits counts."""


def read_fields(kind: type[T], stored: Mapping[str, Any]) -> T:
    """Return a dataclass from the output of `plain`; other keys are ignored."""
    if not isinstance(stored, Mapping):
        raise TypeError(f"expected an object, got {stored!r}")
    hints = _type_hints(kind)  # type: ignore[arg-type]  # classes are hashable
    values = {
        field.name: _read_value(hints[field.name], stored[field.name])
        for field in fields(kind)  # type: ignore[arg-type]  # it is a dataclass
        if field.name in stored or field.default is field.default_factory is MISSING
    }
    return kind(**values)


@cache
def _type_hints(kind: Any) -> dict[str, Any]:  # noqa: ANN401 - a class
    return get_type_hints(kind)


def _read_value(hint: Any, value: Any) -> Any:  # noqa: ANN401 - any type of a field
    """Return a field's value from the output of `plain`."""
    origin, args = get_origin(hint), get_args(hint)
    if origin is UnionType:
        (kind,) = (arg for arg in args if arg is not NoneType)
        return None if value is None else _read_value(kind, value)
    if is_dataclass(hint):
        return read_fields(hint, value)  # type: ignore[arg-type]  # a class, not an instance
    if origin is tuple and args[-1] is ...:
        return tuple(_read_value(args[0], item) for item in value)
    if origin is tuple:
        return tuple(_read_value(a, item) for a, item in zip(args, value, strict=True))
    if origin is Mapping:
        return {name: _read_value(args[1], item) for name, item in value.items()}
    return hint(value) if hint in (float, Fraction) else value


def outcome_of(stored: Mapping[str, Any]) -> Outcome | Failure:
    """Read the output of `plain_outcome`."""
    if stored["verdict"] == "ERROR":
        return Failure(stored["error"])
    late = stored.get("late_start")
    return Outcome(
        float(stored["robustness"]),
        float(stored["lower"]),
        float(stored["upper"]),
        Verdict[stored["verdict"]],
        _moment(stored["decided_at"]),
        text=stored.get("text", ""),
        not_recorded=tuple(stored.get("not_recorded", ())),
        way_out=stored.get("way_out", ""),
        explanation=stored.get("explanation", ""),
        triggers=triggers_of(stored),
        vacuous=stored.get("vacuous", False),
        defaults={name: float(value) for name, value in stored.get("defaults", {}).items()},
        unknown=tuple(stored.get("unknown", ())),
        progress=number_of(stored.get("progress")),
        late_start=None if late is None else read_fields(LateStart, late),
        ended=_moment(stored.get("ended_at")),
        occurrences=occurrences_of(stored["occurrences"]) if "occurrences" in stored else None,
    )


def _moment(stored: Mapping[str, Any] | None) -> Moment | None:
    return None if stored is None else read_fields(Moment, stored)


def trial_of(stored: Mapping[str, Any]) -> Trial:
    """Read the output of `plain_trial`."""
    cells = {name: outcome_of(value) for name, value in stored["outcomes"].items()}
    return Trial(
        Case.from_json(json.dumps(stored.get("case", {}))),
        stored.get("seed"),
        {name: cell for name, cell in cells.items() if isinstance(cell, Outcome)},
        stored["ended"],
        float(stored.get("simulated", 0.0)),
        float(stored.get("wall", 0.0)),
        stored.get("error", ""),
        number_of(stored.get("return")),
        name=stored.get("name", ""),
        described=stored.get("described", ""),
        notes=tuple(stored.get("notes", ())),
        failures={name: cell for name, cell in cells.items() if isinstance(cell, Failure)},
        extent=read_fields(Extent, stored["extent"]) if "extent" in stored else None,
        reported=stored.get("is_success"),
    )


def provenance_of(stored: Mapping[str, Any]) -> Provenance:
    """Read the provenance of a result, which `plain` wrote among its fields."""
    known = read_fields(Provenance, {**stored, "fingerprint": None})
    return replace(known, fingerprint=Fingerprint.read(stored.get("fingerprint")))


def trials_of(stored: Mapping[str, Any]) -> list[Trial]:
    """Return the trials of a result."""
    return [trial_of(item) for item in stored["trials"]]


_TABLES: Mapping[str, type[Any]] = {
    "violations": Occurrence,
    "unknown": UnknownRun,
    "responses": Response,
    "unknown_triggers": UnknownRun,
}
"""The rows of each table of a body."""

_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def plain_occurrences(occurrences: Occurrences) -> dict[str, Any]:
    """Return occurrences as JSON holds them; times are in seconds or numbers of samples."""
    return {
        "unit": occurrences.unit,
        "end": occurrences.end,
        "formula": occurrences.formula,
        "at_start": occurrences.at_start,
        "bodies": [_plain_body(body) for body in occurrences.bodies],
    }


def _plain_body(body: BodyOccurrences) -> dict[str, Any]:
    return {
        "body": body.text,
        "length": body.length,
        "violated": body.violated,
        "statistics": _occurrence_statistics(body),
        **{name: _plain_rows(getattr(body, name)) for name in _TABLES},
    }


def _occurrence_statistics(body: BodyOccurrences) -> dict[str, Any]:
    """Return the count, the share of time, the rate and the answer times of a body."""
    times = body.answer_times
    result: dict[str, Any] = {
        "count": len(body.violations),
        "share": _number_or_none(body.share),
        "per_hour": _number_or_none(body.per_hour),
    }
    if len(body.responses):
        counts = {verdict.name: count for verdict, count in body.outcomes.items()}
        result |= {"triggers": len(body.responses), "outcomes": counts, "answered": len(times)}
    if len(times):
        levels = zip(_QUANTILES, np.quantile(times, _QUANTILES).tolist(), strict=True)
        result["answer_times"] = {
            "min": float(times[0]),
            **{str(share): value for share, value in levels},
            "max": float(times[-1]),
        }
    return result


def _number_or_none(value: float) -> float | None:
    return None if math.isnan(value) else value


def _plain_rows(table: RunTable[Any]) -> list[dict[str, Any]]:
    columns = {
        name: [_plain_cell(name, value) for value in column.tolist()]
        for name, column in table.columns.items()
    }
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _plain_cell(name: str, value: Any) -> object:  # noqa: ANN401 - an element of an array
    if name == "verdict":
        return Verdict(value).name
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else repr(value)
    return value


def occurrences_of(stored: Mapping[str, Any]) -> Occurrences:
    """Read the result of `plain_occurrences`."""
    bodies = tuple(
        BodyOccurrences(
            body["body"],
            **{
                name: _run_table(body[name], kind, stored["unit"]) for name, kind in _TABLES.items()
            },
            length=body["length"],
            violated=body["violated"],
            unit=stored["unit"],
        )
        for body in stored["bodies"]
    )
    return Occurrences(stored["formula"], bodies, stored["end"], stored["unit"], stored["at_start"])


def _run_table(rows: list[dict[str, Any]], kind: type[Any], unit: str) -> RunTable[Any]:
    return RunTable(
        kind,
        {
            name: _run_column(name, [row.get(name, False) for row in rows], unit)
            for name in kind._fields
        },
    )


def _run_column(name: str, values: list[Any], unit: str) -> NDArray[Any]:
    if name in ("to_end", "unseen", "open_start", "closed_end"):
        return np.array(values, bool)
    if name == "verdict":
        return np.array([Verdict[value].value for value in values], np.int8)
    if unit == "samples" and name in ("start", "end", "duration", "worst_at"):
        return np.array(values, np.int64)
    return np.array([math.nan if value is None else float(value) for value in values])


def number_of(stored: float | str | None) -> Any:  # noqa: ANN401 - a float, or None
    """Return a number from the output of `plain`; None stays None."""
    return None if stored is None else float(stored)


def fraction_of(stored: str | None) -> Fraction | None:
    """Return a fraction from the output of `plain`; None stays None."""
    return None if stored is None else Fraction(stored)


class SavedResult:
    """A result that a file of JSON can hold."""

    __slots__ = ()

    kind: ClassVar[str]

    of_kept = OldName("from_saved")

    def to_json(self) -> str:
        """Return the result as strict JSON."""
        raise NotImplementedError

    @classmethod
    def from_saved(cls, kept: Mapping[str, Any]) -> Self:
        """Return the result from the JSON of a result of its kind."""
        raise NotImplementedError

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the text of `to_json` into a file.

        Raises:
            InputError: If the name does not end in ``.json``.
        """
        check_name(path)
        Path(path).write_text(self.to_json() + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a file that `save` wrote.

        Raises:
            InputError: If the file does not hold a result of this class.
        """
        return read_as(path, cls.kind, cls.from_saved)


def check_name(path: str | os.PathLike[str]) -> None:
    """Refuse the name of a file that does not end in ``.json``."""
    if Path(path).suffix.lower() != ".json":
        raise InputError(f"cannot write {os.fspath(path)}: expected a name that ends in .json")


def read(
    path: str | os.PathLike[str], kinds: Iterable[str] = tuple(KINDS), others: str = ""
) -> dict[str, Any]:
    """Read the file of a result."""
    where, kinds = os.fspath(path), list(kinds)
    phrase = f"no {kinds[0]}" if len(kinds) == 1 else "no result"
    written = ", ".join(KINDS[kind] for kind in kinds)
    verb = "writes" if len(kinds) == 1 and " and " not in written else "write"
    expected = f"expected a file that {written} {verb}{others}"
    try:
        stored = json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_no_number)
    except (ValueError, RecursionError) as error:  # not text, not JSON, or nested too deeply
        raise InputError(f"{where} holds {phrase}: {expected}, got no JSON: {error}") from error
    if not isinstance(stored, dict):
        raise InputError(f"{where} holds {phrase}: {expected}")
    version = 1 if _VERSION_1.fullmatch(str(stored.get("format"))) else stored.get("version")
    known = isinstance(stored.get("kind"), str) and stored.get("format") == FORMAT
    if version != 1 and not (known and isinstance(version, int)):
        raise InputError(f"{where} holds {phrase}: {expected}")
    if version != VERSION:
        other = "install a newer rtamt" if version > VERSION else "make it again"
        raise InputError(
            f"{where} holds a result of version {version}, and rtamt {rtamt.__version__} reads "
            f"version {VERSION}; {other}"
        )
    if stored["kind"] not in kinds:
        raise InputError(
            f"{where} holds {phrase} but a result of kind {stored['kind']!r}: {expected}"
        )
    return stored


def read_as(path: str | os.PathLike[str], kind: str, make: Callable[[Mapping[str, Any]], T]) -> T:
    """Read a result of one kind, and return its object."""
    return build(path, read(path, [kind]), make)


def build(
    path: str | os.PathLike[str], stored: Mapping[str, Any], make: Callable[[Mapping[str, Any]], T]
) -> T:
    """Return the object of a result that was read from a file."""
    try:
        return make(stored)
    except rtamt.RtamtError as error:
        error.add_note(os.fspath(path))
        raise
    except _BROKEN as error:
        kind = stored["kind"]
        raise InputError(
            f"cannot read {os.fspath(path)}: it is not a result of kind {kind!r} from "
            f"{KINDS[kind]}: {type(error).__name__}: {error}"
        ) from error


def _no_number(text: str) -> float:
    raise ValueError(f'{text}, which strict JSON does not have; write "inf" or "-inf"')
