"""The options and arguments of monitors and evaluations: defaults, errors, odd values."""

import inspect
import math
import pydoc
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from catalogue import check, entries

import rtamt
from rtamt import InputError, Monitor, RtamtError
from rtamt.machines.backend import BACKENDS, Backend
from rtamt.monitors.options import OPTIONS

EVENTS = {"x": [(0, 1.0), (1, 2.0)]}


CALLS: dict[Callable[..., object], tuple[object, ...]] = {
    rtamt.Monitor: ("x > 0",),
    rtamt.EpisodeMonitor: ("x > 0",),
    rtamt.VectorMonitor: ("x > 0", 2),
    rtamt.VectorEpisodeMonitor: ("x > 0", 2),
    rtamt.dense.Monitor: ("x > 0",),
    rtamt.evaluate: ("x > 0", {"x": [1, 2]}),
    rtamt.dense.evaluate: ("x > 0", EVENTS),
    rtamt.explain: ("x > 0", {"x": [1, 2]}),
    rtamt.dense.explain: ("x > 0", EVENTS),
}


DEFAULTS = {
    "semantics": "standard",
    "inputs": None,
    "outputs": None,
    "backend": "auto",
    "nan": "raise",
    "align": None,
}


DENSE = (rtamt.dense.Monitor, rtamt.dense.evaluate, rtamt.dense.explain)


calls = pytest.mark.parametrize("call", CALLS, ids=lambda call: call.__name__)


@calls
def test_signature_and_help_show_every_option(call: Callable[..., object]) -> None:
    parameters = inspect.signature(call).parameters
    expected = {k: v for k, v in DEFAULTS.items() if call not in DENSE or k not in ("nan", "align")}
    shown = {k: p.default for k, p in parameters.items() if k in DEFAULTS}
    assert shown == expected
    assert all(parameters[name].kind is inspect.Parameter.KEYWORD_ONLY for name in shown)
    assert all(p.kind is not inspect.Parameter.VAR_KEYWORD for p in parameters.values())
    assert "backend: 'Backend' = 'auto'" in pydoc.plain(pydoc.render_doc(call))


@calls
def test_the_defaults_that_are_shown_are_those_that_are_used(call: Callable[..., object]) -> None:
    defaults = {k: v for k, v in DEFAULTS.items() if k in inspect.signature(call).parameters}
    given, without = call(*CALLS[call], **defaults), call(*CALLS[call])
    assert str(given) == str(without)


@calls
def test_an_unknown_option_is_refused_with_the_nearest(call: Callable[..., object]) -> None:
    with pytest.raises(TypeError) as caught:
        call(*CALLS[call], semantic="standard")
    assert str(caught.value) == (
        f"{call.__name__}() got an unexpected keyword argument 'semantic'; "
        "did you mean 'semantics'?"
    )


def test_docstrings_describe_every_option() -> None:
    documented = " ".join(f"{rtamt.Monitor.__doc__} {rtamt.dense.EpisodeMonitor.__doc__}".split())
    for name, option in OPTIONS.items():
        assert f"{name}: {option.about}" in documented
    assert "OPTIONS" not in documented


def test_the_nearest_may_be_any_argument_of_the_call() -> None:
    with pytest.raises(TypeError, match=r"^EpisodeMonitor\(\) got .* did you mean 'history'\?$"):
        rtamt.EpisodeMonitor("x > 0", histroy=True)  # type: ignore[call-arg]
    with pytest.raises(TypeError) as caught:
        rtamt.dense.Monitor("x > 0", qux=1)  # type: ignore[call-arg]
    assert str(caught.value) == (
        "DenseMonitor() got an unexpected keyword argument 'qux'; "
        "its arguments are spec, resolution, interpolation, semantics, inputs, outputs, backend"
    )


def test_a_subclass_is_refused_by_its_own_name() -> None:
    class Named(Monitor):
        pass

    with pytest.raises(TypeError, match=r"^Named\(\) got an unexpected keyword argument 'nam'"):
        Named("x > 0", nam="hold")  # type: ignore[call-arg]


def test_a_back_end_that_is_not_built_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(BACKENDS, "native")
    with pytest.raises(rtamt.InputError) as error:
        Monitor("x > 0", backend="native")
    assert str(error.value) == (
        "backend='native' was not built; reinstall rtamt where a C++20 compiler is found"
    )
    assert Monitor("x > 0", backend="python").update(2.0) == 2.0


@pytest.mark.parametrize("call", DENSE, ids=lambda call: call.__name__)
@pytest.mark.parametrize("option", [{"nan": "unknown"}, {"max_gap": 1}], ids=str)
def test_what_gives_one_number_says_who_takes_values_that_are_not_known(
    call: Callable[..., object], option: dict[str, object]
) -> None:
    with pytest.raises(InputError) as caught:
        call(*CALLS[call], **option)
    assert str(caught.value) == (
        f"{next(iter(option))}= is for unknown values; "
        "rtamt.dense.EpisodeMonitor and rtamt.dense.judge give bounds; "
        "others give one number a time"
    )


class Silent:
    """An object whose repr raises an error."""

    def __repr__(self) -> str:
        raise RuntimeError


ODD: list[Any] = [
    *(None, 0, -1, 2**62, 2**70, 10**5000, True, 1.5, math.nan, math.inf, 1e-320, 1j, b"x"),
    *("", "x", "é", "\0", "x" * 10_000, [], [1], [[1, 2], [3]], [1, [2]], (), {}, {1: 2}),
    *({"x": 1}, {"x": [[1, 2], [3]]}, {1: [1, 2]}, {"x": None}, {"x": "ab"}, {10**5000: [1]}),
    *({Silent(): [1]}, {rtamt.variable("x"): [1]}, set(), frozenset({"x"}), range(3), object()),
    *(Silent(), np.array(1), np.array([]), np.ones((2, 2)), np.zeros((0, 1)), np.ones((2, 2, 1))),
    *(np.array(["a"]), np.array([None]), np.array([10**400], dtype=object), np.float16(1)),
    *(np.ma.array([1.0, 2.0], mask=[False, True]), np.uint64(2**64 - 1), np.longdouble(2)),
    *(np.datetime64("2026-01-01"), np.timedelta64(3, "s"), np.array([1, 2], "M8[s]")),
    *(np.array([(1, 2)], dtype=[("x", float), ("y", float)]), Decimal("NaN"), Decimal("sNaN")),
    *(Fraction(1, 3), int, len, rtamt.parse("x > 0"), ..., NotImplemented, slice(None)),
]


untyped: Any = rtamt


S, D, F = "x > 0", {"x": [1.0, 2.0]}, rtamt.variable("x") > 0


E = {"x": [(0.0, 1.0), (2.0, 2.0)]}


ENTRIES = {"x": [[1, 2], [3, 4]]}


ODD_CALLS: dict[str, Callable[[Any], object]] = {
    "spec": rtamt.Monitor,
    "period": lambda odd: rtamt.Monitor("always[0:1](x > 0)", odd),
    "semantics": lambda odd: rtamt.Monitor(S, semantics=odd),
    "inputs": lambda odd: rtamt.Monitor(S, inputs=odd),
    "outputs": lambda odd: rtamt.Monitor(S, outputs=odd, semantics="output-robustness"),
    "backend": lambda odd: rtamt.Monitor(S, backend=odd),
    "nan": lambda odd: rtamt.Monitor(S, nan=odd),
    "align": lambda odd: rtamt.Monitor(S, align=odd),
    "update": lambda odd: rtamt.Monitor(S).update(odd),
    "update named": lambda odd: rtamt.Monitor(S).update(x=odd),
    "update in Python": lambda odd: rtamt.Monitor(S, backend="python").update(odd),
    "update of a message": lambda odd: rtamt.Monitor("m.a > 0").update(m=odd),
    "update_many": lambda odd: rtamt.Monitor(S).update_many(odd),
    "update_many of a column": lambda odd: rtamt.Monitor(S).update_many({"x": odd}),
    "write": lambda odd: rtamt.Monitor("m.a = x > 0").write(odd),
    "evaluate": lambda odd: rtamt.evaluate(S, odd),
    "evaluate of a column": lambda odd: rtamt.evaluate(S, {"x": odd}),
    "evaluate of a cell": lambda odd: rtamt.evaluate(S, {"x": [1, odd]}),
    "evaluate of messages": lambda odd: rtamt.evaluate("m.a > 0", {"m": odd}),
    "evaluate n": lambda odd: rtamt.evaluate(S, D, n=odd),
    "evaluate_many": lambda odd: rtamt.evaluate(S, odd),
    "evaluate_many of a column": lambda odd: rtamt.evaluate(S, {"x": odd}),
    "evaluate_many of a cell": lambda odd: rtamt.evaluate(S, {"x": [[1, odd]]}),
    "lengths": lambda odd: rtamt.evaluate(S, ENTRIES, lengths=odd),
    "a length": lambda odd: rtamt.evaluate(S, ENTRIES, lengths=[odd, 1]),
    "explain": lambda odd: rtamt.explain(S, odd),
    "explain sample": lambda odd: rtamt.explain(S, D, sample=odd),
    "explain start": lambda odd: str(rtamt.explain(S, D, 1, start=odd)),
    "explain_dense": lambda odd: rtamt.dense.explain(S, odd),
    "explain_dense time": lambda odd: str(rtamt.dense.explain(S, E, odd)),
    "parse": rtamt.parse,
    "parse unit": lambda odd: rtamt.parse(S, unit=odd),
    "parse constants": lambda odd: rtamt.parse("x > c", constants=odd),
    "parse a constant": lambda odd: rtamt.parse("x > c", constants={"c": odd}),
    "variable": rtamt.variable,
    "number": rtamt.number,
    "conjunction": rtamt.conjunction,
    "disjunction": lambda odd: rtamt.disjunction([odd]),
    "comparison": lambda odd: rtamt.variable("x") > odd,
    "and": lambda odd: F & odd,
    "always": lambda odd: F.always(odd, odd),
    "until": F.until,
    "Interval": lambda odd: rtamt.Interval(odd, odd),
    "Interval unit": lambda odd: rtamt.Interval(Fraction(0), Fraction(1), odd),
    "Interval.of": lambda odd: rtamt.Interval.of(odd, odd),
}


@pytest.mark.parametrize("name", ODD_CALLS)
def test_an_argument_is_taken_or_refused_by_name(name: str) -> None:
    foreign = []
    for number, odd in enumerate(ODD):
        try:
            ODD_CALLS[name](odd)
        except RtamtError:
            continue
        except Exception as error:  # noqa: BLE001 - that none comes is what is claimed
            foreign.append((number, type(odd).__name__, repr(error)))
    assert foreign == []


def test_columns_may_have_numbers_for_names() -> None:
    assert untyped.evaluate("x > 0", {0: [[9]], "x": [[1]], 1: [[9]]}).tolist() == [[1.0]]


@pytest.mark.parametrize(("call", "said"), entries(Path(__file__).with_name("errors.txt")))
def test_errors_of_calls(call: str, said: str, backend: Backend) -> None:
    dates = [(np.datetime64("2026-01-01"), 1), (np.datetime64("2026-01-02"), 2)]
    check(call, said, backend=backend, math=math, DATES=dates, NUMBERS=[(1, 1), (3, 2)])
