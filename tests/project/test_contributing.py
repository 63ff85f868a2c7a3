"""The table of CONTRIBUTING and the recipes in docstrings that it lists; paths in `.ci/run`."""

import ast
import re
import subprocess
from pathlib import Path

import pytest
from paths import ROOT

FOLDERS = (
    "rtamt",
    "rtamt_gym",
    "rtamt_arrays",
    "rtamt_ros",
    "envs",
    "ros",
    "examples",
    "tests/support",
)
RECIPE = re.compile(r"^To (add|change) ", re.MULTILINE)
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
LISTED = re.findall(r"^\| [^|`]+ \| `([^`]+\.py)` \|$", PAGE, re.MULTILINE)


def has_recipe(path: Path) -> bool:
    """Return whether a line of the module docstring starts with 'To add' or 'To change'."""
    text = path.read_text(encoding="utf-8")
    return bool(RECIPE.search(text) and RECIPE.search(ast.get_docstring(ast.parse(text)) or ""))


@pytest.mark.parametrize("name", LISTED)
def test_listed_file_explains_additions(name: str) -> None:
    assert has_recipe(ROOT / name), f"add a line 'To add ...' to the docstring of {name}"


def test_every_recipe_is_listed_once() -> None:
    paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    recipes = [path.relative_to(ROOT).as_posix() for path in paths if has_recipe(path)]
    assert len(recipes) > 50
    assert sorted(LISTED) == sorted(recipes)


def test_every_push_runs_ci() -> None:
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    assert "\n  push:\n" in workflow
    assert "run: bash .ci/run " in workflow


def test_contributing_is_short() -> None:
    assert len(PAGE.splitlines()) <= 200


def test_paths_in_ci_exist() -> None:
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    code = "\n".join(line for line in script.splitlines() if not line.startswith("#"))
    words = re.findall(r"(?<![\w/.$}#])tests/[\w/.{},]+", code)
    assert len(words) > 10
    shown = subprocess.run(  # the shell expands the braces
        ["/usr/bin/env", "bash", "-c", f"printf '%s\\n' {' '.join(words)}"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert [path for path in shown if not (ROOT / path).exists()] == []
