"""The monitors of torch equal the C++ machines bit by bit."""

from __future__ import annotations

import copy
import doctest
import io
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence

import array_cases as cases
import numpy as np
import pytest
import strategies as s
import torch
import torch._dynamo.testing
from array_contract import ArrayMonitor, EpisodeContract, OfflineContract, OnlineContract, places
from bits import bits
from hypothesis import given, settings
from numpy.typing import NDArray
from torch.utils._python_dispatch import TorchDispatchMode

import rtamt
import rtamt_arrays.torch as arrays
from rtamt.errors import InputError, InputTypeError, RtamtError
from rtamt_arrays import offline
from rtamt_arrays.operations import Tensor


class Torch:
    """torch in eager mode."""

    arrays = arrays
    kinds = (torch.float32, torch.bfloat16)

    def doubles(self, values: Tensor) -> Tensor:
        return values.double()

    def tensor(self, values: object) -> Tensor:
        array = np.array(values)
        return torch.tensor(array if array.dtype.kind in "bc" else array.astype(np.float64))

    def traced(self, call: Callable[[], object]) -> object:
        return call()

    def readings(
        self,
        monitors: Sequence[ArrayMonitor],
        samples: NDArray[np.float64],
        resets: NDArray[np.bool_],
    ) -> list[Mapping[str, NDArray[np.float64]]]:
        found: list[Mapping[str, NDArray[np.float64]]] = []
        for monitor in monitors:
            chosen = torch.from_numpy(samples[..., places(monitor.variables)])
            found.append(stepped(monitor, chosen, torch.from_numpy(resets)))
        return found

    def evaluated(
        self, evaluations: Sequence[Callable[[Tensor], Tensor]], samples: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        return [evaluation(torch.from_numpy(samples)).numpy() for evaluation in evaluations]

    def gradients(
        self, functions: Sequence[Callable[[Tensor], Tensor]], samples: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]:
        return [
            torch.func.grad(function)(torch.from_numpy(samples)).numpy() for function in functions
        ]

    def sum_of_finite(self, values: Tensor) -> Tensor:
        return torch.where(values.isfinite(), values, 0.0).sum()

    def robustness_sum(self, monitor: ArrayMonitor, samples: Tensor) -> Tensor:
        state, total = monitor.init(samples.shape[1]), samples.sum() * 0.0
        for i, sample in enumerate(samples):
            state, reading = monitor.update(state, sample)
            if i >= monitor.latency:
                total = total + reading.robustness.sum()
        return total


def stepped(
    monitor: ArrayMonitor,
    samples: Tensor,
    resets: Tensor,
    update: Callable[..., ArrayMonitor] | None = None,
) -> dict[str, NDArray[np.float64]]:
    """Return the readings after each sample."""
    state, readings = monitor.init(resets.shape[1]), []
    for sample, mask in zip(samples, resets, strict=True):
        state, reading = (update or monitor.update)(monitor.reset(state, mask), sample)
        readings.append(reading)
    rows = zip(*readings, strict=True)
    fields = type(readings[0])._fields
    return {name: torch.stack(row).numpy() for name, row in zip(fields, rows, strict=True)}


@pytest.fixture(autouse=True, scope="module")
def doubles() -> Iterator[None]:
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(before)


class TestOnline(OnlineContract):
    library = Torch()


class TestEpisode(EpisodeContract):
    library = Torch()


class TestOffline(OfflineContract):
    library = Torch()


@pytest.fixture
def compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run steps in the form of a graph, on integers, without a graph."""
    monkeypatch.setattr(torch.compiler, "is_compiling", lambda: True)


@pytest.mark.usefixtures("compiling")
class TestCompiledOnline(OnlineContract):
    library = Torch()


@pytest.mark.usefixtures("compiling")
class TestCompiledEpisode(EpisodeContract):
    library = Torch()


SPECS = (
    "historically[0:3](x > 0) and once[2:5](y > 1)",
    "(x > 0) since[0:4] (y > 0) or always[0:2](x * y >= 1)",
)
EPISODES = (
    "always(x > 0 implies eventually[0:3](y > 1))",
    "(x > 0) until[1:4] (y > 0 or historically(x > -2))",
)
MADE: tuple[Callable[..., ArrayMonitor], ...] = (arrays.online, arrays.episode)
MONITORS = [
    *(pytest.param(arrays.online, text, id=text) for text in SPECS),
    *(pytest.param(arrays.episode, text, id=text) for text in EPISODES),
]


def played(entries: int = 3) -> tuple[Tensor, Tensor]:
    """Return samples of two variables, with zeros of either sign, and resets in the middle."""
    random = np.random.default_rng(5)
    samples = random.choice(np.array(s.QUARTERS), (12, entries, 2))
    return torch.from_numpy(samples), torch.from_numpy(random.random((12, entries)) < 0.1)


@pytest.mark.parametrize("backend", ["eager", "aot_eager"])
@pytest.mark.parametrize(("made", "text"), MONITORS)
def test_step_is_one_graph(made: Callable[..., ArrayMonitor], text: str, backend: str) -> None:
    torch.compiler.reset()
    monitor, (samples, resets) = made(text), played()
    compiled = torch.compile(monitor.update, fullgraph=True, backend=backend)
    found, expected = (stepped(monitor, samples, resets, f) for f in (compiled, monitor.update))
    assert {k: bits(v) for k, v in found.items()} == {k: bits(v) for k, v in expected.items()}


@pytest.mark.parametrize("more", [{}, {"semantics": "smooth", "temperature": 0.1}])
@pytest.mark.parametrize("spec", [SPECS[1], rtamt.parse(EPISODES[0])], ids=["text", "parsed"])
def test_evaluate_is_one_graph(
    spec: str | rtamt.Specification, more: dict[str, ArrayMonitor]
) -> None:
    torch.compiler.reset()

    def robustness(x: Tensor) -> Tensor:
        return arrays.evaluate(spec, {"x": x[..., 0], "y": x[..., 1]}, **more)

    def total(x: Tensor) -> Tensor:
        values = robustness(x)
        return torch.where(values.isfinite(), values, 0.0).sum()

    samples = torch.from_numpy(np.random.default_rng(6).normal(size=(3, 12, 2))).requires_grad_()
    compiled = torch.compile(robustness, fullgraph=True, backend="aot_eager")
    assert bits(compiled(samples).detach().numpy()) == bits(robustness(samples).detach().numpy())
    (found,) = torch.autograd.grad(
        torch.compile(total, fullgraph=True, backend="aot_eager")(samples), samples
    )
    (expected,) = torch.autograd.grad(total(samples), samples)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


# From torch itself, at the import of its compiler.
@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
@pytest.mark.parametrize(
    ("made", "text"), [(arrays.online, SPECS[1]), (arrays.episode, EPISODES[0])]
)
def test_compiled_step_has_equal_bits(made: Callable[..., ArrayMonitor], text: str) -> None:
    torch.compiler.reset()
    monitor, (samples, resets) = made(text), played()
    graphs = torch._dynamo.testing.CompileCounterWithBackend("inductor")

    def step(state: Tensor, sample: Tensor, mask: Tensor) -> Tensor:
        return monitor.update(monitor.reset(state, mask), sample)

    compiled = torch.compile(step, fullgraph=True, backend=graphs)
    state = monitor.init(3)
    for i, (sample, mask) in enumerate(zip(samples, resets, strict=True)):
        expected = monitor.update(monitor.reset(state, mask), sample)
        state, reading = compiled(state, sample, mask)
        for x, y in zip((*state, *reading), (*expected[0], *expected[1]), strict=True):
            assert bits(x.numpy()) == bits(y.numpy()), i
    assert graphs.frame_count == 1


GRAPH = """
import sys, torch, rtamt_arrays.torch
made, text = sys.argv[1:]
monitor = getattr(rtamt_arrays.torch, made)(text)
def shown(graph, _):
    print(graph.code)
    return graph.forward
step = torch.compile(monitor.update, fullgraph=True, backend=shown)
step(monitor.init(3), torch.ones(3, 2))
"""


@pytest.mark.parametrize(
    ("made", "text"), [("online", SPECS[1]), ("episode", EPISODES[0])], ids=["online", "episode"]
)
def test_graphs_are_deterministic(made: str, text: str) -> None:
    told = [
        subprocess.run(
            [sys.executable, "-c", GRAPH, made, text],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3")
    ]
    assert "torch" in told[0]
    assert told[0] == told[1] == told[2]


@pytest.mark.parametrize(("made", "text"), MONITORS)
def test_in_place_steps_keep_the_state_buffer(made: Callable[..., ArrayMonitor], text: str) -> None:
    monitor, (samples, resets) = made(text), played()
    state, other = monitor.init(3), monitor.init(3)
    addresses = [each.data_ptr() for each in state]
    for sample, mask in zip(samples, resets, strict=True):
        monitor.reset_(state, mask)
        reading = monitor.update_(state, sample)
        other, expected = monitor.update(monitor.reset(other, mask), sample)
        for x, y in zip((*state, *reading), (*other, *expected), strict=True):
            assert bits(x.numpy()) == bits(y.numpy())
    assert [each.data_ptr() for each in state] == addresses


@pytest.mark.parametrize(("made", "text"), MONITORS)
def test_in_place_steps_keep_readings(made: Callable[..., ArrayMonitor], text: str) -> None:
    monitor, (samples, _) = made(text), played()
    nan, state = torch.full((3, 2), torch.nan), monitor.init(3)
    state, *readings = monitor.update(state, nan)
    if made is arrays.episode:
        state, *more = monitor.update_and_cut(state, nan)
        readings += more
    readings.append(monitor.update_(state, nan))
    monitor.reset_(state)
    monitor.update_(state, samples[0])
    assert [reading.nan.tolist() for reading in readings] == [[True] * 3] * len(readings)


class Made(TorchDispatchMode):  # type: ignore[misc] # torch has no types here
    """Records the maximum number of elements of a tensor in new memory."""

    def __init__(self, state: Sequence[Tensor]) -> None:
        super().__init__()
        self._there = {each.data_ptr() for each in state}
        self.most = 0

    def __torch_dispatch__(
        self, func: Tensor, types: object, args: Sequence[Tensor] = (), kwargs: object = None
    ) -> Tensor:
        given: Mapping[str, object] = kwargs or {}  # type: ignore[assignment]
        found = func(*args, **given)
        if isinstance(found, torch.Tensor) and found.data_ptr() not in self._there:
            self.most = max(self.most, found.numel())
        return found


def test_eager_steps_in_place_copy_no_window() -> None:
    monitor = arrays.online("historically[0:1000](x > 0)")
    state, sample = monitor.init(3), torch.ones(3, 1)
    window = max(each.numel() for each in state)
    with Made(state) as made:
        monitor.update_(state, sample)
    assert made.most < window / 10
    with Made(state) as made:
        monitor.update(state, sample)
    assert made.most == window


@pytest.mark.parametrize(("made", "text"), MONITORS)
def test_pure_step_keeps_the_state(made: Callable[..., ArrayMonitor], text: str) -> None:
    monitor, (samples, _) = made(text), played()
    state, _ = monitor.update(monitor.init(3), samples[0])
    before = copy.deepcopy(state)
    monitor.update(monitor.reset(state), samples[1])
    with pytest.raises(InputError):
        monitor.update_(state, samples[1][:2])
    with pytest.raises(InputError):
        monitor.reset_(state, torch.ones(2, dtype=torch.bool))
    for x, y in zip(state, before, strict=True):
        assert bits(x.numpy()) == bits(y.numpy())


@settings(cases.few, max_examples=3)
@given(cases.cases())
def test_step_has_static_shapes(case: cases.Case) -> None:
    """On the device meta, tensors have shapes and no numbers: reading one fails."""
    with torch.device("meta"):
        mask = torch.ones(3, dtype=torch.bool)
        for formula in case.formulas:
            sample = torch.zeros(3, len(formula.variables))
            for made in MADE:
                monitor = made(formula)
                state, _ = monitor.update(monitor.reset(monitor.init(3), mask), sample)
                monitor.reset_(state, mask)
                assert monitor.update_(state, sample).robustness.is_meta
            signals = {name: torch.zeros(3, 9) for name in formula.variables}
            assert arrays.evaluate(formula, signals).is_meta
            smooth = arrays.evaluate(formula, signals, semantics="smooth", temperature=0.1)
            assert smooth.is_meta


class NothingAsked(TorchDispatchMode):  # type: ignore[misc] # torch has no types here
    """Raises an error for operations that wait for a device, or whose shapes depend on numbers."""

    REFUSED = ("_local_scalar_dense", "nonzero", "masked_select", "unique", "equal")

    def __torch_dispatch__(
        self, func: Tensor, types: object, args: Sequence[Tensor] = (), kwargs: object = None
    ) -> Tensor:
        given: Mapping[str, object] = kwargs or {}  # type: ignore[assignment]
        name = func.overloadpacket.__name__
        moves = name == "_to_copy" and given.get("device") is not None
        assert name not in self.REFUSED, name
        assert not moves, name
        return func(*args, **given)


@pytest.mark.parametrize(("made", "text"), MONITORS)
def test_in_place_step_does_not_synchronize(made: Callable[..., ArrayMonitor], text: str) -> None:
    monitor, (samples, resets) = made(text), played()
    state = monitor.init(3)
    with NothingAsked():
        for sample, mask in zip(samples, resets, strict=True):
            monitor.reset_(state, mask)
            monitor.update_(state, sample)
            monitor.update(monitor.reset(state, mask), sample)
        x, y = samples.permute(2, 1, 0)
        arrays.evaluate(text, {"x": x, "y": y})


def test_what_would_be_asked_is_refused() -> None:
    with pytest.raises(AssertionError, match="_local_scalar_dense"), NothingAsked():
        torch.zeros(2)[0].item()


# From torch itself, at its first tangents.
@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
def test_tangents_go_through_min_and_max() -> None:
    def least(x: Tensor) -> Tensor:
        return arrays.evaluate("always(x >= 0)", {"x": x})[0]

    x = torch.tensor([2.0, 1.0, 3.0])
    assert torch.func.jvp(least, (x,), (torch.tensor([5.0, 7.0, 9.0]),))[1].item() == 7.0


# From torch itself, at its first tangents.
@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
@pytest.mark.parametrize(("made", "text"), [(None, "always(x >= 0)"), *MONITORS])
def test_tangents_go_through_compiled_graphs(
    made: Callable[..., ArrayMonitor] | None, text: str
) -> None:
    torch.compiler.reset()
    drawn = np.random.default_rng(4).normal(size=(2, 3, 2))
    samples, tangents = (torch.from_numpy(each.copy()) for each in drawn)
    monitor = None if made is None else made(text)

    def robustness(x: Tensor) -> Tensor:
        if monitor is None:
            return arrays.evaluate(text, {"x": x[:, 0]})
        return monitor.update(monitor.init(3), x)[1].robustness

    def pushed(x: Tensor, tangent: Tensor) -> Tensor:
        return torch.func.jvp(robustness, (x,), (tangent,))

    compiled = torch.compile(pushed, fullgraph=True, backend="aot_eager")
    for found, expected in zip(compiled(samples, tangents), pushed(samples, tangents), strict=True):
        np.testing.assert_array_equal(found, expected)


WRONG: list[tuple[Callable[..., object], str]] = [
    (lambda m, s, _: m.update(s, torch.ones(4, 2)), "expected shape (3,) of 'x', got (4,)"),
    (lambda m, s, _: m.update(s, {"x": [1.0, 2.0, 3.0]}), "expected the variable 'y', got x"),
    (lambda m, s, _: m.update(s, [[1.0] * 2] * 3), "got list; convert with torch.asarray"),
    (lambda m, s, x: m.update((s, x), x), "State, got tuple; init(batch_size) returns"),
    (lambda m, s, _: m.update_(s, torch.ones(3, 2, dtype=torch.complex64)), "real numbers"),
    (lambda m, s, _: m.reset_(s, torch.ones(3)), "expected a mask of booleans"),
    (lambda m, s, x: m.update_(s, x), "the state or the sample requires a gradient"),
]


@pytest.mark.parametrize(("call", "message"), WRONG, ids=[message for _, message in WRONG])
@pytest.mark.parametrize(("made", "text"), MONITORS)
def test_what_is_wrong_is_said_while_a_graph_is_made(
    made: Callable[..., ArrayMonitor], text: str, call: Callable[..., object], message: str
) -> None:
    monitor, x = made(text), torch.ones(3, 2, requires_grad=True)
    state = monitor.init(3)
    for fullgraph, error in ((True, torch._dynamo.exc.Unsupported), (False, RtamtError)):
        torch.compiler.reset()
        compiled = torch.compile(call, fullgraph=fullgraph, backend="eager")
        with pytest.raises(error) as refused:
            compiled(monitor, state, x)
        assert message in str(refused.value)


@pytest.mark.parametrize(("made", "text"), MONITORS)
def test_in_place_gradient_error(made: Callable[..., ArrayMonitor], text: str) -> None:
    monitor, plain = made(text), torch.ones(3, 2)
    sample, state = plain.clone().requires_grad_(), monitor.init(3)
    before, (following, _) = copy.deepcopy(state), monitor.update(state, sample)
    grown = following if any(each.requires_grad for each in following) else state
    x, y = sample.T
    given = [(state, sample), (state, {"x": x, "y": y}), *[(grown, plain)] * (grown is not state)]
    for old, taken in given:
        with pytest.raises(InputError, match=r"call update, or call update_ under torch\.no_grad"):
            monitor.update_(old, taken)
    for found, expected in zip(state, before, strict=True):
        assert bits(found.numpy()) == bits(expected.numpy())
    with torch.no_grad():
        monitor.update_(state, sample)
    monitor.update_(state, {"x": x.detach(), "y": y.detach(), "z": x})  # it is not read
    assert not any(each.requires_grad for each in state)


@pytest.mark.parametrize(("made", "text"), MONITORS)
def test_a_state_that_was_saved_goes_on_where_it_was(
    made: Callable[..., ArrayMonitor], text: str
) -> None:
    monitor, (samples, resets) = made(text), played()
    state = monitor.init(3)
    for sample, mask in zip(samples[:6], resets[:6], strict=True):
        state, _ = monitor.update(monitor.reset(state, mask), sample)
    file = io.BytesIO()
    torch.save({"monitor": state}, file)
    file.seek(0)
    loaded = torch.load(file, weights_only=True)["monitor"]
    _, reading = monitor.update(loaded, samples[6])
    _, expected = monitor.update(state, samples[6])
    for x, y in zip(reading, expected, strict=True):
        assert bits(x.numpy()) == bits(y.numpy())


def test_steps_are_vectorized_by_vmap_as_entries_are() -> None:
    monitor = arrays.online("historically[0:2](x > y)")
    samples = torch.from_numpy(np.random.default_rng(0).normal(size=(5, 4, 3, 2)))
    states = type(monitor.init(3))(*(torch.stack([x] * 4) for x in monitor.init(3)))
    wide = monitor.init(12)
    for sample in samples:
        states, reading = torch.func.vmap(monitor.update)(states, sample)
        wide, expected = monitor.update(wide, sample.reshape(12, 2))
        np.testing.assert_array_equal(reading.robustness.ravel(), expected.robustness)


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16, torch.float16])
@pytest.mark.parametrize(("made", "text"), MONITORS)
def test_numbers_stay_of_the_kind_that_was_asked_for(
    made: Callable[..., ArrayMonitor], text: str, dtype: torch.dtype
) -> None:
    monitor, (samples, resets) = made(text, dtype=dtype), played()
    state, readings = monitor.init(3), []
    for sample, mask in zip(samples, resets, strict=True):
        state, reading = monitor.update(monitor.reset(state, mask), sample)
        readings.append(reading.robustness)
        assert [x.dtype for x in state] == [x.dtype for x in monitor.init(3)]
        assert reading.robustness.dtype == dtype
    # Quarters of small numbers and their products are numbers of each kind.
    expected = stepped(made(text), samples, resets)["robustness"]
    assert bits(torch.stack(readings).double().numpy()) == bits(expected)


def test_tensors_of_another_device_are_refused() -> None:
    monitor = arrays.online("x > 0")
    with pytest.raises(InputError, match="tensors on cpu, got one on meta"):
        monitor.update(monitor.init(2), {"x": torch.zeros(2, device="meta")})
    with pytest.raises(InputError, match="expected a device of torch, got 'nowhere'"):
        arrays.online("x > 0", device="nowhere")
    with torch.device("meta"):
        elsewhere = arrays.online("x > 0").init(2)
    for call in (lambda: monitor.reset(elsewhere), lambda: monitor.update_(elsewhere, None)):
        with pytest.raises(InputError, match="tensors on cpu, got one on meta"):
            call()


def test_what_another_library_made_is_refused() -> None:
    monitor, x = arrays.online("once[0:1](x > 0)"), torch.ones(2, 1)
    state = type(monitor.init(2))(*(each.numpy() for each in monitor.init(2)))
    with pytest.raises(
        InputTypeError, match=r"with tensors of torch.float64 as 'ring', got ndarray"
    ):
        monitor.update(state, x)
    with pytest.raises(
        InputTypeError, match=r"got array\(\[1., 1.\]\); convert with torch.asarray"
    ):
        monitor.update(monitor.init(2), {"x": np.ones(2)})
    with pytest.raises(InputTypeError, match=r"such as torch\.float32, got 'float32'"):
        arrays.online("x > 0", dtype="float32")


def test_the_examples_of_docstrings_show_what_happens() -> None:
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float32)
    done = [doctest.testmod(module) for module in (arrays, offline)]
    torch.set_default_dtype(before)
    assert all(each.attempted for each in done)
    assert not any(each.failed for each in done)
