"""The time saved by stopping at the first certain violation instead of the end of the episode.

The verdicts of all episodes must be equal; otherwise, it raises an error.
"""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table

ENVIRONMENTS = ("InvertedPendulum-v5", "HalfCheetah-v5", "Hopper-v5")


def measure(setting: Setting) -> Iterator[Table]:
    """Measure simulated and wall time of all episodes of an environment."""
    episodes = 20 if setting.quick else 200
    table = Table(f"Early stopping, {episodes} episodes; equal verdicts", "s, saved: %")
    for name in ENVIRONMENTS:
        subject = setting.project("stopping")
        case = {"what": "stopping", "env": name, "episodes": episodes}
        results = race({name: (subject, case)}, 1, table.notes).get(name)
        subject.stop()
        if results is None:
            continue
        violated, *times = results
        table.notes[name] = f"{violated:.0f} of {episodes} episodes are violated"
        for kind, (complete, part) in (("simulated", times[:2]), ("wall", times[2:])):
            figures = {
                "to the end": complete,
                "stopped": part,
                "saved": 100 * (1 - part / complete),
            }
            table.rows.append(Row(f"{name.partition('-')[0]}, {kind}", figures))
    yield table
