"""The section on psy-taliro shows programs that work."""

from typing import Any

import pytest
from pages import blocks
from paths import ROOT


def test_the_programs_of_the_section_on_psy_taliro(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    page = (ROOT / "docs" / "falsification.md").read_text(encoding="utf-8")
    optimized, searched = blocks(page.split("\n## psy-taliro\n")[1], "python")
    names: dict[str, Any] = {}
    exec(optimized, names)  # noqa: S102 - the programs of our page
    assert names["last"].cost < 0
    assert list(names["last"].extra.model) == ["height", "limit"]
    exec(searched, names)  # noqa: S102 - the programs of our page
    assert names["found"].falsified
    assert list(names["found"].input) == ["gap", "speed"]
