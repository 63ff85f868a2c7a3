"""The mutated sources, and the tests that cover them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

# The output of ANTLR, and the script that runs it: it needs Java, and `.ci/run` compares its output
# with the committed files.
_LEFT_OUT: Final = {"generated", "generate.py"}


@dataclass(frozen=True)
class Covering:
    """Tests that are collected once for several folders.

    Attributes:
        tests: Files and folders for pytest.
        left_out: Tests to skip, because they build programs of their own without mutants.
        backend: Skip tests that run only the machines of another back-end; None runs all.
        suite: The suite of `tests/conftest.py` with these tests, and its profile.
    """

    tests: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    backend: str | None = None
    suite: str = "all"


@dataclass(frozen=True)
class Folder:
    """Sources of one sample.

    Attributes:
        sources: Files, and folders with all their files.
        own: The tests for changes of an import, which every test reaches.
        size: The number of mutants in the sample.
    """

    name: str
    sources: tuple[str, ...]
    covering: Covering
    own: tuple[str, ...]
    size: int = 100

    def paths(self, root: Path) -> Iterator[str]:
        """The files from the root, sorted by name."""
        for source in self.sources:
            found = root / source
            for path in sorted(found.rglob("*")) if found.is_dir() else [found]:
                if path.suffix in {".py", ".cpp", ".hpp"} and not _LEFT_OUT & {*path.parts}:
                    yield path.relative_to(root).as_posix()

    @property
    def native(self) -> bool:
        """Whether the sources are C++."""
        return self.name.startswith("rtamt/native/")


_FILES: Final = ("dense", "errors", "internal", "lazy", "limits", "renamed", "typing")
"""Modules of `rtamt` outside its folders."""


def _files(folder: str, *of: str) -> Iterator[str]:
    """Return the test files with these names in a folder."""
    return (f"{folder}/test_{name}.py" for name in of)


_TEXTS: Final = Covering(
    (
        *(f"tests/rtamt/{room}" for room in ("language", "program", "patterns")),
        *_files("tests/rtamt/monitors", "dense", "options"),
        "tests/rtamt/inputs/test_input_errors.py",
        "rtamt/language",
    )
)
_MACHINES: Final = Covering(
    (
        *(f"tests/rtamt/{room}" for room in ("language", "program", "machines", "monitors")),
        *(f"tests/rtamt/{room}" for room in ("native", "inputs", "patterns")),
        *(f"rtamt/{room}" for room in ("program", "machines", "monitors")),
    ),
    (
        "tests/rtamt/machines/test_costs.py",
        "tests/rtamt/native/test_native_memory.py",
        *_files(
            "tests/rtamt/native",
            *("fmu_calls", "fmu_program_file", "fmu_refusals", "fmu_states", "fmu_values"),
        ),
    ),
)
# The folders in Python have fewer tests each: their own tests.
_PROGRAMS: Final = Covering(
    (
        "tests/rtamt/program",
        *_files(
            "tests/rtamt/monitors",
            *("dense", "dense_episode", "dense_errors", "ends", "episode", "judge", "limits"),
            *("neutral", "properties", "triggers", "unknown"),
        ),
        *_files("tests/rtamt/native", "native", "native_machine"),
        "rtamt/program",
    )
)
_RUNNING: Final = Covering(
    (
        *_files("tests/rtamt/machines", "long_windows", "state", "walk"),
        *_files(
            "tests/rtamt/monitors",
            *("dense", "dense_episode", "dense_errors", "dense_judgement", "dense_monitor"),
            *("dense_unknown", "ends", "episode", "holds"),
            *("judge", "monitor_sets", "monitor_state", "neutral", "operator_clocks"),
            *("properties", "triggers", "unknown", "unknown_entries", "vector"),
        ),
        *_files("tests/rtamt/native", "native", "native_batches"),
        "rtamt/machines",
    )
)
_ANSWERS: Final = Covering(
    (
        *_files(
            "tests/rtamt/monitors",
            *("circumstances", "dense_errors", "dense_judgement", "dense_origins"),
            *("explain", "explain_dense", "explain_dense_edges", "holds"),
            *("judge", "limits", "monitor_sets", "monitor_state", "operator_clocks", "options"),
            *("properties", "triggers", "unknown_entries", "vector", "vector_errors"),
        ),
        "tests/rtamt/language/test_table.py",  # it explains operators made of operators
        "tests/rtamt/program/test_align.py",  # it explains rounded bounds
        "rtamt/monitors",
    ),
    backend="python",
)
_NATIVE: Final = replace(_MACHINES, backend="native")
_JUDGING: Final = Covering(
    (
        *(f"tests/rtamt_gym/{room}" for room in ("judging", "wrappers", "success")),
        "rtamt_gym/judging",
    )
)
_SHAPING: Final = Covering(
    (
        *_files(
            "tests/rtamt_gym/wrappers",
            *("shaping", "shaping_mdp", "settled_rewards", "stl_reward", "vector_stl_reward"),
            *("clipping",),
        ),
        "rtamt_gym/shaping.py",
    )
)
_STATISTICS: Final = Covering(
    (
        "tests/rtamt_gym/results",
        "tests/rtamt_gym/evaluation",
        "rtamt_gym/results",
        "rtamt_gym/evaluation",
    )
)


def _room(package: str, room: str, *tests: str, left_out: tuple[str, ...] = ()) -> Folder:
    """Return a room of a package, with the tests that have its name and further ones."""
    own = f"tests/{package}/{room}" if room else f"tests/{package}"
    source = f"{package}/{room}" if room else package
    return Folder(source, (source,), Covering((own, source, *tests), left_out), (own,), size=30)


def _arrays(name: str, library: str, *sources: str) -> Folder:
    """Return sources for the tests of one array library; their group installs the library."""
    covering = Covering((f"tests/arrays/test_{library}.py",))
    return Folder(name, sources, covering, covering.tests, size=30)


_ARRAYS: Final = tuple(
    f"rtamt_arrays/{name}.py"
    for name in (
        *("continuations", "episode", "functions", "inputs", "layout", "monitor_set"),
        *("judging", "offline", "online", "operations", "selectors"),
    )
)
_TOP: Final = ("demo", "drawing", "markup", "success", "tables", "testing")
_CAMPAIGNS: Final = "tests/rtamt_gym/search"
_RUNS: Final = "tests/rtamt_gym/play"

# The mutants that the quick suite must kill: all code of the bare command.
QUICK: Final = Covering(("tests", "rtamt", "rtamt_gym", "rtamt_ros", "envs"), suite="quick")

FOLDERS: Final = {
    folder.name: folder
    for folder in (
        Folder(
            "rtamt/language",
            ("rtamt/language",),
            _TEXTS,
            ("tests/rtamt/language", "tests/rtamt/monitors/test_dense.py"),
        ),
        *(
            Folder(f"rtamt/{room}", (f"rtamt/{room}",), covering, (f"tests/rtamt/{own}",))
            for room, covering, own in (
                ("program", _PROGRAMS, "program"),
                ("machines", _RUNNING, "monitors"),
                ("monitors", _ANSWERS, "monitors"),
            )
        ),
        *(
            Folder(f"rtamt/native/{room}", (f"rtamt/native/{room}",), _NATIVE, ())
            for room in ("core", "discrete", "episode", "batch", "dense")
        ),
        Folder("rtamt_gym/judging", ("rtamt_gym/judging",), _JUDGING, ("tests/rtamt_gym/judging",)),
        Folder(
            "rtamt_gym/shaping",
            ("rtamt_gym/shaping.py",),
            _SHAPING,
            _SHAPING.tests,
        ),
        Folder(
            "rtamt_gym/statistics",
            (
                *(
                    f"rtamt_gym/results/{name}.py"
                    for name in ("statistics", "intervals", "method_scores")
                ),
                *(
                    f"rtamt_gym/evaluation/{name}.py"
                    for name in ("methods", "paired", "sequential")
                ),
            ),
            _STATISTICS,
            ("tests/rtamt_gym/results", "tests/rtamt_gym/evaluation"),
        ),
        *(
            _room("rtamt", room)
            for room in ("checking", "compat", "export", "inputs", "mutation", "patterns")
        ),
        _room("rtamt_gym", "benchmarks"),
        _room("rtamt_gym", "checks", "tests/rtamt_gym/commands"),
        _room("rtamt_gym", "commands", "tests/rtamt_gym/recorded", _CAMPAIGNS, _RUNS),
        _room("rtamt_gym", "datasets"),
        _room("rtamt_gym", "evaluation"),
        _room("rtamt_gym", "inputs", _CAMPAIGNS, _RUNS),
        _room("rtamt_gym", "learners"),
        _room("rtamt_gym", "mujoco"),
        _room("rtamt_gym", "options", "tests/rtamt_gym/commands"),
        _room(
            "rtamt_gym", "play", _CAMPAIGNS, "tests/rtamt_gym/systems", "tests/rtamt_gym/evaluation"
        ),
        _room("rtamt_gym", "recorded"),
        _room("rtamt_gym", "reports"),
        _room("rtamt_gym", "results", "tests/rtamt_gym/reports", "tests/rtamt_gym/recorded"),
        _room("rtamt_gym", "search"),
        _room("rtamt_gym", "signals", "tests/rtamt_gym/wrappers"),
        _room("rtamt_gym", "systems", _CAMPAIGNS, _RUNS),
        Folder(  # .ci/run live installs rerun-sdk
            "rtamt_gym/live",
            ("rtamt_gym/live",),
            Covering(("tests/rtamt_gym/live", "tests/live/test_rerun.py")),
            ("tests/rtamt_gym/live",),
            size=30,
        ),
        _room("rtamt_gym", "watching", "tests/rtamt_gym/commands"),
        _room("rtamt_gym", "wrappers", "tests/rtamt_gym/judging", "tests/rtamt_gym/success"),
        _room("rtamt_ros", "", left_out=("rtamt_ros/ros1.py", "rtamt_ros/ros2.py")),
        Folder(
            "envs",
            ("envs/rtamt_envs",),
            Covering(("tests/rtamt_envs", "envs")),
            ("tests/rtamt_envs",),
            size=30,
        ),
        Folder(
            "rtamt_gym",
            tuple(f"rtamt_gym/{name}.py" for name in _TOP),
            Covering(
                (
                    "tests/rtamt_gym/success",
                    "tests/rtamt_gym/testing",
                    "tests/rtamt_gym/commands",
                    "rtamt_gym/tables.py",
                )
            ),
            ("tests/rtamt_gym/success", "tests/rtamt_gym/testing"),
            size=30,
        ),
        Folder(
            "rtamt",
            ("rtamt/columns", *(f"rtamt/{name}.py" for name in _FILES)),
            Covering(
                (
                    "tests/rtamt/test_errors.py",
                    "tests/rtamt/test_column_names.py",
                    "tests/rtamt/inputs",
                    "tests/rtamt/monitors",
                )
            ),
            ("tests/rtamt/test_errors.py",),
            size=30,
        ),
        _arrays("rtamt_arrays/jax", "jax", "rtamt_arrays/jax"),
        _arrays("rtamt_arrays", "torch", "rtamt_arrays/torch", *_ARRAYS),
    )
}
