"""A report as one self-contained HTML file: text, tables, style, script and charts."""

from __future__ import annotations

import json
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from importlib import resources
from typing import Any, Final, NamedTuple, TypeVar, get_args

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
)
from rtamt_gym.reports.requirements import DIGITS, trials_table, with_trials
from rtamt_gym.results import mutation
from rtamt_gym.results.codec import plain
from rtamt_gym.results.mutation import below, percent
from rtamt_gym.results.outcome import Word
from rtamt_gym.results.warnings import never_triggered_word
from rtamt_gym.tables import counted


class Standing(NamedTuple):
    """The line at the head of a page."""

    verdict: Word
    text: str


_HEADS: Final[dict[Word, str]] = {
    "violated": "Failed",
    "failed": "Undecided",
    "undecided": "Undecided",
    "satisfied": "Passed",
}

_WORST: Final[tuple[Word, ...]] = ("violated", "failed", "undecided", "satisfied")

_NAMED: Final = 5
"""The maximum number of requirements that the line names."""


def standing_of(sections: Sequence[Section]) -> Standing | None:
    """Return the line for the sections of a page; None if no section judges a requirement.

    Each requirement counts once, with its worst outcome in any section, and each episode counts
    once. A rate that sequential stopping compared with a target counts with its answer. Verdicts of
    traces that test requirements by killing mutants do not count.
    """
    same: dict[tuple[str, str], list[Requirement]] = {}
    for section in sections:
        for item in _judged(section) if section.mutants is None else ():
            same.setdefault(key_of(item), []).append(item)
    mutants = _mutants(sections)
    if not same:
        return None if mutants is None else _of_mutants(sections, mutants)
    words = Counter(min(map(word_of, group), key=_WORST.index) for group in same.values())
    worst = next(word for word in _WORST if words[word])
    counts = [f"{words[word]} {word}" for word in (*get_args(Word)[1:], "failed") if words[word]]
    never: dict[str, list[str]] = {}
    for (name, _), group in same.items():
        triggers = [count for item in group for count in item.triggers]
        if triggers and not any(triggers):
            unknown = any(item.unknown for item in group)
            never.setdefault(never_triggered_word(unknown=unknown), []).append(name)
    judged = [item for group in same.values() for item in group]
    defaults = dict.fromkeys(item.name for item in judged if item.defaults)
    parts = [
        f"of {counted(len(same), 'requirement')} {', '.join(counts)}",
        *_runs(sections),
        *(f"{word}: {', '.join(names)}" for word, names in never.items()),
        *([f"on defaults: {', '.join(defaults)}"] if defaults else []),
        *([] if mutants is None else [mutants]),
    ]
    return Standing(worst, f"{_HEADS[worst]}: {'; '.join(parts)}.")


def _judged(section: Section) -> list[Requirement]:
    """Return the requirements of a section that are judged, each by itself."""
    return [r for r in section.requirements if not (r.legend or r.together)]


def _required(sections: Sequence[Section]) -> tuple[float | None, list[str]]:
    """Return the share of killed mutants that was required, and the requirements below it."""
    required = [section.min_share for section in sections if section.min_share is not None]
    names = [
        name for section in sections for name in below(section.mutants or {}, section.min_share)
    ]
    return max(required, default=None), names


def _mutants(sections: Sequence[Section]) -> str | None:
    """Return how many mutants the traces kill; None if no traces were judged as tests."""
    tested = [section.mutants for section in sections if section.mutants is not None]
    if not tested:
        return None
    scores = [score for mutants in tested for score in mutants.values()]
    killed = sum(score.count("noticed") for score in scores)
    text = f"mutants killed: {killed} of {sum(score.different for score in scores)}"
    required, names = _required(sections)
    if not names or required is None:
        return text
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{text}, less than {percent(required)} of {', '.join(names[:_NAMED])}{more}"


def _of_mutants(sections: Sequence[Section], text: str) -> Standing:
    """Return the line of a page that judges mutants only."""
    parts = "; ".join([text, *_runs(sections)])
    tested = [section for section in sections if section.mutants is not None]
    if any(r.counts["failed"] for section in tested for r in section.requirements):
        return Standing("failed", f"{_HEADS['failed']}: {parts}.")
    required, names = _required(sections)
    if required is not None:
        word: Word = "undecided" if names else "satisfied"
        return Standing(word, f"{_HEADS[word]}: {parts}.")
    scores = [score for section in tested for score in (section.mutants or {}).values()]
    survived = any(score.count("noticed") < score.different for score in scores)
    return Standing("undecided" if survived else "satisfied", f"{parts[0].upper()}{parts[1:]}.")


def key_of(requirement: Requirement) -> tuple[str, str]:
    """Return the identity of a requirement in several sections."""
    return requirement.name, requirement.formula


def word_of(requirement: Requirement) -> Word:
    """Return the worst outcome of a requirement; undecided if nothing judged it."""
    if requirement.answer is not None:
        return requirement.answer
    counts = requirement.counts
    return next((word for word in _WORST if counts[word]), "undecided")


def _runs(sections: Sequence[Section]) -> Iterator[str]:
    """Yield how many episodes, simulations and traces were judged, and how many failed."""
    judged: Counter[str] = Counter()
    failed: Counter[str] = Counter()
    for section in sections:
        own = _judged(section)
        if not own:
            continue
        # A trace may fail under a single requirement.
        labels = {
            t.label for requirement in own for t in requirement.trials if t.verdict == "failed"
        }
        lost = max(len(labels), *(requirement.counts["failed"] for requirement in own))
        judged[section.noun] += max(len(requirement.trials) for requirement in own) - lost
        failed[section.noun] += lost
    for noun in judged:
        text = f"{counted(judged[noun], noun)} evaluated"
        yield f"{text}, {failed[noun]} failed" if failed[noun] else text


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
"""The maximum number of requirements on a page with examples open from the start."""

_Drawn = TypeVar("_Drawn", Figure, Table | Figure)

_SYMBOLS: Final = {"satisfied": "\u2713", "violated": "\u2717", "undecided": "?", "failed": "!"}


def render(report: Report) -> str:
    """Return a report as one page of HTML, which loads nothing from anywhere.

    The page has the text and the tables as they are, the data of its charts as JSON, and Plotly's
    script, which draws them. A policy in the page forbids it to load anything, whatever names and
    texts the report has.

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
        requirement = with_trials(requirement, of)
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
    label = f"Mutants of {name} that survived"
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
