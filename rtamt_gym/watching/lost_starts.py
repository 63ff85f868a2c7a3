"""Groups of a stream without a known start, because their first rows were bad lines."""

from __future__ import annotations

from rtamt.errors import shown
from rtamt_gym.tables import counted
from rtamt_gym.watching.rows import RowFault


class LostStarts:
    """Bad lines that came before the first good row of their group.

    Args:
        most: The maximum number of groups that are stored by name.

    Example:
        >>> lost = LostStarts(most=10)
        >>> lost.add(None, "stdin, line 4: expected 3 cells, got 2")
        >>> lost.count_start("b")
        >>> lost.notes()[0][:66]
        '1 group starts after a bad line that may have been its first row, '
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._bad: dict[str, str] = {}
        self._unknown = self._first = ""
        self._doubtful = 0

    def add(self, group: str | None, message: str) -> None:
        """Note a bad line of a group that has not started; None if its group is not known."""
        if group is not None and len(self._bad) < self._most:
            self._bad.setdefault(group, message)
        else:
            self._unknown = self._unknown or message

    def check_start(self, group: str, row: int) -> None:
        """Check that a group starts with its first row.

        Args:
            group: The group of a first good row.
            row: The place of that row in its block.

        Raises:
            RowFault: If a row of the group before it was bad.
        """
        if message := self._bad.get(group):
            raise RowFault(
                row,
                f"group {shown(group)!r} starts with a bad line, {message} (--skip-bad needs a "
                "good first row of each group)",
                skippable=False,
            )

    def count_start(self, group: str) -> None:
        """Note that a group has started; a bad line may have been its first row."""
        if self._unknown:
            self._doubtful += 1
            self._first = self._first or f"{shown(group)!r} after {self._unknown}"

    def failures(self, source: str) -> list[str]:
        """Return a sentence on groups without a good row at the end; an empty list without any.

        Args:
            source: The name of the stream, for messages.
        """
        if not self._bad:
            return []
        (name, message), more = next(iter(self._bad.items())), len(self._bad) - 1
        others = f" (and {counted(more, 'more group')})" if more else ""
        group = f"group {shown(name)!r} has bad lines only, the first: {message}{others}"
        return [f"{source}: {group}. Correct the line, or remove the group."]

    def notes(self) -> list[str]:
        """Return a sentence on groups that may lack their first row; an empty list without any."""
        if not self._doubtful:
            return []
        groups = counted(self._doubtful, "group")
        verb, pronoun = ("starts", "its") if self._doubtful == 1 else ("start", "their")
        lost = f"a bad line that may have been {pronoun} first row"
        return [f"{groups} {verb} after {lost}, the first: {self._first}"]
