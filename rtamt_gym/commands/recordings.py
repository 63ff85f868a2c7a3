"""Judge recorded files from Python, as ``rtamt monitor --results`` does."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypedDict, Unpack

from rtamt import InputError, InputTypeError
from rtamt.errors import nearest
from rtamt.typing import Align, End, Period, SemanticsName
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.checks.names import listing
from rtamt_gym.commands.fleet import judge_into
from rtamt_gym.commands.specs import with_stages
from rtamt_gym.commands.traces import TracesAsked, checked_request, trace_paths
from rtamt_gym.judging.specs import SpecsLike, load_specs
from rtamt_gym.options.evaluation import EvaluationOptions, StagesLike, View
from rtamt_gym.recorded.columns import Columns

if TYPE_CHECKING:
    import pyarrow as pa

_INNER: Final = ("starts", "by", "sorted")
"""The attributes of `Columns` that one trace does not have, or that the reader sets."""


class RecordedKeywords(TypedDict, total=False):
    """The evaluation options of recorded files, for editors and type checkers."""

    end: End
    period: Period | None
    view: View
    semantics: SemanticsName
    align: Align | None
    dense: bool
    stages: StagesLike | None


def judge_recordings(
    specs: SpecsLike,
    files: Iterable[str | os.PathLike[str]],
    results: str | os.PathLike[str],
    *,
    columns: Mapping[str, Any] | None = None,
    workers: int = 1,
    backend: Literal["dask", "ray"] | None = None,
    scheduler: str | None = None,
    verify: bool = False,
    **reading: Unpack[RecordedKeywords],
) -> pa.Table:
    r"""Judge recorded files into a folder, as ``rtamt monitor --results`` does.

    Another call with the same folder judges only new and changed files.

    Args:
        specs: As for `StlMonitor`.
        files: The paths or URLs of files, each of one trace. Folders and patterns, such as
            ``"runs/*.csv"``, are searched as ``rtamt monitor`` does.
        results: The folder of the results. A program and the command can use it in turn.
        columns: How columns are read: the column options of ``rtamt monitor`` by name, such as
            ``{"signals": {"speed": "Vehicle Speed [km/h]"}, "time_unit": "ms"}``. Default: as the
            command does without options.
        workers: The number of processes of this machine that judge files. Default: 1.
        backend: ``"dask"`` or ``"ray"`` judges on the workers of a cluster. Default: the processes
            of this machine.
        scheduler: The address of the cluster. Default: a cluster on this machine.
        verify: Whether to compare the SHA-256 of all files, not their size and time.
        **reading: Evaluation options, as `EvaluationOptions` describes: ``end``, ``period``,
            ``view``, ``semantics``, ``align``, ``dense`` and ``stages``.

    Returns:
        The rows of all files in the folder as a ``pyarrow.Table`` with the columns of
        ``results.parquet``, sorted by path.

    Raises:
        InputError: If the folder holds other results or another program uses it; if there are no
            files; on a wrong option; or if the cluster cannot be reached.
        SpecificationError: As `StlMonitor` does.
        ModuleNotFoundError: If a package of the cluster or pyarrow is missing.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as name:
        ...     file = Path(name) / "run.csv"
        ...     _ = file.write_text("time,x\n0,3\n1,9\n")
        ...     table = judge_recordings({"low": "always(x < 8)"}, [file], Path(name) / "outcomes")
        >>> table["verdict"].to_pylist(), table["robustness(low)"].to_pylist()
        (['violated'], [-1.0])
    """
    check_choice("backend", backend, (None, "dask", "ray"))
    if workers < 1:
        raise InputError(f"expected workers of 1 or more, got {workers}")
    if isinstance(files, str | os.PathLike):
        raise InputTypeError(f"expected a list of files, got {os.fspath(files)!r}. Pass [PATH].")
    column_options = {**(columns or {})}
    _check_names(
        "columns", column_options, [f.name for f in fields(Columns) if f.name not in _INNER]
    )
    _check_names("judge_recordings()", reading, [*RecordedKeywords.__annotations__])
    loaded = load_specs(specs)
    paths, ignored = trace_paths([os.fspath(file) for file in files])
    if not paths:
        raise InputError("expected one or more files, got none")
    request = TracesAsked(
        loaded, EvaluationOptions(**reading), Columns(**column_options), ignored=ignored
    )
    request, paths = checked_request(request, loaded, paths)
    request = replace(request, reading=with_stages(request.specs, request.reading))
    table, _ = judge_into(
        request,
        paths,
        Path(results),
        processes=workers,
        backend=backend,
        scheduler=scheduler,
        verify=verify,
    )
    return table


def _check_names(where: str, names: Iterable[str], known: Sequence[str]) -> None:
    """Raise InputTypeError for a name that is not known."""
    for name in names:
        if name not in known:
            hint = nearest(name, known) or f"; the options are {listing(known)}"
            raise InputTypeError(f"{where} got an unexpected option {name!r}{hint}")
