"""A report as one file of HTML that needs nothing else: text, tables, style, script and charts."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from typing import Any, Final

from rtamt.errors import shown_lines
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.reports import texts
from rtamt_gym.reports.charts import (
    NOUNS,
    Chart,
    charts_of,
    curves_charts,
    episode_chart,
    pairs_chart,
)
from rtamt_gym.reports.model import (
    Report,
    Section,
    ShownEpisode,
    ShownRequirement,
    ShownTrial,
    plain,
)
from rtamt_gym.reports.rows import DIGITS
from rtamt_gym.reports.standing import key_of, standing_of
from rtamt_gym.reports.views import ComparedRequirement
from rtamt_gym.results.mutation import percent
from rtamt_gym.results.statistics import SUCCESS, progress_text
from rtamt_gym.tables import counted, p_text

__all__ = ["render"]

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

_SYMBOLS: Final = {"satisfied": "\u2713", "violated": "\u2717", "undecided": "?", "failed": "!"}


def render(report: Report) -> str:
    """Writes a report as one page of HTML, which loads nothing from anywhere.

    The page has the text and the tables as they are, the data of its charts as JSON, and Plotly's
    script, which draws them. A policy in the page forbids it to load anything, whatever names and
    texts the report has.

    Args:
        report: What the page shows.

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
        {
            "number": texts.number,
            "percent": texts.percent,
            "share": percent,
            "time": texts.time,
            "p_text": p_text,
            "counted": counted,
            "digits": lambda sha: sha[:DIGITS],
        }
    )
    view = _View(open_examples=len(_requirements(report)) <= _FEW)
    sections = [view.section(section) for section in report.sections]
    return environment.get_template("page.html").render(
        report=report,
        sections=sections,
        standing=standing_of(report.sections),
        requirements=_requirements(report),
        symbols=_SYMBOLS,
        style="\n".join(map(_read, _STYLES)),
        plotly=get_plotlyjs(),
        script="\n".join(map(_read, _SCRIPTS)),
        data=_json({"charts": view.charts, "cases": view.cases}),
    )


@dataclass(slots=True)
class _Placed:
    """A part of the report with the id that it has on the page."""

    id: str
    of: Any
    parts: Mapping[str, Any] = field(default_factory=dict)


class _View:
    """Gives the parts of a report their ids, and collects the data of the charts."""

    def __init__(self, *, open_examples: bool) -> None:
        self._open = open_examples
        self.charts: dict[str, Any] = {}
        self.cases: dict[str, Any] = {}
        self._keys: dict[tuple[str, str], int] = {}
        self._names = texts.PageIds(("top", "summary", "filter", "data", "main"))

    def section(self, section: Section) -> _Placed:
        name = self._names.add(section.kind)
        if section.cases is not None:
            self.cases[name] = {
                "labels": section.cases.labels,
                "columns": plain(section.cases.columns),
                "robustness": plain(section.cases.robustness),
                "verdicts": section.cases.verdicts,
            }
        compared = section.comparison.requirements if section.comparison else ()
        drawn = curves_charts(section.methods) if section.methods else []
        return _Placed(
            name,
            section,
            {
                "noun": NOUNS[section.kind],
                "methods": self._place(name, name, drawn),
                "requirements": [self._requirement(name, section, r) for r in section.requirements],
                "compared": [
                    _Placed(
                        own := self._names.add(name, each.name),
                        each,
                        {
                            "open": self._open,
                            "charts": self._place(own, name, _some(pairs_chart(each))),
                            "key": "" if each.name == SUCCESS else self._key(each),
                        },
                    )
                    for each in compared
                ],
                "spread": {
                    text: (numbers[0], numbers[len(numbers) // 2], numbers[-1])
                    for text, numbers in (
                        ("return", section.returns),
                        ("length", section.durations),
                    )
                    if numbers
                },
            },
        )

    def _requirement(self, section: str, of: Section, requirement: ShownRequirement) -> _Placed:
        name = self._names.add(section, requirement.name)
        trials = requirement.trials
        columns = {
            "robustness": texts.aligned([trial.robustness for trial in trials]),
            "progress": [
                "" if trial.progress is None else progress_text(trial.progress) for trial in trials
            ],
            "asked": [_asked(trial) for trial in trials],
            "violated_at": texts.aligned(
                [None if t.violated_at is None else t.violated_at.time for t in trials]
            ),
            "duration": texts.aligned([trial.duration for trial in trials]),
            "reward": texts.aligned([trial.reward for trial in trials]),
        }
        return _Placed(
            name,
            requirement,
            {
                "open": self._open,
                "charts": self._place(name, section, charts_of(of, requirement)),
                "worst": [self._episode(name, section, of, each) for each in requirement.worst],
                "rows": [
                    _Placed(
                        self._names.add(name, trial.label),
                        trial,
                        {column: cells[i] for column, cells in columns.items()},
                    )
                    for i, trial in enumerate(trials)
                ],
                "key": "" if requirement.together else self._key(requirement),
                "columns": {column for column, cells in columns.items() if any(cells)},
                "cases": any(trial.case for trial in trials),
                "texts": any(trial.text or trial.defaults for trial in trials),
                "replay": bool(of.replay) and any(trial.seed is not None for trial in trials),
                "example": _first_seed(trials),
            },
        )

    def _key(self, requirement: ShownRequirement | ComparedRequirement) -> int:
        """A number that a requirement has in every section."""
        return self._keys.setdefault(key_of(requirement), len(self._keys))

    def _episode(self, name: str, section: str, of: Section, episode: ShownEpisode) -> _Placed:
        own = self._names.add(name, "worst", episode.label)
        (chart,) = self._place(own, section, [episode_chart(episode, of.unit)])
        return _Placed(own, episode, {"chart": chart})

    def _place(self, name: str, section: str, charts: list[Chart]) -> list[_Placed]:
        placed = []
        for chart in charts:
            own = self._names.add(name, chart.kind)
            self.charts[own] = {
                "kind": chart.kind,
                "section": section,
                "title": chart.title,
                **plain(chart.data),
            }
            placed.append(_Placed(own, chart))
        return placed


def _asked(trial: ShownTrial) -> str:
    """How often a trial put a requirement to the test."""
    if trial.asked is None:
        return ""
    if trial.vacuous and trial.asked:
        return f"{trial.asked}x, no answer"
    if not trial.asked:
        return "not for certain" if trial.unknown else "never"
    return f"{trial.asked}x"


def _some(chart: Chart | None) -> list[Chart]:
    return [] if chart is None else [chart]


def _first_seed(trials: tuple[ShownTrial, ...]) -> int | None:
    return next((trial.seed for trial in trials if trial.seed is not None), None)


def _requirements(report: Report) -> list[str]:
    """The names of all requirements, each once, in their order."""
    names = itertools.chain.from_iterable(
        [
            *(each.name for each in section.requirements),
            *(
                each.name
                for each in (section.comparison.requirements if section.comparison else ())
            ),
        ]
        for section in report.sections
    )
    return list(dict.fromkeys(names))


def _read(name: str) -> str:
    return (resources.files("rtamt_gym.reports") / "page" / name).read_text(encoding="utf-8")


def _finalized(value: object) -> object:
    """A value as the page writes it: texts of files without control characters."""
    return shown_lines(value) if type(value) is str else value


def _shown(value: Any) -> Any:  # noqa: ANN401 - what JSON holds
    """The same with all texts as they may be shown."""
    match value:
        case str():
            return shown_lines(value)
        case dict():
            return {_shown(key): _shown(each) for key, each in value.items()}
        case list() | tuple():
            return [each if type(each) is float else _shown(each) for each in value]
    return value


def _json(value: object) -> str:
    """Strict JSON that no name in it can leave: what HTML would read is written in escapes."""
    text = json.dumps(_shown(value), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
