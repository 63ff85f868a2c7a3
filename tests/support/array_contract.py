"""The contracts of array monitors: their numbers equal the C++ machines.

The tests of a library subclass the contracts and pass an `ArrayLibrary`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import array_cases as cases
import numpy as np
import pytest
import strategies as s
from bits import bits
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import rtamt
from rtamt.errors import InputError, InputTypeError, SpecificationError
from rtamt_arrays.operations import Tensor

__all__ = ["ArrayLibrary", "ArrayMonitor", "EpisodeContract", "OfflineContract", "OnlineContract"]

ArrayMonitor = Any
"""A monitor of either library."""

READ = ("robustness", "lower", "upper", "verdict")

# One process may test both libraries.
few = settings(cases.few, suppress_health_check=[*HealthCheck])


class ArrayLibrary(Protocol):
    """The functions of a library that the contracts need."""

    @property
    def arrays(self) -> ArrayMonitor:
        """Return the package of monitors on its arrays."""

    @property
    def kinds(self) -> Sequence[object]:
        """Return the dtypes of floats with 24 and with 8 bits."""

    def doubles(self, values: Tensor) -> Tensor:
        """Return the values as doubles."""

    def tensor(self, values: object) -> Tensor:
        """Return an array of doubles, or of booleans for boolean values."""

    def traced(self, call: Callable[[], object]) -> object:
        """Call a function; a library that traces does so here."""

    def readings(
        self,
        monitors: Sequence[ArrayMonitor],
        samples: NDArray[np.float64],
        resets: NDArray[np.bool_],
    ) -> list[Mapping[str, NDArray[np.float64]]]:
        """Return the reading of each monitor after each sample, by name."""

    def evaluated(
        self, evaluations: Sequence[Callable[[Tensor], Tensor]], samples: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Return the values of functions of samples."""

    def gradients(
        self, functions: Sequence[Callable[[Tensor], Tensor]], samples: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        """Return the gradients of functions of samples with one number as result."""

    def sum_of_finite(self, values: Tensor) -> Tensor:
        """Return the sum of the finite values."""

    def robustness_sum(self, monitor: ArrayMonitor, samples: Tensor) -> Tensor:
        """Return the sum of the robustness over entries and all steps after the latency."""


def places(names: Sequence[str]) -> list[int]:
    """Return the columns of variables in samples."""
    return [s.VARIABLES.index(name) for name in names]


def begins_alone(
    library: ArrayLibrary,
    monitor: ArrayMonitor,
    expected: rtamt.VectorMonitor | rtamt.VectorEpisodeMonitor,
) -> None:
    """Start three entries in turns, and take samples together between."""
    random, state = np.random.default_rng(7), monitor.init(3)
    for _ in range(20):
        mask, first, sample = random.random(3) < 0.4, random.normal(size=3), random.normal(size=3)
        state, begun = monitor.begin(state, {"x": library.tensor(first)}, library.tensor(mask))
        expected.reset(mask)
        found = np.array(begun.robustness.tolist())[mask]
        assert bits(found) == bits(expected.update(first[:, None], mask)[mask])
        state, reading = monitor.update(state, {"x": library.tensor(sample)})
        assert bits(reading.robustness.tolist()) == bits(expected.update(sample[:, None]))


class OnlineContract:
    """The contract of `online`."""

    library: ArrayLibrary

    @few
    @given(cases.cases())
    def test_online_equals_vector_monitor(self, case: cases.Case) -> None:
        monitors = [self.library.arrays.online(formula) for formula in case.formulas]
        readings = self.library.readings(monitors, case.samples, case.resets)
        for formula, reading in zip(case.formulas, readings, strict=True):
            found = np.ravel(reading["robustness"])
            assert bits(found) == bits(np.ravel(case.online(formula))), formula

    @settings(few, max_examples=3)
    @given(cases.cases(outermost=False))
    def test_online_gradient_equals_offline(self, case: cases.Case) -> None:
        arrays, library = self.library.arrays, self.library
        samples = np.random.default_rng(1).normal(size=case.samples.shape)
        monitors = [arrays.online(formula) for formula in case.formulas]

        def online(monitor: ArrayMonitor) -> Callable[[Tensor], Tensor]:
            return lambda x: library.robustness_sum(monitor, x[..., places(monitor.variables)])

        def offline(monitor: ArrayMonitor, formula: rtamt.Formula) -> Callable[[Tensor], Tensor]:
            end = max(0, cases.SAMPLES - monitor.latency)
            return lambda x: arrays.evaluate(formula, cases.columns(formula, x))[:, :end].sum()

        found = library.gradients([online(m) for m in monitors], samples)
        pairs = zip(monitors, case.formulas, strict=True)
        expected = library.gradients([offline(*pair) for pair in pairs], samples)
        for x, y in zip(found, expected, strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12)

    def test_nan_lasts_until_reset(self) -> None:
        tensor = self.library.tensor
        monitor = self.library.arrays.online("once[0:1](sqrt(x) > 1 or x > 2)")
        state, seen = monitor.init(2), []
        for x, y in ((4.0, 4.0), (-1.0, 4.0), (4.0, 4.0)):
            state, reading = monitor.update(state, {"x": tensor([x, y])})
            seen.append((reading.nan.tolist(), np.isnan(reading.robustness.tolist()).tolist()))
        assert seen == [([False] * 2,) * 2, ([True, False],) * 2, ([True, False],) * 2]
        _, reading = monitor.update(monitor.reset(state), {"x": tensor([4.0, 4.0])})
        assert reading.robustness.tolist() == [2.0, 2.0]

    @pytest.mark.parametrize("text", ["historically[0:3](x > 0) and once(x > 1)", "x > 0"])
    def test_entries_begin_while_the_others_take_no_sample(self, text: str) -> None:
        begins_alone(self.library, self.library.arrays.online(text), rtamt.VectorMonitor(text, 3))

    def test_integers_and_booleans_are_numbers(self) -> None:
        monitor = self.library.arrays.online("x > 0")
        for sample in ([True, False], [1, 0]):
            _, reading = monitor.update(monitor.init(2), {"x": self.library.tensor(sample)})
            assert reading.robustness.tolist() == [1.0, 0.0]

    @pytest.mark.parametrize(
        ("call", "error", "message"),
        [
            (lambda m, s, t: m.update(s, {"y": t([1.0] * 2)}), InputError, "variable 'x', got y"),
            (lambda m, s, t: m.update(s, {"x": t([1.0] * 3)}), InputError, "shape (2,) of 'x'"),
            (
                lambda m, s, t: m.update(s, t([[1.0] * 3] * 2)),
                InputError,
                "1 variable (x), got shape (2, 3)",
            ),
            (lambda m, s, _: m.update(s, {"x": [1.0, 2.0]}), InputTypeError, "convert with"),
            (
                lambda m, s, _: m.update(s, None),
                InputTypeError,
                "for 1 variable (x), by name or as",
            ),
            (lambda m, s, t: m.update(s, {"x": t([1j, 1])}), InputTypeError, "of real numbers"),
            (
                lambda m, s, t: m.update((s,), {"x": t([1.0] * 2)}),
                InputTypeError,
                "init(batch_size) returns",
            ),
            (lambda m, s, t: m.reset(s, t([1.0] * 2)), InputTypeError, "mask of booleans"),
            (lambda m, s, _: m.reset(s, [True] * 2), InputTypeError, "of shape (2,), got "),
            (lambda m, s, t: m.reset(s, t([0, 1])), InputTypeError, ".arange(2), indices) for"),
            (lambda m, s, t: m.reset(s, t([True] * 3)), InputError, "mask of shape (2,)"),
            (lambda m, s, t: m.reset(s._replace(nan=t([1, 0]))), InputTypeError, "as 'nan', got"),
            (lambda m, s, _: m.reset(s._replace(age=[0, 0])), InputTypeError, "'age', got list"),
            (lambda m, s, _: m.reset(s._replace(ring=m.init(3).ring)), InputError, "or batch size"),
            (lambda m, *_: m.init(0), InputError, "expected 1 or more batch entries, got 0"),
            (lambda m, *_: m.init(2.0), InputTypeError, "number of batch entries, got 2.0"),
            (lambda m, *_: m.init(True), InputTypeError, "number of batch entries, got True"),  # noqa: FBT003
        ],
    )
    def test_what_is_wrong_is_refused_when_it_is_traced(
        self, call: Callable[..., object], error: type[Exception], message: str
    ) -> None:
        monitor = self.library.arrays.online("once[0:1](x > 0)")
        with pytest.raises(error) as refused:
            self.library.traced(lambda: call(monitor, monitor.init(2), self.library.tensor))
        assert message in str(refused.value)

    def test_entries_may_be_a_whole_number_of_any_kind(self) -> None:
        monitor = self.library.arrays.online("x > 0")
        assert monitor.init(np.int64(3)).age.shape == (3,)
        with pytest.warns(DeprecationWarning, match=r"init\(lanes=\) is now init\(batch_size=\)"):
            assert monitor.init(lanes=2).age.shape == (2,)

    @pytest.mark.parametrize("made", ["online", "episode"])
    def test_states_of_other_kinds_of_numbers_are_refused(self, made: str) -> None:
        make, x = getattr(self.library.arrays, made), {"x": self.library.tensor([1.0, 1.0])}
        monitor, other = (make("once[0:1](x > 0)", dtype=d) for d in self.library.kinds)
        calls: list[Callable[[], object]] = [
            lambda: monitor.update(other.init(2), x),
            lambda: monitor.reset(other.init(2)),
        ]
        for call in calls:
            with pytest.raises(InputTypeError, match=r"float32 as '.*', got .*bfloat16"):
                call()

    def test_online_repr(self) -> None:
        monitor = self.library.arrays.online("eventually[0:2](x > 0)")
        assert "Monitor of eventually[0:2](x > 0), latency 2, " in repr(monitor)
        assert repr(monitor).endswith("float64>")
        assert " of always(x > 0), " in repr(self.library.arrays.episode("always(x > 0)"))

    def test_states_of_another_specification_are_refused(self) -> None:
        monitor, other = map(self.library.arrays.online, ("once[0:1](x > 0)", "once[0:9](x > 0)"))
        with pytest.raises(InputError, match="the state belongs to another specification"):
            monitor.update(other.init(2), {"x": self.library.tensor([1.0, 1.0])})

    def test_online_refuses_unbounded_future(self) -> None:
        with pytest.raises(SpecificationError, match="whole future"):
            self.library.arrays.online("always(x > 0) or x > 1")

    def test_numbers_that_are_no_floats_are_refused(self) -> None:
        with pytest.raises(InputTypeError, match="a dtype of floats"):
            self.library.arrays.online("x > 0", dtype=self.library.tensor([True]).dtype)


class Cut:
    """A monitor of episodes that reads a trace as cut after each sample."""

    def __init__(self, monitor: ArrayMonitor) -> None:
        self._monitor = monitor
        self.variables, self.init, self.reset = monitor.variables, monitor.init, monitor.reset

    def update(self, state: ArrayMonitor, sample: Tensor) -> tuple[ArrayMonitor, ArrayMonitor]:
        """Return the next state, and the reading of a trace that is cut."""
        following, _, cut = self._monitor.update_and_cut(state, sample)
        return following, cut


class EpisodeContract:
    """The contract of `episode`."""

    library: ArrayLibrary

    @few
    @given(cases.cases(endless=True))
    def test_bounds_equal_vector_monitor(self, case: cases.Case) -> None:
        monitors = [self.library.arrays.episode(formula) for formula in case.formulas]
        readings = self.library.readings(monitors, case.samples, case.resets)
        for formula, reading in zip(case.formulas, readings, strict=True):
            for name, expected in zip(READ, case.episode(formula, READ), strict=True):
                found = np.ravel(reading[name])
                assert bits(found) == bits(np.ravel(expected)), (name, formula)

    @few
    @given(cases.cases(endless=True))
    def test_cut_ends_equal_vector_monitor(self, case: cases.Case) -> None:
        monitors = [Cut(self.library.arrays.episode(formula)) for formula in case.formulas]
        readings = self.library.readings(monitors, case.samples, case.resets)
        for formula, reading in zip(case.formulas, readings, strict=True):
            for name, expected in zip(READ, case.episode(formula, READ, cut=True), strict=True):
                found = np.ravel(reading[name])
                assert bits(found) == bits(np.ravel(expected)), (name, formula)

    @pytest.mark.parametrize(
        "text",
        [
            "always((a > 0) since[2:2] eventually(b > 0))",
            "not always[0:2]((eventually(a > 0)) since[3:3] (b > 0))",
        ],
    )
    def test_one_sample_window_reads_known_and_open_values(self, text: str) -> None:
        formula, random = rtamt.parse(text).formula, np.random.default_rng(11)
        samples = random.normal(size=(cases.SAMPLES, cases.ENTRIES, len(s.VARIABLES)))
        resets = random.random(samples.shape[:2]) < 0.1
        case = cases.Case([formula], samples, resets)
        monitor = self.library.arrays.episode(formula)
        read = self.library.readings([monitor, Cut(monitor)], samples, resets)
        for reading, cut in zip(read, (False, True), strict=True):
            for name, expected in zip(READ, case.episode(formula, READ, cut=cut), strict=True):
                assert bits(np.ravel(reading[name])) == bits(np.ravel(expected)), name

    @pytest.mark.parametrize("text", ["always[0:3](x > 0) or eventually(x > 1)", "x > 0"])
    def test_entries_begin_while_the_others_take_no_sample(self, text: str) -> None:
        expected = rtamt.VectorEpisodeMonitor(text, 3)
        begins_alone(self.library, self.library.arrays.episode(text), expected)

    def test_update_and_cut_equals_update(
        self,
    ) -> None:
        monitor = self.library.arrays.episode("always((x > 0) implies eventually[0:2](x > 1))")
        state, sample = monitor.init(2), {"x": self.library.tensor([0.5, -1.0])}
        expected = monitor.update(state, sample)
        *found, cut = monitor.update_and_cut(state, sample)
        for x, y in zip((*found[0], *found[1]), (*expected[0], *expected[1]), strict=True):
            assert bits(np.ravel(x)) == bits(np.ravel(y))
        assert cut.verdict.tolist() == [0, 1]
        assert found[1].verdict.tolist() == [0, 0]

    def test_nan_leaves_bounds_open(self) -> None:
        tensor = self.library.tensor
        monitor = self.library.arrays.episode("always(x > 0)")
        state, _ = monitor.update(monitor.init(2), {"x": tensor([math.nan, -1.0])})
        state, reading = monitor.update(state, {"x": tensor([-1.0, -1.0])})
        assert reading.nan.tolist() == [True, False]
        assert np.isnan(reading.robustness.tolist()).tolist() == [True, False]
        assert reading.lower.tolist() == [-math.inf, -math.inf]
        assert reading.upper.tolist() == [math.inf, -1.0]
        assert reading.verdict.tolist() == [0, -1]
        *_, cut = monitor.update_and_cut(state, {"x": tensor([1.0, 1.0])})
        assert np.isnan(cut.robustness.tolist()).tolist() == [True, False]
        assert cut.verdict.tolist() == [0, -1]
        _, reading = monitor.update(monitor.reset(state), {"x": tensor([2.0, 2.0])})
        assert reading.robustness.tolist() == [2.0, 2.0]

    def test_decision_stays_after_the_maximum_age(self) -> None:
        monitor = self.library.arrays.episode("eventually[0:2](x > 0)")
        state = monitor.init(1)
        for x in (-1.0, 3.0, *[-5.0] * 9):
            state, reading = monitor.update(state, {"x": self.library.tensor([x])})
        assert reading.lower.tolist() == reading.upper.tolist() == [3.0]

    @pytest.mark.parametrize(
        ("formula", "message"),
        [
            (
                " and ".join(f"always(x > {i} or eventually(y > {i}))" for i in range(9)),
                "the limit is 8",
            ),
            ("always[0:1500000000](x > 0)", "arrays count up to"),
        ],
    )
    def test_formulas_that_do_not_fit_are_refused(self, formula: str, message: str) -> None:
        with pytest.raises(SpecificationError) as refused:
            self.library.arrays.episode(formula)
        assert message in str(refused.value)

    def test_states_of_others_are_refused(self) -> None:
        arrays, x = self.library.arrays, {"x": self.library.tensor([1.0, 1.0])}
        monitor = arrays.episode("always(x > 0)")
        other = arrays.episode("always(once[0:3](x > 0))")
        with pytest.raises(InputError, match="the state belongs to another specification"):
            monitor.update(other.init(2), x)
        with pytest.raises(InputTypeError, match="expected a state of this monitor"):
            monitor.reset(arrays.online("x > 0").init(2))


def _sum_of_finite(
    library: ArrayLibrary, function: Callable[[Tensor], Tensor]
) -> Callable[[Tensor], Tensor]:
    return lambda x: library.sum_of_finite(function(x))


def _predicates(formula: rtamt.Formula) -> list[rtamt.Formula]:
    """Return the predicates with a variable."""
    parts = [arg for arg in formula.args if isinstance(arg, rtamt.Formula)]
    if not parts:
        return [formula] if formula.variables else []
    return [leaf for part in parts for leaf in _predicates(part)]


def _apart(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Return the maximum difference; nan differs from nothing."""
    different = ~((x == y) | np.isnan(x) | np.isnan(y))
    return float(np.max(np.abs(x[different] - y[different]), initial=0.0))


TEMPERATURES = (0.1, 1.0)

SMOOTH = (
    "always(a > 0)",
    "always[1:4](a > 0 or b > 1)",
    "historically[0:3](a > 0) and once(b < 2)",
    "(a > 0) until[1:4] (b > 0)",
    "(a > 0) since (b > 0)",
    "(a > 0) unless[0:5] (b > 0)",
    "not ((a > 0) since[1:4] (b > 0))",
    "(a > 0) xor eventually[0:2](b > 0)",
    "(a > 0) iff not always(b > 0)",
    "always(a > 0 implies eventually[0:3](once[0:2](b > 0)))",
    "rise(a > 0) or next(b > 0) or true",
    "(a > 0) until (false or 2 * b > a)",
)
"""Every operator, over predicates with smooth robustness."""


class OfflineContract:
    """The contract of `evaluate`, standard and smooth."""

    library: ArrayLibrary

    def value(self, formula: str, x: Tensor, **more: object) -> NDArray[np.float64]:
        """Return the robustness of the traces of x."""
        signals = {"x": self.library.tensor(x)}
        return np.array(self.library.arrays.evaluate(formula, signals, **more).tolist())

    @few
    @given(cases.cases(endless=True))
    def test_evaluate_equals_the_offline_evaluation(self, case: cases.Case) -> None:
        found = self.library.evaluated([self.of(f) for f in case.formulas], case.samples)
        for formula, each in zip(case.formulas, found, strict=True):
            assert bits(np.ravel(each)) == bits(np.ravel(case.offline(formula))), formula

    def of(self, formula: rtamt.Formula, **more: object) -> Callable[[Tensor], Tensor]:
        """Return the robustness as a function of samples."""
        evaluate = self.library.arrays.evaluate
        return lambda x: evaluate(formula, cases.columns(formula, x), **more)

    @settings(few, max_examples=15)
    @given(s.formulas(3).filter(lambda f: bool(f.variables)), s.traces())
    def test_functions_are_exact_to_four_ulp(self, formula: rtamt.Formula, trace: s.Trace) -> None:
        columns = {name: np.array(trace[name]) for name in formula.variables}
        expected = rtamt.evaluate(formula, columns)
        tensors = {name: self.library.tensor(column) for name, column in columns.items()}
        found = self.library.arrays.evaluate(formula, tensors).tolist()
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)

    @settings(few, max_examples=10)
    @given(cases.cases(endless=True), st.integers(0, 1))
    def test_low_precision_error_of_predicates(self, case: cases.Case, kind: int) -> None:
        dtype = self.library.kinds[kind]
        samples = np.random.default_rng(4).normal(size=case.samples.shape)

        def values(formula: rtamt.Formula) -> NDArray[np.float64]:
            exact, rounded = self.of(formula), self.of(formula, dtype=dtype)
            calls = [exact, lambda x: self.library.doubles(rounded(x))]
            return np.array(self.library.evaluated(calls, samples))

        for formula in case.formulas:
            exact, rounded = values(formula)
            worst = max((_apart(*values(each)) for each in _predicates(formula)), default=0.0)
            assert _apart(exact, rounded) <= worst, formula

    @pytest.mark.parametrize(
        "text", ["always(x >= 0)", "not eventually(x <= 0)", "x >= 0 until x < -9"]
    )
    def test_gradient_at_ties_belongs_to_one_sample(self, text: str) -> None:
        def least(x: Tensor) -> Tensor:
            return self.library.arrays.evaluate(text, {"x": x})[0]

        (found,) = self.library.gradients([least], np.array([2.0, 0.0, 0.0]))
        assert sorted(np.abs(found)) == [0.0, 0.0, 1.0]

    @pytest.mark.parametrize("text", ["abs(x) >= 0", "x == 0", "x != 0"])
    def test_the_gradient_of_an_absolute_value_is_0_at_0(self, text: str) -> None:
        def total(x: Tensor) -> Tensor:
            return self.library.arrays.evaluate(text, {"x": x}).sum()

        (found,) = self.library.gradients([total], np.array([0.0, -0.0, 2.0, -2.0]))
        assert np.abs(found).tolist() == [0.0, 0.0, 1.0, 1.0]

    def test_gradient_equals_finite_differences(self) -> None:
        self.check_gradients({})

    def test_a_nan_takes_its_trace(self) -> None:
        found = self.value("x > 0", [[1.0, math.nan], [1.0, 2.0]])
        np.testing.assert_array_equal(found, [[np.nan, np.nan], [1.0, 2.0]])

    def test_smooth_min_and_max_definition(self) -> None:
        x = np.random.default_rng(2).normal(size=(3, 7))
        for t in TEMPERATURES:
            least = self.value("always(x >= 0)", x, semantics="smooth", temperature=t)
            most = self.value("eventually(x >= 0)", x, semantics="smooth", temperature=t)
            for k in range(7):
                later = x[:, k:] / t
                np.testing.assert_allclose(least[:, k], -t * np.log(np.exp(-later).sum(1)))
                np.testing.assert_allclose(most[:, k], t * np.log(np.exp(later).sum(1)))

    @settings(few, max_examples=8)
    @given(cases.cases(endless=True), st.sampled_from(TEMPERATURES))
    def test_smoothing_error_bounds_hold(self, case: cases.Case, temperature: float) -> None:
        more = {"semantics": "smooth", "temperature": temperature}
        smooth = [self.of(formula, **more) for formula in case.formulas]
        found = self.library.evaluated(smooth, case.samples)
        for formula, each in zip(case.formulas, found, strict=True):
            standard = case.offline(formula)
            below, above = self.library.arrays.smoothing_error(formula, cases.SAMPLES, temperature)
            chosen = np.isinf(standard) | np.isnan(standard)
            np.testing.assert_array_equal(each[chosen], standard[chosen])
            error = each[~chosen] - standard[~chosen]
            assert np.all(error >= -below - 1e-9), formula
            assert np.all(error <= above + 1e-9), formula

    @pytest.mark.parametrize(("formula", "sign"), [("always(x > 0)", -1), ("once(x > 0)", 1)])
    def test_equal_values_attain_the_smoothing_error(self, formula: str, sign: int) -> None:
        x = np.zeros((1, 8))
        found = self.value(formula, x, semantics="smooth", temperature=0.5)
        error = sign * 0.5 * math.log(8)
        assert found[0, 0 if sign < 0 else 7] == pytest.approx(error)
        bounds = self.library.arrays.smoothing_error(formula, 8, 0.5)
        assert bounds[sign > 0] == pytest.approx(0.5 * math.log(9))  # a window of 0 to 8 samples
        assert bounds[sign < 0] == 0.0

    def test_smooth_gradient_equals_finite_differences(self) -> None:
        self.check_gradients({"semantics": "smooth", "temperature": 0.5})

    @pytest.mark.parametrize("temperature", [-1.0, 0.0, math.nan, math.inf])
    def test_wrong_temperature_array_gives_nan(self, temperature: float) -> None:
        smooth = {"semantics": "smooth", "temperature": self.library.tensor(temperature)}
        assert np.isnan(self.value("always(x > 0)", [1.0, 2.0, 3.0], **smooth)).all()

    @pytest.mark.parametrize("text", ["always(x >= 0)", "eventually(x >= 0)"])
    def test_small_temperature_selects_numbers(self, text: str) -> None:
        x, smooth = [3.0, 1.0, 2.0], {"semantics": "smooth", "temperature": 1e-307}
        x = [1e10 * each for each in x]
        assert self.value(text, x, **smooth).tolist() == self.value(text, x).tolist()

    @pytest.mark.parametrize("kind", [np.float32, np.float64, np.int64])
    def test_numpy_scalars_are_accepted(self, kind: type) -> None:
        given, x = {"semantics": "smooth"}, [[1.0, 2.0]]
        one, other = (self.value("always(x > 0)", x, **given, temperature=t) for t in (1, kind(1)))
        assert one.tolist() == other.tolist()
        error = self.library.arrays.smoothing_error
        assert error("always(x > 0)", 2, 1) == error("always(x > 0)", np.int64(2), kind(1))

    def check_gradients(self, more: dict[str, Any]) -> None:
        """Compare gradients along a direction with central differences."""
        random = np.random.default_rng(3)
        samples, direction = random.normal(size=(2, cases.SAMPLES, 2, len(s.VARIABLES)))
        formulas = [rtamt.parse(text).formula for text in SMOOTH]
        functions = [_sum_of_finite(self.library, self.of(f, **more)) for f in formulas]
        gradients = self.library.gradients(functions, samples)
        step = 1e-5
        ahead = self.library.evaluated(functions, samples + step * direction)
        behind = self.library.evaluated(functions, samples - step * direction)
        for text, gradient, x, y in zip(SMOOTH, gradients, ahead, behind, strict=True):
            found, expected = np.sum(gradient * direction), (x - y) / (2 * step)
            assert found == pytest.approx(expected, rel=1e-6, abs=1e-6), text

    def test_at_a_tie_the_smooth_gradient_is_shared(self) -> None:
        def least(x: Tensor) -> Tensor:
            smooth = {"semantics": "smooth", "temperature": 0.1}
            return self.library.arrays.evaluate("always(x >= 0)", {"x": x}, **smooth)[0]

        (found,) = self.library.gradients([least], np.array([0.0, 0.0, 5.0, 0.0, 0.0]))
        np.testing.assert_allclose(found, [0.25, 0.25, 0.0, 0.25, 0.25], atol=1e-12)

    @pytest.mark.parametrize(
        ("signals", "more", "error", "message"),
        [
            ([], {}, InputError, "1 sample or more"),
            (1.0, {}, InputError, "axis of samples"),
            ([1.0], {"temperature": 1.0}, InputError, "no effect with"),
            ([1.0], {"semantics": "smooth"}, InputError, "needs a temperature"),
            ([1.0], {"semantics": "smoth"}, InputError, "did you mean 'smooth'"),
            ([1.0], {"semantics": "smooth", "temperature": 0}, InputError, "above 0, got 0"),
            ([1.0], {"semantics": "smooth", "temperature": math.inf}, InputError, "finite"),
            ([1.0], {"semantics": "smooth", "temperature": "1"}, InputTypeError, "a number as"),
            ([1.0], {"semantics": "smooth", "temperature": True}, InputTypeError, "a number as"),
            (
                [1.0],
                {"semantics": "smooth", "temperature": 5e-324},
                InputError,
                "from 2.23e-308 to",
            ),
        ],
    )
    def test_what_is_wrong_is_refused(
        self, signals: object, more: dict[str, Any], error: type[Exception], message: str
    ) -> None:
        with pytest.raises(error) as refused:
            self.library.traced(
                lambda: self.library.arrays.evaluate(
                    "x > 0", {"x": self.library.tensor(signals)}, **more
                )
            )
        assert message in str(refused.value)

    def test_traces_of_other_shapes_are_refused(self) -> None:
        x, y = self.library.tensor([1.0, 2.0, 3.0]), self.library.tensor([1.0, 2.0])
        with pytest.raises(
            InputError, match=r"expected shape \(3,\) of 'y', got \(2,\); 'x' has it"
        ):
            self.library.arrays.evaluate("x > y", {"x": x, "y": y})

    @pytest.mark.parametrize(
        ("samples", "temperature", "error", "message"),
        [
            (2.0, 1.0, InputTypeError, "a whole number of samples, got 2.0"),
            (0, 1.0, InputError, "1 sample or more, got 0"),
            (2, 0.0, InputError, "above 0, got 0.0"),
            (2, None, InputTypeError, "a number as temperature, got None"),
        ],
    )
    def test_what_has_no_smoothing_error_is_refused(
        self, samples: object, temperature: object, error: type[Exception], message: str
    ) -> None:
        with pytest.raises(error) as refused:
            self.library.arrays.smoothing_error("always(x > 0)", samples, temperature)
        assert message in str(refused.value)

    def test_formulas_without_variables_are_refused(self) -> None:
        with pytest.raises(InputError, match="the formula has no variable"):
            self.library.arrays.evaluate("true", {})
