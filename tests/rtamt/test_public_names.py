"""Public names are imported at their first use."""

import ast
import pickle
import sys
from importlib import import_module
from types import FunctionType

import pytest
from paths import ROOT

import rtamt

IMPORTED = {*rtamt.__all__} - {"__version__"}


def test_modules_match_type_checker_imports() -> None:
    tree = ast.parse((ROOT / "rtamt" / "__init__.py").read_text(encoding="utf-8"))
    block = next(
        node for node in tree.body if isinstance(node, ast.If) and "TYPE_CH" in ast.unparse(node)
    )
    modules = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.name != "*" and alias.asname is None
    }
    assert {name: module for name, module in modules.items() if module != "rtamt"} == rtamt._MODULES
    assert {*modules} == IMPORTED


def test_names_are_listed_before_they_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in IMPORTED:
        monkeypatch.delitem(rtamt.__dict__, name, raising=False)
    assert {*dir(rtamt)} >= {"__getattr__", *rtamt.__all__}


def test_star_import_binds_every_name() -> None:
    namespace: dict[str, object] = {}
    exec("from rtamt import *", namespace)  # noqa: S102 - functions cannot use the statement
    assert {*rtamt.__all__} <= {*namespace}


def test_public_classes_and_functions_can_be_pickled() -> None:
    for name in sorted(IMPORTED):
        value = getattr(rtamt, name)
        if isinstance(value, (type, FunctionType)) and value.__module__.startswith("rtamt."):
            assert pickle.loads(pickle.dumps(value)) is value


def test_unknown_name_error() -> None:
    with pytest.raises(AttributeError, match=r"^module 'rtamt' has no attribute 'Monitr'$"):
        _ = rtamt.Monitr  # type: ignore[attr-defined]


def test_submodules_are_attributes() -> None:
    assert rtamt.limits is sys.modules["rtamt.limits"]
    assert rtamt.patterns is import_module("rtamt.patterns")
