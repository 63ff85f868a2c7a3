"""`compare`: which of two policies satisfies the requirements more often, on the same seeds."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

from rtamt import InputError, InputTypeError, Verdict
from rtamt.errors import Argument
from rtamt.language import RequirementId
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.paired import (
    LEVEL,
    Compared,
    Effect,
    compared_of,
    effect_of,
    effect_sentence,
    holm,
    points,
)
from rtamt_gym.evaluation.replays import refuse_unrepeated
from rtamt_gym.play.runner import Requirements
from rtamt_gym.results.codec import SavedResult, document, plain, provenance_of, read_fields
from rtamt_gym.results.outcome import BY_END
from rtamt_gym.results.provenance import ChangedModelError, Provenance, listed
from rtamt_gym.results.statistics import SUCCESS
from rtamt_gym.results.trial import STOPPED, Trial
from rtamt_gym.results.warnings import NEVER, evidence_warnings
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.policies import check_name_of_policy
from rtamt_gym.tables import Terminal, counted, p_text, short, shorten

if TYPE_CHECKING:  # it is optional
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Comparison(SavedResult):
    """Two policies under the same requirements, on the same seeds; `compare` returns it.

    ``print`` shows a table and the significant differences. All differences are B minus A.

    Attributes:
        system: The name of the environment.
        a: The name of policy A.
        b: The name of policy B.
        seeds: The seeds of episodes of both policies.
        requirements: The comparison for every requirement, by name.
        success: The comparison for all requirements at once, with a p-value that is not adjusted.
        returns: The difference of the returns, the sums of the environment's own rewards; None
            without rewards.
        notes: Remarks on the pairs, each a sentence.
        ids: The ids of requirements with an id, by name.
    """

    system: str
    a: str
    b: str
    seeds: tuple[int, ...]
    requirements: Mapping[str, Compared]
    success: Compared
    returns: Effect | None
    notes: tuple[str, ...] = ()
    ids: Mapping[str, RequirementId] = field(default_factory=dict)

    kind: ClassVar = "comparison"

    @property
    def sentence(self) -> str:
        """The differences for each requirement, and for several also for all at once."""
        return " ".join(result.sentence for result in self.results)

    @property
    def results(self) -> tuple[Compared, ...]:
        """The comparison for every requirement; for several, also for all at once."""
        every = tuple(self.requirements.values())
        return every if len(every) == 1 else (*every, self.success)

    def to_frame(self) -> pd.DataFrame:
        """Return a data frame of pandas: a row for each of `results`, by name.

        Needs the extra ``pandas``.
        """
        try:
            import pandas as pd
        except ModuleNotFoundError as error:
            raise naming_extra(error, "Comparison.to_frame") from error
        names = pd.Index([result.name for result in self.results], name="requirement")
        return pd.DataFrame([_cells(result) for result in self.results], index=names)

    def to_json(self) -> str:
        """Return the comparison as strict JSON; infinities are ``"inf"`` and ``"-inf"``.

        Derived values, such as rates and sentences, are included for other programs.
        """
        stored = {field.name: getattr(self, field.name) for field in fields(self)}
        del stored["ids"]
        compared = self.requirements
        return document(
            self.kind,
            {
                **stored,
                "requirements": {name: value.formula for name, value in compared.items()},
                "compared": [_plain_compared(value) for value in compared.values()],
                "success": _plain_compared(self.success),
                **plain(Provenance(self.ids)),
            },
        )

    @classmethod
    def from_saved(cls, kept: Mapping[str, Any]) -> Self:
        """Return the comparison from the JSON of a result of the kind ``"comparison"``."""
        requirements = [read_fields(Compared, item) for item in kept["compared"]]
        return cls(
            kept["system"],
            kept["a"],
            kept["b"],
            tuple(kept["seeds"]),
            {requirement.name: requirement for requirement in requirements},
            read_fields(Compared, kept["success"]),
            None if kept["returns"] is None else read_fields(Effect, kept["returns"]),
            tuple(kept["notes"]),
            provenance_of(kept).ids,
        )

    def __repr__(self) -> str:
        return f"<Comparison of {self.a} and {self.b}: {counted(len(self.seeds), 'pair')}>"

    def __str__(self) -> str:
        return "\n".join(_lines(self))


def compare(
    a: Any,  # noqa: ANN401 - policies and environments of any library
    b: Any,  # noqa: ANN401
    env: Any = None,  # noqa: ANN401
    specs: Requirements | None = None,
    signals: Mapping[str, SignalLike] | None = None,
    *,
    names: Sequence[str] | None = None,
    accept_changed: bool = False,
    **options: Any,  # noqa: ANN401 - as for `evaluate_policy`
) -> Comparison:
    """Compare two policies on the same seeds: how much more often B satisfies each requirement.

    Episodes with the same seed have the same start, so they are compared in pairs, which takes
    fewer episodes than two separate evaluations. Episodes without a partner are left out.

    Args:
        a: An `Evaluation`; or a policy, as `evaluate_policy` takes it.
        b: The evaluation or policy to compare with A, of the same kind.
        env: The environment of two policies; None with evaluations.
        specs: The specifications for two policies, as `evaluate_policy` takes them.
        signals: As for `evaluate_policy`.
        names: The names of A and B, two different texts. Default: the names of the policies; if
            they are equal, followed by ``(A)`` and ``(B)``.
        accept_changed: Whether to compare evaluations although the environment, its source, rtamt
            or the simulator changed between them; a note states the change. Otherwise, a change is
            an error. Policies may differ.
        **options: Further arguments of `evaluate_policy`, for both policies, such as
            ``episodes=200``, except ``until_width=`` and ``target=``, which would stop each policy
            at another episode.

    Returns:
        The comparison: for every requirement the difference of the rates with a paired interval,
        the p-value of McNemar's exact test, and the paired difference of the robustness.

    Raises:
        InputError: If two evaluations cannot be paired, because their systems, periods, time
            limits, requirements, environments or evaluation options differ, they have no seed in
            common, or their seeds do not repeat episodes; if the names are not two; or as
            `evaluate_policy` does.
        InputTypeError: If they are neither two evaluations nor two policies with an environment.
    """
    own = {"env": env, "specs": specs, "signals": signals}
    arguments = {name: value for name, value in own.items() if value is not None} | options
    _check_arguments(a, b, arguments)
    two_names = None if names is None else _two_names(names)
    if env is not None:
        from rtamt_gym.evaluation.evaluate import check_repeats, evaluate_policy

        check_repeats(env, options.get("seed", 0))
        a, b = (evaluate_policy(policy, env, specs, signals, **options) for policy in (a, b))
    changes = _changes(a, b, accept_changed=accept_changed)
    return _paired(a, b, two_names or _distinct_names(a.policy, b.policy), changes)


def _changes(a: Evaluation, b: Evaluation, *, accept_changed: bool) -> list[str]:
    """Return notes on changes of the environment between two evaluations."""
    of_a, of_b = (item.record.provenance.fingerprint for item in (a, b))
    if of_a is None or of_b is None:
        names = " and ".join(n for n, value in (("A", of_a), ("B", of_b)) if value is None)
        return [f"no hashes of {names}: a change of the environment cannot be seen"]
    without = {*of_a.policy, *of_b.policy}
    every = of_a.changes(of_b, without=without)
    # An environment may come from an id in one evaluation and from a function in the other.
    changes = of_a.common(of_b).changes(of_b.common(of_a), without=without)
    if changes and not accept_changed:
        raise ChangedModelError(
            f"cannot compare: in B {listed(changes)}; evaluate both with the same environment, or "
            "compare all the same with ",
            Argument("accept_changed", value=True),
        )
    return [*(f"of B {item}" for item in every), *(f"of B {n}" for n in of_a.notes(of_b))]


def _two_names(names: object) -> tuple[str, str]:
    """Return the names of A and B, which are two different texts."""
    result = list(names) if isinstance(names, list | tuple) else []
    for item in result:
        check_name_of_policy(item)
    if len(result) != 2 or result[0] == result[1] or None in result:
        raise InputError(
            Argument("names"),
            f": expected two different texts, such as ('before', 'after'), got {names!r}",
        )
    return result[0], result[1]


def _distinct_names(a: str, b: str) -> tuple[str, str]:
    return (a, b) if a != b else (f"{a} (A)", f"{b} (B)")


def _check_arguments(a: object, b: object, others: Mapping[str, object]) -> None:
    """Raise InputTypeError unless A and B are two evaluations, or two policies with `env`."""
    evaluations = sum(isinstance(item, Evaluation) for item in (a, b))
    if evaluations == 2:
        if others:
            raise InputError(
                f"two evaluations have run already, got further arguments: {', '.join(others)}; "
                "leave them out"
            )
    elif evaluations or "env" not in others:
        raise InputTypeError(
            "expected two evaluations, or two policies and an environment, as in compare(old, new, "
            f"'CartPole-v1', ...), got {type(a).__name__} and {type(b).__name__} "
            f"{'with' if 'env' in others else 'without'} an environment; Evaluation.load reads a "
            "file"
        )
    for name in ("until_width", "target"):
        if others.get(name) is not None:
            raise InputError(
                f"{name}= would stop each policy at another episode; pass the same episodes= for "
                "both"
            )


def _paired(
    a: Evaluation, b: Evaluation, names: tuple[str, str], changes: Sequence[str]
) -> Comparison:
    """Compare two evaluations; `names` are the names of the policies."""
    _check_alike(a, b)
    places = [{row.seed: index for index, row in enumerate(item.record)} for item in (a, b)]
    seeds = [seed for seed in places[0] if seed is not None and seed in places[1]]
    if not seeds:
        raise InputError(
            f"cannot pair the episodes: A has {_seeds(a)}, B has {_seeds(b)}, none in common; "
            "evaluate both with the same ",
            Argument("seed"),
        )
    rows = [(a.record[places[0][seed]], b.record[places[1][seed]]) for seed in seeds]

    def compared(name: str, names: Collection[str]) -> Compared:
        of_a, of_b = (
            item.success if name == SUCCESS else item.requirements[name] for item in (a, b)
        )
        heights = [
            (of_a.robustness[places[0][seed]], of_b.robustness[places[1][seed]]) for seed in seeds
        ]
        counts = Counter((_satisfies(one, names), _satisfies(two, names)) for one, two in rows)
        return compared_of(name, of_a.formula, counts, _effect(heights), (a.interval, b.interval))

    result = {name: compared(name, [name]) for name in a.requirements}
    adjusted = holm({name: value.p for name, value in result.items()})
    rewards = [(a.returns[places[0][seed]], b.returns[places[1][seed]]) for seed in seeds]
    return Comparison(
        a.system,
        *names,
        tuple(seeds),
        {name: replace(value, adjusted=adjusted[name]) for name, value in result.items()},
        compared(SUCCESS, list(a.requirements)),
        _effect(rewards),
        (*_notes(a, b, rows, len(result)), *changes),
        a.record.provenance.ids,
    )


def _check_alike(a: Evaluation, b: Evaluation) -> None:
    """Raise InputError if systems, periods, limits, requirements or options differ."""
    for phrase, one, two in (
        ("system", a.system, b.system),
        ("period", a.period, b.period),
        # An unknown limit may be the same.
        ("time limit", *((a.limit, b.limit) if None not in (a.limit, b.limit) else (None, None))),
    ):
        if one != two:
            raise InputError(f"cannot compare: the {phrase} is {one} of A and {two} of B")
    # Episodes of a policy that draws random numbers still have the same start.
    if any(item.repeats is False and not item.differing for item in (a, b)):
        refuse_unrepeated(a.system)
    texts_a, texts_b = a.record.requirements, b.record.requirements
    if set(texts_a) != set(texts_b):
        raise InputError(
            f"cannot compare: the requirements are {listing(texts_a)} of A and {listing(texts_b)} "
            "of B; evaluate both with the same"
        )
    for name, text in texts_a.items():
        if text != texts_b[name]:
            raise InputError(f"cannot compare: {name} is {text} of A and {texts_b[name]} of B")
    if a.evaluation_options is not None and b.evaluation_options is not None:
        _check_read_alike(a.evaluation_options, b.evaluation_options)


def _check_read_alike(a: Mapping[str, Any], b: Mapping[str, Any]) -> None:
    """Raise InputError if the evaluations are known to have different options."""
    differences = [
        f"{name} is {one!r} of A and {two!r} of B" for name, one, two in _differences(a, b)
    ]
    if differences:
        raise InputError(
            f"cannot compare, because evaluation options differ: {', '.join(differences)}; "
            "evaluate both with the same"
        )


def _differences(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    """Return the differences with both values."""
    for name in a:
        if name != "signals" and name in b and a[name] != b[name]:
            yield f"{name}=", a[name], b[name]
    one, two = a.get("signals", {}), b.get("signals", {})
    for name in one:
        if None not in (one[name], two.get(name)) and one[name] != two[name]:
            yield f"the signal {name}", one[name], two[name]


def _seeds(evaluation: Evaluation) -> str:
    seeds = [row.seed for row in evaluation.record if row.seed is not None]
    return f"the seeds {min(seeds)} to {max(seeds)}" if seeds else "no seeds"


def _satisfies(row: Trial, names: Collection[str]) -> bool:
    """Return whether an episode satisfies requirements; a failed episode does not."""
    return not row.error and all(
        name in row.outcomes and row.outcomes[name].verdict is Verdict.SATISFIED for name in names
    )


def _effect(pairs: Sequence[tuple[float, float]]) -> Effect | None:
    """Return the effect over the pairs that have no nan."""
    known = [(x, y) for x, y in pairs if not (math.isnan(x) or math.isnan(y))]
    return effect_of([x for x, _ in known], [y for _, y in known])


def _notes(
    a: Evaluation, b: Evaluation, rows: Sequence[tuple[Trial, Trial]], requirements: int
) -> Iterator[str]:
    """Yield remarks on the pairs."""
    for name, evaluation, side in (("A", a, 0), ("B", b, 1)):
        if left := len(evaluation.record) - len(rows):
            yield (
                f"{counted(left, 'episode')} of {name} {'is' if left == 1 else 'are'} left out: "
                f"{'B' if name == 'A' else 'A'} has no episode with the same seed"
            )
        if failed := [pair[side] for pair in rows if pair[side].error]:
            error = shorten(" ".join(failed[0].error.split()), 200)
            yield (
                f"{counted(len(failed), 'episode')} of {name} failed, which counts as not "
                f"satisfied; the first with seed {failed[0].seed}: {error}"
            )
        if ended := sum(_by_end(pair[side]) for pair in rows):
            verb, pronoun = ("is", "its") if ended == 1 else ("are", "their")
            yield (
                f"{counted(ended, 'episode')} of {name} {verb} violated {BY_END}, although "
                f"the samples satisfy the requirement: {pronoun} robustness covers only the samples"
            )
        if (reuse := evaluation.record.provenance.reuse) is not None:
            yield from (f"{name}: {mixture.line('episode')}" for mixture in reuse.mixtures)
        warnings = evidence_warnings(evaluation.record, "episode")
        yield from (f"{warning.text} of {name}" for warning in warnings if warning.kind == NEVER)
        if evaluation.decision is not None:
            yield (
                f"{name} stopped once its answer was known, so its rate may be biased towards that "
                "answer; compare fixed numbers of episodes"
            )
    if len({any(row.ended in STOPPED for row in item.record) for item in (a, b)}) == 2:
        yield (
            "only one side stopped episodes early, which leaves requirements open and changes "
            "robustness and returns; compare evaluations with the same stop="
        )
    if 2 * 0.5 ** len(rows) * requirements > LEVEL:
        yield f"{counted(len(rows), 'pair')} cannot show a difference of rates, however they end"


def _by_end(row: Trial) -> bool:
    """Return whether the end alone of an episode violates a requirement."""
    return any(value.by_end for value in row.outcomes.values())


def _plain_compared(compared: Compared) -> dict[str, Any]:
    derived = ("pairs", "rate_a", "rate_b", "difference", "sentence")
    stored: dict[str, Any] = plain(compared)
    return stored | {name: getattr(compared, name) for name in derived}


def _cells(compared: Compared) -> dict[str, Any]:
    """Return the row of a data frame."""
    low, high = compared.interval
    cells = {
        "A": compared.rate_a,
        "B": compared.rate_b,
        "difference": compared.difference,
        "low": low,
        "high": high,
        "p": compared.p,
        "adjusted p": compared.adjusted,
    }
    cells |= {key: getattr(compared, key) for key in ("both", "only_a", "only_b", "neither")}
    effect = compared.robustness
    cells["robustness difference"] = math.nan if effect is None else effect.value
    ends = (math.nan, math.nan) if effect is None else effect.interval
    cells |= dict(zip(("robustness low", "robustness high"), ends, strict=True))
    return cells


def _lines(comparison: Comparison) -> Iterator[str]:
    """Yield the lines of the table of a comparison, of 80 columns."""
    terminal, results = Terminal(), comparison.results
    seeds, pairs = comparison.seeds, counted(len(comparison.seeds), "pair")
    yield terminal.cut(f"A: {comparison.a}")
    yield terminal.cut(f"B: {comparison.b}")
    yield terminal.cut(
        f"{comparison.system}, {pairs} of episodes, seeds {min(seeds)} to {max(seeds)}"
    )
    yield ""
    names = ["requirement", "A", "B", "B - A", "95%", "p", "robustness", "95%"]
    rows = [[result.name, *_texts(result)] for result in results]
    yield from terminal.table([names, *rows], "<" + ">" * 7)
    for result in results:
        yield ""
        yield from terminal.wrapped(result.sentence)
    below = []
    if comparison.returns is not None:
        below.append(effect_sentence(comparison.returns, "the return"))
    if len(results) > 1:
        below.append(
            f"p: McNemar's exact test, adjusted by Holm's method for {len(results) - 1} "
            "requirements, but of all at once; intervals are of each alone."
        )
    below += [f"note: {note}" for note in comparison.notes]
    yield from [""] if below else []
    for text in below:
        yield from terminal.wrapped(text)


def _texts(compared: Compared) -> list[str]:
    """Return the cells of a requirement."""
    pairs = compared.pairs
    rates = (f"{points(rate, pairs)}%" for rate in (compared.rate_a, compared.rate_b))
    gap, *ends = (
        _signed(points(item, pairs)) for item in (compared.difference, *compared.interval)
    )
    p = p_text(compared.adjusted).removeprefix("p ").removeprefix("= ").replace(" ", "")
    return [*rates, gap, " to ".join(ends), p, *_effect_texts(compared.robustness)]


def _effect_texts(effect: Effect | None) -> tuple[str, str]:
    """Return the cells of an effect: the difference, and its interval."""
    if effect is None:
        return "-", "-"
    low, high = effect.interval
    known = math.isfinite(low) or math.isfinite(high)
    ends = f"{_signed(short(low, 2))} to {_signed(short(high, 2))}" if known else "-"
    return _signed(short(effect.value, 2)), ends


def _signed(text: str) -> str:
    return text if text.startswith("-") or float(text) == 0 else f"+{text}"
