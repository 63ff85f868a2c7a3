"""The results of `check`, `equivalent` and `examples`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from rtamt.renamed import OldName

AnswerWord = Literal["yes", "no", "unknown"]


def worst(answers: Iterable[AnswerWord]) -> AnswerWord:
    """Return ``"no"`` if an answer is no; otherwise ``"unknown"`` if one is unknown."""
    words = {*answers}
    return "no" if "no" in words else "unknown" if "unknown" in words else "yes"


@dataclass(frozen=True, slots=True)
class ExampleTrace:
    """A trace that the search returned, with the verdict that it searched for.

    Attributes:
        columns: The value of each variable at each sample.
        samples: The number of samples.
        loop: The number of last samples that repeat for ever; 0 if the trace ends.
    """

    columns: Mapping[str, tuple[float, ...]]
    samples: int
    loop: int

    @property
    def described(self) -> str:
        """The length of the trace, in words."""
        count = f"{self.samples} sample{'s' * (self.samples != 1)}"
        if not self.loop:
            return f"in {count}"
        last = "sample" if self.loop == 1 else f"{self.loop} samples"
        return f"by {count}, the last {last} again and again"

    def unrolled(self, variable: str) -> list[float]:
        """Return the values of a variable; a trace that repeats has three times its samples."""
        values = [*self.columns[variable]]
        more = 2 * self.samples if self.loop else 0
        again = values[self.samples - self.loop :]
        return values + (again * (more // max(1, self.loop) + 1))[:more]


@dataclass(frozen=True, slots=True)
class Answer:
    """Whether there is a trace with a certain verdict.

    Attributes:
        answer: ``"yes"``, ``"no"`` or ``"unknown"``.
        trace: If yes, the trace, as judged by the monitors.
        samples: If no, 0 if this is proved for all traces. Otherwise, the number of samples of the
            longest traces that were excluded: traces that repeat their last 1 to 4 samples for
            ever, and shorter traces that end.
        why: The reason if the answer is unknown.
        clash: If no, the parts that cannot hold together, as text, with the ranges and rates that
            contribute; empty if they explain nothing.
        places: Line and column of each text of `clash` in the specification, from 1; None for
            assumptions, declarations and parts without a place.
    """

    answer: AnswerWord
    trace: ExampleTrace | None = None
    samples: int = 0
    why: str = ""
    clash: tuple[str, ...] = ()
    places: tuple[tuple[int, int] | None, ...] = ()

    says = OldName("answer")

    def __str__(self) -> str:
        if self.answer == "unknown":
            return f"unknown: {self.why}"
        if self.trace is not None:
            return f"yes, {self.trace.described}"
        if self.samples:
            return f"no, by no trace of up to {self.samples} samples, its end repeated"
        return "no"


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Whether the same traces satisfy two requirements.

    Attributes:
        answer: ``"yes"``, ``"no"`` or ``"unknown"``.
        trace: If no, a trace that satisfies one and violates the other, as judged by the monitors.
        satisfied: If no, the requirement that the trace satisfies: ``"one"`` or ``"other"``.
        samples: If yes, 0 if this is proved for all traces; otherwise as in an `Answer` of no.
        why: The reason if the answer is unknown.
    """

    answer: AnswerWord
    trace: ExampleTrace | None = None
    satisfied: Literal["one", "other", ""] = ""
    samples: int = 0
    why: str = ""

    says = OldName("answer")

    def __str__(self) -> str:
        if self.answer == "unknown":
            return f"unknown: {self.why}"
        if self.trace is not None:
            violated = "other" if self.satisfied == "one" else "one"
            verdicts = f"{self.satisfied} is satisfied, {violated} is violated"
            return f"no, {self.trace.described}: {verdicts}"
        if self.samples:
            return f"yes, on all traces of up to {self.samples} samples, their ends repeated"
        return "yes"


@dataclass(frozen=True, slots=True)
class RedundantPart:
    """A redundant part of a requirement.

    Attributes:
        text: The part.
        instead: The constant that can replace the part without changing the requirement:
            ``"true"`` if the part demands nothing, ``"false"`` if it allows nothing.
        samples: As in an `Answer` of no.
    """

    text: str
    instead: Literal["true", "false"]
    samples: int

    def __str__(self) -> str:
        effect = "demands nothing more" if self.instead == "true" else "never helps"
        bound = f" (on traces of up to {self.samples} samples)" if self.samples else ""
        return f"{self.text} {effect}{bound}"


@dataclass(frozen=True, slots=True)
class CheckedRequirement:
    """The answers for one requirement.

    Attributes:
        text: The requirement.
        satisfiable: Whether a trace satisfies it.
        falsifiable: Whether a trace violates it; otherwise, the requirement demands nothing.
        triggers: For each implication, whether the requirement is satisfied by its answer on a
            trace.
        redundant: The redundant parts, without the parts inside them.
        unknown: The parts that may be redundant, with the reason why this is unknown.
    """

    text: str
    satisfiable: Answer
    falsifiable: Answer
    triggers: Mapping[str, Answer] = field(default_factory=dict)
    redundant: tuple[RedundantPart, ...] = ()
    unknown: Mapping[str, str] = field(default_factory=dict)

    asked = OldName("triggers")
    idle = OldName("redundant")
    says = OldName("answer")

    @property
    def answer(self) -> AnswerWord:
        """``"yes"`` without a defect, ``"no"`` with a defect, or ``"unknown"``."""
        parts: set[AnswerWord] = (
            {"no"} if self.redundant else {"unknown"} if self.unknown else set()
        )
        answers = (self.satisfiable, self.falsifiable, *self.triggers.values())
        return worst({*parts, *(answer.answer for answer in answers)})


@dataclass(frozen=True, slots=True)
class Check:
    """The answers for a set of requirements.

    Attributes:
        requirements: The answers for each requirement, by name.
        together: Whether a trace satisfies all satisfiable requirements; None for one requirement.
        conflict: The names of a minimal set of requirements that no trace satisfies together;
            empty without a conflict, or if this is unknown.
        triggers: For each requirement and implication of it, whether a trace that satisfies all
            requirements satisfies this one by the answer of the implication.
        implied: Name of an implied requirement to the name of the requirement that implies it.
        equal: Pairs of names of requirements that the same traces satisfy.
        unknown: Pairs of names that may imply each other, with the reason why this is unknown.
        same: With ``same_as``, whether the same traces satisfy a requirement and its namesake, by
            name; everything else is empty then.
    """

    requirements: Mapping[str, CheckedRequirement]
    together: Answer | None = None
    conflict: tuple[str, ...] = ()
    triggers: Mapping[tuple[str, str], Answer] = field(default_factory=dict)
    implied: Mapping[str, str] = field(default_factory=dict)
    equal: tuple[tuple[str, str], ...] = ()
    unknown: Mapping[tuple[str, str], str] = field(default_factory=dict)
    same: Mapping[str, Equivalence] = field(default_factory=dict)

    asked = OldName("triggers")
    says = OldName("answer")

    @property
    def answer(self) -> AnswerWord:
        """``"yes"`` without a defect, ``"no"`` with a defect, or ``"unknown"``.

        An implied requirement is reported, but is not a defect.
        """
        parts: list[CheckedRequirement | Answer | Equivalence] = [
            *self.requirements.values(),
            *self.triggers.values(),
            *self.same.values(),
        ]
        if self.together is not None:
            parts.append(self.together)
        pairs: set[AnswerWord] = {"no"} if self.equal else {"unknown"} if self.unknown else set()
        return worst({*pairs, *(part.answer for part in parts)})

    def traces(self) -> Iterator[tuple[str, str, ExampleTrace]]:
        """Yield each trace with the name of its requirement and a word for its purpose."""
        for name, same in self.same.items():
            if same.trace is not None:
                yield name, "apart", same.trace
        for name, requirement in self.requirements.items():
            answers = {"satisfied": requirement.satisfiable, "violated": requirement.falsifiable}
            for i, answer in enumerate(requirement.triggers.values()):
                answers[f"asked {i + 1}" if i else "asked"] = answer
            for purpose, answer in answers.items():
                if answer.trace is not None:
                    yield name, purpose, answer.trace
        if self.together is not None and self.together.trace is not None:
            yield "", "together", self.together.trace
