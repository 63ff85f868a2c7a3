"""The time that a monitor adds to the step of a vector environment."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table

TARGET = 20  # us, for one specification in 1,024 environments


def measure(setting: Setting) -> Iterator[Table]:
    """Measure `VectorStlMonitor` against Gymnasium's wrapper that records returns and lengths."""
    table = Table("VectorStlMonitor, added to a step of N CartPoles", "us")
    table.notes["gymnasium"] = "its vector RecordEpisodeStatistics"
    for num in (64, 1_024):
        for ends in (False, True):
            subjects = {who: setting.project("vectors") for who in ("bare", *WHO)}
            entries = {
                who: (subject, {"what": "steps", "num": num, "ends": ends, "who": who})
                for who, subject in subjects.items()
            }
            results = race(entries, 3 if setting.quick else 9, table.notes)
            for subject in subjects.values():
                subject.stop()
            if "bare" not in results:
                continue
            bare = results.pop("bare")[0]
            when = "poles fall" if ends else "none falls"
            added = {WHO[who]: (seen[0] - bare) / 1e3 for who, seen in results.items()}
            target = TARGET if num == 1_024 and not ends else None
            table.rows.append(Row(f"N={num}, {when}", added, target))
    yield table


WHO = {
    "one": "1 spec",
    "four": "4 specs",
    "state": "their state",
    "obligations": "obligations too",
    "gymnasium": "gymnasium",
}
