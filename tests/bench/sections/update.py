"""One update from Python."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from controller import Setting, Subject, race
from report import Row, Table

SIZES = {"100": 100, "1k": 1_000, "10k": 10_000, "100k": 100_000, "1M": 1_000_000}

THERE = 24  # ns, the floor at k=100 on the machine of the targets


def measure(setting: Setting) -> Iterator[Table]:
    """Measure W1 in every argument form, W2 with `Monitor` and with `EpisodeMonitor`."""
    subjects = setting.subjects()
    try:
        yield w1(setting, subjects)
        yield w2(setting, subjects)
        yield episodes(setting, subjects)
    finally:
        for subject in subjects.values():
            subject.stop()


def row(
    setting: Setting,
    subjects: dict[str, Subject],
    table: Table,
    label: str,
    target: float | None,
    **case: Any,  # noqa: ANN401 - what JSON holds
) -> None:
    """Measure a case with every subject and add the figures to a table."""
    seconds, repeats = (0.002, 3) if setting.quick else (0.01, 9)
    case = {"what": "update", "form": "positional", "fill": 400, "seconds": seconds} | case
    entries = {
        column: (subject, case | {"backend": column})
        for column, subject in subjects.items()
        if column not in case.get("without", ())
    }
    notes: dict[str, str] = {}
    figures = race(entries, repeats, notes)
    table.rows.append(Row(label, {column: seen[0] for column, seen in figures.items()}, target))
    for column, why in notes.items():
        if column in ("native", "python") or "more than" in why:
            table.notes[f"{label} {column}"] = why


def w1(setting: Setting, subjects: dict[str, Subject]) -> Table:
    """Measure the window minimum, in windows so long that only a constant cost is practical."""
    title = "Monitor.update, always[0:k](a + b > -2); python: at most 2k"
    table = Table(title, "ns")
    for name, k in SIZES.items():
        if setting.quick and k not in (100, 100_000):
            continue
        # to fill the window, the slow tools need longer than all other parts
        slow = ("python", "mstlo", "reelay") if setting.quick and k > 100 else ()
        size = {"kind": "w1", "k": k, "fill": k + 1, "without": slow}
        row(setting, subjects, table, f"k={name}", 35, **size)
    for form, target in (("mapping", 50), ("keywords", None), ("array", None)):
        slow = {column: subject for column, subject in subjects.items() if column != "floor"}
        chosen = subjects if form == "mapping" else slow
        row(setting, chosen, table, f"k=1k {form}", target, kind="w1", k=1_000, form=form)
    here = table.rows[0].figures.get("floor")
    if here:
        table.notes["floor"] = (
            f"k=100 took {THERE} ns on the machine of the targets, {here:.0f} here: "
            f"targets x {here / THERE:.2f}"
        )
    if "floor" in subjects:
        only = {"floor": subjects["floor"]}
        row(setting, only, table, "an empty call", None, kind="w1", k=1, form="nothing")
    return table


W2 = (
    ("resp", {"kind": "resp"}, 45),
    ("nested", {"kind": "nested"}, 50),
    ("until w=100", {"kind": "until", "k": 100}, 45),
    ("until w=10k", {"kind": "until", "k": 10_000, "fill": 10_010}, 45),
    ("since w=10k", {"kind": "since", "k": 10_000, "fill": 10_010}, 45),
)


def w2(setting: Setting, subjects: dict[str, Subject]) -> Table:
    """Measure responses, nested windows, until and since."""
    table = Table("Monitor.update, W2; python: at most 6k", "ns")
    for label, case, target in W2:
        slow = ("sentil", "mstlo") if setting.quick and label == "until w=10k" else ()
        row(setting, subjects, table, label, target, **case | {"without": slow})
    return table


EPISODE_TARGETS = {"resp": 200, "nested": 600, "until w=100": 150, "until w=10k": 4_500}


def episodes(setting: Setting, subjects: dict[str, Subject]) -> Table:
    """Measure value, bounds and verdict of an episode; only peers with bounds take part."""
    subjects = {column: subject for column, subject in subjects.items() if column != "reelay"}
    title = "EpisodeMonitor.update; +read: lower, upper and verdict are read too"
    table = Table(title, "ns")
    plain = {"monitor": "episode", "form": "positional"}
    invariant = {"kind": "w1", "formula": "invariant"} | plain
    row(setting, subjects, table, "always(a + b > -2)", None, **invariant)
    row(setting, subjects, table, ".. +read", None, **invariant | {"form": "verdicts"})
    for label, case, _ in W2:
        if setting.quick and "10k" in label:
            continue
        # intervals of every pending instant: seconds per update
        slow = ("mstlo",) if label == "until w=10k" else ()
        chosen = case | plain | {"without": slow}
        target = EPISODE_TARGETS.get(label, 150)
        row(setting, subjects, table, label, target, **chosen)
        if not setting.quick:
            chosen |= {"form": "verdicts", "without": (*slow, "python")}
            row(setting, subjects, table, ".. +read", None, **chosen)
    return table
