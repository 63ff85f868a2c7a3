"""The mutator: its changes in small modules and libraries, and its results for their tests."""

import ctypes
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import folders
import native_code
import pytest
import python_code
import run
from changes import Mutant
from paths import ROOT

pytestmark = pytest.mark.slow

MODULE = """\
import functools
LIMIT = 2
def least(a, b):
    if a < b:
        return a
    return b
def listed(into, n):
    into.append(n)
    while n > 0:
        n -= 1
    return n
def clipped(a: int = 3) -> int:
    return min(a, LIMIT)
@functools.cache
def doubled(a):
    return a * 2
"""

TESTS = """\
from toy import clipped, doubled, least, listed
def test_doubled():
    assert doubled(2) > 0
def test_doubled_of_a_cache():
    assert doubled(2) == 4
def test_least():
    assert least(1, 2) == 1
    assert least(3, 2) == 2
def test_listed():
    into = []
    assert listed(into, 1) == 0
    assert into == [1]
def test_clipped():
    assert clipped(5) == 2
def test_fails():
    assert least(1, 2) == 2
"""

CONFTEST = """\
from hypothesis import settings
settings.register_profile("mutation")
def pytest_addoption(parser):
    parser.addoption("--suite")
"""


def tried(root: Path, only: int | None = None) -> tuple[list[Mutant], Any]:
    """Return the result of `trials.py` for every mutant of the toy, in the order of the source."""
    sites = python_code.sites(MODULE)
    mutants = [
        Mutant(number, "toy", "toy.py", site, MODULE.splitlines()[site.line - 1].strip())
        for number, site in enumerate(sites)
    ]
    for name, text in (("toy.py", MODULE), ("test_toy.py", TESTS), ("conftest.py", CONFTEST)):
        (root / name).write_text(text, encoding="utf-8")
    task = {
        "root": str(root),
        "mutants": [run.plain(mutant) for mutant in mutants],
        "native": None,
        "count": len(mutants),
        "tests": ["test_toy.py", "toy.py"],
        "left_out": [],
        "backend": None,
        "suite": "all",
        "only": only,
        "costs": {"test_toy.py::test_clipped": 0.1},
    }
    (root / "task.json").write_text(json.dumps(task), encoding="utf-8")
    trials = Path(run.__file__).with_name("trials.py")
    subprocess.run(
        [sys.executable, str(trials), str(root / "task.json")],
        env={**os.environ, "PYTHONPATH": str(root)},
        check=True,
        capture_output=True,
    )
    return mutants, json.loads((root / "task.out").read_text(encoding="utf-8"))


def test_mutants_of_a_toy_are_killed_or_survive_as_known(tmp_path: Path) -> None:
    mutants, said = tried(tmp_path)
    found = {
        f"{mutant.site.line}: {mutant.site.change}": said["trials"][str(mutant.number)]["killed_by"]
        for mutant in mutants
    }
    assert found == {
        "2: 2 to 3": None,  # read at the import, see below
        "4: < to <=": None,  # equal numbers are not tried, and would show nothing
        "8: statement removed": "test_toy.py::test_listed",
        "9: > to >=": "test_toy.py::test_listed",
        "9: 0 to 1": "test_toy.py::test_listed",
        "10: -= to +=": "SIGXCPU",
        "10: 1 to 2": "test_toy.py::test_listed",
        "10: statement removed": "SIGXCPU",
        "12: 3 to 4": None,
        "16: * to /": "test_toy.py::test_doubled_of_a_cache",
        "16: 2 to 3": "test_toy.py::test_doubled_of_a_cache",
    }
    assert said["failed"] == ["test_toy.py::test_fails"]
    reaching = [said["trials"][str(mutant.number)]["reaching"] for mutant in mutants]
    assert reaching == [0, 1, 1, 1, 1, 1, 1, 1, 0, 2, 2]
    early = [said["trials"][str(mutant.number)]["early"] for mutant in mutants]
    assert early == [place in {0, 8} for place in range(len(mutants))]


def test_a_mutant_of_an_import_is_on_before_it(tmp_path: Path) -> None:
    assert tried(tmp_path, only=0)[1] == {"killed_by": "test_toy.py::test_clipped"}


def test_an_expression_and_a_statement_have_a_choice_each() -> None:
    source = "x.y = not a\nprint(a < b <= 2)\n"
    numbers = {site: number for number, site in enumerate(python_code.sites(source))}
    assert [site.change for site in numbers] == [
        "statement removed",
        "not removed",
        "statement removed",
        "< to <=",
        "<= to <",
        "2 to 3",
    ]
    made: dict[str, object] = {}
    for number in numbers.values():
        choices = python_code.Choices()
        choices.begin(number)
        said: list[object] = []
        names = {"x": type("X", (), {"y": None})(), "a": 1, "b": 1, "print": said.append}
        exec(compile(python_code.rewritten(source, numbers), "toy", "exec"), names)  # noqa: S102
        made[str(number)] = (names["x"].y, said)
    assert list(made.values()) == [
        (None, [False]),
        (1, [False]),
        (False, []),
        (False, [True]),
        (False, [False]),
        (False, [False]),
    ]


def test_changes_that_are_alike_on_a_line_are_told_apart() -> None:
    sites = python_code.sites("f(1, 2, 1, a < b < c, d < 1)\nf(1)\n")
    changes = [site.change for site in sites if "to" in site.change]
    assert sorted(changes) == [
        *("1 to 2", "1 to 2", "1 to 2 at 2", "1 to 2 at 3", "2 to 3"),
        *("< to <=", "< to <= at 2", "< to <= at 3"),
    ]


def test_types_annotations_and_patterns_have_no_mutant() -> None:
    source = """\
import functools
@functools.lru_cache(maxsize=3)
def f(a: "x < 3", b: int | None) -> -1:
    c: Literal[1]
    isinstance(a, int | float)
    match a:
        case 3:
            return None
Row = int | None
"""
    assert [site.change for site in python_code.sites(source)] == ["statement removed"]


NATIVE = """\
#include <optional>
#include <vector>
#define CASES(x) case 5: return twice(x);
template <int N> struct Ring { int size = N + 1; };
constexpr int kTwo = 1 + 1;
constexpr int twice(int n) { return n * kTwo; }
static_assert(twice(2) == 4);
extern "C" int toy(int a, int b) {
    Ring<3> ring;
    if (a < b && !(b == 7)) ring.size = 9;
    switch (a) {
        CASES(a)
        default: break;
    }
    std::optional<int> found;
    if (!found) ++ring.size;
    if (found) return a;
    std::vector<int> held{a, b};
    held.push_back(1);
    return ring.size + static_cast<int>(held.size()) + 2 - 2;
}
"""


def test_mutants_of_cpp_are_all_in_one_build(tmp_path: Path) -> None:
    sites = native_code.sites(NATIVE)
    numbers = {site: number for number, site in enumerate(sites)}
    assert [f"{site.line}: {site.change}" for site in sites] == [
        "4: + to -",
        "4: 1 to 1 + 1",
        "6: * to /",
        "10: < to <=",
        "10: && to ||",
        "10: not removed",
        "10: == to !=",
        "10: 7 to 7 + 1",
        "10: statement removed",
        "10: 9 to 9 + 1",
        "16: not removed",
        "16: statement removed",
        "17: condition negated",
        "19: statement removed",
        "19: 1 to 1 + 1",
        "20: + to -",
        "20: + to - at 2",
        "20: - to +",
        "20: 2 to 2 + 1",
        "20: 2 to 2 + 1 at 2",
    ]
    (tmp_path / "toy.cpp").write_text(native_code.rewritten(NATIVE, numbers), encoding="utf-8")
    library = tmp_path / "toy.so"
    flags = ["-std=c++20", "-shared", "-fPIC", f"-DMUTANTS={len(sites)}"]
    subprocess.run(
        [
            os.environ.get("CXX", "c++"),
            *flags,
            "-include",
            str(native_code.HEADER),
            str(tmp_path / "toy.cpp"),
            "-o",
            str(library),
        ],
        check=True,
    )
    places, toy = native_code.Reached(library, len(sites)), ctypes.CDLL(str(library)).toy
    places.begin()
    assert (toy(1, 2), toy(5, 2)) == (13, 10)
    assert places.reached() == set(range(len(sites)))
    made = []
    for number in range(len(sites)):
        places.begin(number)
        made.append((toy(1, 2), toy(2, 2), toy(5, 2), toy(1, 7)))
    original = (13, 8, 10, 8)
    assert [i for i, values in enumerate(made) if values == original] == [14]


def test_what_does_not_compile_is_named_by_its_number(tmp_path: Path) -> None:
    (tmp_path / "a.cpp").write_text("int a;\nint b = (mutant(4) ? (x) : (1));\n", encoding="utf-8")
    said = f"{tmp_path}/a.cpp:2:20: error: 'x' was not declared\na.cpp:1:2: warning: w\n"
    assert set(native_code._refused(said, tmp_path)) == {4}


@pytest.mark.parametrize("name", ["rtamt/program", "rtamt/native/batch"])
def test_a_seed_draws_the_same_sample_again(name: str) -> None:
    first, again, other = (run.drawn(folders.FOLDERS[name], ROOT, seed) for seed in (1, 1, 2))
    assert first == again != other
    assert len(set(first)) == len(first) >= folders.FOLDERS[name].size


def test_every_folder_names_tests_that_exist() -> None:
    for folder in folders.FOLDERS.values():
        given = (*folder.covering.tests, *folder.covering.left_out, *folder.own)
        assert [path for path in given if not (ROOT / path).exists()] == []


def test_every_module_has_a_folder() -> None:
    packages = ("rtamt", "rtamt_gym", "rtamt_arrays", "rtamt_ros", "envs")
    modules = {
        path.relative_to(ROOT).as_posix()
        for package in packages
        for path in (ROOT / package).rglob("*.py")
        if path.name not in {"__init__.py", "__main__.py", "generate.py"}
    }
    mutated = {path for folder in folders.FOLDERS.values() for path in folder.paths(ROOT)}
    generated = {path for path in modules if "/generated/" in path}
    assert modules - mutated == generated


def test_every_equivalent_mutant_is_still_one_of_its_line() -> None:
    """A changed line must be judged again."""
    sources: dict[str, set[tuple[str, str]]] = {}
    for path, line, change in run.equivalents():
        if path not in sources:
            text = (ROOT / path).read_text(encoding="utf-8")
            code = python_code if path.endswith(".py") else native_code
            lines = text.splitlines()
            sources[path] = {
                (lines[site.line - 1].strip(), site.change) for site in code.sites(text)
            }
        assert (line, change) in sources[path], f"{path}: {change}: {line}"


def test_a_report_counts_what_is_known_to_be_equivalent(
    capsys: pytest.CaptureFixture[str],
) -> None:
    sites = python_code.sites(MODULE)[1:4]
    sample = [
        Mutant(number, "toy", "toy.py", site, MODULE.splitlines()[site.line - 1].strip())
        for number, site in enumerate(sites)
    ]
    trials: dict[int, dict[str, Any]] = {
        0: {"killed_by": None, "tried": 1, "reaching": 1},
        1: {"killed_by": "test_toy.py::test_listed", "tried": 1, "reaching": 1},
        2: {"killed_by": None, "tried": 2, "reaching": 5},
    }
    known = {("toy.py", "if a < b:", "< to <="): "equal numbers are one"}
    assert not run.report("toy", sample, trials, known, 4)
    assert capsys.readouterr().out == (
        "\ntoy: 3 mutants, 1 killed, 1 equivalent, 1 survive; 50.0% of those that a test can tell "
        "(1.3% to 98.7%); 4 did not compile\n"
        "  survives 2 of 5 tests: toy.py:9: > to >=: while n > 0:\n"
        "  equivalent, equal numbers are one: toy.py:4: < to <=: if a < b:\n"
    )
    trials[0]["killed_by"] = "test_toy.py::test_least"
    assert run.report("toy", sample, trials, known, 0)
    assert "  equivalent.toml is wrong, test_toy.py::test_least fails: " in capsys.readouterr().out
