"""Time that a monitor adds to `env.step`."""

from __future__ import annotations

import math
from collections.abc import Iterator

from controller import LeftOut, Setting, Subject, race
from report import Row, Table


def measure(setting: Setting) -> Iterator[Table]:
    """Steps with no, one and four specifications, early and late; what an episode costs."""
    yield steps(setting)
    yield episode(setting)


def steps(setting: Setting) -> Table:
    """Added time of a step; a peer is a naive wrapper, the value alone."""
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
        found = race(entries, 3 if setting.quick else 9, table.notes)
        for subject in subjects.values():
            subject.stop()
        bare, peers_bare = found.get("bare"), found.get("peer's bare")
        if bare is None:
            continue
        naive = math.nan
        if "naive" in found and peers_bare:
            naive = (found["naive"][2] - peers_bare[2]) / 1e3
        table.rows.append(Row(f"{short}, bare step", {"rtamt": bare[2] / 1e3}))
        for who, target in (("one", 0.45), ("four", 1.0)):
            if who in found:
                figures = {"rtamt": (found[who][2] - bare[2]) / 1e3}
                if who == "one" and not math.isnan(naive):
                    figures["sentil"] = naive
                table.rows.append(
                    Row(f"{short}, {who} spec{'s' * (who == 'four')}", figures, target)
                )
                late = (found[who][1] - bare[1]) / (found[who][0] - bare[0])
                table.rows.append(Row("  added late / early", {"rtamt": late}, None))
                late = found[who][1] / found[who][0]
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
    """Time that is spent once an episode."""
    subject = setting.project("steps")
    table = Table("Once an episode", "us")
    try:
        case = {"what": "episode"}
        found = race({"rtamt": (subject, case)}, 3 if setting.quick else 9, table.notes)
    except LeftOut as why:
        table.notes["rtamt"] = str(why)
        found = {}
    subject.stop()
    for (label, target), value in zip(EPISODE, found.get("rtamt", ()), strict=False):
        table.rows.append(Row(label, {"rtamt": value / 1e3}, target))
    return table
