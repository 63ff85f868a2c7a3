"""Suites, back-ends and Hypothesis profiles of the tests.

``pytest -q`` runs the suite ``quick``: every test that is not marked ``slow``, and each property on
a fifth of its examples. Tests of paths on the command line run in full.
"""

import gc
import os
import stat
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import HealthCheck, Phase, is_hypothesis_test, settings

import rtamt

# Tests and fixtures that two files share.
pytest.register_assert_rewrite(
    "array_contract", "ros_contract", "ros_live", "ros_tutorial", "ros2_client"
)

# Every run repeats the same few examples; a nightly run draws many other examples. A property with
# slow examples sets its own number with `examples` of tests/support/profiles.py.
settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "nightly",
    settings.get_profile("repeatable"),
    derandomize=False,
    max_examples=1000,
    print_blob=True,
)
# The examples of `quick` are the first fifth of those of `repeatable`.
settings.register_profile("quick", settings.get_profile("repeatable"), max_examples=10)
# Sanitizers check memory: a tenth of the examples reaches each path of the machines.
settings.register_profile("sanitized", settings.get_profile("repeatable"), max_examples=15)
# The first failing example kills a mutant, however long it is; hundreds of mutants are tried.
settings.register_profile(
    "mutation",
    settings.get_profile("repeatable"),
    max_examples=20,
    phases=[Phase.explicit, Phase.generate],
)
settings.load_profile("repeatable")

# Without a compiler there is one back-end to test; CI requires both.
BACKENDS = ("python", "native") if rtamt.BACKEND == "native" else ("python",)


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """The complete suite runs on every core; selected tests start no workers."""
    return None if config.args_source is pytest.Config.ArgsSource.TESTPATHS else 0


@pytest.hookimpl(tryfirst=True)
def pytest_make_collect_report(collector: pytest.Collector) -> pytest.CollectReport | None:
    """Where ROS is missing, each file of its tests fails and reports how to install it."""
    if collector.path.name.startswith(("test_ros1", "test_ros2")):
        from ros_processes import missing

        if install := missing(int(collector.path.name[8])):
            if type(collector) is not pytest.Module:  # the collector of doctests
                return pytest.CollectReport(collector.nodeid, "passed", None, [])
            return pytest.CollectReport(collector.nodeid, "failed", install, [])
    return None


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--backend", choices=BACKENDS, help="leave out the tests that run another back-end alone"
    )
    parser.addoption(
        "--suite",
        choices=("quick", "rest", "all"),
        help="quick: no slow tests, few examples; rest: slow tests and all examples; "
        "default: quick, or all where paths are named",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Choose the suite; xdist hands the options of this process to its workers."""
    if config.option.suite is None:
        bare = config.args_source is pytest.Config.ArgsSource.TESTPATHS
        config.option.suite = "quick" if bare else "all"
    if config.option.suite == "quick" and not config.getoption("--hypothesis-profile"):
        settings.load_profile("quick")
    config.pluginmanager.register(_Collection())
    if not hasattr(config, "workerinput"):
        return
    config.pluginmanager.register(_Worker())
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=partial(_disconnect, _open_pipes()))


class _Collection:
    """Faster collection, also in the folders of the packages, which have no other conftest."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        """Collect without garbage collection, which would take a fifth of the time."""
        gc.disable()
        try:
            return (yield)
        finally:
            gc.enable()

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(
        self, file_path: Path
    ) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
        """Look for doctests only in files with prompts."""
        collectors = yield
        return [
            collector
            for collector in collectors
            if not isinstance(collector, DoctestModule)
            or ">>> " in file_path.read_text(encoding="utf-8")
        ]


class _Worker:
    """Spare garbage collection the objects that live until the end of a worker.

    Tests that collect garbage would otherwise take seconds late in a run.
    """

    def __init__(self) -> None:
        self._file = ""
        self._files = 0

    def pytest_collection_finish(self) -> None:
        gc.freeze()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Freeze what remains before every twentieth file, when no fixture of a file lives."""
        file = nodeid.partition("::")[0]
        if file == self._file:
            return
        self._file = file
        self._files += 1
        if self._files % 20 == 0:
            gc.collect()
            gc.freeze()


def _open_pipes() -> list[int]:
    """Return the open pipes of this process, except the standard streams."""
    pipes = []
    for descriptor in range(3, 64):
        with suppress(OSError):
            if stat.S_ISFIFO(os.fstat(descriptor).st_mode):
                pipes.append(descriptor)
    return pipes


def _disconnect(pipes: list[int]) -> None:
    """Leave the pipes of xdist to the worker: it waits for a dead worker until all ends close."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in pipes:
        os.dup2(nothing, descriptor)
    os.close(nothing)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    only: str | None = config.getoption("--backend")
    suite: str = config.getoption("--suite")
    slow = _slow(items)
    run: dict[bool, list[pytest.Item]] = {True: [], False: []}
    for item in items:
        wanted = {
            "quick": item not in slow,
            "rest": item in slow or is_hypothesis_test(getattr(item, "obj", None)),
            "all": True,
        }
        run[wanted[suite] and (only is None or _backend_of(item) in {None, only})].append(item)
    config.hook.pytest_deselected(items=run[False])
    items[:] = run[True]


def _slow(items: list[pytest.Item]) -> set[pytest.Item]:
    """Return the tests that the suite `quick` omits."""
    slow = set()
    kept: Counter[tuple[str, str | None]] = Counter()
    for item in items:
        backend = _backend_of(item)
        for mark in item.iter_markers("slow"):
            test = item.nodeid.partition("[")[0], backend
            kept[test] += 1
            if mark.kwargs.get("backend", backend) == backend and kept[test] > mark.kwargs.get(
                "keep", 0
            ):
                slow.add(item)
    return slow


def _backend_of(item: pytest.Item) -> str | None:
    """Return the back-end of a parametrized test; None without one, or if it compares them."""
    params = (
        item.callspec.params
        if isinstance(item, pytest.Function) and hasattr(item, "callspec")
        else {}
    )
    backend: object = params.get("backend")
    return None if backend is None else str(backend)


@pytest.fixture(scope="session", params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    """Return every back-end that is built."""
    return str(request.param)


@pytest.fixture(scope="module")
def doubles() -> Iterator[None]:
    """Enable float64 in JAX; its own tests install JAX."""
    import jax

    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - its only form
    yield
    jax.config.update("jax_enable_x64", before)
