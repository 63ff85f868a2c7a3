"""Tests that `.ci/run` runs in environments of their own, which the suite omits."""

import tomllib

import pytest
from hypothesis import settings
from paths import ROOT

FOLDERS = (
    *("arrays", "benchmarks", "browser", "cluster", "learners", "live", "optimizers", "ros"),
    "site",
)


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_test_of_a_folder_belongs_to_one_group(folder: str) -> None:
    groups = {path.stem for path in (ROOT / "tests" / folder).glob("*.txt")}
    tests = (ROOT / "tests" / folder).glob("test_*.py")
    names = [path.stem.removeprefix("test_") for path in tests]
    assert [sum(name.startswith(group) for group in groups) for name in names] == [1] * len(names)
    assert groups
    assert all(any(name.startswith(group) for name in names) for group in groups)


def test_the_suite_leaves_the_groups_out_and_ci_runs_them() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    left_out = settings["tool"]["pytest"]["ini_options"]["norecursedirs"]
    assert {f"tests/{folder}" for folder in FOLDERS} <= set(left_out)
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert [folder for folder in FOLDERS if f"groups tests/{folder} " not in ci] == []


def test_a_night_draws_more_examples_and_others_each_time() -> None:
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "--hypothesis-profile=nightly --hypothesis-seed=" in ci
    night, each = settings.get_profile("nightly"), settings.get_profile("repeatable")
    assert (night.derandomize, each.derandomize) == (False, True)
    assert night.max_examples >= 10 * each.max_examples
    assert night.deadline is None


def test_sanitizers_see_every_property_on_fewer_examples() -> None:
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "--hypothesis-profile=sanitized" in ci
    fewer = settings.get_profile("sanitized")
    assert fewer.derandomize
    assert 10 <= fewer.max_examples < settings.get_profile("repeatable").max_examples
