"""The drop-in classes for samples: laws on generated formulas, and forms of calls."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import pytest
from compat_specs import LANGUAGES, declared
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import robustness
from profiles import examples
from strategies import INTEGERS, VARIABLES, Trace, formulas, length, traces

import rtamt
from rtamt import (
    EpisodeMonitor,
    Formula,
    Monitor,
    Semantics,
    StlDenseTimeSpecification,
    StlDiscreteTimeOfflineSpecification,
    StlDiscreteTimeOnlineSpecification,
    StlDiscreteTimeSpecification,
)


def play(spec: StlDiscreteTimeOnlineSpecification, trace: Trace) -> list[float]:
    """Return the result of update at every sample."""
    n = length(trace)
    return [spec.update(i, [(name, trace[name][i]) for name in trace]) for i in range(n)]


# Laws. -------------------------------------------------------------------------------------------


@given(formula=formulas(endless=True), trace=traces())
def test_evaluate_matches_definition(formula: Formula, trace: Trace, backend: str) -> None:
    n = length(trace)
    time = [i / 4 for i in range(n)]
    spec = declared(formula, language=LANGUAGES[backend])
    spec.set_sampling_period(1, "s")
    expected = [[t, value] for t, value in zip(time, robustness(formula, trace, n), strict=True)]
    assert spec.evaluate({"time": time, **trace}) == expected


@given(formula=formulas(), trace=traces(most=16))
def test_update_is_late_by_the_latency(formula: Formula, trace: Trace, backend: str) -> None:
    n, late = length(trace), Monitor(formula).latency
    complete = robustness(formula, trace, n)
    so_far = [
        robustness(formula, {name: trace[name][: i + 1] for name in trace}, i + 1)[0]
        for i in range(min(late, n))
    ]
    assert play(declared(formula, language=LANGUAGES[backend]), trace) == [*so_far, *complete][:n]


@given(formula=formulas(), trace=traces())
def test_pastify_changes_nothing(formula: Formula, trace: Trace) -> None:
    plain, pastified = declared(formula), declared(formula)
    pastified.pastify()
    assert play(pastified, trace) == play(plain, trace)
    data = {"time": range(length(trace)), **trace}
    assert pastified.evaluate(data) == plain.evaluate(data)


@given(formula=formulas(), trace=traces(least=2), stop=st.integers(0, 12), shift=st.integers(0, 1))
def test_absent_variables_keep_values(
    formula: Formula, trace: Trace, stop: int, shift: int
) -> None:
    held = {name: list(values) for name, values in trace.items()}
    spec, robustnesses = declared(formula), []
    for i in range(length(trace)):
        sample: list[tuple[str, float]] = [("unknown", 7.0)]
        for k, name in enumerate(VARIABLES):
            if (i + k + stop) % 3 <= shift:
                held[name][i] = held[name][i - 1] if i else 0.0
            else:
                sample.append((name, trace[name][i]))
        robustnesses.append(spec.update(i, sample))
    assert robustnesses == play(declared(formula), held)


@given(formula=formulas(), trace=traces(), after=st.integers(1, 12))
def test_reset_starts_afresh(formula: Formula, trace: Trace, after: int) -> None:
    spec = declared(formula)
    play(spec, {name: values[:after] for name, values in trace.items()})
    spec.reset()
    assert play(spec, trace) == play(declared(formula), trace)


@settings(max_examples=examples(50))
@given(formula=formulas(), trace=traces(least=2), after=st.integers(0, 12))
def test_copies_go_on_by_themselves(formula: Formula, trace: Trace, after: int) -> None:
    spec = declared(formula)
    play(spec, {name: values[:after] for name, values in trace.items()})
    shift = {name: values[after:] for name, values in trace.items()}
    twins = [copy.deepcopy(spec), pickle.loads(pickle.dumps(spec))]
    expected = play(spec, shift)
    assert [play(twin, shift) for twin in twins] == [expected, expected]


@settings(max_examples=examples(50))
@given(p=formulas(2), q=formulas(2), trace=traces())
def test_get_value_of_named_formulas(p: Formula, q: Formula, trace: Trace) -> None:
    spec, monitor = declared("c > 0"), Monitor(f"p = {p}\nq = {q}\nout = p or q")
    spec.add_sub_spec(f"p = {p}")
    spec.add_sub_spec(f"q = {q}")
    spec.spec = "p or q"
    spec.parse()
    *_, last = play(spec, trace)
    for i in range(length(trace)):
        monitor.update({name: trace[name][i] for name in monitor.variables})
    assert spec.get_value("out") == last
    n = length(trace)
    for name, formula in (("p", p), ("q", q)):
        so_far = robustness(formula, trace, n)[0]
        expected = so_far if math.isnan(monitor.values[name]) else monitor.values[name]
        assert spec.get_value(name) == expected
    spec.evaluate({"time": range(n), **trace})
    assert [spec.get_value(name) for name in "pq"] == [robustness(f, trace, n) for f in (p, q)]
    assert spec.get_value("a") == trace["a"]


@settings(max_examples=examples(50))
@given(p=formulas(2), q=formulas(2), trace=traces(most=16))
def test_named_formula_before_its_latency(
    p: Formula, q: Formula, trace: Trace, backend: str
) -> None:
    spec = declared("c > 0", language=LANGUAGES[backend])
    spec.add_sub_spec(f"p = {p}")
    spec.spec = f"out = p or {q}"
    spec.parse()
    late, n = Monitor(p).latency, length(trace)
    complete = robustness(p, trace, n)
    for i in range(n):
        so_far = {name: trace[name][: i + 1] for name in trace}
        now = spec.update(i, [(name, trace[name][i]) for name in trace])
        assert spec.get_value("out") == now
        expected = robustness(p, so_far, i + 1)[0] if i < late else complete[i - late]
        assert spec.get_value("p") == expected


def test_a_result_may_be_a_number() -> None:
    for text in ("5", "out = 5", "out = c", "out = 3 + 2"):
        spec = StlDiscreteTimeSpecification()
        spec.declare_var("a", "float")
        spec.declare_const("c", "float", "5")
        spec.spec = text
        spec.parse()
        assert [spec.update(i, [("a", 1.0)]) for i in range(3)] == [5.0, 5.0, 5.0]
        assert spec.evaluate({"time": [0, 1], "a": [1.0, 2.0]}) == [[0, 5.0], [1, 5.0]]
        assert spec.get_value("out") == [5.0, 5.0]
    with pytest.raises(rtamt.ParseError, match="the result 'out' is the number 5"):
        rtamt.parse("out = 5")


@pytest.mark.parametrize("semantics", list(Semantics))
def test_semantics_are_those_of_all_monitors(semantics: Semantics, backend: str) -> None:
    text, trace = "always[0:1](a > b) implies (b > 1)", {"a": [3.0, 0.0, 5.0], "b": [1.0, 2.0, 0.5]}
    spec = declared(text, ("a", "b"), semantics=semantics, language=LANGUAGES[backend])
    spec.set_var_io_type("a", "input")
    interface: dict[str, Any] = {"semantics": semantics.value, "inputs": ["a"], "outputs": ["b"]}
    complete = rtamt.evaluate(text, trace, **interface)
    assert [value for _, value in spec.evaluate({"time": [0, 1, 2], **trace})] == list(complete)
    episode = EpisodeMonitor(text, **interface)
    assert play(spec, trace) == [episode.update(3.0, 1.0), *complete[:2]]


@pytest.mark.parametrize("given_as", ["input", rtamt.StlIOType.IN])
def test_an_io_type_is_a_word_or_a_member(given_as: str | rtamt.StlIOType) -> None:
    spec = declared("a > 2", semantics="output-robustness")
    spec.set_var_io_type("a", given_as)
    spec.spec = "a > 2 or b > 2"
    spec.parse()
    assert spec.update(0, [("a", 3.0), ("b", 0.0)]) == float("inf")
    spec.set_var_io_type("a", rtamt.StlIOType.UNDEFINED)
    assert spec.var_io_dict["a"] == "undefined"


def test_operators_that_do_not_chain_group_to_the_left() -> None:
    trace = {"a": [3.0, 2.0], "b": [1.0, 4.0], "c": [0.0, 5.0]}
    for word in ("implies", "until", "since", "unless[0:1]"):
        chained = declared(f"a > 1 {word} b > 1 {word} c > 1")
        grouped = declared(f"(a > 1 {word} b > 1) {word} c > 1")
        data = {"time": [0, 1], **trace}
        assert chained.evaluate(data) == grouped.evaluate(data), word


# Time. -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "period", "text"),
    [
        ("s", (500, "ms"), "eventually[0.5:1.5](a > 0)"),
        ("ms", (500, "ms"), "eventually[500:1500](a > 0)"),
        ("us", (0.5, "s"), "eventually[500:1500ms](a > 0)"),
        ("s", (1, "s"), "eventually[1:3](a > 0)"),
        ("s", (1 / 3, "s"), "eventually[0.333333333333:1](a > 0)"),
    ],
)
def test_bounds_periods_and_units_go_together(
    unit: str, period: tuple[float, str], text: str
) -> None:
    spec = StlDiscreteTimeOnlineSpecification()
    spec.declare_var("a", "float")
    spec.unit = unit
    spec.set_sampling_period(*period, 0.1)
    spec.spec = text
    spec.parse()
    if "333" in text:
        with pytest.raises(rtamt.RTAMTException, match="is not a multiple of the period 1/3 s"):
            spec.update(0, [("a", 1.0)])
        return
    assert [spec.update(i, [("a", x)]) for i, x in enumerate([1.0, 2.0, 3.0, 9.0])][3] == 9.0


def test_the_unit_and_the_period_may_come_after_parse() -> None:
    spec = declared("always[0:200](a > 0)", ("a",))
    spec.unit = "ms"
    spec.set_sampling_period(100, "ms")
    samples = enumerate([3.0, 2.0, 1.0, 4.0, 6.0, 7.0])
    values = [spec.update(100 * i, [("a", x)]) for i, x in samples]
    assert values == [3.0, 2.0, 1.0, 1.0, 1.0, 4.0]
    assert spec.sampling_violation_counter == 0
    assert spec.get_sampling_frequency() == 10.0


@pytest.mark.parametrize(
    ("times", "period", "unit", "violations"),
    [
        ([0, 1, 2], (1, "s", 0.1), "s", 0),
        ([0, 1.02, 1.98], (1, "s", 0.1), "s", 0),
        ([0, 1.02, 2.14], (1, "s", 0.1), "s", 1),
        ([0, 1.02, 2.14], (1, "s", 0.2), "s", 0),
        ([0, 0.9, 2.0], (1, "s", 0.1), "s", 0),
        ([0, 0.5, 1.0], (500, "ms", 0.1), "s", 0),
        ([0, 500, 1000], (500, "ms", 0.1), "ms", 0),
        ([0, 0.5, 1.0], (1, "s", 0.1), "s", 2),
        ([3, 3, 9, 10], (1, "s", 0), "s", 2),
    ],
)
def test_samples_that_come_early_or_late_are_counted(
    times: list[float], period: tuple[float, str, float], unit: str, violations: int
) -> None:
    spec = declared("a > 0", ("a",))
    spec.unit = unit
    spec.set_sampling_period(*period)
    for time in times:
        spec.update(time, [("a", 1.0)])
    assert spec.sampling_violation_counter == violations
    spec.reset()
    assert spec.sampling_violation_counter == 0
    spec.evaluate({"time": times, "a": [1.0] * len(times)})
    assert spec.sampling_violation_counter == violations


# Declarations. -----------------------------------------------------------------------------------


def test_what_is_declared_can_be_read_back() -> None:
    spec = declared("out = a >= b", ("a", "b", "out"))
    assert spec.free_vars == {"a", "b"}
    assert (spec.out_var, spec.out_var_field) == ("out", "")
    assert spec.var_object_dict == {"a": 0.0, "b": 0.0, "out": 0.0}
    spec.set_var_topic("a", "plant/a")
    assert spec.var_topic_dict == {"a": "plant/a", "b": "rtamt/b", "out": "rtamt/out"}
    assert spec.var_io_dict == dict.fromkeys(("a", "b", "out"), "output")


def test_the_text_may_declare_what_the_calls_do_not() -> None:
    spec = declared("specification brake\ninput float c = 2\nout = a > c", ("a", "b"))
    assert (spec.name, spec.var_io_dict["c"]) == ("brake", "input")
    assert spec.update(0, [("a", 5.0)]) == 3.0


def test_constants_are_numbers_or_text_and_may_be_bounds() -> None:
    spec = StlDiscreteTimeOfflineSpecification()
    spec.declare_const("k", "float", "1.5")
    spec.declare_const("n", "int", 1)
    spec.declare_var("a", "float")
    spec.spec = "always[0:n](a > k)"
    spec.parse()
    assert spec.evaluate({"time": [0, 1], "a": [2.0, 4.0]}) == [[0, 0.5], [1, 2.5]]


def test_named_formulas_may_be_terms() -> None:
    spec = declared("d = c >= -2;", ("a", "b", "c", "d"))
    spec.add_sub_spec("c = a + b;")
    spec.parse()
    data = {"time": [0, 1], "a": [100.0, -1.0], "b": [20.0, 2.0]}
    assert spec.evaluate(data) == [[0, 122.0], [1, 3.0]]
    assert spec.get_value("c") == [120.0, 1.0]


class Float:
    """A message."""

    def __init__(self, value: float = 0.0) -> None:
        self.value = value


def test_variables_may_be_messages() -> None:
    spec = StlDiscreteTimeSpecification()
    spec.import_module(__name__, "Float")
    for name in ("req", "gnt", "rob"):
        spec.declare_var(name, "Float")
    spec.spec = "rob.value = req.value >= 3 implies eventually[0:1](gnt.value >= 3)"
    spec.parse()
    assert (spec.out_var, spec.out_var_field, spec.free_vars) == ("rob", "value", {"req", "gnt"})
    samples = [(4.0, 0.0), (0.0, 5.0), (0.0, 0.0)]
    for i, (req, gnt) in enumerate(samples):
        now = spec.update(i, [("req", Float(req)), ("gnt", Float(gnt))])
        assert spec.get_value("rob").value == now
        twin = copy.deepcopy(spec)
    assert now == 3.0
    sample = [("req", Float(4.0)), ("gnt", Float(0.0))]
    assert twin.update(3, sample) == spec.update(3, sample) == 3.0
    reqs, gnts = ([Float(sample[k]) for sample in samples] for k in (0, 1))
    expected = [[0, 2.0], [1, 3.0], [2, 3.0]]
    assert spec.evaluate({"time": [0, 1, 2], "req": reqs, "gnt": gnts}) == expected


def test_a_text_imports_what_the_calls_have_imported() -> None:
    spec = StlDiscreteTimeSpecification()
    spec.spec = f"from {__name__} import Float\nFloat req\nreq.value > 1"
    with pytest.raises(rtamt.ParseError, match="was not given"):
        spec.parse()
    spec.import_module(__name__, "Float")
    spec.parse()
    assert spec.update(0, [("req", Float(3.0))]) == 2.0


def test_explain_says_what_decided_the_first_sample() -> None:
    spec = declared("always(a > b)", ("a", "b"))
    spec.set_sampling_period(0.5)
    spec.evaluate({"time": [3.0, 3.5, 4.0], "a": [5.0, 1.0, 4.0], "b": [0.0, 3.0, 1.0]})
    explanation = spec.explain()
    assert explanation.robustness == -2.0
    assert [cause.sample for cause in explanation.causes] == [1, 1]


def test_robustness_of_formula_without_outputs() -> None:
    spec = rtamt.StlDiscreteTimeSpecification(rtamt.Semantics.OUTPUT_ROBUSTNESS)
    spec.declare_var("req", "float")
    spec.set_var_io_type("req", "input")
    spec.spec = "req >= 3"
    spec.parse()
    assert spec.evaluate({"time": [0, 1], "req": [4, 1]}) == [[0, math.inf], [1, -math.inf]]


def test_message_without_result_field_error() -> None:
    spec = StlDiscreteTimeSpecification()
    spec.import_module(__name__, "Float")
    spec.declare_var("x", "float")
    spec.declare_var("rob", "Float")
    spec.spec = "rob.level = once(x > 0)"
    spec.parse()
    text = r"^'rob' \(Float\) has no field 'level'"
    for _ in range(2):
        with pytest.raises(rtamt.InputError, match=text):
            spec.update(0, [("x", 5.0)])
    spec.get_value("rob").level = 7.0
    with pytest.raises(rtamt.InputError, match="nan"):
        spec.update(0, [("x", math.nan)])
    assert spec.get_value("rob").level == 7.0
    assert spec.update(0, [("x", 3.0)]) == 3.0
    assert spec.get_value("rob").level == 3.0


def test_undeclared_names_warn(caplog: pytest.LogCaptureFixture) -> None:
    spec = declared("a > 0", ("a",))
    calls: list[tuple[Callable[[], None], str]] = [
        (lambda: spec.declare_var("a", "float"), "variable 'a' is declared again"),
        (
            lambda: spec.set_var_io_type("z", "input"),
            "variable 'z' is not declared; its io type is ignored",
        ),
        (
            lambda: spec.set_var_topic("z", "plant/z"),
            "variable 'z' is not declared; its topic is ignored",
        ),
    ]
    for call, _ in calls:
        call()
    assert [record.getMessage() for record in caplog.records] == [
        text_of_log for _, text_of_log in calls
    ]
    assert "z" not in spec.var_io_dict
    assert "z" not in spec.var_topic_dict


def test_roles_are_set_and_undone() -> None:
    spec = declared("a > 0", ("a",))
    spec.add_input_var("a")
    assert spec.var_io_dict == {"a": "input"}
    spec.remove_output_var("a")  # it is not an output
    assert spec.var_io_dict == {"a": "input"}
    spec.remove_input_var("a")
    assert spec.var_io_dict == {"a": "undefined"}
    spec.add_output_var("a")
    spec.remove_input_var("a")
    assert spec.var_io_dict == {"a": "output"}
    spec.remove_output_var("a")
    assert spec.var_io_dict == {"a": "undefined"}


def test_period_0_counts_every_new_time() -> None:
    spec = declared("a > 0", ("a",))
    spec.sampling_period = 0
    for time in (0, 1, 1, 3):
        spec.update(time, [("a", 1.0)])
    assert spec.sampling_violation_counter == 2


def test_earlier_dense_names() -> None:
    def built_value() -> rtamt.STLCTSpecification:
        spec = rtamt.STLCTSpecification(is_pure_python=True)
        spec.declare_var("x", "float")
        spec.spec = "once[0:1](x > 0)"
        spec.parse()
        return spec

    first, last = ["x", [(0, 1.0), (1, -2.0)]], ["x", [(2, 1.0), (4, -2.0)]]
    assert built_value().offline(first) == built_value().evaluate(first)
    one, other = built_value(), built_value()
    assert one.update(first) == other.update(first)
    assert one.update_final(last) == other.final_update(last)


def negative_zeros(values: list[float]) -> int:
    """Return how many values are -0.0."""
    return sum(value == 0 and math.copysign(1, value) < 0 for value in values)


@given(formula=formulas(), trace=traces(values=INTEGERS))
def test_no_sample_gives_a_zero_with_a_sign(formula: Formula, trace: Trace, backend: str) -> None:
    n = length(trace)
    spec = declared(formula, language=LANGUAGES[backend])
    spec.set_sampling_period(1, "s")
    pairs = spec.evaluate({"time": list(range(n)), **trace})
    assert negative_zeros([value for _, value in pairs]) == 0
    online = declared(formula, language=LANGUAGES[backend])
    given = [online.update(i, [(name, trace[name][i]) for name in trace]) for i in range(n)]
    assert negative_zeros(given) == 0


def dense(formula: str) -> StlDenseTimeSpecification:
    spec = StlDenseTimeSpecification()
    spec.declare_var("x", "float")
    spec.spec = formula
    spec.parse()
    return spec


@pytest.mark.parametrize("formula", ["x > 0", "not (x >= 0)", "x >= 0 and x > 0"])
def test_no_breakpoint_has_a_zero_with_a_sign(formula: str) -> None:
    events = [[0, 0], [1, 1], [2, 0], [3, 0]]
    values = [value for _, value in dense(formula).evaluate(["x", events])]
    assert 0.0 in values
    assert negative_zeros(values) == 0
    online = dense(formula)
    online_pairs = [
        value for _, value in online.update(["x", events]) + online.final_update(["x", []])
    ]
    assert 0.0 in online_pairs
    assert negative_zeros(online_pairs) == 0


def test_signs_of_zeros_are_not_steps() -> None:
    text = "(x >= 0 and x < 5) or (x - 5 > 0)"
    pairs = dense(text).evaluate(["x", [[0, 0], [1, 5], [2, 7], [3, 7]]])
    assert pairs[:2] == [[0.0, 0.0], [2.0, 2.0]]
