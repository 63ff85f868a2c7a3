"""`write_report`: results as one page of HTML."""

from __future__ import annotations

import os
from pathlib import Path

import rtamt
from rtamt import InputError
from rtamt_gym.reports.html import render
from rtamt_gym.reports.model import Report
from rtamt_gym.reports.results import Result, section_of
from rtamt_gym.reports.series import ROOM
from rtamt_gym.tables import counted

__all__ = ["check_page", "report_of", "write_report"]


def write_report(path: str | os.PathLike[str], *results: Result, title: str | None = None) -> None:
    """Writes results as one page of HTML, which needs no network and no other file.

    Each result is a section, in their order: every requirement in words, what became of it, the
    worst episodes as plots. The simulation that a search has found, and the worst of a sweep, run
    again for that; a case or an evaluation in a file has all that is shown. Episodes with more than
    600 samples are shown without some of them, with fewer where episodes are many: never without
    the first, the last, the extremes of a series or the samples that decided. Needs the extra
    ``report``.

    Args:
        path: The name of the page, which ends in ``.html``.
        results: `Evaluation`, `Comparison`, `Sweep`, `Record`, `Falsification` and `SavedCase`, and
            the paths of their files: JSON and Parquet that they save, folders of campaigns, and
            what ``rtamt sweep``, ``falsify``, ``monitor`` and others write with ``--json``.
        title: The title of the page. None: the title of the only result, or how many there are.

    Raises:
        InputError: If there is no result, a file holds none, or the page has another ending.
        InputTypeError: If something is no result.
        OSError: If there is no such file, or the page cannot be written.
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
    page = render(report_of(*results, title=title))
    Path(path).write_text(page, encoding="utf-8")


def report_of(*results: Result, title: str | None = None) -> Report:
    """What the page of results shows."""
    if not results:
        raise InputError(
            "expected one result at least, such as an Evaluation or its file, got none"
        )
    sections = tuple(section_of(each, ROOM // len(results)) for each in results)
    if title is None:
        title = sections[0].title if len(sections) == 1 else counted(len(sections), "result")
    return Report(title, f"rtamt {rtamt.__version__}", sections)


def check_page(path: str | os.PathLike[str]) -> None:
    """Refuses the name of a page that does not end in ``.html``."""
    if Path(path).suffix.lower() != ".html":
        raise InputError(f"cannot write {os.fspath(path)}: expected a name that ends in .html")
