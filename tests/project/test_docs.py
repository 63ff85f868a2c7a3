"""The pages in docs are true: their Python runs and shows what they say, their links lead on."""

import doctest
import re
from pathlib import Path

import pytest
from paths import ROOT

PAGES = sorted((ROOT / "docs").glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
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
    prose = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    links = re.findall(r"\]\(([^)#:]+)\)", prose)
    assert [link for link in links if not (page.parent / link).is_file()] == []


def test_the_page_on_files_shows_the_example_as_it_is() -> None:
    page = (ROOT / "docs" / "specifications.md").read_text(encoding="utf-8")
    example = (ROOT / "examples" / "teleoperation.stl").read_text(encoding="utf-8")
    assert f"```\n{example}```" in page
