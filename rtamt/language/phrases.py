"""The words for operators: adjectives of comparisons, nouns of functions, phrases of time.

`rtamt.language.words` joins them to sentences. A row of the table of operators has an entry in one
of the tables here.

To add the words of an operator or a function, add an entry to one of these tables, and the same
words to ``tests/support/words_reader.py``, which reads sentences back to formulas.
``tests/rtamt/language/test_words.py`` names a row that has no words.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Final

from rtamt.language.interval import decimal_text

__all__ = [
    "ADJECTIVES",
    "ARITHMETIC",
    "CHANGES",
    "CONDITIONS",
    "CONSTANTS",
    "EVENTUAL",
    "FIRST_SAMPLE",
    "FUNCTIONS",
    "INFIX",
    "MOMENTS",
    "NEGATIONS",
    "NEIGHBOURS",
    "NEVER",
    "START",
    "VERBS",
    "VOCABULARY",
    "WINDOWS",
    "amount",
    "window",
]

ADJECTIVES: Final = {
    ">=": "at least",
    ">": "above",
    "<=": "at most",
    "<": "below",
    "==": "equal to",
    "!=": "different from",
    "value": "nonnegative",
}
"""Of predicates, behind a verb: "x is at least 3"."""

EVENTUAL: Final = {">=": "reaches", "<=": "reaches"}
"""The verbs of predicates that hold at some time; of others it is "gets"."""

FUNCTIONS: Final = {
    "abs": "the absolute value of {}",
    "sqrt": "the square root of {}",
    "exp": "the exponential of {}",
    "ln": "the natural logarithm of {}",
    "pow": "{} to the power of {}",
    "log": "the logarithm of {} to base {}",
    "min": "the least of {}",
    "max": "the greatest of {}",
    "neg": "minus {}",
    "rate": "the rate of {}",
}
"""Of functions; what is not a variable or a number stands in brackets, as a list does. Inside of
arithmetic a function is written as in the formula."""

ARITHMETIC: Final = ("+", "-", "*", "/")
"""What has no other words than the formula itself."""

CONSTANTS: Final = ("true", "false")
"""What holds always or never, in the same words."""

NEGATIONS: Final = {
    "not": ("is not", "does not hold", "it is not true that "),
    "rise": ("becomes", "begins to hold", "it becomes true that "),
    "fall": ("stops being", "ceases to hold", "it stops being true that "),
}
"""What changes the verb: of predicates, of what has a name, and what stands before all else."""

CHANGES: Final = ("rise", "fall")
"""What compares a sample with the one before."""

FIRST_SAMPLE: Final = "the first sample counts as changed"
"""What ``rise(p)`` and ``fall(p)`` are at the first sample, which has none before it: ``p`` and
``not p``."""

INFIX: Final = {
    "and": ("", " and ", ""),
    "or": ("", " or ", ""),
    "iff": ("", " exactly when ", ""),
    "xor": ("either ", " or ", " but not both"),
}
"""What stands before, between and behind operands."""

CONDITIONS: Final = {"implies": ("if ", ", then "), "always implies": ("whenever ", ", ")}
"""What stands before a condition and behind it."""

NEIGHBOURS: Final = {
    "next": "at the next sample if there is one",
    "s_next": "at the next sample",
    "prev": "at the previous sample if there is one",
    "s_prev": "at the previous sample",
}

MOMENTS: Final = {
    "until": " until, ",
    "since": " ever since, ",
    "unless": ", or only until, ",
}
"""What stands between what holds and the phrase of the moment of the other operand."""

START: Final = "at the start"
"""Before a sentence of which a part speaks of the begin of the trace alone."""

VERBS: Final = {
    "always": "stays",
    "eventually": "gets",
    "historically": "has been",
    "once": "was",
}
"""The verbs of predicates that have a window behind them."""

NEVER: Final = {"always": "is never", "historically": "has never been"}
"""The verbs of predicates that hold at no time of a window."""

WINDOWS: Final = {
    "always at first": (
        *("at all times", "from {} on", "during the first {}", "from {} to {}"),
        "at {} if the trace lasts",
    ),
    "always": (
        *("from then on", "from {} later on", "for the next {}", "from {} to {} later"),
        "{} later if the trace lasts",
    ),
    "eventually at first": (
        *("at some time", "at some time from {} on", "within the first {}"),
        *("at some time from {} to {}", "at {}"),
    ),
    "eventually": (
        *("at some time from then on", "at some time from {} later on", "within {}"),
        *("at some time from {} to {} later", "{} later"),
    ),
    "historically": (
        *("at all times so far", "at all times up to {} earlier", "for the last {}"),
        *("from {} to {} earlier", "{} earlier if the trace had begun"),
    ),
    "once": (
        *("at some time so far", "at some time up to {} earlier", "within the last {}"),
        *("at some time from {} to {} earlier", "{} earlier"),
    ),
}
"""Windows without an end, from a time on, up to a time, between two, and a single time;
"at first" where the operator is about the begin of the trace."""

VOCABULARY: Final = frozenset(
    word
    for texts in (
        *(
            "is holds means that where",
            START,
            FIRST_SAMPLE,
            *ADJECTIVES.values(),
            *EVENTUAL.values(),
        ),
        *(*FUNCTIONS.values(), *NEIGHBOURS.values(), *MOMENTS.values()),
        *(*VERBS.values(), *NEVER.values()),
        *(text for table in (NEGATIONS, INFIX, CONDITIONS, WINDOWS) for text in table.values()),
    )
    for word in re.findall("[a-z]+", " ".join([texts] if isinstance(texts, str) else texts))
)
"""Every word of the phrases. A variable with such a name is written in quotation marks."""


def window(name: str, begin: Fraction, end: Fraction | None, unit: str, *, at_first: bool) -> str:
    """The phrase for the interval of ``always``, ``eventually``, ``historically`` or ``once``.

    Example:
        >>> window("once", Fraction(0), Fraction(5), "s", at_first=False)
        'within the last 5 s'
    """
    phrases = WINDOWS.get(f"{name} at first" if at_first else name, WINDOWS[name])
    endless, from_on, up_to, between, single = phrases
    if end is None:
        return from_on.format(amount(begin, unit)) if begin else endless
    if begin == end:
        return single.format(amount(begin, unit))
    if not begin:
        return up_to.format(amount(end, unit))
    first, last = amount(begin, unit), amount(end, unit)
    past = name in ("historically", "once")
    return between.format(last, first) if past else between.format(first, last)


def amount(value: Fraction, unit: str) -> str:
    """A time with its unit; one of a unit that is a word is in the singular.

    Example:
        >>> amount(Fraction(1), "steps"), amount(Fraction(1, 2), "s")
        ('1 step', '0.5 s')
    """
    one = value == 1 and len(unit) > 2
    return f"{decimal_text(value)} {unit.removesuffix('s') if one else unit}"
