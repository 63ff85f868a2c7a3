"""`check`: whether requirements can be satisfied, violated and asked, and whether they agree."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from typing import Literal, cast

from rtamt.checking.answers import Answer, Check, CheckedRequirement, Clashing, Idle
from rtamt.checking.equivalence import paired, same
from rtamt.checking.limits import ValueRange
from rtamt.checking.questions import impossible, prepared
from rtamt.checking.search import SearchAnswer, WitnessSearch
from rtamt.checking.witness import Goal
from rtamt.language.formula import Formula, make, replaced
from rtamt.language.node import Node
from rtamt.language.specification import Specification
from rtamt.machines.protocols import End
from rtamt.monitors.options import Spec
from rtamt.program.implications import implications, signs, unanswered
from rtamt.program.lowering import compile_program
from rtamt.program.program import Program
from rtamt.program.timing import Period

__all__ = ["check"]

_CONSTANTS: tuple[Literal["true", "false"], ...] = ("true", "false")


def check(
    specs: Spec | Mapping[str, Spec],
    period: Period | None = None,
    *,
    end: End = "cut",
    assume: Spec | None = None,
    rates: Mapping[str, ValueRange] | None = None,
    same_as: Spec | Mapping[str, Spec] | None = None,
    horizon: int = 10_000,
    timeout: float = 10.0,
) -> Check:
    """Whether requirements say what was meant.

    Of each it is asked whether a trace satisfies it, whether one violates it, whether each of its
    implications is asked where it is satisfied, and whether each part decides something; of
    several, whether one trace satisfies them all and which imply or equal which. The program of a
    requirement is checked for traces up to a horizon with Z3 (bounded model checking). A yes comes
    with a trace that `judge` has judged. A no is proved, or says up to how many samples it was
    tried. All else is unknown, with the reason: a guess is never made.

    Args:
        specs: A specification, each of whose requirements is checked, or several by name.
        period: Seconds between samples; None: bounds are numbers of samples.
        end: How the end of a trace is read, as in `judge`.
        assume: What is taken to hold of every trace, such as ``always(abs(x) < 3)``. Declared
            ranges, and the ranges of types, are taken to hold too.
        rates: How much variables change in a second at least and at most, in a sample if there is
            no period, such as ``{"x": (-2, 2)}``; taken to hold too.
        same_as: Requirements with the same names, or one where there is one: then only this is
            asked, whether each is satisfied by the same traces as its namesake.
        horizon: The most samples of a trace. A requirement is asked with as many as it needs; if it
            needs more than these it may be unknown.
        timeout: The most seconds for each question.

    Returns:
        What there is to say, which `Check.says` sums up.

    Raises:
        ModuleNotFoundError: If Z3 is not installed, which the extra ``check`` does.
        SpecificationError: If a requirement cannot be compiled: bounds that are no whole samples.
        InputError: If the horizon is below 1, the timeout not above 0, there is nothing to check,
            no trace fulfils what is assumed, or a name is on one side only of ``same_as``.

    Example:
        >>> import rtamt
        >>> found = rtamt.check("always(x > 1 and (x > 0 or y > 2))")
        >>> str(found.requirements["spec"].satisfiable), found.says
        ('yes, in 1 sample', 'no')
        >>> print(*found.requirements["spec"].idle)
        x > 0 or y > 2 demands nothing more (on traces of up to 16 samples)
        >>> rtamt.check({"low": "always(x < 3)", "high": "eventually(x > 5)"}).conflict
        ('low', 'high')

    References:
        Biere, Cimatti, Clarke and Zhu, "Symbolic model checking without BDDs", TACAS 1999.
        Dokhanchi, Hoxha and Fainekos, "Formal requirement debugging for testing and verification
        of cyber-physical systems", TECS 2018.
    """
    if same_as is not None:
        pairs = paired(specs, same_as)
        every = {f"{name} {i}": spec for name, pair in pairs.items() for i, spec in enumerate(pair)}
        _, seconds, search, given = prepared(every, period, end, assume, horizon, timeout, rates)
        return Check({}, same=same(pairs, seconds, search, given))
    named, seconds, search, given = prepared(specs, period, end, assume, horizon, timeout, rates)
    checkers = {name: _Checker(spec, seconds, search, given) for name, spec in named.items()}
    found = {name: checker.checked() for name, checker in checkers.items()}
    return _set(found, checkers, search, given)


class _Checker:
    """Asks about one requirement."""

    def __init__(
        self, spec: Specification, period: Fraction | None, search: WitnessSearch, given: list[Goal]
    ) -> None:
        self.spec, self._period, self._search, self._given = spec, period, search, given
        self.program = compile_program(spec, period)
        self._signs = signs(spec.formula)
        self._first = 1  # the samples of a trace on which parts may decide something

    def checked(self) -> CheckedRequirement:
        """What there is to say of it."""
        satisfied = self._find((self.program, True))
        clash = self._clash(satisfied) if impossible(satisfied) else []
        satisfiable = Answer.of(satisfied, clash)
        violated = self._find((self.program, False))
        falsifiable = Answer.of(violated, _limiting(violated))
        asked, idle, unknown = {}, [], {}
        if satisfiable.says == "yes":
            for implication in implications(self.spec.formula):
                other = self.unanswered(implication)
                answer = Answer.of(self._find((self.program, True), (other, False)))
                asked[str(implication)] = answer
        if satisfiable.trace is not None and falsifiable.trace is not None:
            self._first = max(satisfiable.trace.samples, falsifiable.trace.samples)
            never = {text for text, answer in asked.items() if answer.says == "no"}
            covered: set[Node] = set()
            for node in self._parts():
                if node in covered or str(node) in never:
                    covered |= {*node.nodes()}
                    continue
                found = self._idle(node)
                if isinstance(found, Idle):
                    idle.append(found)
                    covered |= {*node.nodes()}
                elif found:
                    unknown[str(node)] = found
        text = str(self.spec.formula)
        return CheckedRequirement(text, satisfiable, falsifiable, asked, tuple(idle), unknown)

    def unanswered(self, implication: Formula) -> Program:
        """The program of the requirement where nothing answers one of its implications."""
        return self._with(unanswered(self.spec.formula, [implication]))

    def _find(self, *demands: tuple[Program, bool]) -> SearchAnswer:
        return self._search.find_short(self._goals(*demands))

    def _goals(self, *demands: tuple[Program, bool]) -> list[Goal]:
        return [*(Goal(program, holds) for program, holds in demands), *self._given]

    def _with(self, formula: Formula) -> Program:
        return compile_program(self.spec.with_result(formula), self._period)

    def _parts(self) -> Iterator[Formula]:
        """The formulas below it, each before those below it."""
        below = [*self.spec.formula.nodes()][-2::-1]
        for node in below:
            if isinstance(node, Formula) and node.args:  # a constant decides nothing by itself
                yield node

    def _idle(self, node: Formula) -> Idle | str:
        """The part if it decides nothing; else why nobody knows, which is empty if it does."""
        why = ""
        for instead in _CONSTANTS:
            other = self._with(replaced(self.spec.formula, {node: make(instead, ())}))
            # Where the requirement rises with the part alone, it only rises with true in its place.
            ways = [
                self._goals((other, holds), (self.program, not holds))
                for holds in {sign == (instead == "true") for sign in self._signs[node]}
            ]
            if len(ways) > 1 and any(map(self._search.seldom_changing, ways)):
                continue
            found = [self._search.find(way, self._first) for way in ways]
            if all(map(impossible, found)):
                return Idle(str(node), instead, max(each.samples for each in found))
            if all(each.trace is None for each in found):
                why = why or next(each.why for each in found if not impossible(each))
        return why

    def _clash(self, found: SearchAnswer) -> list[Clashing]:
        """The fewest conjuncts that cannot hold together; none if it is one alone.

        What is assumed or declared comes last, if it is needed.
        """
        more: list[Clashing] = []
        if self._given and self._search.find([Goal(self.program, holds=True)]).trace is not None:
            more.append((f"assumed: {self._given[0].program.specification.formula}", None))
        parts = list(_conjuncts(self.spec.formula))
        programs = [self._with(whole) for whole, _ in parts]

        def find(places: list[int]) -> SearchAnswer:
            return self._find(*((programs[place], True) for place in places))

        kept = [0]
        if len(parts) > 1:
            kept = _fewest(list(range(len(parts))), find)
            found = find(kept)
        more += _limiting(found)
        if len(parts) == 1 and not more:
            return []
        positions = self.spec.positions
        return [(str(parts[k][0]), positions.get(parts[k][1])) for k in kept] + more


def _limiting(found: SearchAnswer) -> list[Clashing]:
    """The ranges and rates on which an answer rests."""
    return [(text, None) for text in found.limits]


def _fewest(places: list[int], find: Callable[[list[int]], SearchAnswer]) -> list[int]:
    """The fewest of some places that no trace fulfils together, none of which can be left out."""
    found = find(places)
    kept = [places[i] for i in found.core if i < len(places)] or places
    if len(kept) < len(places) and not impossible(find(kept)):
        kept = places
    for place in list(kept):
        rest = [other for other in kept if other != place]
        if rest and impossible(find(rest)):
            kept = rest
    return kept


def _conjuncts(formula: Formula) -> Iterator[tuple[Formula, Formula]]:
    """The parts that have to hold together, each with what stands for it in the text.

    Of ``always(p and q)`` they are ``always(p)``, for which ``p`` stands, and ``always(q)``.
    """
    name = formula.op.name if formula.op else ""
    if name == "and":
        for part in formula.args:
            yield from _conjuncts(cast("Formula", part))
    elif name == "always":
        below = [*_conjuncts(cast("Formula", formula.args[0]))]
        for part, last in below:
            whole = cast("Formula", make("always", (part,), formula.interval))
            yield whole, formula if len(below) == 1 else last
    else:
        yield formula, formula


def _set(
    found: Mapping[str, CheckedRequirement],
    checkers: Mapping[str, _Checker],
    search: WitnessSearch,
    given: list[Goal],
) -> Check:
    """What there is to say of the requirements together."""
    if len(found) == 1:
        return Check(found)

    def find(*demands: tuple[str, bool]) -> SearchAnswer:
        return search.find([*_wanted(checkers, *demands), *given])

    names = [name for name, each in found.items() if each.satisfiable.says == "yes"]
    every = [*_wanted(checkers, *((name, True) for name in names)), *given]
    both = search.find_short(every) if names else SearchAnswer()
    conflict: tuple[str, ...] = ()
    if impossible(both):
        kept = _fewest(
            list(range(len(names))), lambda places: find(*((names[i], True) for i in places))
        )
        conflict = tuple(names[i] for i in kept)
    clash = [(name, None) for name in conflict]
    together = Answer.of(both, clash) if len(names) > 1 else None
    several = [checkers[name] for name in names] if together and both.trace else []
    asked = {
        (name, str(each)): Answer.of(
            search.find([*_answered(checkers[name], each, several), *given])
        )
        for name in names
        if several
        for each in implications(checkers[name].spec.formula)
        if found[name].asked[str(each)].says == "yes"
    }
    implied: dict[str, str] = {}
    unknown: dict[tuple[str, str], str] = {}
    equal: list[tuple[str, str]] = []
    some = [name for name in names if found[name].falsifiable.says == "yes"]
    for a, b in itertools.combinations(some, 2):
        if not _shared(checkers[a], checkers[b]):
            continue  # nothing that one reads is read by the other
        ways = find((a, True), (b, False)), find((b, True), (a, False))
        ab, ba = map(impossible, ways)
        if ab and ba:
            equal.append((a, b))
        elif ab:
            implied.setdefault(b, a)
        elif ba:
            implied.setdefault(a, b)
        elif why := next((f.why for f in ways if f.trace is None), ""):
            unknown[a, b] = why
    return Check(found, together, conflict, asked, implied, tuple(equal), unknown)


def _wanted(checkers: Mapping[str, _Checker], *demands: tuple[str, bool]) -> list[Goal]:
    return [Goal(checkers[name].program, holds) for name, holds in demands]


def _answered(checker: _Checker, implication: Formula, all_of: list[_Checker]) -> Iterator[Goal]:
    """All hold, and one would not without the answer of its implication."""
    yield from (Goal(each.program, holds=True) for each in all_of)
    yield Goal(checker.unanswered(implication), holds=False)


def _shared(a: _Checker, b: _Checker) -> bool:
    """Whether one can imply the other: both read a variable, as both can be and not be so."""
    return not {*a.program.variables}.isdisjoint(b.program.variables)
