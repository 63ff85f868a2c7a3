"""Read the sentences of `Specification.in_words` back to formulas; shares no table with it."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import cast

import rtamt
from rtamt import Formula, Interval
from rtamt.language.formula import make
from rtamt.language.node import Node

_T = r"([\d.]+) (s|ms|us|ns|ps)"

_FIRST = {
    "always": {
        "at all times": "",
        f"from {_T} on": "a",
        f"during the first {_T}": "b",
        f"from {_T} to {_T}": "ab",
        f"at {_T} if the trace lasts": "p",
    },
    "eventually": {
        "at some time": "",
        f"at some time from {_T} on": "a",
        f"within the first {_T}": "b",
        f"at some time from {_T} to {_T}": "ab",
        f"at {_T}": "p",
    },
}
"""Phrases of the future at the start of a trace, with their bounds."""

_LATER = {
    "always": {
        "from then on": "",
        f"from {_T} later on": "a",
        f"for the next {_T}": "b",
        f"from {_T} to {_T} later": "ab",
        f"{_T} later if the trace lasts": "p",
    },
    "eventually": {
        "at some time from then on": "",
        f"at some time from {_T} later on": "a",
        f"within {_T}": "b",
        f"at some time from {_T} to {_T} later": "ab",
        f"{_T} later": "p",
    },
}

_PAST = {
    "historically": {
        "at all times so far": "",
        "so far": "",
        f"(?:at all times )?up to {_T} earlier": "a",
        f"for the last {_T}": "b",
        f"from {_T} to {_T} earlier": "ba",
        f"{_T} earlier if the trace had begun": "p",
    },
    "once": {
        "at some time so far": "",
        f"at some time up to {_T} earlier": "a",
        f"within the last {_T}": "b",
        f"at some time from {_T} to {_T} earlier": "ba",
        f"{_T} earlier": "p",
    },
}

_NEIGHBOURS = {
    "at the next sample if there is one": "next",
    "at the next sample": "s_next",
    "at the previous sample if there is one": "prev",
    "at the previous sample": "s_prev",
}

_ADJECTIVES = {
    "at least": ">=",
    "above": ">",
    "at most": "<=",
    "below": "<",
    "equal to": "==",
    "different from": "!=",
}

_VERBS = {
    "is": (),
    "is not": ("not",),
    "becomes": ("rise",),
    "stops being": ("fall",),
    "stays": ("always",),
    "reaches": ("eventually",),
    "gets": ("eventually",),
    "has been": ("historically",),
    "was": ("once",),
    "is never": ("always", "not"),
    "has never been": ("historically", "not"),
}

_VERB = "is not|is never|is|becomes|stops being|stays|reaches|gets|has been|was|has never been"
_PREDICATE = re.compile(
    rf"(?P<left>.+?) (?P<verb>{_VERB}) "
    rf"(?:(?P<op>{'|'.join(_ADJECTIVES)}) (?P<right>.+)|nonnegative(?: (?P<rest>.+))?)"
)
_HOLDS = {
    " does not hold": "not",
    " begins to hold": "rise",
    " ceases to hold": "fall",
    " holds": None,
}
_TRUE_THAT = {
    "it is not true that ": "not",
    "it becomes true that ": "rise",
    "it stops being true that ": "fall",
}


_FIRST_SAMPLE = "the first sample counts as changed"


def read(text: str) -> Formula:
    """Return the formula of a sentence.

    Raises:
        AssertionError: If there is none.
    """
    text = re.sub(r'"(\w+)"', r"Quoted_\1", text)
    says_first = text.endswith(_FIRST_SAMPLE)
    text = re.sub(f"; (where )?{_FIRST_SAMPLE}$", "", text)
    main, where, rest = text.partition("; where ")
    meanings = {}
    for each in rest.split("; ") if where else ():
        name, verb, meaning = re.fullmatch(r"(\[\d+\]|\w+) (is|means that) (.*)", each).groups()  # type: ignore[union-attr]  # else the test fails
        meanings[name, verb] = meaning
    formula = _Reader(meanings).clause(main.removeprefix("at the start, "), first=True)
    changes = any(node.op and node.op.name in ("rise", "fall") for node in formula.nodes())
    assert says_first == changes
    return formula


class _Reader:
    def __init__(self, meanings: dict[tuple[str, str], str]) -> None:
        self.meanings = meanings

    def clause(self, text: str, *, first: bool) -> Formula:
        if text.startswith("if "):
            left, right = _cut(text.removeprefix("if "), ", then ")
            return _make("implies", self.clause(left, first=first), self.clause(right, first=first))
        if text.startswith("whenever "):
            assert first, text
            return _make("always", self.rule(text))
        head, rest = _cut(text, ", ")
        if rest:
            return self.opened(head, rest, first=first)
        if text.startswith("either ") and text.endswith(" but not both"):
            left, right = _cut(text.removeprefix("either ").removesuffix(" but not both"), " or ")
            return _make("xor", self.clause(left, first=first), self.clause(right, first=first))
        for word, name in ((" exactly when ", "iff"), (" and ", "and"), (" or ", "or")):
            parts = _parts(text, word)
            if len(parts) > 1:
                return _make(name, *(self.clause(part, first=first) for part in parts))
        return self.atom(text, first=first)

    def rule(self, text: str, *, first: bool = False) -> Formula:
        left, right = _cut(text.removeprefix("whenever "), ", ")
        return _make("implies", self.clause(left, first=first), self.clause(right, first=first))

    def opened(self, head: str, rest: str, *, first: bool) -> Formula:
        if head.endswith((" until", " ever since")):
            since = head.endswith(" ever since")
            left = self.clause(head.removesuffix(" until").removesuffix(" ever since"), first=False)
            when, right = _cut(rest, ", ")
            name, bounds = _when(when, first=first)
            assert name == ("once" if since else "eventually"), when
            return _make(
                "since" if since else "until", left, self.clause(right, first=False), bounds=bounds
            )
        if rest.startswith("or only until, "):
            when, right = _cut(rest.removeprefix("or only until, "), ", ")
            name, bounds = _when(when, first=first)
            assert name == "eventually", when
            left, as_long = self.kept(head, first=first)
            assert as_long == _long(bounds), head
            return _make("unless", left, self.clause(right, first=False), bounds=bounds)
        if head in _NEIGHBOURS:
            return _make(_NEIGHBOURS[head], self.clause(rest, first=False))
        name, bounds = _when(head, first=first)
        single = bounds is not None and bounds.begin == bounds.end
        if rest.startswith("whenever ") and name == "always" and not single:
            return _make("always", self.rule(rest), bounds=bounds)
        return _make(name, self.clause(rest, first=False), bounds=bounds)

    def kept(self, head: str, *, first: bool) -> tuple[Formula, Interval | None]:
        """Return the operand before "or only until", and its duration otherwise."""
        for phrase, which in (_FIRST if first else _LATER)["always"].items():
            if found := re.fullmatch(f"(.*?) ({phrase})", head):
                held = found[1]
                if not (_bracketed(held) or held.endswith(" holds")):
                    assert held.count(" stays ") == 1, held
                    held = held.replace(" stays ", " is ")
                return self.clause(held, first=False), _bounds(which, found.groups()[2:])
        raise AssertionError(head)

    def atom(self, text: str, *, first: bool) -> Formula:
        for before, name in _TRUE_THAT.items():
            if text.startswith(before):
                inside = text.removeprefix(before)
                assert _bracketed(inside), text
                return _make(name, self.clause(inside[1:-1], first=first and name == "not"))
        if _bracketed(text):
            return self.clause(text[1:-1], first=first)
        for behind, holding in _HOLDS.items():
            if text.endswith(behind):
                held = self.held(text.removesuffix(behind))
                return held if holding is None else _make(holding, held)
        return self.predicate(text, first=first)

    def held(self, name: str) -> Formula:
        if name in ("true", "false"):
            return _make(name)
        return self.clause(self.meanings[name, "means that"], first=False)

    def predicate(self, text: str, *, first: bool) -> Formula:
        found = _PREDICATE.fullmatch(text)
        assert found, text
        outer = list(_VERBS[found["verb"]])
        right, bounds = found["right"], None
        if outer and outer[0] in ("always", "eventually", "historically", "once"):
            behind = f" {right}" if right else f" {found['rest']}" if found["rest"] else ""
            behind, bounds = _suffix(outer[0], behind, first=first, never="not" in outer)
            right = behind.strip()
        else:
            assert not found["rest"], text
        left = self.term(found["left"])
        formula = (
            _make(_ADJECTIVES[found["op"]], left, self.term(right))
            if found["op"]
            else _make("value", left)
        )
        if outer[-1:] == ["not"]:
            formula = _make("not", formula)
            outer.pop()
        if outer:
            reaches = found["verb"] == "reaches"
            assert found["verb"] not in ("reaches", "gets") or reaches == (
                found["op"] in ("at least", "at most")
            )
            return _make(outer[0], formula, bounds=bounds)
        return formula

    def term(self, text: str) -> Node:
        if (text, "is") in self.meanings:
            return self.term(self.meanings[text, "is"])
        for name, words in {
            "abs": "the absolute value of ",
            "sqrt": "the square root of ",
            "exp": "the exponential of ",
            "ln": "the natural logarithm of ",
            "neg": "minus ",
            "rate": "the rate of ",
        }.items():
            if text.startswith(words):
                return make(name, (self.operand(text.removeprefix(words)),))
        for name, words in {"min": "the smallest of ", "max": "the largest of "}.items():
            if text.startswith(words):
                inside = text.removeprefix(words)
                assert _bracketed(inside), text
                return make(name, tuple(self.notation(each) for each in _parts(inside[1:-1], ", ")))
        if text.startswith("the logarithm of "):
            x, base = _cut(text.removeprefix("the logarithm of "), " to base ")
            return make("log", (self.operand(x), self.operand(base)))
        x, y = _cut(text, " to the power of ")
        return make("pow", (self.operand(x), self.operand(y))) if y else self.notation(text)

    def operand(self, text: str) -> Node:
        if _bracketed(text):
            return self.notation(text[1:-1])
        assert re.fullmatch(r"-?[\w.+-]+", text), text
        return self.notation(text)

    def notation(self, text: str) -> Node:
        for name, verb in self.meanings:
            if verb == "is":
                text = re.sub(rf"\b{name}\b", f"({self.meanings[name, verb]})", text)
        return rtamt.parse(f"{text.replace('Quoted_', '')} > 0").formula.args[0]


def _when(phrase: str, *, first: bool) -> tuple[str, Interval | None]:
    for name, phrases in {**(_FIRST if first else _LATER), **_PAST}.items():
        for pattern, which in phrases.items():
            if found := re.fullmatch(pattern, phrase):
                return name, _bounds(which, found.groups())
    raise AssertionError(phrase)


def _suffix(name: str, text: str, *, first: bool, never: bool) -> tuple[str, Interval | None]:
    """Return the text before the phrase at the end of a predicate, and its bounds."""
    phrases = {**(_FIRST if first else _LATER), **_PAST}[name]
    for pattern, which in phrases.items():
        if which != "p" and (found := re.fullmatch(f"(.*?) ({pattern})", text)):
            return found[1], _bounds(which, found.groups()[2:])
    assert never, text
    assert first, text
    return text, None


def _bounds(which: str, groups: tuple[str, ...]) -> Interval | None:
    if not which:
        return None
    times = [Fraction(each) for each in groups[::2]]
    units = {None if each == "s" else each for each in groups[1::2]}
    assert len(units) == 1, groups
    (unit,) = units
    match which:
        case "a":
            return Interval(times[0], None, unit)
        case "b":
            return Interval(Fraction(0), times[0], unit)
        case "p":
            return Interval(times[0], times[0], unit)
    assert times[0] != times[1], groups
    return Interval(min(times), max(times), unit)


def _long(bounds: Interval | None) -> Interval | None:
    """Return the bounds within which ``unless`` holds its left operand by default."""
    if bounds is None or bounds.end is None:
        return None
    return Interval(Fraction(0), bounds.end, bounds.unit)


def _make(name: str, *args: Node, bounds: Interval | None = None) -> Formula:
    return cast("Formula", make(name, args, bounds))


def _parts(text: str, word: str) -> list[str]:
    """Return the parts of a text between the words outside brackets."""
    parts, depth, begin = [], 0, 0
    for i, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and text.startswith(word, i) and i >= begin:
            parts.append(text[begin:i])
            begin = i + len(word)
    return [*parts, text[begin:]]


def _cut(text: str, word: str) -> tuple[str, str]:
    """Return the text before and after the first word outside brackets."""
    head, *rest = _parts(text, word)
    return head, word.join(rest)


def _bracketed(text: str) -> bool:
    """Return whether a text is one pair of brackets."""
    if not (text.startswith("(") and text.endswith(")")):
        return False
    depth = 0
    for i, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return i == len(text) - 1
    return False
