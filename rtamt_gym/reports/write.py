"""`write_report`: results, or the files of results, as one page of HTML.

To add a section about a kind of file, see `rtamt_gym.results.codec`. A section about an object
needs a function in `rtamt_gym.reports`, its class in `Result` and a case of `section_of`. A new
kind of section also needs its name in `SectionKind` and its noun in `NOUNS`, both in
`rtamt_gym.reports.model`. Describe it in the docstring of `write_report` and in
``docs/results.md``. An error in ``tests/rtamt_gym/reports/test_results.py`` lists the classes.

To add a part to the sections of some results, put a block of `rtamt_gym.reports.model` into the
fields ``blocks`` or ``figures`` of `Section` or `Requirement`, where these sections are made.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, get_args

import rtamt
from rtamt import InputError, InputTypeError
from rtamt.errors import Argument
from rtamt_gym.evaluation.comparison import Comparison
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.methods import MethodComparison
from rtamt_gym.evaluation.recording_changes import RecordingsComparison
from rtamt_gym.play.record import Record, holds_run, read_space
from rtamt_gym.play.run import Run
from rtamt_gym.play.saved_case import SavedCase
from rtamt_gym.reports.comparisons import of_comparison, of_methods, of_recordings
from rtamt_gym.reports.evaluations import of_evaluation
from rtamt_gym.reports.examples import ExamplesLike, with_examples
from rtamt_gym.reports.html import render
from rtamt_gym.reports.model import Report, Section
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.simulations import (
    of_case,
    of_record,
    of_run,
    of_runs,
    of_search,
    of_search_json,
    record_of,
)
from rtamt_gym.reports.traces import holds_results, of_matrix, of_mined, of_results
from rtamt_gym.results.codec import build, read
from rtamt_gym.results.provenance import file_hash
from rtamt_gym.search.falsification.falsification import Falsification
from rtamt_gym.search.sweeps.sweep import Sweep
from rtamt_gym.tables import counted

Result = (
    Evaluation
    | Comparison
    | RecordingsComparison
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
    """The actions of a section in addition to reading the file of its result."""

    play: bool = False
    traces: tuple[Path, ...] = ()


def write_report(
    path: str | os.PathLike[str],
    *results: Result,
    title: str | None = None,
    names: Sequence[str] | None = None,
    date: datetime | None = None,
    examples: ExamplesLike | None = None,
    play: bool = False,
    traces: Sequence[str | os.PathLike[str]] = (),
) -> None:
    """Write results as one page of HTML, which needs no network and no other file.

    Each result is a section, in order: every requirement in words, its outcomes, and the worst
    episodes as plots. The violation of a `Falsification` and the worst simulation of a `Sweep` run
    again for these plots, because the objects have their systems. Files are only read; a saved
    case, which is code of its author, runs only with ``play=True``. At most 600 samples of an
    episode are shown, fewer if there are many episodes; these include the first, the last, the
    extremes of each series and the samples that decided. Needs the extra ``report``.

    Args:
        path: The name of the page, which ends in ``.html``.
        results: `Evaluation`, `Comparison`, `Sweep`, `Record`, `Falsification` and `SavedCase`, and
            the paths of their files: saved JSON and Parquet, folders of campaigns, and ``--json``
            output of ``rtamt sweep``, ``falsify``, ``monitor`` and others.
        title: The title of the page. None: the title of the only result, or the number of results.
        names: The names of the results, in order. None: equal titles are followed by the names of
            their files, or by numbers.
        date: The date of the page. None: the environment variable ``SOURCE_DATE_EPOCH`` in seconds
            since 1970, so that the same results return the same page; without it, now.
        examples: Traces that satisfy and violate requirements, drawn next to their words: the
            result of `rtamt.examples`, or the path of ``rtamt examples --json`` output.
        play: Whether to run saved cases, which imports and runs the code that they name:
            `SavedCase.imports`.
        traces: Folders with recorded traces to read for the page, in addition to the folder of
            their result and the current folder. No other file that a result names is opened.

    Raises:
        InputError: If no result is passed, a file is not a result, the name of the page has another
            ending, the number of names is wrong, examples belong to other requirements, or
            ``SOURCE_DATE_EPOCH`` is not a number of seconds.
        InputTypeError: If a value is not a result.
        OSError: If a file does not exist, or the page cannot be written.
        ModuleNotFoundError: If jinja2 or plotly is not installed; names the extra ``report``.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from rtamt_gym import Parameter, sweep, write_report
        >>> def tank(inflow):
        ...     level = 1.0
        ...     for _ in range(20):
        ...         yield {"level": level}
        ...         level += inflow - 0.1 * level
        >>> space = [Parameter("inflow", 0.1, 0.3)]
        >>> done = sweep(tank, {"dry": "always(level < 2)"}, space, samples=9, period=1)
        >>> with TemporaryDirectory() as folder:
        ...     page = Path(folder, "tank.html")
        ...     write_report(page, done)
        ...     print("level stays below 2 at all times" in page.read_text(encoding="utf-8"))
        True
    """
    check_page(path)
    shown = () if examples is None else (examples,)
    access = Access(play, tuple(map(Path, traces)))
    page = report_of(*results, title=title, names=names, date=date, examples=shown, access=access)
    Path(path).write_text(render(page), encoding="utf-8")


def report_of(
    *results: Result,
    title: str | None = None,
    names: Sequence[str] | None = None,
    date: datetime | None = None,
    examples: Sequence[ExamplesLike] = (),
    access: Access = Access(),
) -> Report:
    """Return the report of `write_report`, with a sequence of examples."""
    if not results:
        raise InputError(
            "expected at least one result, such as an Evaluation or its file, got none"
        )
    made_on = _date(date)
    sections = tuple(_section(result, ROOM // len(results), access) for result in results)
    sections = _named(sections, results, names)
    if examples:
        sections = with_examples(sections, examples)
    if title is None:
        title = sections[0].title if len(sections) == 1 else counted(len(sections), "result")
    return Report(title, f"rtamt {rtamt.__version__}", sections, made_on)


def _section(result: Result, room: int, access: Access) -> Section:
    """Return the section of a result; the section of a file has its hash."""
    section = section_of(result, room, access)
    if not isinstance(result, str | os.PathLike):
        return section
    return replace(section, source=(os.fspath(result), file_hash(result)))


def _named(
    sections: Sequence[Section], results: Sequence[Result], names: Sequence[str] | None
) -> tuple[Section, ...]:
    """Return the sections with different titles."""
    if names is not None:
        every: object = names
        known = [] if isinstance(every, str) or not isinstance(every, Sequence) else list(every)
        texts = [name for name in known if isinstance(name, str) and name]
        if not len(texts) == len(known) == len(results):
            raise InputError(
                Argument("names"),
                f": expected a text for each of {counted(len(results), 'result')}, got {names!r}",
            )
        if len(set(known)) < len(known):
            raise InputError(Argument("names"), f": expected different texts, got {names!r}")
        return tuple(
            replace(value, title=f"{name}: {value.title}")
            for name, value in zip(known, sections, strict=True)
        )
    titles = [section.title for section in sections]
    files = [
        os.fspath(result) if isinstance(result, str | os.PathLike) else "" for result in results
    ]
    # Files of one name lie in different folders.
    short = [Path(file).name for file in files]
    of = [f"result {i + 1}" for i in range(len(sections))]
    for own in (files, short):  # the shorter one, if it distinguishes them
        of = [name if name and own.count(name) == 1 else of[i] for i, name in enumerate(own)]
    return tuple(
        replace(value, title=f"{value.title} ({of[i]})") if titles.count(value.title) > 1 else value
        for i, value in enumerate(sections)
    )


def _date(date: datetime | None) -> str:
    """Return the date of a page in UTC, to the minute."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if date is None and epoch is not None:
        try:
            date = datetime.fromtimestamp(int(epoch), UTC)
        except (ValueError, OverflowError, OSError):
            raise InputError(
                f"expected SOURCE_DATE_EPOCH as seconds since 1970, got {epoch!r}"
            ) from None
    return f"{(date or datetime.now(UTC)).astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def check_page(path: str | os.PathLike[str]) -> None:
    """Refuse the name of a page that does not end in ``.html``."""
    if Path(path).suffix.lower() != ".html":
        raise InputError(f"cannot write {os.fspath(path)}: expected a name that ends in .html")


def section_of(result: Result, room: int, access: Access = Access()) -> Section:
    """Return the section of a result, or of the file of one."""
    match result:
        case Evaluation():
            return of_evaluation(result, room)
        case Comparison():
            return of_comparison(result)
        case RecordingsComparison():
            return of_recordings(result)
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
    classes = [kind for kind in get_args(Result) if isinstance(kind, type) and kind is not str]
    raise InputTypeError(
        f"expected a result ({', '.join(kind.__name__ for kind in classes)}) or the path of its "
        f"file, got {type(result).__name__}"
    )


def _of_file(path: Path, room: int, access: Access) -> Section:
    if path.suffix.lower() == ".parquet" or path.is_dir():
        return _of_table(path, room)
    stored = read(
        path, SECTIONS, others=", or the Parquet file or the folder of a sweep, a campaign or a run"
    )
    return build(path, stored, lambda result: SECTIONS[result["kind"]](result, path, room, access))


def _of_table(path: Path, room: int) -> Section:
    """Return the section of a Parquet file, or of the folder of a campaign or of results."""
    if holds_results(path):
        return of_results(path)
    if not path.is_dir() and holds_run(path):
        return of_run(Run.load(path), room)
    record, also = Record.read(path, "a report")
    if "space" not in also:
        return of_record(record, room)
    space = read_space(also["space"])
    return of_record(Sweep(record, space, also["sampler"], also["seed"]), room)


def _traces(stored: Mapping[str, Any], path: Path, room: int, access: Access) -> Section:
    return of_matrix(stored, path.parent, room, traces=access.traces)


def _case(_: Mapping[str, Any], path: Path, room: int, access: Access) -> Section:
    return of_case(SavedCase.load(path), room, play=access.play)


def _record(stored: Mapping[str, Any], room: int) -> Section:
    facts = {name: str(stored[name]) for name in ("sampler", "seed", "stop") if name in stored}
    return of_record(record_of(stored), room, facts)


SECTIONS: Final[Mapping[str, Callable[[Mapping[str, Any], Path, int, Access], Section]]] = {
    "runs": lambda stored, _path, room, _: of_runs(stored, room),
    "traces": _traces,
    "record": lambda stored, _path, room, _: _record(stored, room),
    "search": lambda stored, _path, _room, _: of_search_json(stored),
    "case": _case,
    "evaluation": lambda stored, _path, room, _: of_evaluation(Evaluation.from_saved(stored), room),
    "comparison": lambda stored, _path, _room, _: of_comparison(Comparison.from_saved(stored)),
    "recordings": lambda stored, _path, _room, _: of_recordings(
        RecordingsComparison.from_saved(stored)
    ),
    "methods": lambda stored, _path, _room, _: of_methods(MethodComparison.from_saved(stored)),
    "mined": lambda stored, _path, _room, _: of_mined(stored),
}
"""The section of each kind of result that a file can hold."""
