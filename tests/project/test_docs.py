"""The pages in docs: their code and commands produce the output shown, and their links work."""

import ast
import doctest
import re
import tomllib
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import get_args

import command_options
import pytest
from pages import blocks, broken_links, check_session
from paths import ROOT
from rtamt_envs import SCENARIOS

import rtamt
import rtamt_gym
from rtamt.language.operators import OPERATORS
from rtamt.typing import End, SemanticsName
from rtamt_gym.commands import COMMANDS
from rtamt_gym.recorded.readers import FORMATS
from rtamt_gym.results.statistics import STATISTICS
from rtamt_gym.search.falsification.optimizers import OPTIMIZERS
from rtamt_gym.search.sweeps.samplers import Sampler
from rtamt_gym.shaping import Mode

DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
RUN_HERE = [page for page in PAGES if page.parent.name != "tutorials"]
"""`test_tutorials.py` runs the tutorials, each in a folder."""
LONG = {"evaluation", "falsification", "sweeps"}
"""Pages whose examples take seconds: the quick suite runs the first."""
SESSIONS = [
    pytest.param(session, marks=[pytest.mark.slow] if at else [])  # the quick suite runs the first
    for page in RUN_HERE
    for at, session in enumerate(blocks(page.read_text(encoding="utf-8"), "console"))
]


@pytest.mark.parametrize("name", sorted(LONG))
def test_the_first_example_of_a_long_page(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    text = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    test = doctest.DocTestParser().get_doctest(text, {}, name, name, 0)
    shown = next(at for at, example in enumerate(test.examples) if example.want)
    test.examples = test.examples[: shown + 1]
    assert doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test).failed == 0


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.slow] if page.stem in LONG else [])
        for page in RUN_HERE
    ],
    ids=lambda page: page.stem,
)
def test_the_python_of_a_page_shows_what_it_says(
    page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    failures, examples = doctest.testfile(
        str(page), module_relative=False, optionflags=doctest.ELLIPSIS, encoding="utf-8"
    )
    assert (failures, examples > 0) == (0, ">>>" in page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_links_of_a_page_lead_somewhere(page: Path) -> None:
    assert broken_links(page) == []


@pytest.mark.parametrize("session", SESSIONS)
def test_the_commands_of_a_page_print_what_it_shows(
    session: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    check_session(session, capsys)


def test_the_page_on_files_shows_the_example_as_it_is() -> None:
    page = (ROOT / "docs" / "specifications.md").read_text(encoding="utf-8")
    example = (ROOT / "examples" / "teleoperation.stl").read_text(encoding="utf-8")
    assert f"```\n{example}```" in page


def test_every_page_stands_in_one_list_of_the_site() -> None:
    listed: list[Path] = []
    for page in PAGES:
        for toctree in re.findall(
            r"^```{toctree}\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL
        ):
            names = [line for line in toctree.splitlines() if not line.startswith(":")]
            files = [page.parent / f"{name}.md" for name in names]
            listed += [file if file.exists() else file.with_suffix(".ipynb") for file in files]
    wanted = [page for page in PAGES if page.stem != "index"]
    wanted += DOCS.rglob("*.ipynb")
    named = {page.relative_to(DOCS).as_posix(): listed.count(page) for page in wanted}
    assert {name for name, times in named.items() if not times} == set(), (
        "add them to docs/index.md"
    )
    assert {name: times for name, times in named.items() if times > 1} == {}, "they stand twice"
    assert set(listed) == set(wanted), "a list names a page that is not there"


ROOMS = {
    "rtamt": ("checking", "dense", "language", "monitors", "mutation", "typing"),
    "rtamt_gym": ("live", "mujoco", "results", "wrappers"),
}
"""Packages inside a package whose public names are in the reference too."""


def _reference(package: str) -> str:
    """Return the part of the reference about a package."""
    page = (DOCS / "reference" / "python.md").read_text(encoding="utf-8")
    parts = re.split(r"^## (rtamt\w*)$", page, flags=re.MULTILINE)
    assert parts.count(package) == 1
    return parts[parts.index(package) + 1]


@pytest.mark.parametrize("module", [rtamt, rtamt_gym], ids=lambda module: module.__name__)
def test_the_reference_has_every_public_name_once(module: object) -> None:
    name = getattr(module, "__name__", "")
    said = re.findall(r"^\.\. (?:auto|py:)\w+:: (\S+)$", _reference(name), re.MULTILINE)
    dotted = re.findall(r"^\.\. auto\w+:: (\S+\.\S+)$", _reference(name), re.MULTILINE)
    assert [each for each in dotted if not each.startswith(f"{name}.")] == [], "use full names"
    shown = [each.removeprefix(f"{name}.") for each in said]
    assert {each for each in shown if shown.count(each) > 1} == set()
    wanted = set(getattr(module, "__all__", ()))
    wanted |= {
        f"{room}.{each}" for room in ROOMS[name] for each in import_module(f"{name}.{room}").__all__
    }
    assert wanted - set(shown) == set(), f"add them to {name} in docs/reference/python.md"
    assert set(shown) - wanted <= {"success", "testing"}  # modules that are imported by name


def test_the_reference_has_every_public_name_of_the_libraries_of_arrays_once() -> None:
    shown: set[tuple[str, str]] = set()
    for part in _reference("rtamt_arrays").split(".. currentmodule:: ")[1:]:
        module = part.split()[0]
        names = [
            (module, name) for name in re.findall(r"^\.\. auto\w+:: (\S+)$", part, re.MULTILINE)
        ]
        assert not shown.intersection(names)
        shown |= {*names}
    wanted = {
        (f"rtamt_arrays.{library}", name)
        for library in ("jax", "torch")
        for name in _exported(ROOT / "rtamt_arrays" / library / "__init__.py")
    }
    assert shown <= wanted
    both = {
        name
        for _, name in wanted
        if {("rtamt_arrays.jax", name), ("rtamt_arrays.torch", name)} <= wanted
    }
    assert {name for _, name in wanted - shown} <= both & {name for _, name in shown}


def _exported(path: Path) -> list[str]:
    """Return the names in ``__all__`` of a module, without importing its library."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.Assign(targets=[ast.Name(id="__all__")], value=value):
                names: list[str] = ast.literal_eval(value)
                return names
    raise AssertionError(path)


def test_the_page_of_options_is_what_the_parsers_have() -> None:
    written = command_options.PAGE.read_text(encoding="utf-8")
    assert written == command_options.page(), "run python tests/support/command_options.py"


def test_the_page_of_what_is_tested_names_every_group() -> None:
    said = set(re.findall(r"`(\w+)`", (DOCS / "tested.md").read_text(encoding="utf-8")))
    groups = {path.stem for path in (ROOT / "tests").glob("*/*.txt")}
    assert len(groups) > 10
    assert groups - said == set()


def test_the_page_of_installation_has_every_extra() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = set(settings["project"]["optional-dependencies"]) - {"pytest"}  # only our own
    page = (DOCS / "installation.md").read_text(encoding="utf-8")
    assert extras - set(re.findall(r"`([a-z]+)`", page)) == set()
    asked = re.findall(r"\.\[([a-z,]+)\]", "".join(each.read_text("utf-8") for each in PAGES))
    assert {extra for each in asked for extra in each.split(",")} <= extras


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("commands", [f"rtamt {command}" for command in COMMANDS]),
        ("ends", get_args(End)),
        ("falsification", OPTIMIZERS),
        ("gymnasium", get_args(Mode)),
        ("language", [row.symbol for row in OPERATORS.values() if row.notation == "call"]),
        ("language", get_args(SemanticsName)),
        ("learning", get_args(Mode)),
        ("results", [statistic.key for statistic in STATISTICS]),
        ("simulations", [f"rtamt/{scenario}-v0" for scenario in SCENARIOS]),
        ("sweeps", get_args(Sampler)),
        ("traces", [extension for row in FORMATS for extension in row.extensions]),
    ],
)
def test_page_lists_every_name(page: str, names: Iterable[str]) -> None:
    """A new row of a table in the code is also in a table of the page."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    cells = re.findall(r"`([^`]+)`", "\n".join(re.findall(r"^\|.*\|$", text, re.MULTILINE)))
    missing = [
        name
        for name in names
        if not any(re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", cell) for cell in cells)
    ]
    assert missing == []
