"""The exact commands and transcripts of docs/tutorials/robot.md."""

from __future__ import annotations

import re

from paths import ROOT

__all__ = ["PAGE", "block"]

PAGE = (ROOT / "docs" / "tutorials" / "robot.md").read_text(encoding="utf-8")


def block(command: str) -> list[str]:
    """Return the lines of the block that starts with a command."""
    found = re.search(rf"```\w*\n((?:\$ )?{command}.*?)```", PAGE, re.DOTALL)
    assert found is not None, command
    return found[1].splitlines()
