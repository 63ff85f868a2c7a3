"""What the subjects have in common: a clock, and how they answer."""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

Case = dict[str, Any]


def least(run: Callable[[], object], repeats: int) -> float:
    """The least number of seconds of some runs."""
    found = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        found.append(time.perf_counter() - begin)
    return min(found)


def processor_seconds(run: Callable[[], object]) -> float:
    """The seconds of processors that one run takes, with compilers that it starts."""
    begin = _processors()
    run()
    return _processors() - begin


def _processors() -> float:
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(used.ru_utime + used.ru_stime for used in map(resource.getrusage, who))


def answer(subjects: dict[str, Callable[[Case], Case]]) -> None:
    """Print what the subject of the command line finds, as JSON."""
    print(json.dumps(subjects[sys.argv[1]](json.loads(sys.argv[2]))))
