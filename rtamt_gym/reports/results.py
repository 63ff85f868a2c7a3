"""The results that a report shows: objects, and the files that commands and methods write."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rtamt import InputTypeError
from rtamt_gym.evaluation.comparison import Comparison
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.methods import MethodComparison
from rtamt_gym.play.record import Record
from rtamt_gym.play.record_files import holds_run, read_space
from rtamt_gym.play.run import Run
from rtamt_gym.play.saved_case import SavedCase
from rtamt_gym.reports.model import Section
from rtamt_gym.reports.of_comparison import of_comparison
from rtamt_gym.reports.of_evaluation import of_evaluation
from rtamt_gym.reports.of_matrix import of_matrix
from rtamt_gym.reports.of_methods import of_methods
from rtamt_gym.reports.of_mined import of_mined
from rtamt_gym.reports.of_record import of_record
from rtamt_gym.reports.of_runs import of_run, of_runs
from rtamt_gym.reports.of_search import of_case, of_search, of_search_json
from rtamt_gym.results.codec import made, read, trials_of
from rtamt_gym.results.provenance import provenance_of
from rtamt_gym.search.falsification.falsification import Falsification
from rtamt_gym.search.sweeps.sweep import Sweep

__all__ = ["SECTIONS", "Access", "section_of"]

Result = (
    Evaluation
    | Comparison
    | MethodComparison
    | Sweep
    | Record
    | Falsification
    | SavedCase
    | str
    | os.PathLike[str]
)


@dataclass(frozen=True, slots=True)
class Access:
    """What a section may do beside reading the file of its result.

    Attributes:
        play: Whether a saved case is played again, which runs the code that it names.
        traces: Folders below which recorded traces are read, beside the folder of the result and
            the present one.
    """

    play: bool = False
    traces: tuple[Path, ...] = ()


_READING: Final = Access()


def section_of(result: Result, room: int, access: Access = _READING) -> Section:
    """The section of a result, or of the file of one.

    Args:
        result: The result, or the path of its file or folder.
        room: How many numbers its episodes together may have.
        access: What may be read and run for it.

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
        case MethodComparison():
            return of_methods(result)
        case Sweep() | Record():
            return of_record(result, room)
        case Falsification():
            return of_search(result, room)
        case SavedCase():
            return of_case(result, room, play=access.play)
        case str() | os.PathLike():
            return _of_file(Path(result), room, access)
    raise InputTypeError(
        "expected an Evaluation, a Comparison, a MethodComparison, a Sweep, a Record, a "
        "Falsification, a SavedCase or the path of the file of one, got "
        f"{type(result).__name__}"
    )


def _of_file(path: Path, room: int, access: Access) -> Section:
    if path.suffix.lower() == ".parquet" or path.is_dir():
        return _of_table(path, room)
    kept = read(
        path, SECTIONS, others=", or the Parquet file or the folder of a sweep, a campaign or a run"
    )
    return made(path, kept, lambda found: SECTIONS[found["kind"]](found, path, room, access))


def _of_table(path: Path, room: int) -> Section:
    """The section of a Parquet file, or of the folder of a campaign."""
    if not path.is_dir() and holds_run(path):
        return of_run(Run.load(path), room)
    record, also = Record.read(path, "a report")
    if "space" not in also:
        return of_record(record, room)
    space = read_space(also["space"])
    return of_record(Sweep(record, space, also["sampler"], also["seed"]), room)


def _traces(kept: Mapping[str, Any], path: Path, room: int, access: Access) -> Section:
    return of_matrix(kept, path.parent, room, traces=access.traces)


def _case(_: Mapping[str, Any], path: Path, room: int, access: Access) -> Section:
    return of_case(SavedCase.load(path), room, play=access.play)


def _record(kept: Mapping[str, Any], room: int) -> Section:
    facts = {name: str(kept[name]) for name in ("sampler", "seed", "stop") if name in kept}
    return of_record(
        Record(trials_of(kept), kept["requirements"], kept["system"], provenance_of(kept)),
        room,
        facts,
    )


SECTIONS: Final[Mapping[str, Callable[[Mapping[str, Any], Path, int, Access], Section]]] = {
    "runs": lambda kept, _path, room, _: of_runs(kept, room),
    "traces": _traces,
    "record": lambda kept, _path, room, _: _record(kept, room),
    "search": lambda kept, _path, _room, _: of_search_json(kept),
    "case": _case,
    "evaluation": lambda kept, _path, room, _: of_evaluation(Evaluation.of_kept(kept), room),
    "comparison": lambda kept, _path, _room, _: of_comparison(Comparison.of_kept(kept)),
    "methods": lambda kept, _path, _room, _: of_methods(MethodComparison.of_kept(kept)),
    "mined": lambda kept, _path, _room, _: of_mined(kept),
}
"""The section of each kind of result that a file can hold."""
