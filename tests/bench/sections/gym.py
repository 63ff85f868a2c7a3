"""The time that a monitor adds to `env.step`."""

from __future__ import annotations

import math
from collections.abc import Iterator

from controller import LeftOut, Setting, Subject, race
from report import Row, Table


def measure(setting: Setting) -> Iterator[Table]:
    """Measure steps with zero, one and four specifications, early and late, and an episode."""
    yield steps(setting)
    yield episode(setting)


def steps(setting: Setting) -> Table:
    """Measure the added time of a step; a peer is a simple wrapper that computes only the value."""
    table = Table("StlMonitor, added to env.step; late: last 1,000 of 5,000 to first", "us")
    for name, short in (("CartPole-v1", "CartPole"), ("Pendulum-v1", "Pendulum")):
        subjects = {who: setting.project("steps") for who in ("bare", "one", "four")}
        if "sentil" in setting.peers:
            subjects["naive"] = Subject(setting.peers["sentil"], "steps")
            subjects["peer's bare"] = Subject(setting.peers["sentil"], "steps")
        entries = {
            column: (subject, {"what": "steps", "env": name, "who": column.removeprefix("peer's ")})
            for column, subject in subjects.items()
        }
        figures_by_subject = race(entries, 3 if setting.quick else 9, table.notes)
        for subject in subjects.values():
            subject.stop()
        bare, peers_bare = figures_by_subject.get("bare"), figures_by_subject.get("peer's bare")
        if bare is None:
            continue
        naive = math.nan
        if "naive" in figures_by_subject and peers_bare:
            naive = (figures_by_subject["naive"][2] - peers_bare[2]) / 1e3
        table.rows.append(Row(f"{short}, bare step", {"rtamt": bare[2] / 1e3}))
        for who, target in (("one", 0.45), ("four", 1.0)):
            if who in figures_by_subject:
                figures = {"rtamt": (figures_by_subject[who][2] - bare[2]) / 1e3}
                if who == "one" and not math.isnan(naive):
                    figures["sentil"] = naive
                table.rows.append(
                    Row(f"{short}, {who} spec{'s' * (who == 'four')}", figures, target)
                )
                late = (figures_by_subject[who][1] - bare[1]) / (
                    figures_by_subject[who][0] - bare[0]
                )
                table.rows.append(Row("  added late / early", {"rtamt": late}, None))
                late = figures_by_subject[who][1] / figures_by_subject[who][0]
                table.rows.append(Row("  step late / early", {"rtamt": late}, 1.02))
    return table


EPISODE = (
    ("EpisodeMonitor(spec) and reset", 5),
    ("EpisodeMonitor(text) and reset", None),
    ("StlMonitor(env, spec)", None),
    ("CartPole reset, bare", None),
    ("CartPole reset, monitored", None),
)


def episode(setting: Setting) -> Table:
    """Measure the time that is spent once per episode."""
    subject = setting.project("steps")
    table = Table("Once an episode", "us")
    try:
        case = {"what": "episode"}
        figures_by_subject = race(
            {"rtamt": (subject, case)}, 3 if setting.quick else 9, table.notes
        )
    except LeftOut as why:
        table.notes["rtamt"] = str(why)
        figures_by_subject = {}
    subject.stop()
    for (label, target), value in zip(EPISODE, figures_by_subject.get("rtamt", ()), strict=False):
        table.rows.append(Row(label, {"rtamt": value / 1e3}, target))
    return table
