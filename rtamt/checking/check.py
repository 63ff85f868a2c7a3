"""`check` and `equivalent`: defects of requirements, and differences between them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Literal, cast

from rtamt.checking.answers import Answer, Check, CheckedRequirement, Equivalence, RedundantPart
from rtamt.checking.encoding import ValueRange, VariableLimits
from rtamt.checking.search import Goal, SearchAnswer, WitnessSearch
from rtamt.errors import Argument, InputError, InputTypeError
from rtamt.language.declarations import is_whole, range_of_type, range_text
from rtamt.language.formula import Formula, make, replaced
from rtamt.language.node import Node
from rtamt.language.parser import as_specification
from rtamt.language.specification import Specification
from rtamt.machines.protocols import End
from rtamt.monitors.options import Spec, checked_end
from rtamt.program.implications import implications, signs, unanswered
from rtamt.program.lowering import compile_program, refuse_rates
from rtamt.program.program import Program
from rtamt.program.timing import Period, as_period

_CONSTANTS: tuple[Literal["true", "false"], ...] = ("true", "false")
_SIDES: tuple[Literal["one", "other"], ...] = ("one", "other")

_Clash = list[tuple[str, tuple[int, int] | None]]
"""Parts that cannot hold together, with line and column; None for parts without a place."""


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
    """Check requirements for contradictions, tautologies, vacuity and redundancy.

    For each requirement: can a trace satisfy it, can a trace violate it, can the answer of each
    implication satisfy it, and does each part matter? For several: can one trace satisfy all, and
    which requirements imply or equal another? Z3 searches for traces up to a horizon (bounded model
    checking). The answer "yes" comes with a trace and its verdict from `judge`. The answer "no" is
    proved, or states how many samples were tried. Everything else is unknown, with the reason.

    Args:
        specs: A specification, or several by name; each requirement is checked.
        period: Seconds between samples; None: bounds are numbers of samples.
        end: The end mode, as in `judge`.
        assume: A condition that every trace satisfies, such as ``always(abs(x) < 3)``. The ranges
            of declarations and types are assumed too.
        rates: The minimum and maximum change of variables per second, or per sample if there is no
            period, such as ``{"x": (-2, 2)}``; assumed too.
        same_as: Requirements with the same names as ``specs``, or one requirement if ``specs`` is
            one. Then the only question is whether the same traces satisfy a requirement and its
            namesake.
        horizon: The maximum number of samples of a trace. If a requirement needs more, answers may
            be unknown.
        timeout: The maximum time for each question, in seconds.

    Returns:
        The answers; `Check.answer` summarizes them.

    Raises:
        ModuleNotFoundError: If Z3 is not installed; the extra ``check`` installs it.
        SpecificationError: If a requirement cannot be compiled: bounds that are not whole samples.
        InputError: If the horizon is below 1, the timeout not above 0, there is nothing to check,
            no trace satisfies the assumptions, or a name is only on one side of ``same_as``.

    Example:
        >>> import rtamt
        >>> checked = rtamt.check("always(x > 1 and (x > 0 or y > 2))")
        >>> str(checked.requirements["spec"].satisfiable), checked.answer
        ('yes, in 1 sample', 'no')
        >>> print(*checked.requirements["spec"].redundant)
        x > 0 or y > 2 demands nothing more (on traces of up to 16 samples)
        >>> rtamt.check({"low": "always(x < 3)", "high": "eventually(x > 5)"}).conflict
        ('low', 'high')

    References:
        Biere, Cimatti, Clarke and Zhu, "Symbolic model checking without BDDs", TACAS 1999.
        Dokhanchi, Hoxha and Fainekos, "Formal requirement debugging for testing and verification
        of cyber-physical systems", TECS 2018.
    """
    if same_as is not None:
        pairs = _pairs(specs, same_as)
        every = {f"{name} {i}": spec for name, pair in pairs.items() for i, spec in enumerate(pair)}
        questions = RequirementQuestions(every, period, end, assume, horizon, timeout, rates)
        return Check({}, same={name: _compared(*pair, questions) for name, pair in pairs.items()})
    questions = RequirementQuestions(specs, period, end, assume, horizon, timeout, rates)
    checkers = {name: _Checker(spec, questions) for name, spec in questions.specs.items()}
    checked = {name: checker.checked() for name, checker in checkers.items()}
    return _checked_set(checked, checkers, questions)


def equivalent(
    one: Spec,
    other: Spec,
    period: Period | None = None,
    *,
    end: End = "cut",
    assume: Spec | None = None,
    rates: Mapping[str, ValueRange] | None = None,
    horizon: int = 10_000,
    timeout: float = 10.0,
) -> Equivalence:
    """Return whether the same traces satisfy two requirements.

    If they differ, the answer has a trace that satisfies one requirement and violates the other, as
    judged by the monitors. The ranges that either requirement declares are assumed. See `check`.

    Args:
        one: A requirement.
        other: Another requirement.
        period: Seconds between samples; None: bounds are numbers of samples.
        end: The end mode, as in `judge`.
        assume: A condition that every trace satisfies.
        rates: The minimum and maximum change of variables, as for `check`.
        horizon: The maximum number of samples of a trace. If more are needed, the answer is
            unknown.
        timeout: The maximum time for each direction, in seconds.

    Raises:
        ModuleNotFoundError: If Z3 is not installed; the extra ``check`` installs it.
        SpecificationError: If a requirement cannot be compiled.
        InputError: If a specification has several requirements, or as for `check`.

    Example:
        >>> import rtamt
        >>> str(rtamt.equivalent("not eventually[0:3](x > 3)", "always[0:3](x <= 3)"))
        'yes'
        >>> answer = rtamt.equivalent("always(x < 3)", "always(x <= 3)")
        >>> str(answer), dict(answer.trace.columns)
        ('no, in 1 sample: other is satisfied, one is violated', {'x': (3.0,)})
    """
    specs = {"one": as_specification(one), "other": as_specification(other)}
    for name, spec in specs.items():
        if len(spec.requirements) > 1:
            names = ", ".join(spec.requirements)
            msg = f"{name}: expected one requirement, got {names}; give spec.requirements[NAME]"
            raise InputError(msg)
    questions = RequirementQuestions(specs, period, end, assume, horizon, timeout, rates)
    return _compared(specs["one"], specs["other"], questions)


class RequirementQuestions:
    """The requirements of a call of `check`, the search for traces, and what every trace assumes.

    It has the arguments and raises the errors of `check`. ``assumed`` is empty without an
    assumption.
    """

    def __init__(
        self,
        specs: Spec | Mapping[str, Spec],
        period: Period | None,
        end: End,
        assume: Spec | None,
        horizon: int,
        timeout: float,
        rates: Mapping[str, ValueRange] | None,
    ) -> None:
        if horizon < 1:
            msg = f"horizon: expected 1 sample or more, got {horizon}"
            raise InputError(msg)
        if not timeout > 0:
            msg = f"timeout: expected seconds, more than 0, got {timeout}"
            raise InputError(msg)
        self.specs = _named_requirements(specs)
        self.period = as_period(period)
        assumed = None if assume is None else as_specification(assume)
        every = [*self.specs.values(), *([assumed] if assumed else [])]
        for spec in every:
            refuse_rates(spec, "symbolic checking")
        integers = frozenset(
            name
            for spec in every
            for name, declared in spec.declarations.items()
            if is_whole(declared.type)
        )
        checked = _checked_rates(rates, (name for spec in every for name in spec.variables))
        limits = VariableLimits(_ranges(every), checked, self.period)
        self.end = checked_end(end)
        self.search = WitnessSearch(self.period, self.end, horizon, timeout, integers, limits)
        self.assumed = [Goal(self.program(assumed), holds=True)] if assumed else []
        if assumed and self.search.find(self.assumed).impossible:
            msg = f"assume: no trace satisfies {assumed.formula}; expected a satisfiable assumption"
            raise InputError(msg)

    def program(self, spec: Specification, formula: Formula | None = None) -> Program:
        """Return the program of a requirement, or of a formula in its place."""
        spec = spec if formula is None else spec.with_result(formula)
        return compile_program(spec, self.period)

    def goals(self, *goals: tuple[Program, bool]) -> list[Goal]:
        """Return goals together with the assumed one."""
        return [*(Goal(program, holds) for program, holds in goals), *self.assumed]

    def find(self, *goals: tuple[Program, bool]) -> SearchAnswer:
        """Search for a trace that reaches goals."""
        return self.search.find(self.goals(*goals))

    def find_short(self, *goals: tuple[Program, bool]) -> SearchAnswer:
        """Search for a short trace that reaches goals."""
        return self.search.find_short(self.goals(*goals))


def answer_of(result: SearchAnswer, clash: _Clash | None = None) -> Answer:
    """Return the answer for a search."""
    if result.trace is not None:
        return Answer("yes", result.trace)
    if result.impossible:
        texts, places = tuple(zip(*clash, strict=True)) if clash else ((), ())
        samples = 0 if result.none else result.samples
        return Answer("no", samples=samples, clash=texts, places=places)
    return Answer("unknown", why=result.why)


def _named_requirements(specs: Spec | Mapping[str, Spec]) -> dict[str, Specification]:
    if not isinstance(specs, Mapping):
        return {**as_specification(specs).requirements}
    if not specs:
        msg = "expected one specification or more, got an empty mapping"
        raise InputError(msg)
    named: dict[str, Specification] = {}
    for name, spec in specs.items():
        if not isinstance(name, str):
            msg = f"expected names of specifications as text, got {type(name).__name__}"
            raise InputTypeError(msg)
        parts = as_specification(spec).requirements
        named |= {f"{name}.{part}" if len(parts) > 1 else name: s for part, s in parts.items()}
    return named


def _ranges(specs: Iterable[Specification]) -> dict[str, tuple[float, float]]:
    """Return the values of each variable that all specifications allow."""
    specs = [*specs]
    used = dict.fromkeys(name for spec in specs for name in spec.variables)
    ranges: dict[str, tuple[float, float]] = {}
    for spec in specs:
        declared = {name: spec.declarations[name] for name in used if name in spec.declarations}
        own = {name: d.range or range_of_type(d.type) for name, d in declared.items()}
        limited = {name: values for name, values in own.items() if values is not None}
        for name, (lower, upper) in (limited | dict(spec.ranges)).items():
            known = ranges.get(name, (-math.inf, math.inf))
            ranges[name] = max(lower, known[0]), min(upper, known[1])
            if ranges[name][0] > ranges[name][1]:
                texts = f"{range_text(known)} and {range_text((lower, upper))}"
                msg = f"'{name}' has no value: specifications declare the ranges {texts}"
                raise InputError(msg)
    return ranges


def _checked_rates(
    rates: Mapping[str, ValueRange] | None, variables: Iterable[str]
) -> dict[str, ValueRange]:
    """Return rates as pairs of numbers, the lower one first."""
    if rates is None:
        return {}
    if not isinstance(rates, Mapping):
        raise InputTypeError(
            Argument("rates"), f" expected a mapping of variables, got {type(rates).__name__}"
        )
    known = [*dict.fromkeys(variables)]
    checked = {}
    for name, rate in rates.items():
        if name not in known:
            names = ", ".join(known) or "none"
            msg = f" expected variables of the specification, which are {names}, got '{name}'"
            raise InputError(Argument("rates"), msg)
        try:
            lower, upper = map(float, rate)
        except (TypeError, ValueError):
            lower, upper = math.nan, math.nan
        if not lower <= upper or lower == math.inf or upper == -math.inf:
            msg = f" '{name}': expected (lower, upper) with lower <= upper, got {rate!r}"
            raise InputError(Argument("rates"), msg)
        checked[name] = lower, upper
    return checked


class _Checker:
    """The questions about one requirement."""

    def __init__(self, spec: Specification, questions: RequirementQuestions) -> None:
        self.spec, self._questions = spec, questions
        self.program = questions.program(spec)
        self._signs = signs(spec.formula)
        self._first = 1  # a part may matter only on traces of this length or more

    def checked(self) -> CheckedRequirement:
        """Return the answers."""
        satisfied = self._find((self.program, True))
        satisfiable = answer_of(satisfied, self._clash(satisfied) if satisfied.impossible else [])
        violated = self._find((self.program, False))
        falsifiable = answer_of(violated, _limits(violated))
        triggers: dict[str, Answer] = {}
        if satisfiable.answer == "yes":
            for implication in implications(self.spec.formula):
                answer = self._find((self.program, True), (self.unanswered(implication), False))
                triggers[str(implication)] = answer_of(answer)
        redundant: list[RedundantPart] = []
        unknown: dict[str, str] = {}
        if satisfiable.trace is not None and falsifiable.trace is not None:
            self._first = max(satisfiable.trace.samples, falsifiable.trace.samples)
            never = {text for text, answer in triggers.items() if answer.answer == "no"}
            covered: set[Node] = set()
            for node in self._parts():
                result = None if node in covered or str(node) in never else self._redundant(node)
                if result is None or isinstance(result, RedundantPart):
                    covered |= {*node.nodes()}
                if isinstance(result, RedundantPart):
                    redundant.append(result)
                elif result:
                    unknown[str(node)] = result
        text = str(self.spec.formula)
        return CheckedRequirement(
            text, satisfiable, falsifiable, triggers, tuple(redundant), unknown
        )

    def unanswered(self, implication: Formula) -> Program:
        """Return the program of the requirement without the answer of an implication."""
        return self._with(unanswered(self.spec.formula, [implication]))

    def _find(self, *goals: tuple[Program, bool]) -> SearchAnswer:
        return self._questions.find_short(*goals)

    def _with(self, formula: Formula) -> Program:
        return self._questions.program(self.spec, formula)

    def _parts(self) -> Iterator[Formula]:
        """Yield the formulas below the requirement, each before the formulas below it."""
        for node in [*self.spec.formula.nodes()][-2::-1]:
            if isinstance(node, Formula) and node.args:  # not a constant
                yield node

    def _redundant(self, node: Formula) -> RedundantPart | str:
        """Return a redundant part; otherwise the reason if unknown, or "" if the part matters."""
        search, why = self._questions.search, ""
        for instead in _CONSTANTS:
            other = self._with(replaced(self.spec.formula, {node: make(instead, ())}))
            # If the requirement only rises with the part, it only rises with true in its place.
            differences = [
                self._questions.goals((other, holds), (self.program, not holds))
                for holds in {sign == (instead == "true") for sign in self._signs[node]}
            ]
            if len(differences) > 1 and any(map(search.seldom_changing, differences)):
                continue
            answers = [search.find(goals, self._first) for goals in differences]
            if all(answer.impossible for answer in answers):
                return RedundantPart(str(node), instead, max(answer.samples for answer in answers))
            if all(answer.trace is None for answer in answers):
                why = why or next(answer.why for answer in answers if not answer.impossible)
        return why

    def _clash(self, result: SearchAnswer) -> _Clash:
        """Return a minimal set of conjuncts and limits that clash; empty for one conjunct alone."""
        assumed, more = self._questions.assumed, _Clash()
        if assumed and self._questions.search.find([Goal(self.program, holds=True)]).trace:
            more.append((f"assumed: {assumed[0].program.specification.formula}", None))
        parts = list(_conjuncts(self.spec.formula))
        programs = [self._with(conjunct) for conjunct, _ in parts]

        def find(places: list[int]) -> SearchAnswer:
            return self._find(*((programs[position], True) for position in places))

        fewest = [0]
        if len(parts) > 1:
            fewest = _fewest(list(range(len(parts))), find)
            result = find(fewest)
        more += _limits(result)
        if len(parts) == 1 and not more:
            return []
        positions = self.spec.positions
        return [(str(parts[i][0]), positions.get(parts[i][1])) for i in fewest] + more


def _limits(result: SearchAnswer) -> _Clash:
    return [(text, None) for text in result.limits]


def _fewest(places: list[int], find: Callable[[list[int]], SearchAnswer]) -> list[int]:
    """Return a minimal set of places that no trace fulfils together."""
    result = find(places)
    fewest = [places[i] for i in result.core if i < len(places)] or places
    if len(fewest) < len(places) and not find(fewest).impossible:
        fewest = places
    for position in list(fewest):
        remainder = [other for other in fewest if other != position]
        if remainder and find(remainder).impossible:
            fewest = remainder
    return fewest


def _conjuncts(formula: Formula) -> Iterator[tuple[Formula, Formula]]:
    """Yield the conjuncts of a formula, each with the part of the text that it comes from.

    ``always(p and q)`` has the conjuncts ``always(p)``, from ``p``, and ``always(q)``, from ``q``.
    """
    name = formula.op.name if formula.op else ""
    if name == "and":
        for part in formula.args:
            yield from _conjuncts(cast("Formula", part))
    elif name == "always":
        below = [*_conjuncts(cast("Formula", formula.args[0]))]
        for part, source in below:
            conjunct = cast("Formula", make("always", (part,), formula.interval))
            yield conjunct, formula if len(below) == 1 else source
    else:
        yield formula, formula


def _checked_set(
    checked: Mapping[str, CheckedRequirement],
    checkers: Mapping[str, _Checker],
    q: RequirementQuestions,
) -> Check:
    """Return the answers for requirements one by one and together."""
    if len(checked) == 1:
        return Check(checked)
    names = [name for name, part in checked.items() if part.satisfiable.answer == "yes"]
    programs = {name: checker.program for name, checker in checkers.items()}

    def all_of(places: Iterable[int]) -> list[tuple[Program, bool]]:
        return [(programs[names[i]], True) for i in places]

    every = [*range(len(names))]
    both = q.find_short(*all_of(every)) if names else SearchAnswer()
    fewest = _fewest(every, lambda places: q.find(*all_of(places))) if both.impossible else []
    conflict = tuple(names[i] for i in fewest)
    together = answer_of(both, [(name, None) for name in conflict]) if len(names) > 1 else None
    triggers: dict[tuple[str, str], Answer] = {}
    if together and both.trace:
        for name in names:
            for implication in implications(checkers[name].spec.formula):
                if checked[name].triggers[str(implication)].answer == "yes":
                    other = checkers[name].unanswered(implication)
                    result = q.find(*all_of(every), (other, False))
                    triggers[name, str(implication)] = answer_of(result)
    falsifiable = [name for name in names if checked[name].falsifiable.answer == "yes"]
    implied, equal, unknown = _implications(falsifiable, programs, q)
    return Check(checked, together, conflict, triggers, implied, equal, unknown)


def _implications(
    names: Sequence[str], programs: Mapping[str, Program], q: RequirementQuestions
) -> tuple[dict[str, str], tuple[tuple[str, str], ...], dict[tuple[str, str], str]]:
    """Return `Check.implied`, `Check.equal` and `Check.unknown`."""
    implied: dict[str, str] = {}
    unknown: dict[tuple[str, str], str] = {}
    equal: list[tuple[str, str]] = []
    for a, b in itertools.combinations(names, 2):
        one, other = programs[a], programs[b]
        if {*one.variables}.isdisjoint(other.variables):
            continue  # both can be satisfied and violated, independently
        answers = q.find((one, True), (other, False)), q.find((other, True), (one, False))
        forward, backward = (answer.impossible for answer in answers)
        if forward and backward:
            equal.append((a, b))
        elif forward:
            implied.setdefault(b, a)
        elif backward:
            implied.setdefault(a, b)
        elif why := next((answer.why for answer in answers if answer.trace is None), ""):
            unknown[a, b] = why
    return implied, tuple(equal), unknown


def _pairs(
    specs: Spec | Mapping[str, Spec], others: Spec | Mapping[str, Spec]
) -> dict[str, tuple[Specification, Specification]]:
    """Return requirements with their namesakes; two single requirements are a pair."""
    ones, twos = _named_requirements(specs), _named_requirements(others)
    if len(ones) == len(twos) == 1:
        (other,) = twos.values()
        return {name: (one, other) for name, one in ones.items()}
    single = [name for name in (*ones, *twos) if not (name in ones and name in twos)]
    if single:
        raise InputError(
            Argument("same_as"),
            f" expected requirements of the same names, or one and one; {', '.join(single)} "
            f"{'is' if len(single) == 1 else 'are'} on one side only",
        )
    return {name: (one, twos[name]) for name, one in ones.items()}


def _compared(one: Specification, other: Specification, q: RequirementQuestions) -> Equivalence:
    """Return whether the same traces satisfy two requirements.

    For unbounded requirements, a proof compares the parts that differ. A suffix of a trace is a
    trace, so parts that are the same on all traces are the same at each instant if they do not look
    back.
    """
    result = _difference(q.program(one), q.program(other), q, q.assumed)
    if result.answer != "yes" or not result.samples:
        return result
    for pair in _differing(one.formula, other.formula):
        if any(map(_looks_back, pair)):
            continue
        parts = _difference(q.program(one, pair[0]), q.program(other, pair[1]), q, [])
        if parts.answer == "yes" and not parts.samples:
            return parts
        if parts.answer == "no":  # then smaller parts differ too
            break
    return result


def _difference(
    one: Program, other: Program, q: RequirementQuestions, assumed: Sequence[Goal]
) -> Equivalence:
    """Search for a trace that satisfies one program and violates the other."""
    samples, why = 0, ""
    for satisfied, (holds, fails) in zip(_SIDES, ((one, other), (other, one)), strict=True):
        goals = [Goal(holds, holds=True), Goal(fails, holds=False), *assumed]
        result = q.search.find_short(goals)
        if result.trace is not None:
            return Equivalence("no", result.trace, satisfied)
        if not result.impossible:
            why = why or result.why or "no trace was found, and none was ruled out"
        samples = max(samples, result.samples)
    return Equivalence("unknown", why=why) if why else Equivalence("yes", samples=samples)


def _differing(one: Formula, other: Formula) -> Iterator[tuple[Formula, Formula]]:
    """Yield pairs of parts that are the only difference of two formulas, the largest first."""
    while one.op is other.op and one.interval == other.interval:
        if len(one.args) != len(other.args):
            return
        sides = [(a, b) for a, b in zip(one.args, other.args, strict=True) if a != b]
        if len(sides) != 1 or not all(isinstance(side, Formula) for side in sides[0]):
            return
        one, other = cast("tuple[Formula, Formula]", sides[0])
        yield one, other


def _looks_back(formula: Formula) -> bool:
    operators = (node.op for node in formula.nodes())
    return any(op is not None and (op.timed or op.sampled) and not op.future for op in operators)
