"""Imports go one way, and what stands above uses public names only."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import rtamt

ROOT = Path(__file__).parents[1]

# From the bottom up: a package imports from lower floors only.
FLOORS = (
    "errors",
    "language",
    "program",
    "inputs",
    "machines",
    "monitors",
    "__init__",
    "compat",
)
FLOOR = {name: floor for floor, name in enumerate(FLOORS)}

# Not while modules load: the released classes are loaded when first asked for.
LATE = {("__init__", "compat")}

# What runs programs knows no text.
TEXT = ("rtamt.language.parser", "rtamt.language.grammar")


def modules(package: str) -> list[Path]:
    """The modules of a package that are written by hand."""
    paths = (ROOT / package).rglob("*.py")
    return sorted(path for path in paths if "generated" not in path.parts)


def imported(path: Path) -> Iterator[tuple[str, str | None]]:
    """Every import in a file, wherever it stands: module, and name if one is taken from it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: write the whole name of the module"
            yield from ((node.module or "", alias.name) for alias in node.names)


def part(module: str) -> str:
    """The part of rtamt that a module is or belongs to."""
    return module.split(".")[1] if "." in module else "__init__"


def part_of(path: Path) -> str:
    return path.relative_to(ROOT / "rtamt").parts[0].removesuffix(".py")


def edges() -> set[tuple[str, str]]:
    """The imports inside rtamt, as (importing part, imported part)."""
    found = set()
    for path in modules("rtamt"):
        for module, name in imported(path):
            if module == "rtamt" and name in FLOOR:
                module = f"rtamt.{name}"  # noqa: PLW2901
            if module.split(".")[0] == "rtamt" and part(module) != part_of(path):
                found.add((part_of(path), part(module)))
    return found


def test_every_module_has_its_floor() -> None:
    new = {part_of(path) for path in modules("rtamt")} - set(FLOOR)
    assert not new, f"say in FLOORS what {new} may import"


def test_imports_go_down_and_close_no_circle() -> None:
    down = edges() - LATE
    known = {edge for edge in down if set(edge) <= set(FLOOR)}
    wrong = {(above, below) for above, below in known if FLOOR[above] < FLOOR[below]}
    assert not wrong
    graph: dict[str, set[str]] = {}
    for above, below in down:
        graph.setdefault(above, set()).add(below)
    TopologicalSorter(graph).prepare()


def test_machines_know_no_text() -> None:
    texts, monitors = FLOOR["language"], FLOOR["monitors"]
    for path in modules("rtamt"):
        if texts < FLOOR[part_of(path)] < monitors:
            assert not [m for m, _ in imported(path) if m.startswith(TEXT)], path


def test_rtamt_knows_nothing_of_what_uses_it() -> None:
    above = {"rtamt_gym", "rtamt_envs", "gymnasium", "mujoco", "matplotlib"}
    for path in modules("rtamt"):
        assert not above & {module.split(".")[0] for module, _ in imported(path)}, path


@pytest.mark.parametrize("path", modules("rtamt_gym"), ids=lambda path: path.stem)
def test_rtamt_gym_uses_public_names_only(path: Path) -> None:
    for module, name in imported(path):
        assert module.split(".")[0] != "rtamt_envs"
        if module.split(".")[0] == "rtamt":
            assert module == "rtamt"
            assert name is None or name in rtamt.__all__
    used = {
        node.attr
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "rtamt"
    }
    assert used <= set(rtamt.__all__)


def test_import_loads_neither_the_parser_nor_a_simulator() -> None:
    code = "import sys, rtamt; print(*{m.split('.')[0] for m in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"antlr4", "gymnasium", "mujoco", "matplotlib"} & set(done.stdout.split())
