"""Whether requirements say what was meant: bounded model checking of their programs."""

from typing import TYPE_CHECKING

from rtamt.lazy import lazy_names

if TYPE_CHECKING:
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

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__,
        {
            "Answer": "rtamt.checking.answers.Answer",
            "Check": "rtamt.checking.answers.Check",
            "CheckedRequirement": "rtamt.checking.answers.CheckedRequirement",
            "Equivalence": "rtamt.checking.answers.Equivalence",
            "Example": "rtamt.checking.examples.Example",
            "ExampleTrace": "rtamt.checking.answers.ExampleTrace",
            "RedundantPart": "rtamt.checking.answers.RedundantPart",
            "RequirementExamples": "rtamt.checking.examples.RequirementExamples",
        },
    )
