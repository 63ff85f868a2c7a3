"""The options that all monitors and evaluations share: what is shown, and what is refused."""

import inspect
import pydoc
from collections.abc import Callable

import pytest

import rtamt
from rtamt import InputError, Monitor
from rtamt.machines.backend import BACKENDS
from rtamt.monitors.options import OPTIONS

EVENTS = {"x": [(0, 1.0), (1, 2.0)]}
CALLS: dict[Callable[..., object], tuple[object, ...]] = {
    rtamt.Monitor: ("x > 0",),
    rtamt.EpisodeMonitor: ("x > 0",),
    rtamt.VectorMonitor: ("x > 0", 2),
    rtamt.VectorEpisodeMonitor: ("x > 0", 2),
    rtamt.DenseMonitor: ("x > 0",),
    rtamt.evaluate: ("x > 0", {"x": [1, 2]}),
    rtamt.evaluate_dense: ("x > 0", EVENTS),
    rtamt.explain: ("x > 0", {"x": [1, 2]}),
    rtamt.explain_dense: ("x > 0", EVENTS),
}
DEFAULTS = {
    "semantics": "standard",
    "inputs": None,
    "outputs": None,
    "backend": "auto",
    "nan": "raise",
    "align": None,
}
DENSE = (rtamt.DenseMonitor, rtamt.evaluate_dense, rtamt.explain_dense)
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
    documented = " ".join(f"{rtamt.Monitor.__doc__} {rtamt.DenseEpisodeMonitor.__doc__}".split())
    for name, option in OPTIONS.items():
        assert f"{name}: {option.about}" in documented
    assert "OPTIONS" not in documented


def test_the_nearest_may_be_any_argument_of_the_call() -> None:
    with pytest.raises(TypeError, match=r"^EpisodeMonitor\(\) got .* did you mean 'history'\?$"):
        rtamt.EpisodeMonitor("x > 0", histroy=True)  # type: ignore[call-arg]
    with pytest.raises(TypeError) as caught:
        rtamt.DenseMonitor("x > 0", qux=1)  # type: ignore[call-arg]
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
        f"{next(iter(option))}= speaks of values that are not known; DenseEpisodeMonitor and "
        "judge_dense give bounds; others give one number for each time"
    )
