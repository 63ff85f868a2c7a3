"""Pages of documentation: their code blocks, their links, and the output of their commands."""

import re
import shlex
from pathlib import Path

import pytest

from rtamt_gym.__main__ import main


def blocks(text: str, language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def broken_links(page: Path) -> list[str]:
    """Return links to missing files or headings."""
    prose = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    links = re.findall(r"\]\(([^)#:]*)(?:#([^):]+))?\)", prose)
    return [
        f"{file}#{anchor}" if anchor else file
        for file, anchor in links
        if not _leads_somewhere(page.parent / file if file else page, anchor)
    ]


def _leads_somewhere(target: Path, anchor: str) -> bool:
    if not target.is_file() or not anchor or target.suffix != ".md":
        return target.is_file()
    return anchor in _anchors(target.read_text(encoding="utf-8"), target.parent)


def _anchors(text: str, folder: Path) -> set[str]:
    """Return the anchors of the headings of a page and of the files that it includes."""
    included = re.findall(r"^```{include} (\S+)$", text, re.MULTILINE)
    found = {
        anchor
        for name in included
        for anchor in _anchors((folder / name).read_text(encoding="utf-8"), folder)
    }
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    for heading in re.findall(r"^#{1,4} (.+)$", prose, re.MULTILINE):
        plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
        found.add(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    return found


def check_session(session: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Run the command of a block ``$ rtamt ...``, and compare its output with the block."""
    prompt, _, shown = session.partition("\n")
    dollar, program, *arguments = shlex.split(prompt)
    assert (dollar, program) == ("$", "rtamt")
    main(arguments)
    assert capsys.readouterr() == (shown, "")
