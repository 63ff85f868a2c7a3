"""Try mutants on tests: one process collects the tests, and each mutant runs in a copy of it.

`run.py` starts ``python trials.py task.json``. A first copy runs every test, and records the cost
and the mutants of each test. The copy of a mutant runs the tests that reach it, first those that
killed others in its file, then those that killed any, then the cheapest, until one fails. Costs and
limits are processor seconds: the limit of a test ends an endless loop.
"""

from __future__ import annotations

import functools
import gc
import json
import math
import os
import resource
import signal
import sys
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import pytest
from changes import Site
from native_code import Reached
from python_code import Choices, Finder, module_name

BUDGET: Final = 20.0  # seconds of tests for one mutant
_SLOW: Final = 10.0  # the factor by which a mutant may slow a test, with 5 s in addition
_MEMORY: Final = 4 << 30  # more than the tests have used so far
_BLOCKED: Final = 600  # seconds of a clock, for a mutant that waits forever


@dataclass
class Tests:
    """The records of the first copy, by the number of a test."""

    seconds: dict[int, float] = field(default_factory=dict)
    reaching: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    failed: list[str] = field(default_factory=list)


class Trials:
    """A plug-in of pytest that runs the collected tests in copies of its process.

    Args:
        files: The path of each mutant, by its number.
        only: A mutant that is active from the start, because it changes an import; the tests run in
            the order of their cost.
    """

    def __init__(
        self,
        files: Mapping[int, str],
        places: Sequence[Choices | Reached],
        finder: Finder,
        *,
        only: int | None = None,
        costs: Mapping[str, float] | None = None,
    ) -> None:
        self._files = files
        self._places = places
        self._finder = finder
        self._only = only
        self._costs = costs or {}
        self._failed = False
        self._caches: list[functools._lru_cache_wrapper[Any]] = []
        self.result: dict[str, Any] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self) -> None:
        """After this, pytest would import each named file for its doctests."""
        self._finder.go_first()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Record a failing test or fixture, which kills the mutant."""
        self._failed |= report.failed

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Replace pytest's loop."""
        items = session.items
        if self._only is not None:
            chosen = sorted(
                (item for item in items if item.nodeid in self._costs),
                key=lambda item: self._costs[item.nodeid],
            )
            seconds = [self._costs[item.nodeid] for item in chosen]
            number = self._until_one_fails(chosen, seconds)
            self.result = {"killed_by": None if number is None else chosen[number].nodeid}
            return True
        assert session.testsfailed == 0, "expected every test to be collected"
        early = self._reached()
        packages = {module_name(path).partition(".")[0] for path in self._files.values()}
        self._caches = [
            each
            for each in gc.get_objects()
            if isinstance(each, functools._lru_cache_wrapper)
            and each.__module__.partition(".")[0] in packages
        ]
        tests = self._first(items)
        print(f"{len(items)} tests, {sum(tests.seconds.values()):.0f} s", file=sys.__stderr__)
        found: Counter[tuple[str, int]] = Counter()
        found_any: Counter[int] = Counter()
        trials = {}
        for number, path in self._files.items():
            reaching = sorted(
                tests.reaching.get(number, ()),
                key=lambda test: (-found[path, test], -found_any[test], tests.seconds[test]),
            )
            tried: list[int] = []
            total = 0.0
            for test in reaching:
                total += tests.seconds[test]
                if tried and total > BUDGET:
                    break
                tried.append(test)
            killed = self._copied(items, tried, tests.seconds, number) if tried else None
            if isinstance(killed, int):
                found[path, killed] += 1
                found_any[killed] += 1
            print(number, killed, file=sys.__stderr__)
            trials[number] = {
                "reaching": len(reaching),
                "tried": len(tried),
                "early": number in early,
                "killed_by": items[killed].nodeid if isinstance(killed, int) else killed,
            }
        self.result = {
            "trials": trials,
            "failed": tests.failed,
            "costs": {items[test].nodeid: cost for test, cost in tests.seconds.items()},
        }
        return True

    def _reached(self) -> set[int]:
        return set().union(*(place.reached() for place in self._places))

    def _begin(self, on: int | None = None) -> None:
        # A cache filled by another test would hide that this test needs the code behind it.
        for cache in self._caches:
            cache.cache_clear()
        for place in self._places:
            place.begin(on)

    def _run(self, item: pytest.Item, following: pytest.Item | None) -> bool:
        """Return whether a test passes."""
        self._failed = False
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        return not self._failed

    def _first(self, items: Sequence[pytest.Item]) -> Tests:
        """Return costs and reached mutants of each test that passes without a mutant."""
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            with os.fdopen(writer, "w", encoding="utf-8") as notes:
                for test, item in enumerate(items):
                    self._begin()
                    before = _seconds()
                    passed = self._run(item, items[test + 1] if test + 1 < len(items) else None)
                    seconds = round(_seconds() - before, 4)
                    notes.write(json.dumps([test, passed, seconds, sorted(self._reached())]) + "\n")
            os._exit(0)
        os.close(writer)
        tests = Tests()
        with os.fdopen(reader, encoding="utf-8") as notes:
            for line in notes:
                test, passed, seconds, reached = json.loads(line)
                if not passed:
                    tests.failed.append(items[test].nodeid)
                    continue
                tests.seconds[test] = seconds
                for number in reached:
                    tests.reaching[number].append(test)
        os.waitpid(child, 0)
        return tests

    def _copied(
        self,
        items: Sequence[pytest.Item],
        tried: Sequence[int],
        seconds: Mapping[int, float],
        number: int,
    ) -> int | str | None:
        """Return the failing test, the signal that ends the process, or None for a survivor."""
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reader)
            self._begin(number)
            place = self._until_one_fails(
                [items[test] for test in tried], [seconds[test] for test in tried], writer
            )
            os._exit(0 if place is None else 1)
        os.close(writer)
        with os.fdopen(reader, "rb") as notes:
            begun = len(notes.read())
        _, status = os.waitpid(child, 0)
        if os.WIFSIGNALED(status):
            return signal.Signals(os.WTERMSIG(status)).name
        return tried[begun - 1] if os.WEXITSTATUS(status) else None

    def _until_one_fails(
        self, items: Sequence[pytest.Item], seconds: Sequence[float], notes: int | None = None
    ) -> int | None:
        """Return the index of the first failing test; write a byte at the start of each."""
        memory = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (memory + _MEMORY, resource.RLIM_INFINITY))
        for place, (item, own) in enumerate(zip(items, seconds, strict=True)):
            if notes is not None:
                os.write(notes, b".")
            limit = math.ceil(_seconds() + 5 + _SLOW * own)
            resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))
            signal.alarm(_BLOCKED)
            if not self._run(item, items[place + 1] if place + 1 < len(items) else None):
                return place
        return None


def _seconds() -> float:
    """Return the processor time of this process."""
    used = os.times()
    return used.user + used.system


def main(task: Path) -> None:
    """Do a task, and write its result next to it."""
    given = json.loads(task.read_text(encoding="utf-8"))
    root = Path(given["root"])
    numbers: dict[str, dict[Site, int]] = {}
    files = {}
    for number, path, site in given["mutants"]:
        files[number] = path
        if path.endswith(".py"):
            numbers.setdefault(path, {})[Site(*site)] = number
    native = Path(given["native"]) if given["native"] else None
    choices = Choices()
    choices.begin(given["only"])
    finder = Finder(root, numbers, native)
    finder.install()
    places: list[Choices | Reached] = [choices]
    if native is not None:
        places.append(Reached(native, given["count"]))
    trials = Trials(files, places, finder, only=given["only"], costs=given["costs"])
    os.chdir(root)
    options = [
        "-q",
        "-n0",
        "-x",
        "-pno:cacheprovider",
        "--tb=native",
        f"--suite={given['suite']}",
    ]
    if given["suite"] == "all":
        options.append("--hypothesis-profile=mutation")
    if given["backend"] is not None:
        options.append(f"--backend={given['backend']}")
    code = pytest.main(
        [*options, *(f"--ignore={path}" for path in given["left_out"]), *given["tests"]], [trials]
    )
    if given["only"] is not None and not trials.result:
        trials.result = {"killed_by": f"the import ({pytest.ExitCode(code).name})"}
    assert trials.result, f"pytest ended with {code}"
    task.with_suffix(".out").write_text(json.dumps(trials.result), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
