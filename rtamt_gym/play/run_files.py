"""Complete runs as JSON, in files of results and in the metadata of Parquet files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from rtamt import InputError, Verdict
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.run_record import CURVES, Floats, History, RunRecord
from rtamt_gym.results.codec import VERSION, fraction_of, number_of, plain
from rtamt_gym.results.outcome import asked_of

_OF_OUTCOME: Final = ("decided_at", "ended_at", "triggers", "vacuous", "progress")
"""The fields of a course that are written like those of its outcome."""

_KEYS: Final = {"histories": "courses"}
"""The keys of files whose attributes have another name."""


def plain_run(run: RunRecord, *, arrays: bool = True) -> dict[str, Any]:
    """Return a run for JSON; without arrays, the names of its signals replace them."""
    plain_fields = {
        _KEYS.get(item.name, item.name): getattr(run, item.name) for item in fields(run)
    }
    plain_fields["signals"] = run.signals if arrays else list(run.signals)
    outcomes = run.outcomes
    plain_fields["courses"] = {
        name: {
            item.name: getattr(course, item.name)
            for item in fields(course)
            if item.name not in _OF_OUTCOME and (arrays or item.name not in CURVES)
        }
        | {"decided_at": outcomes[name].decided}
        | ({} if course.ended_at is None else {"ended_at": outcomes[name].ended})
        | dict(outcomes[name].evidence or {})
        | ({} if course.progress is None else {"progress": course.progress})
        | ({"by_end": True} if outcomes[name].by_end else {})
        for name, course in run.histories.items()
    }
    written: dict[str, Any] = plain(plain_fields)
    return written


def run_fields(
    kept: Mapping[str, Any], column: Callable[[str], Floats] | None = None
) -> dict[str, Any]:
    """Return the fields of a run that `plain_run` wrote; ``column`` reads arrays of a table."""
    case = kept.get("case")
    if not isinstance(case, str | None):  # version 1 has it as text
        case = json.dumps(case)
    signals = kept["signals"]
    taken = ("wall_time", "reward", "period", "case", "signals", "histories")
    known = {field.name for field in fields(RunRecord)} - {*taken}
    own = {name: value for name, value in kept.items() if name in known}
    return own | {
        "wall_time": number_of(kept["wall_time"]),
        "reward": number_of(kept.get("reward")),
        "period": fraction_of(kept["period"]),
        "case": None if case is None else Case.from_json(case),
        "signals": {name: column(name) if column else _array(signals[name]) for name in signals},
        "histories": {
            name: _course(
                value, {c: column(f"{c}({name})") if column else _array(value[c]) for c in CURVES}
            )
            for name, value in kept["courses"].items()
        },
    }


def _course(kept: Mapping[str, Any], curves: Mapping[str, Floats]) -> History:
    return History(
        formula=kept["formula"],
        **curves,
        final=number_of(kept["final"]),
        verdict=Verdict[kept["verdict"]],
        decided_at=_sample(kept["decided_at"]),
        unit=kept.get("unit", "s"),
        semantics=kept.get("semantics", "standard"),
        inputs=tuple(kept.get("inputs", ())),
        outputs=tuple(kept.get("outputs", ())),
        triggers=asked_of(kept),
        vacuous=kept.get("vacuous", False),
        progress=number_of(kept.get("progress")),
        ended_at=_sample(kept.get("ended_at")),
    )


def _sample(kept: Mapping[str, int] | int | None) -> int | None:
    return kept["sample"] if isinstance(kept, Mapping) else kept  # version 1 wrote a sample


def _array(kept: Sequence[float | str]) -> Floats:
    return np.array([number_of(value) for value in kept], np.float64)


_KEY = b"rtamt.run"
"""The key of the file's metadata, which stores as JSON everything except the arrays."""


def save_run(run: RunRecord, path: Path) -> None:
    """Write a run: its columns, and everything else as metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if path.suffix.lower() != ".parquet":
        raise InputError(
            f"cannot write {path}: expected a name that ends in .parquet, the format that holds "
            "all of a run; run.to_frame() has the columns for other formats"
        )
    kept = {"version": VERSION, **plain_run(run, arrays=False)}
    metadata = {_KEY: json.dumps(kept, allow_nan=False)}
    table = pa.table({name: np.asarray(values) for name, values in run.columns().items()})
    pq.write_table(table.replace_schema_metadata(metadata), path)


def load_run(path: Path) -> dict[str, Any]:
    """Read the fields of a run that `save_run` has written."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except pa.ArrowInvalid as error:
        raise InputError(f"cannot read {path}: it is not a Parquet file") from error
    metadata = table.schema.metadata or {}
    if _KEY not in metadata:
        raise InputError(f"{path} is not a run: expected a file of Run.save")
    stored: dict[str, Any] = json.loads(metadata[_KEY])

    def column(name: str) -> Floats:
        array: Floats = table.column(name).to_numpy()
        return array

    return run_fields(stored, column)
