"""The page on psy-taliro shows what happens."""

import doctest

import pytest
from paths import ROOT


def test_the_python_of_the_page_shows_what_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    page = str(ROOT / "docs" / "taliro.md")
    failures, examples = doctest.testfile(page, module_relative=False, encoding="utf-8")
    assert failures == 0
    assert examples > 10
