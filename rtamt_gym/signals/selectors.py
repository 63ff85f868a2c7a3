"""The grammar of selectors: ``obs[2]``, ``info['speed']``, ``body:torso.xpos[2]``.

A selector is the word of a source, then names, a field and indices as its `Syntax` allows::

    [agent ":"]  source  [":" name ["," name]]  ["." field]  {"[" (integer | string) "]"}

Only selectors of several agents start with an agent: ``agent_0: obs[2]``. A name is text without
blanks, quotes and ``. , : [ ]``, or any text in quotes: ``body:'arm.left'.xpos[2]``. A selector is
never evaluated as Python.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final, Literal, NoReturn

from rtamt import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class Syntax:
    """How selectors of a source are written.

    Attributes:
        example: A selector, for messages.
        names: The maximum number of names after the colon.
        field: Whether a field follows.
        brackets: ``"any"`` for indices and keys; ``"key"`` if a key comes first.
        common: Whether hints show the example.
    """

    example: str
    names: int = 0
    field: Literal["none", "optional", "required"] = "none"
    brackets: Literal["any", "key"] = "any"
    common: bool = False


@dataclass(frozen=True, slots=True)
class Selector:
    """A parsed selector: a word, names, a field or "", indices and keys, an agent or ""."""

    source: str
    names: tuple[str, ...] = ()
    field: str = ""
    path: tuple[int | str, ...] = ()
    agent: str = ""

    def __str__(self) -> str:
        return self.container + "".join(f"[{part!r}]" for part in self.path)

    @property
    def container(self) -> str:
        """The selector without its indices."""
        names = ",".join(map(_written, self.names))
        agent = f"{_written(self.agent)}: " * bool(self.agent)
        field = f".{self.field}" * bool(self.field)
        return f"{agent}{self.source}" + f":{names}" * bool(names) + field


def parse_selector(
    owner: str, text: str, sources: Mapping[str, Syntax], agents: Collection[str] = ()
) -> Selector:
    """Parse a selector; with agents, it starts with an agent.

    Raises:
        InputError: On a syntax error, with the column, the expected text and a caret.
    """
    scan = _Scanner(owner, text, sources)
    agent = ""
    if agents:
        agent = _unquoted(scan.peek(_NAME))
        if agent not in agents:
            scan.refuse(f"one of the agents {', '.join(map(_written, agents))}, and ':'")
        scan.next(_NAME)
        scan.expect(":", "':' after the agent")
    source = scan.peek()
    if source not in sources:
        scan.refuse(f"one of {', '.join(sources)}")
    scan.next()
    syntax = sources[source]
    names, field, path = scan.names(syntax), "", list[int | str]()
    if syntax.field != "none" and scan.peek() == ".":
        scan.next()
        field = scan.word()
    elif syntax.field == "required":
        scan.refuse(f"'.' and a field, {syntax.example}")
    while scan.peek():
        scan.expect("[", "'[' or the end of the selector")
        if syntax.brackets == "key" and not path and scan.peek()[:1] not in {"'", '"'}:
            scan.refuse(f"a key in quotes, {syntax.example}")
        path.append(scan.key())
        scan.expect("]", "']'")
    if syntax.brackets == "key" and not path:
        scan.refuse(f"a key in quotes, {syntax.example}")
    return Selector(source, names, field, tuple(path), agent)


def hint(sources: Mapping[str, Syntax]) -> str:
    """List common selectors of these sources."""
    *examples, last = [syntax.example for syntax in sources.values() if syntax.common]
    return f"{', '.join(examples)} or {last}"


_TOKEN: Final = re.compile(r"\s*([A-Za-z_]\w*|[+-]?\d+|'[^']*'|\"[^\"]*\"|.|$)")
_NAME: Final = re.compile(r"\s*([^\s.,:\[\]'\"]+|'[^']*'|\"[^\"]*\"|.|$)")


class _Scanner:
    """Reads a text token by token; the end of the text is an empty token."""

    def __init__(self, owner: str, text: str, sources: Mapping[str, Syntax]) -> None:
        self._owner, self._text, self._sources = owner, text, sources
        self._at = 0

    def peek(self, kind: re.Pattern[str] = _TOKEN) -> str:
        return self._match(kind)[1]

    def next(self, kind: re.Pattern[str] = _TOKEN) -> str:
        match = self._match(kind)
        self._at = match.end()
        return match[1]

    def _match(self, kind: re.Pattern[str]) -> re.Match[str]:
        match = kind.match(self._text.rstrip(), self._at)
        assert match is not None  # noqa: S101 - both patterns match an empty token
        return match

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

    def names(self, syntax: Syntax) -> tuple[str, ...]:
        if not syntax.names:
            return ()
        self.expect(":", f"':' and a name, {syntax.example}")
        names = [self.name()]
        while len(names) < syntax.names and self.peek() == ",":
            self.next()
            names.append(self.name())
        return tuple(names)

    def name(self) -> str:
        token = self.peek(_NAME)
        quoted = len(token) > 1 and token[0] in "'\""
        if token[1:-1] == "" if quoted else token in {"", *".,:[]'\""}:
            self.refuse("a name")
        return _unquoted(self.next(_NAME))

    def refuse(self, expected: str) -> NoReturn:
        token = self.peek()
        column = len(self._text.rstrip()) - len(self._text.rstrip()[self._at :].lstrip())
        got = repr(token) if token else "the end of the selector"
        raise InputError(
            f"{self._owner}, column {column + 1}: expected {expected}, got {got}\n"
            f"  {self._text}\n"
            f"  {' ' * column}^\n"
            f"  hint: write {hint(self._sources)}"
        )


def _unquoted(token: str) -> str:
    return token[1:-1] if len(token) > 1 and token[0] in "'\"" else token


def _written(name: str) -> str:
    plain = name[:1] not in {*".,:[]'\""}  # otherwise it looks like the start of a quote
    if plain and (match := _NAME.fullmatch(name)) and match[1] == name:
        return name
    return f'"{name}"' if "'" in name else f"'{name}'"
