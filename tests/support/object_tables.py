"""Tables of several objects with the peculiarities of recorded tables."""

import math
from collections.abc import Callable, Mapping, Sequence
from random import Random
from typing import Any

SPECS = (
    "limit = always(x < 4)",
    "reply = always(a > 0 implies eventually[0:0.3](b > 0))",
    "hold = always(a > 0 implies x > -3)",
    "past = always(b > 0 implies once[0:0.2](a > 0))",
    "early = eventually[0:0.5](x > 2)",
    "goal = eventually(x > 2 and eventually(x < -2))",
    "ranged.stl",
    "deep = always(a > 0 implies (b > 0 until[0:0.4] x > 1))",
    "change = always(rate(x) < 50)",
)
OPTIONS: Sequence[Sequence[str]] = (
    (),
    ("--end", "complete"),
    ("--end", "open"),
    ("--view", "step"),
    ("--missing", "hold"),
    ("--missing", "unknown"),
    ("--missing", "drop"),
    ("--period", "0.1"),
    ("--period", "0.1", "--missing", "hold"),
    ("--time-unit", "ms"),
    ("--jitter", "5%"),
    ("--max-gap", "1s"),
    ("--dense",),
    ("--min-duration", "0.3s"),
    ("--semantics", "boolean"),
    ("--align", "outward"),
    ("--one-trace",),
    ("--strict-ranges",),
    ("--same-time", "first"),
    ("--occurrences",),
)
Rows = list[dict[str, Any]]


def jitter(random: Random, rows: Rows) -> None:
    for row in rows:
        row["time"] += random.uniform(-0.002, 0.002)


def hole(_random: Random, rows: Rows) -> None:
    for row in rows[len(rows) // 2 :]:
        row["time"] += 3.0


def constant(_random: Random, rows: Rows) -> None:
    for row in rows:
        row["x"] = row["a"] = 1.0


def objects(random: Random, rows: Rows) -> None:
    for k, row in enumerate(rows):
        row["trial"], row["driver"] = k % 2, random.choice(["ann", "bob"])


def in_the_middle(**cells: float) -> Callable[[Random, Rows], None]:
    return lambda _, rows: rows[len(rows) // 2].update(cells)


CHANGES: Mapping[str, Callable[[Random, Rows], None]] = {
    "jitter": jitter,
    "uneven": lambda _, rows: rows[len(rows) // 2].update(time=rows[len(rows) // 2]["time"] + 0.04),
    "repeated": lambda _, rows: rows.insert(len(rows) // 2, dict(rows[len(rows) // 2])),
    "falling": lambda _, rows: rows.reverse(),
    "hole": hole,
    "empty": in_the_middle(x=math.nan),
    "constant": constant,
    "objects": objects,
    "nan time": in_the_middle(time=math.nan),
    "flag": lambda _, rows: rows[0].update(terminated=True),
}
HABITS = ("plain",) * 6 + (*CHANGES, "one", "two", "late", "far", "whole", "fine")


def group(random: Random, key: int, habit: str) -> Rows:
    """Return the rows of an object with some peculiarity of recorded tables."""
    n = {"one": 1, "two": 2}.get(habit, random.randint(2, 12))
    step = {"whole": 1.0, "fine": 0.02}.get(habit, 0.1)
    start = {"late": 1.7e9, "far": 45413.5}.get(habit, random.choice([0.0, 3.0, 0.05]))
    rows = [
        {
            "car": key,
            "kind": "ab"[key % 2],
            "time": start + step * k,
            "x": float(random.randint(-5, 5)),
            "a": random.choice([0.0, 0.0, 1.0]),
            "b": random.choice([0.0, 1.0]),
            "trial": 0,
            "driver": "ann",
            "terminated": k == n - 1,
        }
        for k in range(n)
    ]
    if habit in CHANGES:
        CHANGES[habit](random, rows)
    return rows
