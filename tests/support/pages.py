"""Pages of documentation: their blocks of code, their links, and what their commands print."""

import re
import shlex
from pathlib import Path

import pytest

from rtamt_gym.__main__ import main


def blocks(text: str, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def broken_links(page: Path) -> list[str]:
    """Links to files that are not there."""
    prose = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    links = re.findall(r"\]\(([^)#:]+)\)", prose)
    return [link for link in links if not (page.parent / link).is_file()]


def check_session(session: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Run the command of a block ``$ rtamt ...``; it prints what stands below it."""
    prompt, _, shown = session.partition("\n")
    dollar, program, *arguments = shlex.split(prompt)
    assert (dollar, program) == ("$", "rtamt")
    main(arguments)
    assert capsys.readouterr() == (shown, "")
