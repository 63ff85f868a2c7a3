"""Unknown or uncertain samples: bounds around every trace that they allow."""

import copy
import itertools
import math
import pickle
import random
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
from bits import bits, identical
from choices import ENDS, Backend
from episode_monitors import offered
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_oracle import order
from profiles import examples
from strategies import VARIABLES, formulas, traces
from uncertain_traces import UNKNOWN, Uncertain, one_of, uncertain_traces

from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    Monitor,
    UncertainValue,
    VectorMonitor,
    Verdict,
    evaluate,
    explain,
    judge,
    number,
    variable,
)
from rtamt.machines.backend import BACKENDS
from rtamt.typing import End

INF, NAN = math.inf, math.nan
SPEC = "always(a > 1 implies eventually[0:2](b >= 0))"


def sample(trace: Uncertain, i: int, names: tuple[str, ...]) -> list[float | UncertainValue]:
    return [trace[name][i] for name in names]


def signed(*values: float) -> list[tuple[float, float]]:
    return [order(value) for value in values]


@given(formulas(3, endless=True), uncertain_traces(), st.integers(0, 2**32))
def test_every_trace_inside_has_its_value_inside_the_bounds(
    formula: Formula, trace: Uncertain, seed: int
) -> None:
    rng = random.Random(seed)
    n = len(trace["a"])
    for _ in range(3):
        its = one_of(trace, rng)
        end, stop = rng.choice(ENDS), rng.randrange(n) + 1
        bounded, plain = EpisodeMonitor(formula), EpisodeMonitor(formula)
        for i in range(stop):
            bounded.update(sample(trace, i, bounded.variables))
            plain.update([its[name][i] for name in plain.variables])
            lower, robustness, its_lower, value, its_upper, upper = signed(
                *(bounded.lower, bounded.robustness),
                *(plain.lower, plain.robustness, plain.upper, bounded.upper),
            )
            assert lower <= its_lower, i
            assert robustness <= value, i
            assert its_upper <= upper, i
        bounded.finish(end)
        plain.finish(end)
        assert signed(bounded.lower) <= signed(plain.lower), end
        assert signed(plain.upper) <= signed(bounded.upper), end
        if bounded.verdict is not Verdict.UNDECIDED:
            assert plain.verdict is bounded.verdict


@given(formulas(3, endless=True), uncertain_traces(), st.sampled_from(ENDS))
@settings(max_examples=examples(60))
def test_both_back_ends_agree_to_the_bit(formula: Formula, trace: Uncertain, end: End) -> None:
    monitors = [EpisodeMonitor(formula, backend=name) for name in BACKENDS]
    for i in range(len(trace["a"])):
        for monitor in monitors:
            monitor.update(sample(trace, i, monitor.variables))
        assert all(identical(offered(m), offered(monitors[0])) for m in monitors)
        assert len({str(m._machine.inputs) for m in monitors}) == 1
    for monitor in monitors:
        monitor.finish(end)
    assert all(identical(offered(m), offered(monitors[0])) for m in monitors)


@given(formulas(3, endless=True), uncertain_traces())
@settings(max_examples=examples(60))
def test_a_cut_moves_the_robustness_to_the_nearest_bound_of_both(
    formula: Formula, trace: Uncertain
) -> None:
    for backend in BACKENDS:
        monitor = EpisodeMonitor(formula, backend=backend)
        for i in range(len(trace["a"])):
            monitor.update(sample(trace, i, monitor.variables))
        complete = monitor.robustness
        assert identical([monitor.finish("cut")], [monitor.robustness])
        lower, before, after, upper = signed(
            monitor.lower, complete, monitor.robustness, monitor.upper
        )
        assert after == max(lower, min(before, upper))


def test_a_cut_moves_the_robustness_no_further_than_the_greatest_upper_bound(
    backend: Backend,
) -> None:
    # In a complete trace the window is empty, which is inf; in a cut one it is at most 1.
    monitor = EpisodeMonitor("(b > 0) or always[5:8](a > 0 and 1 > 0)", backend=backend)
    monitor.update(a=1.0, b=UncertainValue(0.0, 3.0))
    assert monitor.robustness == INF
    assert monitor.finish("cut") == 3.0
    assert monitor.bounds() == (0.0, 3.0)


@given(formulas(3, endless=True), traces(), st.sampled_from(ENDS))
@settings(max_examples=examples(60))
def test_without_an_unknown_sample_nothing_changes(
    formula: Formula, trace: dict[str, list[float]], end: End
) -> None:
    for backend in BACKENDS:
        plain = EpisodeMonitor(formula, backend=backend)
        ready = EpisodeMonitor(formula, backend=backend, nan="unknown")
        # An episode with unknown samples leaves no state.
        ready.update([NAN] * len(ready.variables))
        ready.reset()
        for i in range(len(trace["a"])):
            row = [trace[name][i] for name in plain.variables]
            assert identical(
                [plain.update(row)], [ready.update([UncertainValue(x, x) for x in row])]
            )
            assert identical(offered(plain), offered(ready))
        assert identical([plain.finish(end)], [ready.finish(end)])
        assert identical(offered(plain), offered(ready))
        assert plain.verdict is ready.verdict


def read_once(rng: random.Random, names: list[str], depth: int) -> Formula:
    """A formula that reads each variable once, without an operator that reads an operand twice."""
    if len(names) == 1 and (depth == 0 or rng.random() < 0.3):
        term, bound = variable(names[0]), number(rng.choice([-1.0, 0.0, 0.5]))
        return rng.choice([term > bound, term <= bound, (-term) >= bound, term * 2 - bound < 1])
    if len(names) == 1 or rng.random() < 0.3:
        below = read_once(rng, names, depth - 1)
        end = rng.choice([1, 2, None])
        return rng.choice([below.always(0, end), below.eventually(0, end), below.once(), ~below])
    cut = rng.randrange(1, len(names))
    p, q = (read_once(rng, part, depth - 1) for part in (names[:cut], names[cut:]))
    return rng.choice([p & q, p | q, p.implies(q), p.until(q, 0, 2), p.since(q)])


@pytest.mark.parametrize("seed", range(60))
def test_where_each_variable_is_read_once_the_bounds_are_reached(
    seed: int, backend: Backend
) -> None:
    rng = random.Random(seed)
    formula = read_once(rng, list(VARIABLES), 2)
    n = rng.randrange(1, 5)
    ends: dict[tuple[str, int], tuple[float, float]] = {}
    for name in VARIABLES:
        for i in range(n):
            x = rng.randrange(-8, 9) / 4
            ends[name, i] = x, x
    for place in rng.sample(list(ends), min(5, len(ends))):
        ends[place] = ends[place][0], ends[place][0] + rng.choice([0.25, 1.0, 3.0, INF])
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(n):
        monitor.update([UncertainValue(*ends[name, i]) for name in monitor.variables])
    monitor.finish()
    places = list(ends)
    values = []
    for corner in itertools.product(*({x, y} for x, y in ends.values())):
        at = dict(zip(places, corner, strict=True))
        data = {name: [at[name, i] for i in range(n)] for name in VARIABLES}
        values.append(float(evaluate(formula, data)[0]))
    least, greatest = min(values, key=order), max(values, key=order)
    assert identical(offered(monitor), (least, least, greatest)), (str(formula), ends)


def test_bounds_go_by_polarity(backend: Backend) -> None:
    e = EpisodeMonitor("a > 1 implies b > 0", backend=backend)
    # The left side counts negated, so its maximum is the worst case.
    assert e.update(a=UncertainValue(0, 4), b=-2.0) == -2.0
    assert identical(e.bounds(), (-2.0, 1.0))
    e = EpisodeMonitor("(a > 1) iff (a > 1)", backend=backend)  # it reads both polarities
    e.update(a=UncertainValue(0, 3))
    assert identical(e.bounds(), (-1.0, 2.0))


def test_terms_by_interval_arithmetic(backend: Backend) -> None:
    def verdict(text: str, **sample: float | UncertainValue) -> Verdict:
        monitor = EpisodeMonitor(text, backend=backend, nan="unknown")
        monitor.update(**sample)
        return monitor.verdict

    assert verdict("abs(x) >= 0", x=NAN) is Verdict.SATISFIED
    assert verdict("exp(x) >= 0", x=NAN) is Verdict.SATISFIED
    assert verdict("exp(x) < 0", x=NAN) is Verdict.VIOLATED
    assert verdict("min(x, 1) <= 1", x=NAN) is Verdict.SATISFIED
    assert verdict("abs(x) > 0", x=NAN) is Verdict.UNDECIDED
    assert verdict("x - x == 0", x=NAN) is Verdict.UNDECIDED  # each x is an interval of its own
    assert verdict("x == y", x=UncertainValue(1, 2), y=UncertainValue(3, 4)) is Verdict.VIOLATED
    assert verdict("x != y", x=UncertainValue(1, 2), y=UncertainValue(3, 4)) is Verdict.SATISFIED
    assert verdict("x == y", x=UncertainValue(1, 2), y=UncertainValue(2, 4)) is Verdict.UNDECIDED
    assert verdict("1 / x > 0", x=UncertainValue(0.5, 2)) is Verdict.SATISFIED
    assert verdict("1 / x > 0", x=UncertainValue(0, 2)) is Verdict.UNDECIDED
    assert verdict("sqrt(x) >= 0", x=UncertainValue(0, 4)) is Verdict.SATISFIED


def test_a_complete_trace_may_stay_undecided(backend: Backend) -> None:
    e = EpisodeMonitor("always(x > 1)", nan="unknown", backend=backend)
    for value in (5.0, NAN, 3.0):
        e.update(value)
    for end in ENDS:
        assert e.finish(end) == -INF
        assert identical(e.bounds(), (-INF, 2.0))
        assert e.verdict is Verdict.UNDECIDED
    e.reset()
    assert [e.update(5.0), e.upper, e.finish(), e.lower] == [4.0, 4.0, 4.0, 4.0]


@pytest.mark.parametrize("semantics", ["input-vacuity", "output-vacuity", "input-robustness"])
def test_neutral_predicates_and_unknown_samples_together(
    semantics: Literal["input-vacuity", "output-vacuity", "input-robustness"], backend: Backend
) -> None:
    text = "input float req; output float gnt; always(req >= 3 implies gnt >= 3)"
    rng = random.Random(7)
    for _ in range(40):
        e, plain = (EpisodeMonitor(text, semantics=semantics, backend=backend) for _ in range(2))
        for _ in range(3):
            req, gnt = (float(rng.randrange(0, 6)) for _ in range(2))
            e.update(
                req=UncertainValue(req - rng.choice([0, 1]), req), gnt=UncertainValue(gnt, gnt + 1)
            )
            plain.update(req=req, gnt=gnt)
            assert signed(e.lower, plain.upper) <= signed(plain.lower, e.upper)
        e.finish()
        plain.finish()
        assert signed(e.lower) <= signed(plain.lower)
        assert signed(plain.upper) <= signed(e.upper)


DUPLICATES: list[Callable[[Any], Any]] = [copy.copy, lambda m: pickle.loads(pickle.dumps(m))]


@pytest.mark.parametrize("duplicate", DUPLICATES, ids=["copy", "pickle"])
@given(trace=uncertain_traces(least=3, most=6), seed=st.integers(0, 9))
@settings(max_examples=examples(20))
def test_duplicates_go_on_alike_and_apart(
    duplicate: Callable[[Any], Any], trace: Uncertain, seed: int
) -> None:
    for backend in BACKENDS:
        original = EpisodeMonitor(SPEC, nan="unknown", backend=backend)
        for i in range(seed % 3):
            original.update(sample(trace, i, original.variables))
        twin = duplicate(original)
        before = bits(offered(original))
        twin.update(sample(trace, 2, twin.variables))
        assert bits(offered(original)) == before
        original.update(sample(trace, 2, twin.variables))
        assert identical(offered(original), offered(twin))
        twin.reset()
        assert identical(offered(twin), offered(EpisodeMonitor(SPEC)))


def test_a_default_stays_as_it_was(backend: Backend) -> None:
    text = "input float x; input float limit = 2.0; always(x <= limit)"
    e = EpisodeMonitor(text, backend=backend)
    e.update(x=0.0)
    e.update(x=0.0, limit=UncertainValue(1.0, 3.0))
    assert identical(e.bounds(), (-INF, 2.0))
    e.update(x=2.0)  # its limit is still unknown
    assert identical([e.robustness, e.upper], [-1.0, 1.0])


def test_hold_keeps_an_interval(backend: Backend) -> None:
    e = EpisodeMonitor("always(x > 0)", nan="hold", backend=backend)
    e.update(UncertainValue(1.0, 2.0))
    e.update(NAN)
    assert identical([e.robustness, e.upper], [1.0, 2.0])
    assert e._machine.inputs == [UncertainValue(1.0, 2.0)]


def test_an_error_leaves_the_monitor_as_it_was(backend: Backend) -> None:
    e = EpisodeMonitor("always(sqrt(x) + y > 0)", nan="unknown", backend=backend)
    for known in (1.0, UncertainValue(1.0, 2.0)):
        e.update(x=known, y=0.0)
        before = bits(offered(e)), e.samples
        for x, y in ((UncertainValue(-4.0, -1.0), 0.0), (-1.0, NAN), (-1.0, 0.0)):
            with pytest.raises(InputError, match=r"^'sqrt\(x\)' is not a number at sample \d"):
                e.update(x=x, y=y)
        assert (bits(offered(e)), e.samples) == before


def test_who_gives_no_bounds_refuses_with_the_reason(backend: Backend) -> None:
    reason = "EpisodeMonitor, VectorEpisodeMonitor and judge give bounds"
    for call in (
        lambda: Monitor("x > 0", nan="unknown", backend=backend),
        lambda: VectorMonitor("x > 0", 2, nan="unknown", backend=backend),
        lambda: evaluate("x > 0", {"x": [1.0]}, nan="unknown", backend=backend),
        lambda: evaluate("x > 0", {"x": [[1.0]]}, nan="unknown", backend=backend),
        lambda: explain("x > 0", {"x": [1.0]}, nan="unknown", backend=backend),
        lambda: Monitor("x > 0", backend=backend).update(UNKNOWN),
        lambda: Monitor("x > 0", backend=backend).update_many({"x": UncertainValue([1], [2])}),
        lambda: evaluate("x > 0", {"x": UncertainValue([1], [2])}, backend=backend),
    ):
        with pytest.raises(InputError, match=reason):
            call()
    assert Monitor("x > 0", backend=backend).update(UncertainValue(1, 1)) == 1.0  # it is known
    with pytest.raises(InputError, match=r"^expected nan='raise', nan='hold' or nan='unknown'"):
        EpisodeMonitor("x > 0", nan="skip", backend=backend)  # type: ignore[arg-type]


def test_an_explanation_needs_samples_that_are_known(backend: Backend) -> None:
    e = EpisodeMonitor("always(x > 0)", nan="unknown", history=True, backend=backend)
    e.update(1.0)
    e.update(UncertainValue(1.0, 2.0))
    with pytest.raises(InputError, match=r"^explain\(\) needs samples that are known, and"):
        e.explain()
    assert identical(offered(pickle.loads(pickle.dumps(e))), offered(e))


def test_an_interval_is_a_value() -> None:
    x = UncertainValue(1, 2)
    same = UncertainValue(1.0, 2.0)
    assert (x, hash(x), repr(x)) == (same, hash(same), "UncertainValue(1.0, 2.0)")
    assert x != UncertainValue(1, 3)
    assert x != 1.0
    columns = UncertainValue(0, np.array([1.0, 2.0]))
    assert columns == UncertainValue([0, 0], [1, 2]) == pickle.loads(pickle.dumps(columns))
    assert repr(columns) == "UncertainValue([0.0, 0.0], [1.0, 2.0])"
    assert isinstance(columns.lower, np.ndarray)
    with pytest.raises(ValueError, match="read-only"):
        columns.lower[0] = 5.0
    with pytest.raises(AttributeError, match="does not change"):
        x.lower = 3.0


@given(
    formulas(3, endless=True),
    uncertain_traces(),
    st.sampled_from(ENDS),
    st.sampled_from(["nan", "ends"]),
)
@settings(max_examples=examples(60))
def test_a_judgement_is_what_the_monitor_says(
    formula: Formula, trace: Uncertain, end: End, form: str
) -> None:
    n = len(trace["a"])
    pairs = {
        name: [(x.lower, x.upper) if isinstance(x, UncertainValue) else (x, x) for x in column]
        for name, column in trace.items()
    }
    columns: dict[str, Any] = {
        name: UncertainValue(*np.array(ends, np.float64).reshape(n, 2).T)
        for name, ends in pairs.items()
    }
    if form == "nan":  # unknown values as nan
        columns = {
            name: [
                NAN if x is UNKNOWN else low for (low, _), x in zip(ends, trace[name], strict=True)
            ]
            for name, ends in pairs.items()
        }
    for backend in BACKENDS:
        monitor = EpisodeMonitor(formula, backend=backend, nan="unknown")
        for i in range(n):
            monitor.update(
                [columns[v][i] if form == "nan" else trace[v][i] for v in monitor.variables]
            )
        open_verdicts = monitor.verdict
        monitor.finish(end)
        found = judge(formula, columns, end=end, n=n, backend=backend, nan="unknown")
        assert identical(offered(monitor), (found.robustness, found.lower, found.upper))
        assert found.verdict is monitor.verdict
        assert (found.decided_at is None) == (open_verdicts is Verdict.UNDECIDED)


def test_a_judgement_says_what_is_not_known(backend: Backend) -> None:
    columns = {"x": [3.0, NAN, 5.0], "y": [1.0, 1.0, 1.0]}
    for end in ENDS:
        found = judge("always(x > 1 or y > 2)", columns, end=end, nan="unknown", backend=backend)
        assert found.verdict is found.complete is Verdict.UNDECIDED
        assert found.unknown == ("x",)
        last = str(found).splitlines()[-1]
        assert last.startswith("undecided under every end mode: it depends on values of x that")
    known = judge("always(y > 2)", columns, nan="unknown", backend=backend)
    assert (known.unknown, known.undecided_because) == ((), "")
    with pytest.raises(InputError, match=r"^variable 'x' is nan at sample 1; pass nan='hold'"):
        judge(
            "always(x + y > 1)",
            {"x": [1, NAN], "y": UncertainValue([1, 1], [2, 2])},
            backend=backend,
        )
    with pytest.raises(InputError, match=r"^'sqrt\(x\)' is not a number at sample 1, where x = U"):
        judge("always(sqrt(x) > 1)", {"x": UncertainValue([1, -2], [2, -1])}, backend=backend)
