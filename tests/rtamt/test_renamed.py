"""Every new public name stands for what the old one stood for."""

from importlib import import_module

import pytest

from rtamt.renamed import FUNCTIONS, NAMES, named

LATER = {"rtamt.UncertainValue", "rtamt.evaluate", "rtamt_gym.EvaluationOptions"}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param(f"{package}.{old}", new, id=f"{package}.{old}")
        for package, names in NAMES.items()
        for old, new in names.items()
        if new not in LATER
    ],
)
def test_new_name_is_the_old_object(old: str, new: str) -> None:
    package, _, name = old.rpartition(".")
    assert named(FUNCTIONS.get(new, new)) is getattr(import_module(package), name)
