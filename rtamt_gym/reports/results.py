"""The results that a report shows: objects, and the files that commands and methods write."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rtamt import InputError, InputTypeError
from rtamt_gym.evaluation.comparison import Comparison
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.inputs.case import Case
from rtamt_gym.recorded.outcomes_json import FORMAT as OUTCOMES
from rtamt_gym.reports.model import Section
from rtamt_gym.reports.of_comparison import of_comparison
from rtamt_gym.reports.of_evaluation import of_evaluation
from rtamt_gym.reports.of_matrix import of_matrix
from rtamt_gym.reports.of_record import of_record
from rtamt_gym.reports.of_search import of_case, of_search, of_search_json
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.falsification.falsification import Falsification
from rtamt_gym.search.runs.record import Record, storage
from rtamt_gym.search.runs.report import FORMAT as RECORD
from rtamt_gym.search.runs.saved_case import SavedCase
from rtamt_gym.search.sweeps.sweep import Sweep

__all__ = ["KINDS", "section_of"]

KINDS: Final = {
    "rtamt evaluation 1": "Evaluation.save, rtamt evaluate --save",
    "rtamt comparison 1": "Comparison.save, rtamt compare --save",
    RECORD: "rtamt sweep --json",
    "rtamt case 1": "Falsification.save, rtamt falsify --save",
    "rtamt search 1": "rtamt falsify --json",
    OUTCOMES: "rtamt monitor --json",
}
"""The formats of JSON that are results, and what writes them."""

Result = (
    Evaluation | Comparison | Sweep | Record | Falsification | SavedCase | str | os.PathLike[str]
)


def section_of(result: Result, room: int) -> Section:
    """The section of a result, or of the file of one.

    Args:
        result: The result, or the path of its file or folder.
        room: How many numbers its episodes together may have.

    Raises:
        InputError: If a file holds no result; says what does.
        InputTypeError: If it is no result.
        OSError: If there is no such file.
    """
    match result:
        case Evaluation():
            return of_evaluation(result, room)
        case Comparison():
            return of_comparison(result)
        case Sweep() | Record():
            return of_record(result, room)
        case Falsification():
            return of_search(result, room)
        case SavedCase():
            return of_case(result, room)
        case str() | os.PathLike():
            return _of_file(Path(result), room)
    raise InputTypeError(
        "expected an Evaluation, a Comparison, a Sweep, a Record, a Falsification, a SavedCase or "
        f"the path of the file of one, got {type(result).__name__}"
    )


def _of_file(path: Path, room: int) -> Section:
    if path.suffix.lower() == ".parquet" or path.is_dir():
        record, also = Record.read(path, "a report")
        if "space" not in also:
            return of_record(record, room)
        space = storage("a report").read_space(also["space"])
        return of_record(Sweep(record, space, also["sampler"], also["seed"]), room)
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} {_EXPECTED}; it is no JSON: {error}") from error
    found = kept.get("format") if isinstance(kept, dict) else None
    try:
        return _of_json(str(found), kept, path, room)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, InputError | InputTypeError):
            raise
        said = f"{type(error).__name__}: {error}"
        raise InputError(f'cannot read {path}: "format" is "{found}", but {said}') from error


def _of_json(found: str, kept: Mapping[str, Any], path: Path, room: int) -> Section:
    match found:
        case "rtamt evaluation 1":
            return of_evaluation(Evaluation.load(path), room)
        case "rtamt comparison 1":
            return of_comparison(Comparison.load(path))
        case "rtamt case 1":
            return of_case(SavedCase.load(path), room)
        case "rtamt search 1":
            return of_search_json(kept)
    if found == RECORD:
        facts = {name: str(kept[name]) for name in ("sampler", "seed", "stop") if name in kept}
        return of_record(_record(kept), room, facts)
    if found == OUTCOMES:
        return of_matrix(kept, path.parent, room)
    raise InputError(f"{path} {_EXPECTED}")


def _record(kept: Mapping[str, Any]) -> Record:
    """A record from its JSON, in which a waveform is a number for each control point."""
    texts = {f"verdict({name})" for name in kept["requirements"]} | {"ended", "error", "seed"}
    rows = []
    for cells in kept["simulations"]:
        read = {
            name: cell if name in texts or cell is None else float(cell)
            for name, cell in cells.items()
        }
        names = list(read)[: list(read).index("seed")]
        case = Case({name: read[name] for name in names if read[name] is not None})
        rows.append(Trial.read(read, case, kept["requirements"]))
    return Record(rows, kept["requirements"], kept["system"])


_EXPECTED: Final = (
    f"holds no result; results are the files of {', '.join(KINDS.values())}, and the Parquet files "
    "and folders of sweeps and campaigns"
)
