"""A report as one file of HTML that needs nothing else: text, tables, style, script and charts."""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from importlib import resources
from typing import Any, Final, TypeVar

from rtamt.errors import shown_lines
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.reports import numbers
from rtamt_gym.reports.figures import episode_figure
from rtamt_gym.reports.model import (
    Cell,
    Column,
    Facts,
    Figure,
    Report,
    Requirement,
    Row,
    Section,
    ShownEpisode,
    Table,
    plain,
)
from rtamt_gym.reports.requirements import DIGITS, trials_table
from rtamt_gym.reports.standing import key_of, standing_of
from rtamt_gym.results import mutation
from rtamt_gym.tables import counted

_STYLES: Final = ("page.css", "parts.css", "print.css")
_SCRIPTS: Final = (
    "texts.js",
    "theme.js",
    "charts.js",
    "episode.js",
    "tables.js",
    "filter.js",
    "page.js",
)
_FEW: Final = 5
"""The most requirements of a page on which examples are open from the start."""

_Drawn = TypeVar("_Drawn", Figure, Table | Figure)

_SYMBOLS: Final = {"satisfied": "\u2713", "violated": "\u2717", "undecided": "?", "failed": "!"}


def render(report: Report) -> str:
    """Return a report as one page of HTML, which loads nothing from anywhere.

    The page has the text and the tables as they are, the data of its charts as JSON, and Plotly's
    script, which draws them. A policy in the page forbids it to load anything, whatever names and
    texts the report has.

    Args:
        report: The content of the page.

    Raises:
        ModuleNotFoundError: If jinja2 or plotly is not installed; names the extra ``report``.

    Example:
        >>> page = render(Report("Runs of <b>A</b>", "rtamt", ()))
        >>> page.count("<h1>Runs of &lt;b&gt;A&lt;/b&gt;</h1>")
        1
    """
    try:
        import jinja2
        from plotly.offline import get_plotlyjs
    except ModuleNotFoundError as error:
        raise naming_extra(error, "a report") from None
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rtamt_gym.reports", "page"),
        autoescape=True,
        finalize=_finalized,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        number=numbers.number,
        percent=numbers.percent,
        share=mutation.percent,
        counted=counted,
        digits=lambda sha: sha[:DIGITS],
    )
    names = dict.fromkeys(
        requirement.name for section in report.sections for requirement in section.requirements
    )
    environment.globals.update(
        symbols=_SYMBOLS,
        open_examples=len(names) <= _FEW,
        all_facts=_all_facts,
        survivors=_survivors,
        below=mutation.below,
    )
    layout = _Layout()
    sections = [layout.section(section) for section in report.sections]
    return environment.get_template("page.html").render(
        report=report,
        sections=sections,
        standing=standing_of(report.sections),
        requirements=list(names),
        style="\n".join(map(_read, _STYLES)),
        plotly=get_plotlyjs() if layout.charts else "",
        script="\n".join(map(_read, _SCRIPTS)),
        data=_json({"charts": layout.charts, "cases": layout.cases}),
    )


class _Layout:
    """The ids of the parts of a report on the page, and the data of its charts."""

    def __init__(self) -> None:
        self.charts: dict[str, Any] = {}
        self.cases: dict[str, Any] = {}
        self._keys: dict[tuple[str, str], int] = {}
        self._ids = PageIds(("top", "summary", "filter", "data", "main"))

    def section(self, section: Section) -> Section:
        own = self._ids.add(section.kind)
        if section.cases is not None:
            self.cases[own] = plain(section.cases)
        return replace(
            section,
            id=own,
            figures=self._placed(section.figures, own, own),
            requirements=tuple(self._requirement(own, section, r) for r in section.requirements),
        )

    def _requirement(self, section: str, of: Section, requirement: Requirement) -> Requirement:
        own = self._ids.add(section, requirement.name)
        key: int | str = ""
        if not requirement.together:
            key = self._keys.setdefault(key_of(requirement), len(self._keys))
        figures = self._placed(requirement.figures, own, section)
        worst = tuple(self._episode(own, section, of, worst_run) for worst_run in requirement.worst)
        placed = replace(requirement, place=own, key=key, figures=figures, worst=worst)
        if not placed.trials:
            return placed
        ids = partial(self._ids.add, own)
        return replace(placed, table=trials_table(placed, of.noun, of.unit, of.replay, ids))

    def _episode(self, name: str, section: str, of: Section, episode: ShownEpisode) -> ShownEpisode:
        own = self._ids.add(name, "worst", episode.label)
        (figure,) = self._placed([episode_figure(episode, of.unit)], own, section)
        return replace(episode, id=own, figure=figure)

    def _placed(self, figures: Iterable[_Drawn], name: str, section: str) -> tuple[_Drawn, ...]:
        placed: list[_Drawn] = []
        for figure in figures:
            if isinstance(figure, Figure):
                own = self._ids.add(name, figure.kind)
                head = {"kind": figure.kind, "section": section, "title": figure.title}
                self.charts[own] = {**head, **plain(figure.data)}
                placed.append(replace(figure, id=own))
            else:
                placed.append(figure)
        return tuple(placed)


def _all_facts(section: Section) -> Facts:
    """Return the facts of a section, with its system, its policy and the spread of its episodes."""
    named = (("system", section.system), ("policy", section.policy))
    rows = [
        (name, text, "") for name, text in (*(item for item in named if item[1]), *section.facts)
    ]
    for name, values in (("return", section.returns), ("length", section.durations)):
        if values:
            low, middle, high = map(
                numbers.number, (values[0], values[len(values) // 2], values[-1])
            )
            unit = f" {section.unit}" if name == "length" else ""
            rows.append((f"median {name}", f"{middle}{unit}", f"({low} to {high})"))
    return Facts(tuple(rows))


def _survivors(name: str, score: mutation.MutationScore) -> Table | None:
    """Return the table of surviving mutants, or None."""
    survivors = [mutant for mutant in score.mutants if mutant.says in ("missed", "unknown")]
    if not survivors:
        return None
    notes = any(item.remark for item in survivors)
    head = ("at", "change", "kind", *["note"] * notes)
    rows = (Row((m.place, Cell(codes=(m.change,)), m.kind, *[m.remark] * notes)) for m in survivors)
    label = f"Mutants of {name} that no trace notices"
    return Table(tuple(map(Column, head)), tuple(rows), label)


class PageIds:
    """Ids of a page, made from names: short, safe in an address, and unique.

    Example:
        >>> names = PageIds()
        >>> names.add("Höhe < 3"), names.add("hohe 3"), names.add("高度")
        ('hohe-3', 'hohe-3-2', 'x')
    """

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)

    def add(self, *parts: str) -> str:
        """Return an id of the parts that is unique on the page."""
        plain = "-".join(_slug(part) for part in parts)
        result, i = plain, 2
        while result in self._taken:
            result, i = f"{plain}-{i}", i + 1
        self._taken.add(result)
        return result


def _slug(text: str) -> str:
    letters = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", letters).strip("-")[:60].rstrip("-") or "x"


def _read(name: str) -> str:
    return (resources.files("rtamt_gym.reports") / "page" / name).read_text(encoding="utf-8")


def _finalized(value: object) -> object:
    """Return a value as the page writes it: texts of files without control characters."""
    return shown_lines(value) if type(value) is str else value


def _shown(value: Any) -> Any:  # noqa: ANN401 - what JSON holds
    """Return a value with all texts as they may be shown."""
    match value:
        case str():
            return shown_lines(value)
        case dict():
            return {_shown(key): _shown(each) for key, each in value.items()}
        case list() | tuple():
            return [item if type(item) is float else _shown(item) for item in value]
    return value


def _json(value: object) -> str:
    """Return strict JSON with escaped HTML characters, so that no name can end the script."""
    text = json.dumps(_shown(value), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
