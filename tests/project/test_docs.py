"""The pages in docs: their Python and commands give what they show, their links lead somewhere."""

import doctest
from pathlib import Path

import pytest
from pages import blocks, broken_links, check_session
from paths import ROOT

PAGES = sorted((ROOT / "docs").glob("*.md"))
SESSIONS = [
    session for page in PAGES for session in blocks(page.read_text(encoding="utf-8"), "console")
]


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
