"""Hints for texts that were written for Breach, S-TaLiRo or MATLAB, or that quote a paper.

A hint proposes a form that means the same. Where there is none, it says so.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final

__all__ = ["foreign_hint"]

_Hint = Callable[[re.Match[str]], str]

_INTERVAL: Final = r"[\[(][^\[\]()]*[,:][^\[\]()]*[\])]"
_TEMPORAL: Final[Mapping[str, str]] = {
    "[]": "always",
    "<>": "eventually",
    **dict.fromkeys(("G", "alw", "always"), "always"),
    **dict.fromkeys(("F", "ev", "eventually"), "eventually"),
    **dict.fromkeys(("H", "hist", "historically"), "historically"),
    **dict.fromkeys(("O", "once"), "once"),
    **dict.fromkeys(("U", "until"), "until"),
    **dict.fromkeys(("S", "since"), "since"),
}
_WORDS: Final = "|".join(word for word in _TEMPORAL if word.isalpha())
_LATEX: Final[Mapping[str, str]] = {
    **dict.fromkeys(("land", "wedge"), "and"),
    **dict.fromkeys(("lor", "vee"), "or"),
    **dict.fromkeys(("neg", "lnot"), "not"),
    **dict.fromkeys(("implies", "rightarrow", "Rightarrow", "to"), "->"),
    **dict.fromkeys(("iff", "leftrightarrow", "Leftrightarrow"), "<->"),
    **dict.fromkeys(("square", "Box"), "always"),
    **dict.fromkeys(("lozenge", "Diamond"), "eventually"),
    **dict.fromkeys(("leq", "le"), "<="),
    **dict.fromkeys(("geq", "ge"), ">="),
    **dict.fromkeys(("neq", "ne"), "!="),
}
_MOMENT: Final = "; of p {0} q, p need not hold at the moment of q"


def _temporal(match: re.Match[str]) -> str:
    interval = match["interval"] or ""
    if not _is_closed(interval):
        return _OPEN.format(interval)
    word = _TEMPORAL.get(match["word"])
    if word is None:
        return f"for p {match['word']} q write not (not p until{interval} not q)"
    more = _MOMENT.format(word) if word in ("until", "since") else ""
    return f"write '{word}{interval}'{more}"


def _is_closed(interval: str) -> bool:
    """Whether an interval includes its bounds, or there is none."""
    return not interval or bool(re.fullmatch(r"\[.*(\]|[:,]\s*inf\s*\))", interval))


_OPEN: Final = "an interval includes both of its bounds here: {} has no form"


def _fixed(text: str) -> _Hint:
    return lambda _: text


def _parameter(match: re.Match[str]) -> str:
    return f"write const float {match[1]} = {match[2]}, one line for each parameter"


def _latex(match: re.Match[str]) -> str:
    return f"write '{_LATEX[match[1]]}'" if match[1] in _LATEX else ""


def _signal(match: re.Match[str]) -> str:
    return f"write float {match[1]}, one line for each signal, or leave the signals out"


def _present(match: re.Match[str]) -> str:
    return f"write {match[1]}: a name is the value at the present time"


_ROWS: Final[tuple[tuple[str, _Hint], ...]] = (
    # S-TaLiRo and papers: an operator, an underscore, an interval.
    (rf"(?<![\w\]])(?P<word>\[\]|<>)(?:(?=\[|_)_?\{{?(?P<interval>{_INTERVAL}))?", _temporal),
    (rf"\b(?P<word>{_WORDS})_\{{?(?P<interval>{_INTERVAL})?", _temporal),
    (rf"\b(?P<word>R|V|release)(?=[\s_(\[])(?:_?\{{?(?P<interval>{_INTERVAL}))?", _temporal),
    (r"/\\", _fixed("write 'and'")),
    (r"\\/", _fixed("write 'or'")),
    (r"<=>", _fixed("write '<->'")),
    (r"=?=>", _fixed("implication is written '->'")),
    (r"\\([A-Za-z]+)", _latex),
    # Breach
    (r":=", _fixed("a formula is named with '=': p = always(x > 0)")),
    (r"\bparam\s+(\w+)\s*=\s*([-\w.]+)[^\n]*", _parameter),
    (r"\bsignal\s+(\w+)[^\n]*", _signal),
    (r"\b([A-Za-z_]\w*)\s*[\[(]\s*t\s*[\])]", _present),
    (
        r"\b([A-Za-z_]\w*)\s*[\[(]\s*t\s*[-+][^\])]*[\])]",
        _fixed("only the value at the present time has a form: x for x[t]"),
    ),
    # MATLAB
    (r"~=", _fixed("write !=")),
    (r"~", _fixed("write 'not'; of a signal of 0 and 1 write x == 0, as x alone means x >= 0")),
    (r"\.\^", _fixed("write pow(x, 2) for x.^2")),
    (r"\.[*/]", _fixed("write it without the dot: all values are numbers")),
    (r"[#%]", _fixed("a comment begins with //")),
    (r"\.\.\.", _fixed("leave it out: after an operator and in brackets the next line goes on")),
)
_TABLE: Final = tuple((re.compile(pattern), hint) for pattern, hint in _ROWS)
_MARGIN: Final = 100
"""The most characters of a foreign form before the place that is refused."""


def foreign_hint(text: str, at: int) -> str:
    """Return the hint for a form of another tool at a place; an empty text if there is none.

    Args:
        text: A text that is refused.
        at: The place of the character at which it is refused.

    Example:
        >>> foreign_hint("[]_[0,20] p", 0)
        "write 'always[0,20]'"
    """
    begin = max(0, at - _MARGIN)
    for pattern, hint in _TABLE:
        for match in pattern.finditer(text, begin, at + _MARGIN):
            if match.start() <= at < match.end() and (found := hint(match)):
                return found
    return ""
