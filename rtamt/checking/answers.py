"""What `check` says of requirements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from rtamt.checking.search import SearchAnswer
from rtamt.checking.witness import ExampleTrace

__all__ = [
    "Answer",
    "Check",
    "CheckedRequirement",
    "Clashing",
    "Equivalence",
    "Idle",
    "Says",
    "worst",
]

Says = Literal["yes", "no", "unknown"]

Clashing = tuple[str, tuple[int, int] | None]
"""A part that clashes: its text, and its line and column if it has any."""


def worst(said: Iterable[Says]) -> Says:
    """What several answers say together: ``"no"`` if one does, else ``"unknown"`` if one does."""
    several = {*said}
    return "no" if "no" in several else "unknown" if "unknown" in several else "yes"


@dataclass(frozen=True, slots=True)
class Answer:
    """Whether there is a trace of some kind.

    Attributes:
        says: ``"yes"``, ``"no"`` or ``"unknown"``.
        trace: Of a yes, such a trace, which the monitors have judged.
        samples: Of a no, 0 if it is proved for all traces; else there is no trace of up to that
            many samples that then repeats its last 1 to 4 for ever, and no shorter one that ends.
        why: Why it is unknown.
        clash: Of a no, the parts that cannot hold together, as text, with the ranges and rates on
            which that rests; empty if that says nothing.
        places: Line and column in the text of each of `clash`, from 1; None of what is assumed or
            declared, and of what has no place.
    """

    says: Says
    trace: ExampleTrace | None = None
    samples: int = 0
    why: str = ""
    clash: tuple[str, ...] = ()
    places: tuple[tuple[int, int] | None, ...] = ()

    @classmethod
    def of(cls, found: SearchAnswer, clash: Iterable[Clashing] = ()) -> Answer:
        """The answer that a search has found."""
        parts = [*clash]
        if found.trace is not None:
            return cls("yes", found.trace)
        if found.none or found.samples:
            samples = 0 if found.none else found.samples
            texts = tuple(text for text, _ in parts)
            return cls("no", samples=samples, clash=texts, places=tuple(at for _, at in parts))
        return cls("unknown", why=found.why)

    def __str__(self) -> str:
        if self.says == "unknown":
            return f"unknown: {self.why}"
        if self.trace is not None:
            return f"yes, {self.trace.described}"
        if self.samples:
            return f"no, by no trace of up to {self.samples} samples, its end repeated"
        return "no"


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Whether two requirements are satisfied by the same traces.

    Attributes:
        says: ``"yes"``, ``"no"`` or ``"unknown"``.
        trace: Of a no, a trace that satisfies one and violates the other, as the monitors judge.
        satisfied: Of a no, which of the two the trace satisfies: ``"one"`` or ``"other"``.
        samples: Of a yes, 0 if it is proved for all traces; else as in an `Answer` that says no.
        why: Why it is unknown.
    """

    says: Says
    trace: ExampleTrace | None = None
    satisfied: Literal["one", "other", ""] = ""
    samples: int = 0
    why: str = ""

    def __str__(self) -> str:
        if self.says == "unknown":
            return f"unknown: {self.why}"
        if self.trace is not None:
            violated = "other" if self.satisfied == "one" else "one"
            said = f"{self.satisfied} is satisfied, {violated} is violated"
            return f"no, {self.trace.described}: {said}"
        if self.samples:
            return f"yes, on all traces of up to {self.samples} samples, their ends repeated"
        return "yes"


@dataclass(frozen=True, slots=True)
class Idle:
    """A part of a requirement that decides nothing.

    Attributes:
        text: The part.
        instead: The requirement stays the same with ``"true"`` in its place, so that it demands
            nothing, or with ``"false"``, so that it allows nothing.
        samples: As in an `Answer` that says no.
    """

    text: str
    instead: Literal["true", "false"]
    samples: int

    def __str__(self) -> str:
        what = "demands nothing more" if self.instead == "true" else "never helps"
        bound = f" (on traces of up to {self.samples} samples)" if self.samples else ""
        return f"{self.text} {what}{bound}"


@dataclass(frozen=True, slots=True)
class CheckedRequirement:
    """What there is to say of one requirement.

    Attributes:
        text: The requirement.
        satisfiable: Whether a trace satisfies it.
        falsifiable: Whether a trace violates it; if none does, it demands nothing.
        asked: For each implication whether a trace satisfies the requirement by its answer.
        idle: The parts that decide nothing, the largest ones.
        unknown: The parts of which nobody knows whether they decide anything, and why.
    """

    text: str
    satisfiable: Answer
    falsifiable: Answer
    asked: Mapping[str, Answer] = field(default_factory=dict)
    idle: tuple[Idle, ...] = ()
    unknown: Mapping[str, str] = field(default_factory=dict)

    @property
    def says(self) -> Says:
        """``"no"`` if something is wrong with it, ``"yes"`` if nothing is, or ``"unknown"``."""
        said: set[Says] = {"no"} if self.idle else {"unknown"} if self.unknown else set()
        answers = (self.satisfiable, self.falsifiable, *self.asked.values())
        return worst({*said, *(each.says for each in answers)})


@dataclass(frozen=True, slots=True)
class Check:
    """What there is to say of a set of requirements.

    Attributes:
        requirements: Each of them, by name.
        together: Whether a trace satisfies all that can be satisfied; None of one requirement.
        conflict: Names of requirements that no trace satisfies together, as few as can be; empty
            if there is no conflict, or nobody knows.
        asked: For each requirement that can be asked and one of its implications whether a trace
            that satisfies all of them is satisfied by its answer.
        implied: Names of requirements that one other implies, with its name.
        equal: Pairs of names whose requirements are satisfied by the same traces.
        unknown: Pairs of names of which nobody knows whether one implies the other, and why.
        same: By name whether a requirement is satisfied by the same traces as its namesake, where
            that was asked; then nothing else was.
    """

    requirements: Mapping[str, CheckedRequirement]
    together: Answer | None = None
    conflict: tuple[str, ...] = ()
    asked: Mapping[tuple[str, str], Answer] = field(default_factory=dict)
    implied: Mapping[str, str] = field(default_factory=dict)
    equal: tuple[tuple[str, str], ...] = ()
    unknown: Mapping[tuple[str, str], str] = field(default_factory=dict)
    same: Mapping[str, Equivalence] = field(default_factory=dict)

    @property
    def says(self) -> Says:
        """``"no"`` if something is wrong, ``"yes"`` if nothing is, or ``"unknown"``.

        That one requirement implies another is told, and is not wrong.
        """
        parts: list[CheckedRequirement | Answer | Equivalence] = [
            *self.requirements.values(),
            *self.asked.values(),
            *self.same.values(),
        ]
        if self.together is not None:
            parts.append(self.together)
        said: set[Says] = {"no"} if self.equal else {"unknown"} if self.unknown else set()
        return worst({*said, *(each.says for each in parts)})

    def traces(self) -> Iterator[tuple[str, str, ExampleTrace]]:
        """Every trace that was found, with the name of its requirement and what it shows."""
        for name, same in self.same.items():
            if same.trace is not None:
                yield name, "apart", same.trace
        for name, each in self.requirements.items():
            answers = {"satisfied": each.satisfiable, "violated": each.falsifiable}
            answers |= {
                f"asked {i + 1}" if i else "asked": a for i, a in enumerate(each.asked.values())
            }
            for what, answer in answers.items():
                if answer.trace is not None:
                    yield name, what, answer.trace
        if self.together is not None and self.together.trace is not None:
            yield "", "together", self.together.trace
