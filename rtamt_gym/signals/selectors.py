"""The grammar of text selectors: ``obs[2]``, ``info['speed']``, ``body:torso.xpos[2]``.

A selector is a source, then names, a field and indices as the source has them::

    source  [":" name ["," name]]  ["." field]  {"[" (integer | string) "]"}

A name is text without blanks, quotes and ``. , : [ ]``, or any text in quotes:
``body:'arm.left'.xpos[2]``. Nothing is ever evaluated as Python.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NoReturn

from rtamt import InputError

__all__ = ["MUJOCO", "NAMED", "STEP", "VEHICLE", "Selector", "hint", "parse_selector"]

STEP: Final = ("obs", "action", "reward", "info")
"""Sources that `reset` and `step` of an environment give, in the order in which they give them."""

NAMED: Final = {
    "body": "body:torso.xpos[2]",
    "joint": "joint:hip.qpos",
    "geom": "geom:foot.xpos[2]",
    "site": "site:grip.xpos[2]",
    "camera": "camera:eye.xpos[2]",
    "light": "light:sun.xpos[2]",
    "tendon": "tendon:cord.length",
    "actuator": "actuator:motor.force",
    "sensor": "sensor:imu[0]",
    "contact": "contact:foot,floor",
}
"""Sources of a MuJoCo simulation that are read by name, with an example each."""

MUJOCO: Final = ("time", "qpos", "qvel", "qacc", "act", "ctrl", "sensordata", *NAMED)
"""Sources that a MuJoCo simulation gives: its state, and what is read by name."""

VEHICLE: Final = ("vehicle",)
"""Sources that a simulation of highway-env gives."""

_BARE: Final = frozenset({"sensor", "contact"})
"""Named sources that need no field."""


@dataclass(frozen=True, slots=True)
class Selector:
    """A parsed selector.

    Attributes:
        source: The word that it begins with.
        names: The names behind the colon.
        field: The word behind the dot, or an empty string.
        path: The indices and keys in brackets.
    """

    source: str
    names: tuple[str, ...] = ()
    field: str = ""
    path: tuple[int | str, ...] = ()

    def __str__(self) -> str:
        return self.whole + "".join(f"[{part!r}]" for part in self.path)

    @property
    def whole(self) -> str:
        """The selector without its indices."""
        names = ",".join(map(_written, self.names))
        return self.source + f":{names}" * bool(names) + f".{self.field}" * bool(self.field)


def parse_selector(name: str, text: str, sources: Sequence[str]) -> Selector:
    """The selector that a text is.

    Args:
        name: Name of the signal, for messages.
        text: The text.
        sources: The words that it may begin with.

    Raises:
        InputError: With the column, what was expected there, and a caret.
    """
    scan = _Scanner(name, text, sources)
    source = scan.peek()
    if source not in sources:
        scan.refuse(f"one of {', '.join(sources)}")
    scan.next()
    names = _names(scan, source) if source in NAMED else ()
    field = _field(scan, source)
    path: list[int | str] = []
    if source == "reward" and scan.peek():
        scan.refuse("the end of the selector")
    while scan.peek():
        scan.expect("[", "'[' or the end of the selector")
        if source == "info" and not path and scan.peek()[:1] not in {"'", '"'}:
            scan.refuse("a key in quotes, info['key']")
        path.append(scan.key())
        scan.expect("]", "']'")
    if source == "info" and not path:
        scan.refuse("a key in quotes, info['key']")
    return Selector(source, names, field, tuple(path))


def hint(sources: Sequence[str]) -> str:
    """Selectors of some sources, to choose from."""
    examples = [example for source, example in _EXAMPLES.items() if source in sources]
    return f"{', '.join(examples[:-1])} or {examples[-1]}"


_EXAMPLES: Final = {
    "obs": "obs[2], obs['key'][0]",
    "action": "action[0]",
    "reward": "reward",
    "info": "info['key']",
    "qpos": "qpos[0]",
    "sensor": NAMED["sensor"],
    "body": NAMED["body"],
    "vehicle": "vehicle.speed",
}


def _names(scan: _Scanner, source: str) -> tuple[str, ...]:
    scan.expect(":", f"':' and a name, {NAMED[source]}")
    first = scan.name()
    if source != "contact" or scan.peek() != ",":
        return (first,)
    scan.next()
    return first, scan.name()


def _field(scan: _Scanner, source: str) -> str:
    if source in NAMED or source in VEHICLE:
        if scan.peek() == ".":
            scan.next()
            return scan.word()
        if source not in _BARE:
            scan.refuse(f"'.' and a field, {NAMED.get(source, 'vehicle.speed')}")
    return ""


_TOKEN: Final = re.compile(r"\s*([A-Za-z_]\w*|[+-]?\d+|'[^']*'|\"[^\"]*\"|.|$)")
_NAME: Final = re.compile(r"\s*([^\s.,:\[\]'\"]+|'[^']*'|\"[^\"]*\"|.|$)")


class _Scanner:
    """Reads a text token by token; an empty token is its end."""

    def __init__(self, signal: str, text: str, sources: Sequence[str]) -> None:
        self._signal = signal
        self._text = text
        self._sources = sources
        self._at = 0

    def peek(self, kind: re.Pattern[str] = _TOKEN) -> str:
        match = kind.match(self._text.rstrip(), self._at)
        return match[1] if match else ""

    def next(self, kind: re.Pattern[str] = _TOKEN) -> str:
        match = kind.match(self._text.rstrip(), self._at)
        if match is None:
            return ""
        self._at = match.end()
        return match[1]

    def expect(self, token: str, expected: str) -> None:
        if self.peek() != token:
            self.refuse(expected)
        self.next()

    def key(self) -> int | str:
        token = self.peek()
        if token[-1:].isdigit() and not token.isidentifier():
            return int(self.next())
        if len(token) < 2 or token[0] not in "'\"":
            self.refuse("an index or a key in quotes")
        return self.next()[1:-1]

    def word(self) -> str:
        if not self.peek().isidentifier():
            self.refuse("the name of a field")
        return self.next()

    def name(self) -> str:
        token = self.peek(_NAME)
        quoted = len(token) > 1 and token[0] in "'\""
        if token[1:-1] == "" if quoted else token in {"", *".,:[]'\""}:
            self.refuse("a name")
        self.next(_NAME)
        return token[1:-1] if quoted else token

    def refuse(self, expected: str) -> NoReturn:
        token = self.peek()
        column = len(self._text.rstrip()) - len(self._text.rstrip()[self._at :].lstrip())
        got = repr(token) if token else "the end of the selector"
        raise InputError(
            f"signal {self._signal!r}, column {column + 1}: expected {expected}, got {got}\n"
            f"  {self._text}\n"
            f"  {' ' * column}^\n"
            f"  hint: write {hint(self._sources)}"
        )


def _written(name: str) -> str:
    if (match := _NAME.fullmatch(name)) and match[1] == name and name not in {*".,:[]'\""}:
        return name
    return f'"{name}"' if "'" in name else f"'{name}'"
