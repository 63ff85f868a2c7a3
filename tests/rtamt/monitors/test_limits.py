"""The memory that windows may need is known when a monitor is created, and limited."""

import math
import pickle
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from strategies import Trace, formulas, length, sample, traces

import rtamt
from rtamt import Formula, InputError, SpecificationError, limits
from rtamt.inputs.samples import SampleReader
from rtamt.machines.discrete import PythonDiscreteMachine
from rtamt.machines.episode.machine import PythonEpisodeMachine
from rtamt.program.lowering import compile_program
from rtamt.program.memory import discrete_numbers, episode_numbers
from rtamt.program.placement import place

Make = Callable[[str], object]

DISCRETE = [
    ("x > 0", 0),
    ("historically(x > 0)", 0),
    ("always(x > 0)", 0),
    ("always[0:9](x > 0)", 10),
    ("once[5:9](x > 0)", 5 + 5),
    ("x > 0 since[0:9] y > 0", 20),
    ("eventually[0:9](x > 0) and y > 0", 10 + 9),
    ("always[0:9](x > 0) and always[0:9](x > 0)", 10),
    ("next(x > 0)", 0),
]
EPISODE = [
    ("x > 0", 0),
    ("always[0:9](x > 0)", 0),
    ("always(x > 0)", 0),
    # nine settled samples are read at a time, and as many values are open in three modes
    ("always(eventually[0:9](x > 0))", 9 + 3 * 9),
    ("always(once[0:9](x > 0))", 9 + 3 * 9),
]


def needed(call: Callable[[], object], monkeypatch: pytest.MonkeyPatch) -> int:
    """Return the bytes that the error names under a limit of no bytes."""
    monkeypatch.setattr(limits, "window_bytes", 0)
    try:
        call()
    except SpecificationError as error:
        return int(str(error).partition("the windows need ")[2].split()[0])
    return 0


@pytest.mark.parametrize(("text", "numbers"), DISCRETE)
def test_a_monitor_needs_a_double_for_each_sample_of_a_window(
    text: str, numbers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert needed(lambda: rtamt.Monitor(text), monkeypatch) == 8 * numbers
    assert needed(lambda: rtamt.VectorMonitor(text, 7), monkeypatch) == 7 * 8 * numbers


@pytest.mark.parametrize(("text", "numbers"), EPISODE)
def test_an_episode_needs_settled_and_open_values(
    text: str, numbers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert needed(lambda: rtamt.EpisodeMonitor(text), monkeypatch) == 8 * numbers
    assert needed(lambda: rtamt.VectorEpisodeMonitor(text, 7), monkeypatch) == 7 * 8 * numbers


@pytest.mark.parametrize("text", [text for text, _ in EPISODE])
def test_unknown_samples_and_neutral_predicates_take_a_machine_each(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = f"input float64 x\noutput float64 y\n{text.replace('x > 0', '(x > 0 or y > 0)')}"
    neutral: dict[str, Any] = {"semantics": "input-vacuity"}

    def bytes_of(**options: Any) -> list[int]:  # noqa: ANN401 - of a monitor
        return [
            needed(lambda: rtamt.EpisodeMonitor(spec, **options), monkeypatch),
            needed(lambda: rtamt.VectorEpisodeMonitor(spec, 7, **options), monkeypatch) // 7,
        ]

    once = bytes_of()
    assert bytes_of(nan="unknown") == bytes_of(**neutral) == [2 * each for each in once]
    assert bytes_of(nan="unknown", **neutral) == [3 * each for each in once]


@pytest.mark.parametrize("backend", ["python", "native"])
def test_the_first_sample_that_is_not_known_is_refused_if_two_machines_are_too_much(
    backend: Any,  # noqa: ANN401 - a name
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text, between = "always(once[0:9](x > 0))", rtamt.UncertainValue(-1.0, 1.0)
    one = 8 * (9 + 3 * 9)
    roomy = rtamt.EpisodeMonitor(text, backend=backend)
    monkeypatch.setattr(limits, "window_bytes", 2 * one)
    for nan in ("raise", "unknown"):
        rtamt.EpisodeMonitor(text, backend=backend, nan=nan).update(between)
    monkeypatch.setattr(limits, "window_bytes", 2 * one - 1)
    roomy.update(between)  # it was created under a larger limit
    monitor = rtamt.EpisodeMonitor(text, backend=backend)
    monkeypatch.setattr(limits, "window_bytes", 4 * one)
    several = rtamt.VectorEpisodeMonitor(text, 2, backend=backend)
    several.update([[1.0], [1.0]], upper=[[2.0], [1.0]])
    monkeypatch.setattr(limits, "window_bytes", 2 * one - 1)
    monitor.update(2.0)
    words = f"the windows need {2 * one} bytes with samples that are not known, and this one"
    with pytest.raises(SpecificationError, match=words):
        monitor.update(between)
    assert (monitor.samples, monitor.robustness) == (1, 2.0)
    assert monitor.update(rtamt.UncertainValue(3.0, 3.0)) == 2.0  # it is known
    with pytest.raises(SpecificationError, match="bytes with samples that are not known"):
        rtamt.EpisodeMonitor(text, backend=backend, nan="unknown")
    monkeypatch.setattr(limits, "window_bytes", 4 * one - 1)
    entries = rtamt.VectorEpisodeMonitor(text, 2, backend=backend)
    entries.update([[1.0], [3.0]])
    with pytest.raises(
        SpecificationError, match="in 2 batch entries with samples that are not known"
    ):
        entries.update([[1.0], [1.0]], upper=[[2.0], [1.0]])
    assert (entries.samples.tolist(), entries.robustness.tolist()) == ([1, 1], [1.0, 3.0])


@given(formulas(), traces())
def test_no_monitor_keeps_more_numbers(formula: Formula, trace: Trace) -> None:
    program = compile_program(rtamt.Specification.of(formula), online=True)
    machine = PythonDiscreteMachine(program, SampleReader(program), ())
    for i in range(length(trace)):
        machine.update(*sample(trace, i, program.variables).values())
    kept = sum(map(numbers_in, machine._parts))
    assert kept <= discrete_numbers(program)


def numbers_in(part: Any) -> int:  # noqa: ANN401 - a window or a delay line
    """Return the number of doubles in the blocks of a window or in the ring of a delay line."""
    blocks = [getattr(part, name, []) for name in ("_front", "_back", "_ring")]
    return sum(np.size(number) for block in blocks for number in block)


@given(formulas(), traces())
def test_no_episode_keeps_more_numbers(formula: Formula, trace: Trace) -> None:
    program = compile_program(rtamt.Specification.of(formula))
    machine = PythonEpisodeMachine(program, SampleReader(program))
    placement = place(program)
    numbers = episode_numbers(placement)
    for i in range(length(trace)):
        values = [*sample(trace, i, program.variables).values()]
        machine.take(machine.terms(values), values)
        for register, stream in machine._streams.items():
            kept = sum(map(len, (*stream.history, *stream.open)))
            assert kept <= numbers[register] + 1  # its newest value


MAKERS: list[tuple[Callable[[str], object], str]] = [
    (rtamt.Monitor, "always[0:2000000000](x > 0)"),
    (lambda text: rtamt.VectorMonitor(text, 1000), "always[0:2000000](x > 0)"),
    (rtamt.EpisodeMonitor, "always(once[0:2000000000](x > 0))"),
    (lambda text: rtamt.VectorEpisodeMonitor(text, 1000), "always(once[0:2000000](x > 0))"),
]


@pytest.mark.parametrize(("make", "text"), MAKERS)
def test_a_window_of_gigabytes_is_refused_before_it_is_allocated(make: Make, text: str) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(SpecificationError, match="the windows need"):
            make(text)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2**24


def test_the_error_names_bytes_formula_and_limit() -> None:
    text = "historically[0:9](y > 0) and always[0:2000000000](x > 0)"
    with pytest.raises(SpecificationError) as caught:
        rtamt.Monitor(text)
    assert str(caught.value) == (
        "STL:1:36: the windows need 32000000088 bytes, and this one is the longest; "
        "the limit is 1073741824\n"
        f"  {text}\n"
        f"  {' ' * 35}^\n"
        "  hint: write shorter windows, take samples further apart, or raise "
        "rtamt.limits.window_bytes"
    )
    with pytest.raises(
        SpecificationError, match="the windows need 160000800 bytes in 10 batch entries, and this"
    ):
        limited(1000, lambda: rtamt.VectorMonitor("once[0:2000009](x > 0)", 10))


@pytest.mark.parametrize(
    ("middle", "needed"),
    [(1.0, "95999999712 bytes, and"), (math.nan, "191999999424 bytes with samples that are not")],
)
def test_windows_that_go_on_behind_a_trace_take_twice_with_unknown_samples(
    middle: float, needed: str
) -> None:
    """Three samples; two windows and a variable, a minimum and a maximum of 8 bytes each."""
    with pytest.raises(SpecificationError, match=f"^STL:1:11: the windows need {needed}"):
        rtamt.judge(
            "eventually[0:1e9](once[0:1e9](x > 0))", {"x": [1.0, middle, 1.0]}, nan="unknown"
        )


def limited(limit: float | np.number[Any], call: Callable[[], object]) -> None:
    """Run the call under a limit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(limits, "window_bytes", limit)
        call()


def test_the_limit_itself_is_allowed_and_may_be_raised() -> None:
    limited(80, lambda: rtamt.Monitor("once[0:9](x > 0)"))
    with pytest.raises(SpecificationError, match="the windows need 80 bytes"):
        limited(79, lambda: rtamt.Monitor("once[0:9](x > 0)"))
    for enough in (math.inf, np.int64(80), np.float32(80)):
        limited(enough, lambda: rtamt.Monitor("once[0:9](x > 0)"))


@pytest.mark.parametrize("limit", ["1GiB", None, -1, math.nan, True])
def test_the_limit_is_a_number_of_bytes(limit: float) -> None:
    with pytest.raises(InputError) as caught:
        limited(limit, lambda: rtamt.Monitor("once[0:9](x > 0)"))
    assert str(caught.value) == (
        f"expected a number of bytes as rtamt.limits.window_bytes, got {limit!r}"
    )


def test_a_monitor_that_is_made_goes_on_under_a_lower_limit() -> None:
    monitor = rtamt.Monitor("once[0:9](x > 0)")
    limited(0, lambda: monitor.update(1.0))
    data = pickle.dumps(monitor)
    with pytest.raises(SpecificationError, match="the windows need 80 bytes"):
        limited(0, lambda: pickle.loads(data))


def test_a_whole_trace_cuts_the_windows_and_is_not_limited() -> None:
    text = "always[0:2000000000](x > 1) and once[5:2000000000](y > 0)"
    trace = {"x": [3.0, 2.0], "y": [1.0, 1.0]}
    limited(0, lambda: rtamt.evaluate(text, trace))
    assert rtamt.evaluate(text, trace).tolist() == [-math.inf, -math.inf]
    assert rtamt.evaluate(text, {"x": [[3.0]], "y": [[1.0]]}).tolist() == [[-math.inf]]
    assert rtamt.explain(text, trace).robustness == -math.inf


def test_an_episode_of_a_long_window_at_its_root_needs_nothing() -> None:
    episode = rtamt.EpisodeMonitor("always[0:2000000000](x > 1)")
    assert episode.update(3.0) == 2.0


def test_a_formula_made_in_python_is_named() -> None:
    formula = (rtamt.variable("z") > 0).once(0, 9)
    with pytest.raises(SpecificationError) as caught:
        limited(0, lambda: rtamt.Monitor(formula))
    assert str(caught.value).splitlines()[:2] == [
        "the windows need 80 bytes, and this one is the longest; the limit is 0",
        "  in once[0:9](z > 0)",
    ]


@pytest.mark.parametrize(
    "text", ["once[0:9999999](x > 0)", "x > 0 and next(once[9999999:9999999] y)"]
)
def test_a_window_takes_memory_for_what_it_has_seen(text: str, backend: Any) -> None:  # noqa: ANN401
    tracemalloc.start()
    try:
        monitor = rtamt.Monitor(text, backend=backend)
        for i in range(100):
            monitor.update(*[float(i)] * len(monitor.variables))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2**20
