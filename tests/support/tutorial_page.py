"""The commands and the transcripts of the tutorial, as they stand in docs/tutorials/robot.md."""

from __future__ import annotations

import re

from paths import ROOT

__all__ = ["PAGE", "block"]

PAGE = (ROOT / "docs" / "tutorials" / "robot.md").read_text(encoding="utf-8")


def block(command: str) -> list[str]:
    """The lines of the block that begins with a command."""
    found = re.search(rf"```\w*\n((?:\$ )?{command}.*?)```", PAGE, re.DOTALL)
    assert found is not None, command
    return found[1].splitlines()
