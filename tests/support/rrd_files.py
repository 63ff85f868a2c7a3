"""The contents of a ``.rrd`` file of Rerun."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

from rerun.chunk import RrdReader


class Point(NamedTuple):
    """A value at a place: the time is None if samples have no time."""

    sample: int
    time: float | None
    episode: int
    value: Any


def read_rrd(path: Path, component: str = "Scalars:scalars") -> dict[str, list[Point]]:
    """Return the points of each entity that has the component, in the order of their samples."""
    points: defaultdict[str, list[Point]] = defaultdict(list)
    for chunk in RrdReader(path).stream():
        columns = chunk.to_record_batch().to_pydict()
        if component not in columns:
            continue
        count = len(columns[component])
        times = [time.total_seconds() for time in columns.get("time", ())] or [None] * count
        places = zip(columns["sample"], times, columns["episode"], strict=True)
        for place, (value,) in zip(places, columns[component], strict=True):
            points[chunk.entity_path].append(Point(*place, value))
    return {path: sorted(some, key=lambda point: point.sample) for path, some in points.items()}
