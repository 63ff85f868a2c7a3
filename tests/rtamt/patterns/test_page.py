"""The page on patterns shows the catalogue."""

import pytest
from paths import ROOT

from rtamt.patterns import CATALOGUE, Pattern

PAGE = (ROOT / "docs" / "patterns.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("pattern", CATALOGUE, ids=lambda pattern: pattern.name)
def test_the_page_has_the_row_of_a_pattern(pattern: Pattern) -> None:
    said = f"**{pattern.name}** {pattern.wanted}"
    assert f"| {said} | `{pattern.written}` | `{pattern.formula}` |" in PAGE
