"""Imports go in one direction, and upper packages use only public names."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from paths import ROOT
from rtamt_envs import SCENARIOS

import rtamt

# From the bottom up: a room imports only from lower floors. A room is a folder, or a separate file.
FLOORS = {
    "rtamt": (
        ("errors", "limits", "columns", "lazy", "renamed"),
        ("language",),
        ("program", "patterns"),
        ("inputs",),
        ("machines",),
        ("monitors",),
        ("export", "checking", "mutation", "dense", "internal", "typing"),
        ("__init__",),
        ("compat",),
    ),
    "rtamt_gym": (
        ("checks", "starters"),
        ("options",),
        ("shaping", "success", "tables", "drawing", "markup", "inputs"),
        ("signals", "results", "live"),
        ("judging", "benchmarks"),
        ("wrappers", "mujoco"),
        ("systems", "recorded"),
        ("play",),
        ("search",),
        ("evaluation",),
        ("reports", "learners", "datasets", "watching"),
        ("demo", "testing"),
        ("commands",),
        ("__init__", "__main__"),
    ),
    "rtamt_ros": (
        ("middleware",),
        ("core", "messages", "packed", "callbacks", "process"),
        ("node", "parameters"),
        ("ros2_subscription",),
        ("ros1", "ros2"),
        ("ros2_lifecycle", "generation"),
        ("simulator", "screen"),
        ("command",),
        ("__init__", "__main__"),
    ),
    "rtamt_arrays": (
        ("operations",),
        ("functions",),
        ("inputs", "layout"),
        ("continuations",),
        ("offline", "online", "episode"),
        ("monitor_set", "selectors"),
        ("judging",),
        ("jax", "torch"),
        ("__init__",),
    ),
    "rtamt_envs": (
        ("compiled", "scenario"),
        ("pictures", "scenario_batch"),
        tuple(module for module, _ in SCENARIOS.values()),
        ("environment",),
        ("vector",),
        ("__init__",),
    ),
    "rtamt_gym.search": (
        ("sweeps",),
        ("falsification", "mining"),
        ("__init__",),
    ),
}

# The packages, from the bottom up.
HOUSE = ("rtamt", "rtamt_gym", "rtamt_arrays", "rtamt_envs", "rtamt_ros")

# The modules of public names.
PUBLIC: dict[str, ModuleType] = {
    name: import_module(name)
    for name in (
        "rtamt",
        "rtamt.checking",
        "rtamt.columns",
        "rtamt.dense",
        "rtamt.errors",
        "rtamt.internal",
        "rtamt.language",
        "rtamt.lazy",
        "rtamt.monitors",
        "rtamt.mutation",
        "rtamt.patterns",
        "rtamt.renamed",
        "rtamt.typing",
    )
}

# Not at the import of modules: the released classes are loaded at their first use.
LATE = {
    ("rtamt", "rtamt.compat"),
    ("rtamt.language.formula", "rtamt.language.words"),
    *(
        ("rtamt.language.specification", module)  # methods import their implementation
        for module in (
            "rtamt.export.fmu",
            "rtamt.language.parser",
            "rtamt.language.topics",
            "rtamt.language.words",
        )
    ),
    *(
        ("rtamt_gym.results", module)  # its names are imported at their first use
        for module in (
            "rtamt_gym.evaluation.comparison",
            "rtamt_gym.evaluation.evaluation",
            "rtamt_gym.evaluation.methods",
            "rtamt_gym.mujoco.snapshots",
            "rtamt_gym.search.falsification.falsification",
            "rtamt_gym.search.mining.mining",
            "rtamt_gym.play.record",
            "rtamt_gym.play.saved_case",
            "rtamt_gym.search.sweeps.sweep",
            "rtamt_gym.play.history",
            "rtamt_gym.play.run",
        )
    ),
}

# The machines do not know the language.
TEXT = ("rtamt.language.parser", "rtamt.language.grammar")


def modules(package: str) -> list[Path]:
    """Return the modules of a package that are not generated."""
    paths = _above(package).joinpath(*package.split(".")).rglob("*.py")
    return sorted(path for path in paths if "generated" not in path.parts)


def _above(package: str) -> Path:
    """Return the folder of a package."""
    return ROOT / "envs" if package == "rtamt_envs" else ROOT


def name_of(path: Path) -> str:
    """Return the dotted name of a module."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[1:] if parts[0] == "envs" else parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room(module: str, package: str) -> str:
    """Return the room of a module in its package."""
    return module.removeprefix(package).removeprefix(".").split(".")[0] or "__init__"


@cache
def imported(path: Path) -> list[tuple[str, str | None]]:
    """Return every import in a file: the module, and the name if one is taken from it."""
    return list(_imported(path))


def _imported(path: Path) -> Iterator[tuple[str, str | None]]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: write the whole name of the module"
            yield from ((node.module or "", alias.name) for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            yield from ((ast.literal_eval(each), None) for each in node.args if _is_text(each))


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def edges(*packages: str) -> set[tuple[str, str]]:
    """Return the imports inside packages, as (importing module, imported module)."""
    paths = [path for package in packages for path in modules(package)]
    known = {name_of(path) for path in paths}
    found = set()
    for path in paths:
        for module, name in imported(path):
            target = f"{module}.{name}" if f"{module}.{name}" in known else module
            if target in known and target != name_of(path):
                found.add((name_of(path), target))
    return found - LATE


@pytest.mark.parametrize("package", FLOORS)
def test_every_module_has_its_floor(package: str) -> None:
    rooms = {name for names in FLOORS[package] for name in names}
    new = {room(name_of(path), package) for path in modules(package)} - rooms
    assert not new, f"say in FLOORS what {new} may import"


@pytest.mark.parametrize("package", FLOORS)
def test_a_room_imports_from_lower_floors_only(package: str) -> None:
    floor = {name: at for at, names in enumerate(FLOORS[package]) for name in names}
    rooms = {(room(above, package), room(below, package)) for above, below in edges(package)}
    assert not {(a, b) for a, b in rooms if a != b and floor[a] <= floor[b]}


@pytest.mark.parametrize("package", FLOORS)
def test_imports_close_no_circle_of_rooms(package: str) -> None:
    order({(room(a, package), room(b, package)) for a, b in edges(package)})


def test_imports_close_no_circle_of_modules_in_the_whole_house() -> None:
    order(edges(*HOUSE))


def test_a_package_imports_from_lower_packages_only() -> None:
    floor = {name: at for at, name in enumerate(HOUSE)}
    packages = {(a.split(".")[0], b.split(".")[0]) for a, b in edges(*HOUSE)}
    assert not {(a, b) for a, b in packages if floor[a] < floor[b]}


def order(arrows: set[tuple[str, str]]) -> None:
    """Raise an error if imports form a circle between rooms."""
    graph: dict[str, set[str]] = {}
    for above, below in arrows:
        if above != below:
            graph.setdefault(above, set()).add(below)
    TopologicalSorter(graph).prepare()


def test_machines_know_no_text() -> None:
    for path in modules("rtamt"):
        if room(name_of(path), "rtamt") in ("program", "inputs", "machines"):
            assert not [m for m, _ in imported(path) if m.startswith(TEXT)], path


def test_nanobind_is_included_in_one_folder_only() -> None:
    native = ROOT / "rtamt" / "native"
    sources = [*native.rglob("*.hpp"), *native.rglob("*.cpp")]
    rooms = {
        path.relative_to(native).parts[0] for path in sources if "nanobind/" in path.read_text()
    }
    assert rooms == {"python"}


def test_rtamt_knows_nothing_of_what_uses_it() -> None:
    above = {"rtamt_gym", "rtamt_arrays", "rtamt_envs", "gymnasium", "mujoco", "matplotlib"}
    for path in modules("rtamt"):
        assert not above & {module.split(".")[0] for module, _ in imported(path)}, path


def test_rtamt_gym_uses_public_names_only() -> None:
    for path in modules("rtamt_gym"):
        for module, name in imported(path):
            if module.split(".")[0] == "rtamt":
                assert module in PUBLIC, path
                assert name is None or name in PUBLIC[module].__all__, path
        used = {
            node.attr
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id == "rtamt"
        }
        assert used <= {*rtamt.__all__, *(name.removeprefix("rtamt.") for name in PUBLIC)}, path


def test_inputs_are_imported_without_simulators() -> None:
    code = "import sys; from rtamt_gym import Case, Parameter, Signal, Space, Waveform\n"
    code += "print(*{m.split('.')[0] for m in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"antlr4", "gymnasium", "mujoco", "matplotlib", "scipy"} & set(done.stdout.split())


@pytest.mark.parametrize(
    ("code", "unused"),
    [
        ("import rtamt", ("numpy", "rtamt.")),
        ("import rtamt_gym.__main__ as m; m.main(['--help'])", ("numpy", "rtamt.machines")),
        (
            "from rtamt import EpisodeMonitor, Monitor, VectorMonitor, judge",
            ("antlr4", "rtamt.checking", "rtamt.mutation", "rtamt.patterns", "rtamt.export"),
        ),
    ],
)
def test_import_loads_only_what_is_used(code: str, unused: tuple[str, ...]) -> None:
    code += "; import sys; print('loaded', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = done.stdout.partition("loaded ")[2].split()
    assert [name for name in loaded if name.startswith(unused)] == []
