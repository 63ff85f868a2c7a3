"""Bounded model checking of requirements: can each be satisfied, violated and triggered?"""

from rtamt.checking.answers import (
    Answer,
    Check,
    CheckedRequirement,
    Equivalence,
    ExampleTrace,
    RedundantPart,
)
from rtamt.checking.examples import Example, RequirementExamples

__all__ = [
    "Answer",
    "Check",
    "CheckedRequirement",
    "Equivalence",
    "Example",
    "ExampleTrace",
    "RedundantPart",
    "RequirementExamples",
]
