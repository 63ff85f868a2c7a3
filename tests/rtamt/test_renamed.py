"""Old names: each warns and equals its new name."""

import re
import warnings
from importlib import import_module

import pytest
from paths import ROOT

import rtamt
from rtamt import compat, mutants
from rtamt.renamed import (
    ATTRIBUTES,
    FUNCTIONS,
    KEYWORDS,
    NAMES,
    OPTIONS,
    TARGETS,
    new_options,
    object_named,
)

NAME_ROWS = [
    pytest.param(package, old, new, id=f"{package}.{old}")
    for package, names in NAMES.items()
    for old, new in names.items()
]
ATTRIBUTE_ROWS = [
    pytest.param(path, old, new, id=f"{path}.{old}")
    for path, names in ATTRIBUTES.items()
    for old, new in names.items()
]


@pytest.mark.parametrize(("package", "old", "new"), NAME_ROWS)
def test_old_name(package: str, old: str, new: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"^{package}.{old} is now {new}") as caught:
        value = getattr(import_module(package), old)
    assert value is object_named(TARGETS.get(new, new))
    assert caught[0].filename == __file__
    assert old not in dir(import_module(package))


@pytest.mark.parametrize("path", FUNCTIONS)
def test_function_became_method(path: str) -> None:
    assert callable(getattr(rtamt.Specification, path.rpartition(".")[2]))


@pytest.mark.parametrize(("path", "old", "new"), ATTRIBUTE_ROWS)
def test_old_attribute(path: str, old: str, new: str) -> None:
    kind: type = object_named(path)  # type: ignore[assignment]  # the tables list classes
    thing: object = kind
    if not hasattr(kind, new):  # an attribute of instances
        thing = object.__new__(kind)
        object.__setattr__(thing, new, object())
    with pytest.warns(DeprecationWarning, match=rf"\.{old} is now \w+\.{new}\. ") as caught:
        value = getattr(thing, old)
    assert value == getattr(thing, new)
    assert caught[0].filename == __file__


def test_old_keyword() -> None:
    assert KEYWORDS == {"init": {"lanes": "batch_size"}, "mutants": {"most": "limit"}}
    with pytest.warns(DeprecationWarning, match=r"^mutants\(most=\) is now mutants\(limit=\)"):
        few = mutants("always(x > 1)", most=2)  # type: ignore[call-arg]
    assert few == mutants("always(x > 1)", limit=2)
    assert len(few) == 2


@pytest.mark.parametrize(("old", "new"), OPTIONS.items())
def test_old_option(old: str, new: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"^{old} is now {new}"):
        assert new_options(["monitor", old, "x"]) == ["monitor", new, "x"]
    with pytest.warns(DeprecationWarning, match=f"^{old} is now {new}"):
        assert new_options([f"{old}=1=2", "--", old]) == [f"{new}=1=2", "--", old]
    assert new_options([new, f"{old}er", old[2:]]) == [new, f"{old}er", old[2:]]


def test_page_lists_every_row() -> None:
    page = (ROOT / "docs" / "changes.md").read_text(encoding="utf-8").partition("## Renamed")[2]
    rows = dict(re.findall(r"^\| `(.+?)` \| `(.+?)` \|$", page, re.MULTILINE))
    for module, names in re.findall(r"^- `(\S+)`: ((?:`\w+`,?\s+)+)", page, re.MULTILINE):
        for name in re.findall(r"\w+", names):
            rows[f"{module.partition('.')[0]}.{name}"] = f"{module}.{name}"
    expected = {
        f"{package}.{old}": new + "()" * (new in FUNCTIONS)
        for package, names in NAMES.items()
        for old, new in names.items()
    }
    for tables, form in ((ATTRIBUTES, "{}.{}"), (KEYWORDS, "{}({}=)")):
        for owner, names in tables.items():
            expected |= {form.format(owner, a): form.format(owner, b) for a, b in names.items()}
    assert rows == expected | dict(OPTIONS)


@pytest.mark.parametrize("name", compat.__all__)
def test_names_of_the_released_library_never_warn(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert getattr(rtamt, name) is getattr(compat, name)


def test_evaluate_many_takes_traces_of_one_sample() -> None:
    with pytest.warns(DeprecationWarning, match=r"rtamt\.evaluate_many is now rtamt\.evaluate"):
        function = rtamt.evaluate_many
    assert function("x > 0", {"x": [[1.0], [2.0]]}).tolist() == [[1.0], [2.0]]
