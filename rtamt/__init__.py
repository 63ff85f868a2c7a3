"""Robustness monitors from Signal Temporal Logic.

Text becomes a formula, a formula a program of four instructions, and small machines run it: on
samples as they come (`Monitor`), on a whole episode with bounds from the first sample on
(`EpisodeMonitor`), on many signals in lockstep (`VectorMonitor`, `VectorEpisodeMonitor`), on
recorded traces (`evaluate`); `explain` says which samples decided.
"""

from rtamt.backend import BACKEND
from rtamt.errors import (
    InputError,
    InputTypeError,
    ParseError,
    RtamtError,
    SpecificationError,
    StateError,
)
from rtamt.explanation import Explanation, explain
from rtamt.formula import Formula, Term, conjunction, disjunction, number, variable
from rtamt.interval import Interval
from rtamt.monitor import EpisodeMonitor, Monitor, Verdict, evaluate
from rtamt.parser import load, parse
from rtamt.specification import Specification
from rtamt.vector import VectorEpisodeMonitor, VectorMonitor

__version__ = "0.5.0"

__all__ = [
    "BACKEND",
    "EpisodeMonitor",
    "Explanation",
    "Formula",
    "InputError",
    "InputTypeError",
    "Interval",
    "Monitor",
    "ParseError",
    "RtamtError",
    "Specification",
    "SpecificationError",
    "StateError",
    "Term",
    "VectorEpisodeMonitor",
    "VectorMonitor",
    "Verdict",
    "__version__",
    "conjunction",
    "disjunction",
    "evaluate",
    "explain",
    "load",
    "number",
    "parse",
    "variable",
]
