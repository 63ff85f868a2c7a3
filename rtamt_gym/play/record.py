"""`Record`: the table of many simulations, in a Parquet file or in the folder of a campaign.

Sweeps, searches and campaigns share it. A row stores the case, the outcome of every requirement,
and the cost of a simulation.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import nearest
from rtamt.renamed import OldName
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.inputs.space import Parameter, Signal, Space
from rtamt_gym.results.codec import plain, plain_results, provenance_of, read_fields
from rtamt_gym.results.outcome import order
from rtamt_gym.results.provenance import (
    Fingerprint,
    Mixture,
    Provenance,
    Reuse,
    file_hash,
)
from rtamt_gym.results.statistics import Results
from rtamt_gym.results.trial import MEASURES, OF_TRIAL, Measure, Trial
from rtamt_gym.tables import counted

if TYPE_CHECKING:
    import pandas as pd

CAMPAIGN: Final = "campaign.json"
"""Identifies the campaign of a folder."""

PARTS: Final = "part-*.parquet"
"""Finished runs, until all are finished: ``part-000001-0123456789abcdef.parquet`` and so on.

The name contains the first 16 digits of the SHA-256 of the file; names of older files do not.
"""

RECORD: Final = "record.parquet"
"""All runs, once the campaign is finished."""

_PART: Final = re.compile(r"part-(\d+)(?:-([0-9a-f]{16}))?\.parquet")

_REMOVE: Final = "remove it, and its runs are made again, or give another folder"

_OTHER: Final = "give another folder, or remove this one"

_KEY = b"rtamt.record"
"""The key of the file's metadata, which stores as JSON everything that is not a cell."""

_FIELDS: Final[dict[str, type]] = {
    "system": str,
    "requirements": dict,
    "also": dict,
    "identity": dict,
}
"""The required fields of ``campaign.json``."""


class Record(Results):
    """The table of many simulations of one system: a row for each, in the order of their cases.

    It is a sequence of `Trial`. Two records are equal if they differ only in wall times.

    Args:
        rows: The simulations. A waveform has the same times in all of them.
        requirements: The text of each requirement, by name.
        system: The name of the system.
        provenance: As for `Results`.

    Raises:
        InputError: If a case has a name that another column has too, or a waveform has other times
            in one row than in another.

    Example:
        >>> from rtamt_gym import Parameter, sweep
        >>> def tank(inflow=0.2):
        ...     level = 1.0
        ...     for _ in range(20):
        ...         yield {"level": level}
        ...         level += inflow - 0.1 * level
        >>> inflow = Parameter("inflow", 0.1, 0.3)
        >>> record = sweep(
        ...     tank, {"dry": "always(level < 2)"}, [inflow], samples=3, sampler="grid", period=1
        ... ).record
        >>> record
        <Record of tank: 3 simulations, 1 violates>
        >>> [round(row.outcomes["dry"].robustness, 2) for row in record]
        [1.0, 0.14, -0.73]
        >>> record.violated("dry")[0].case
        Case({'inflow': 0.3})
    """

    heights = OldName("robustness_values")
    unconditional = OldName("without_implications")
    timed = OldName("has_times")

    def __init__(
        self,
        rows: Iterable[Trial],
        requirements: Mapping[str, str],
        system: str = "",
        provenance: Provenance = Provenance(),  # noqa: B008 - it cannot be changed
    ) -> None:
        super().__init__(rows, requirements, system, provenance)
        self.shapes = _shapes(self.rows)
        columns: list[str] = []
        for name, shape in self.shapes.items():
            points = [""] if shape is None else [f"[{i}]" for i in range(len(shape["times"]))]
            columns += [f"{name}{point}" for point in points]
        self.case_columns = tuple(columns)
        check_columns(self.case_columns, self.requirements)

    def __repr__(self) -> str:
        violated, failed = len(self.violated()), len(self.failed())
        verb = "violates" if violated == 1 else "violate"
        errors = f", {counted(failed, 'error')}" if failed else ""
        system = f" of {self.system}" if self.system else ""
        return f"<Record{system}: {counted(len(self), 'simulation')}, {violated} {verb}{errors}>"

    @property
    def has_cases(self) -> bool:
        """Whether cases were chosen; episodes of a policy have no case and differ by chance."""
        return bool(self.case_columns)

    def worst(self, requirement: str | None = None) -> Trial:
        """Return the simulation with the minimum robustness; None: of the only requirement.

        A simulation that an error has ended counts only if no other one has a robustness.

        Raises:
            InputError: If the requirement is unknown or must be named, or no simulation has a
                robustness.
        """
        name = self.name(requirement)
        rows = [row for row in self.rows if name in row.outcomes]
        if not rows:
            raise InputError(f"no simulation of the record has a robustness of {name!r}")
        rows = [row for row in rows if not row.error] or rows
        return min(rows, key=lambda row: order(row.outcomes[name].robustness))

    def columns(self) -> dict[str, list[Any]]:
        """Return a table: columns of the case, then ``seed``, then columns of outcomes.

        These are ``robustness(NAME)``, ``lower(NAME)``, ``upper(NAME)``, ``verdict(NAME)``,
        ``decided_at(NAME)`` in seconds (samples if there is no period) and ``decided_sample(NAME)``
        of every requirement, then ``ended``, ``simulated``, ``return``, ``wall`` and ``error``, and
        ``is_success``, 1 or 0, if an environment reports it. Missing values are None. For a
        requirement with an implication, ``asked(NAME)`` is the number of triggers, and
        ``evidence(NAME)`` their JSON (docs/results.md). ``violated(NAME)`` is ``"by how it ended"``
        in rows that violate a requirement only by their end, at a robustness that holds.

        If only the end decided a verdict, ``decided_at(NAME)`` is None, and ``ended_at(NAME)``
        and ``ended_sample(NAME)`` are the last sample; other records lack these two.
        """
        cells = [row.columns() for row in self.rows]
        return {name: [row.get(name) for row in cells] for name in self.kinds()}

    def kinds(self) -> dict[str, str]:
        """Return the kind of each column: ``"number"``, ``"whole"`` or ``"text"``."""
        seed, *others = (
            (measure.name, measure.kind)
            for measure in OF_TRIAL
            if not measure.optional or any(measure.of(row) is not None for row in self.rows)
        )
        measured = [
            (f"{measure.name}({name})", measure.kind)
            for name in self.requirements
            for measure in MEASURES
            if not measure.optional or self._has(measure, name)
        ]
        return dict([*((name, "number") for name in self.case_columns), seed, *measured, *others])

    def _has(self, measure: Measure, name: str) -> bool:
        """Return whether some row has a value of a measure of a requirement."""
        outcomes = (row.outcomes[name] for row in self.rows if name in row.outcomes)
        return any(measure.of(outcome) is not None for outcome in outcomes)

    def numbers(self, column: str) -> NDArray[np.float64]:
        """Return a column of numbers; missing values are nan.

        Raises:
            InputError: If the column of numbers is unknown; the error names the nearest.
        """
        known = [name for name, kind in self.kinds().items() if kind != "text"]
        if column not in known:
            raise InputError(
                f"unknown column of numbers {column!r}; the columns are "
                f"{listing(known)}{nearest(column, known)}"
            )
        return np.array(self.columns()[column], dtype=np.float64)  # None becomes nan

    def to_frame(self) -> pd.DataFrame:
        """Return a data frame of pandas: a row for each simulation, columns as in `columns`.

        Missing cells are nan or None. Needs the extra ``pandas``.
        """
        try:
            import pandas as pd
        except ModuleNotFoundError as error:
            raise naming_extra(error, "Record.to_frame") from error
        kinds = self.kinds()
        arrays_of: dict[str, Callable[[list[Any]], Any]] = {
            "number": lambda cells: np.array(cells, dtype=np.float64),
            "whole": lambda cells: pd.array(cells, dtype="Int64"),
            "text": lambda cells: pd.array(cells, dtype=object),
        }
        columns = {name: arrays_of[kinds[name]](cells) for name, cells in self.columns().items()}
        return pd.DataFrame(columns, index=pd.RangeIndex(len(self), name="simulation"))

    def robustness_values(self, requirement: str) -> NDArray[np.float64]:
        """Return the robustness of a requirement in each simulation; nan after an error."""
        judged = [row.judged(requirement) for row in self.rows]
        return np.array([math.nan if outcome is None else outcome.robustness for outcome in judged])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a Parquet file: a row for each simulation, columns as in `columns`.

        `Record.load` returns an equal record. Needs the extra ``files``.

        Raises:
            InputError: If the name does not end in ``.parquet``.
        """
        self.write(path, "Record.save", {})

    def write(self, path: str | os.PathLike[str], caller: str, also: Mapping[str, Any]) -> None:
        """Write the file of `save` with further metadata; errors name the method ``caller``."""
        pa, parquet = _pyarrow(caller)
        path = Path(path)
        if path.suffix.lower() != ".parquet":
            raise InputError(
                f"cannot write {path}: expected a name that ends in .parquet, the format that "
                "holds all of a record; to_frame() has the columns for other formats"
            )
        metadata = {
            "system": self.system,
            "requirements": dict(self.requirements),
            "shapes": self.shapes,
            "timed": self.has_times,
            "unconditional": self.without_implications,
            "results": plain_results(self, rates=not self.has_cases)["results"],
            "also": also,
            **plain(self.provenance),
        }
        types = {"number": pa.float64(), "whole": pa.int64(), "text": pa.string()}
        columns, kinds = self.columns(), self.kinds()
        arrays = {name: pa.array(cells, types[kinds[name]]) for name, cells in columns.items()}
        table = pa.table(arrays).replace_schema_metadata({_KEY: json.dumps(metadata)})
        parquet.write_table(table, path)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Record:
        """Read a file that `save` has written, of a record or of a `Sweep`.

        Raises:
            InputError: If the file does not hold a record.
        """
        return Record.read(path, "Record.load")[0]

    @staticmethod
    def read(path: str | os.PathLike[str], caller: str) -> tuple[Record, Mapping[str, Any]]:
        """Read a record, and the further metadata of `write`."""
        rows, metadata = load_record(Path(path), caller)
        record = Record(rows, metadata["requirements"], metadata["system"], provenance_of(metadata))
        return record, metadata["also"]

    @property
    def without_implications(self) -> list[str]:
        """The requirements that are known to have no implication."""
        return [
            name
            for name in self.requirements
            if any(row.outcomes[name].triggers == () for row in self.rows if name in row.outcomes)
        ]

    @property
    def has_times(self) -> bool:
        """Whether times are seconds, and not numbers of samples."""
        moments = (outcome.settled for row in self.rows for outcome in row.outcomes.values())
        return all(outcome.seconds is not None for outcome in moments if outcome is not None)


def check_columns(case: Iterable[str], requirements: Iterable[str]) -> None:
    """Raise InputError if a column of a case has the name of another column."""
    case = list(case)
    reserved = {measure.name for measure in OF_TRIAL}
    reserved |= {f"{measure.name}({name})" for name in requirements for measure in MEASURES}
    for name in case:
        if name in reserved:
            raise InputError(
                f"a varied parameter cannot have the name {name!r}, a column of every record; "
                "rename it"
            )
        if case.count(name) > 1:
            raise InputError(f"expected columns of different names, got {name!r} twice")


def _shapes(rows: Iterable[Trial]) -> dict[str, dict[str, Any] | None]:
    """Return times and interpolation of each waveform of the cases; None for a number."""
    shapes: dict[str, dict[str, Any] | None] = {}
    for number, row in enumerate(rows):
        for name, entry in row.case.items():
            shape = (
                None
                if isinstance(entry, float)
                else {"times": entry.times, "interpolation": entry.interpolation}
            )
            if shapes.setdefault(name, shape) != shape:
                raise InputError(
                    f"expected {name!r} of every case with the same control points, got another "
                    f"kind in row {number}: {entry!r}"
                )
    return shapes


def load_record(path: Path, caller: str) -> tuple[list[Trial], dict[str, Any]]:
    """Read rows and metadata of a file, or the finished rows of a campaign's folder."""
    pa, parquet = _pyarrow(caller)
    if path.is_dir():
        finished_rows, campaign = finished(path, caller), read_campaign(path)
        unseen = tuple(campaign.get("fingerprint", {}).get("unseen", ()))
        mixtures = tuple(read_fields(Mixture, item) for item in campaign.get("mixtures", ()))
        count = len(finished_rows)
        reuse = Reuse(str(path), count, count, mixtures, (), unseen)
        rows = [finished_rows[number] for number in sorted(finished_rows)]
        return rows, {**campaign, "reuse": plain(reuse)}
    try:
        table = parquet.read_table(path)
    except pa.ArrowInvalid as error:
        raise InputError(f"cannot read {path}: it is not a Parquet file") from error
    stored = table.schema.metadata or {}
    if _KEY not in stored:
        raise InputError(f"{path} is not a record: expected a file of Record.save or Sweep.save")
    metadata: dict[str, Any] = json.loads(stored[_KEY])
    return [_row(cells, metadata) for cells in table.to_pylist()], metadata


def holds_run(path: Path) -> bool:
    """Return whether a Parquet file stores one run, as `Run.save` writes it."""
    pa, parquet = _pyarrow("a file of runs")
    try:
        return b"rtamt.run" in (parquet.read_schema(path).metadata or {})
    except pa.ArrowInvalid as error:
        raise InputError(f"cannot read {path}: it is not a Parquet file") from error


def written_space(space: Space) -> dict[str, Any]:
    """Return a space as plain values for JSON; `read_space` is the inverse."""
    return {
        "duration": space.duration,
        "entries": [{"kind": type(entry).__name__, **asdict(entry)} for entry in space],
    }


def read_space(written: Mapping[str, Any]) -> Space:
    """Read a space that `written_space` wrote."""
    kinds: dict[str, Any] = {"Signal": Signal, "Parameter": Parameter}
    entries = [
        kinds[entry["kind"]](**{key: value for key, value in entry.items() if key != "kind"})
        for entry in written["entries"]
    ]
    return Space(entries, duration=written["duration"])


def part_name(number: int, path: Path) -> str:
    """Return the file name of a part, with the checksum of its content."""
    return f"part-{number:06d}-{file_hash(path)[:16]}.parquet"


def part_number(path: Path) -> int:
    """Return the number in the file name of a part."""
    return int(_match(path)[1])


def finished(path: Path, caller: str) -> dict[int, Trial]:
    """Read the finished runs of a folder, by task number."""
    read_campaign(path)
    rows: dict[int, Trial] = {}
    for numbers, trials, _ in parts(path, caller):
        rows |= zip(numbers, trials, strict=True)
    return rows


def parts(path: Path, caller: str) -> Iterator[tuple[list[int], list[Trial], dict[str, Any]]]:
    """Yield the task numbers, the runs and the metadata of each file of finished runs.

    The file of a finished campaign comes first: a larger budget adds further files.
    """
    if (path / RECORD).exists():
        rows, also = _load_part(path / RECORD, caller, _OTHER)
        yield list(range(len(rows))), rows, also
    for part in sorted(path.glob(PARTS)):
        checksum = _match(part)[2]
        _check_regular(part, _REMOVE)
        if checksum is not None and file_hash(part)[:16] != checksum:
            raise InputError(
                f"{part} is damaged: its content does not match the checksum in its name; {_REMOVE}"
            )
        rows, also = _load_part(part, caller, _REMOVE)
        tasks = also.get("tasks")
        if not isinstance(tasks, list) or len(tasks) != len(rows):
            raise InputError(f"{part} is damaged: it does not number its runs; {_REMOVE}")
        yield tasks, rows, also


def read_campaign(path: Path) -> dict[str, Any]:
    """Read the description of the campaign in a folder."""
    file = path / CAMPAIGN
    if file.exists():
        _check_regular(file, _OTHER)
    try:
        campaign: Any = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path} holds no campaign: there is no {CAMPAIGN} in it") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file} is damaged: {error}; {_OTHER}") from error
    for key, kind in _FIELDS.items():
        if not isinstance(campaign, dict) or not isinstance(campaign.get(key), kind):
            raise InputError(f"{file} is damaged: expected an object with {key!r}; {_OTHER}")
    try:
        Fingerprint.read(campaign.get("fingerprint"))
        [read_fields(Mixture, item) for item in campaign.get("mixtures", ())]
    except (InputError, KeyError, TypeError) as error:
        raise InputError(
            f"{file} is damaged: expected a fingerprint and mixtures; {_OTHER}"
        ) from error
    result: dict[str, Any] = campaign
    return result


def _pyarrow(caller: str) -> tuple[Any, Any]:
    """Import pyarrow and its Parquet module; an error names the caller and the extra."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ModuleNotFoundError as error:
        raise naming_extra(error, caller, "search") from error
    return pa, pq


def _match(path: Path) -> re.Match[str]:
    match = _PART.fullmatch(path.name)
    if match is None:
        raise InputError(
            f"expected parts of a campaign as part-NUMBER-CHECKSUM.parquet, got {path}; {_REMOVE}"
        )
    return match


def _check_regular(path: Path, fix: str) -> None:
    """Raise InputError for a pipe, which would block a reader forever, or a device."""
    if not path.is_file():
        raise InputError(f"{path} is damaged: expected a regular file; {fix}")


def _load_part(path: Path, caller: str, fix: str) -> tuple[list[Trial], dict[str, Any]]:
    _check_regular(path, fix)
    try:
        rows, metadata = load_record(path, caller)
        also: dict[str, Any] = {**metadata["also"]}
    except Exception as error:  # reading a damaged file can raise anything
        reason = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise InputError(f"{path} is damaged: {reason}; {fix}") from error
    return rows, also


def _row(cells: Mapping[str, Any], metadata: Mapping[str, Any]) -> Trial:
    case: dict[str, float | Waveform] = {}
    for name, shape in metadata["shapes"].items():
        if shape is None:
            if cells[name] is not None:
                case[name] = cells[name]
            continue
        values = [cells[f"{name}[{i}]"] for i in range(len(shape["times"]))]
        if values[0] is not None:
            case[name] = Waveform(shape["times"], values, shape["interpolation"])
    return Trial.read(
        cells,
        Case(case),
        metadata["requirements"],
        timed=metadata.get("timed", True),  # version 1 does not store it
        unconditional=metadata.get("unconditional", ()),
    )
