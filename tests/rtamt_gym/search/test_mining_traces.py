"""The data of mining: columns, data frames, files, runs of simulations and of sweeps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import rtamt
from rtamt import InputError, InputTypeError
from rtamt_gym import Parameter, mine, simulate, sweep
from rtamt_gym.results import Sweep

LEVELS = [1.0, 4.0, 2.5, 3.0, 0.5]
RANGE = {"v": (0, 10)}


def tank(inflow: float) -> Iterator[dict[str, float]]:
    level = 1.0
    for _ in range(20):
        yield {"level": level, "flow": inflow}
        level += inflow - 0.1 * level


def of_levels(kind: str, folder: Path) -> Any:  # noqa: ANN401 - a trace of any kind
    columns = {"level": LEVELS, "time": [0.5 * i for i in range(5)]}
    match kind:
        case "columns":
            return {"level": LEVELS}
        case "array":
            return np.array(LEVELS)[:, None]
        case "frame":
            return pd.DataFrame(columns)
        case "run":
            return simulate([{"level": x} for x in LEVELS], "always(level < 9)", period=0.5)
    path = folder / f"levels{kind}"
    frame = pd.DataFrame(columns)
    if kind == ".csv":
        frame.to_csv(path, index=False)
        return str(path)
    frame.to_parquet(path)
    return path


@pytest.mark.parametrize("kind", ["columns", "array", "frame", "run", ".csv", ".parquet"])
def test_one_trace_of_every_kind_has_the_same_constant(kind: str, tmp_path: Path) -> None:
    trace = of_levels(kind, tmp_path)
    for given in (trace, [trace], iter([trace])):
        result = mine("always(level < ?v)", given, RANGE, tolerance=0.5)
        assert (result.value, result.fails_at, result.traces) == (4.5, 4.0, 1)
        assert result.witness.trace is trace
    later = mine("eventually[0:?v](level < 1)", trace, RANGE, period=0.5)
    assert (later.value, later.explanation.period) == (2.0, 0.5)


def test_traces_have_the_name_of_the_file_the_label_of_the_run_or_their_number(
    tmp_path: Path,
) -> None:
    samples = [{"level": x} for x in LEVELS]
    path = of_levels(".csv", tmp_path)
    given = [
        {"level": [1.0]},
        path,
        simulate(samples, "always(level < 9)"),
        simulate(samples, "always(level < 9)", label="full"),
    ]
    result = mine("always(level < ?v)", given, RANGE)
    assert [each.name for each in result.witnesses] == [path, "run 2", "full"]
    assert [each.index for each in result.witnesses] == [1, 2, 3]


def test_files_and_runs_bring_their_periods_and_all_need_one_for_a_bound(tmp_path: Path) -> None:
    path = of_levels(".csv", tmp_path)
    run = of_levels("run", tmp_path)
    result = mine("eventually[0:?t](level < 1)", [path, run], {"t": (0, 10)})
    assert (result.value, result.fails_at) == (2.0, 1.5)
    other = simulate([{"level": x} for x in LEVELS], "always(level < 9)", period=0.25)
    with pytest.raises(InputError) as caught:
        mine("eventually[0:?t](level < 1)", [run, other], {"t": (0, 10)})
    assert str(caught.value) == (
        "'t' bounds a time, so that all traces need one period; run 0 has 0.5 s, run 1 has "
        "0.25 s; give period="
    )


def test_the_end_of_a_run_is_read_as_the_run_read_it() -> None:
    # The window of the last sample extends beyond the end: nothing is there, or it is unknown.
    text = "always(always[0:1](level < ?v))"
    levels = [1.0, 3.0, 2.0, 3.0]
    samples = [{"level": level} for level in levels]
    run = simulate(samples, text.replace("?v", "5"), period=1, stop="end")
    assert (run.ended, run.verdict.name) == ("terminated", "SATISFIED")
    assert mine(text, run, RANGE, tolerance=0.5).value == 3.5
    assert mine(text, {"level": levels}, RANGE, tolerance=0.5, end="complete").value == 3.5
    for options in ({"traces": {"level": levels}}, {"traces": run, "end": "cut"}):
        with pytest.raises(InputError, match="comes closest at v = 10, UNDECIDED"):
            mine(text, ranges=RANGE, **options)


def test_a_run_that_was_stopped_is_said() -> None:
    samples = [{"level": x} for x in LEVELS]
    stopped = simulate(samples, "always(level < 3)")
    whole = simulate(samples, "always(level < 3)", stop="end")
    result = mine("always(level < ?v)", [whole, stopped], RANGE)
    (note,) = result.notes
    assert note == (
        "1 run of 2 ended at a verdict or an error, such as run 1; simulate(..., "
        'stop="end") goes on after a verdict'
    )
    assert mine("always(level < ?v)", [whole], RANGE).notes == ()


@pytest.mark.parametrize("stop", ["end", "violation"])
def test_a_sweep_is_mined_over_whole_runs_whatever_it_was_for(stop: Any) -> None:  # noqa: ANN401
    done = sweep(
        tank,
        {"dry": "always(level < 1.5)"},
        [Parameter("inflow", 0.05, 0.4)],
        samples=9,
        period=1,
        stop=stop,
    )
    assert 0 < len(done.record.violated()) < 9
    result = mine("always(level < ?v and flow > 0)", done, RANGE)
    greatest = [
        max(sample["level"] for sample in tank(row.case.columns()["inflow"])) for row in done.record
    ]
    assert result.fails_at <= max(greatest) < result.value
    assert result.witness.index == int(np.argmax(greatest))
    assert result.witness.trace is done.record[result.witness.index]
    assert f"case: inflow={max(row.case.columns()['inflow'] for row in done.record):.6g}" in str(
        result
    )


@pytest.mark.slow
def test_the_environments_of_a_scenario_give_the_constant_of_its_single_runs() -> None:
    system = "rtamt/AutomaticTransmission-v0"
    done = sweep(system, ["AT1", "AT2"], samples=5, seed=3)
    runs = [done.replay(row) for row in done.record]
    speeds = [run.signals["speed"][:2001].max() for run in runs]
    for traces in (done, runs):
        result = mine("always[0:20](speed < ?v)", traces, {"v": (0, 200)}, tolerance=0)
        assert result.value == np.nextafter(max(speeds), np.inf)
        assert result.witness.index == int(np.argmax(speeds))
    fast = 30.0
    late = mine(f"always[0:?t](speed < {fast})", done, {"t": (0, 30)})
    first = min(int(np.argmax(run.signals["speed"] >= fast)) for run in runs)
    assert late.side == "greatest"
    assert late.value == pytest.approx((first - 1) / 100)
    signals = {name: runs[late.witness.index].signals[name] for name in ("speed",)}
    assert late.explanation == rtamt.explain(late.specification, signals, period=0.01)


def test_runs_that_failed_are_left_out_and_a_loaded_sweep_is_refused(tmp_path: Path) -> None:
    def brittle(inflow: float) -> Iterator[dict[str, float]]:
        if inflow > 0.35:
            msg = "burst"
            raise ValueError(msg)
        yield from tank(inflow)

    with pytest.warns(UserWarning, match="failed"):
        done = sweep(
            brittle,
            {"dry": "always(level < 2)"},
            [Parameter("inflow", 0.1, 0.4)],
            samples=4,
            sampler="grid",
            period=1,
        )
    result = mine("always(level < ?v)", done, RANGE)
    assert (result.traces, result.witness.name) == (3, "run 2")
    assert result.notes == ("1 simulation of 4 failed and is left out",)
    done.save(tmp_path / "done.parquet")
    with pytest.raises(InputError) as caught:
        mine("always(level < ?v)", Sweep.load(tmp_path / "done.parquet"), RANGE)
    assert str(caught.value) == (
        "a sweep from a file has no system to run; repeat it with sweep(system, ...)"
    )


def test_a_simulation_that_fails_when_it_is_run_again_is_told() -> None:
    runs: list[float] = []

    def worn(inflow: float) -> Iterator[dict[str, float]]:
        runs.append(inflow)
        if len(runs) == 4:
            raise ValueError("worn out")
        yield from tank(inflow)

    done = sweep(
        worn,
        {"dry": "always(level < 2)"},
        [Parameter("inflow", 0.1, 0.4)],
        samples=3,
        sampler="grid",
        period=1,
    )
    with pytest.raises(InputError) as caught:
        mine("always(level < ?v)", done, RANGE)
    assert str(caught.value) == "run 0 failed when run again: ValueError: worn out"


def test_what_is_no_trace_is_refused(tmp_path: Path) -> None:
    def refusal(given: Any) -> str:  # noqa: ANN401 - whatever it is
        with pytest.raises((InputError, InputTypeError)) as caught:
            mine("always(level < ?v)", given, RANGE)
        return ": ".join([*getattr(caught.value, "__notes__", []), str(caught.value)])

    assert refusal([]) == "expected at least one trace, got none"
    assert refusal(3) == "expected traces or runs, got int 3"
    assert refusal([3]) == (
        "expected a trace as columns by name, a data frame, a path, or a Run, got int 3"
    )
    assert (
        refusal(tmp_path)
        == f'{tmp_path} is a folder; write sorted(Path("{tmp_path}").glob("*.csv"))'
    )
    assert refusal([{"level": [1.0]}, {"lvl": [1.0]}]) == (
        "trace 1: expected columns by name, 'level' among them, got 'lvl'"
    )
    assert refusal([{"level": [1.0]}, {"level": [float("nan")]}]) == (
        "trace 1: at v = 0: variable 'level' is nan at sample 0; pass nan='hold' to keep the last "
        "value instead"
    )
    assert refusal({"a": {"level": [1.0]}, "b": {"level": [2.0]}}) == (
        "trace 0: expected columns by name, 'level' among them, got 'a', 'b'; several traces are a "
        "sequence: list(traces.values())"
    )
    assert refusal("rtamt/RequestGrant-v0") == (
        "the file 'rtamt/RequestGrant-v0' does not exist; for a system write mine(requirement, "
        "sweep('rtamt/RequestGrant-v0', ...), ranges)"
    )
