"""Helpers of the subjects: clocks and output."""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

Case = dict[str, Any]


def least(run: Callable[[], object], repeats: int) -> float:
    """Return the minimum time of several runs, in seconds."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    return min(times)


def processor_seconds(run: Callable[[], object]) -> float:
    """Return the processor time of one run in seconds, with the compilers that it starts."""
    begin = _processors()
    run()
    return _processors() - begin


def _processors() -> float:
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(used.ru_utime + used.ru_stime for used in map(resource.getrusage, who))


def answer(subjects: dict[str, Callable[[Case], Case]]) -> None:
    """Print the figures of the case on the command line, as JSON."""
    print(json.dumps(subjects[sys.argv[1]](json.loads(sys.argv[2]))))
