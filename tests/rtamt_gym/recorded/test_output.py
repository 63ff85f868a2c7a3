"""Robustness in files and pictures."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded import output
from rtamt_gym.recorded.judge import judge, signals_of
from rtamt_gym.recorded.output import WRITERS, save
from rtamt_gym.recorded.plot import draw_trace
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.recording import Wanted
from rtamt_gym.recorded.times import TimeAxis
from rtamt_gym.recorded.trace import EventTrace, Trace

SPECS = {
    "near": rtamt.parse("close = x < 1 \n near = always(close)"),
    "far, but": rtamt.parse("always[0:1](x > -1)"),
}
X = np.array([0.1, -0.0, 1 / 3, np.inf, -np.inf, 1e-300, -1.5, 2.0])


def trace(n: int = 800) -> Trace:
    x = np.resize(X, n)
    times = TimeAxis("time", np.arange(n) / 8, 0.5, 1e-12, certain=True)
    return Trace("made", {"x": x}, n, times, str)


@pytest.fixture(params=[*WRITERS])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / f"Robustness{request.param}"


@pytest.mark.parametrize("long", [1 << 30, 0])
def test_values_come_back_bit_by_bit(
    path: Path, long: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "_LONG", long)
    monkeypatch.setattr(output, "_PIECE", 7)
    samples = trace()
    period = samples.period()
    judgements = {name: judge(s, samples, period, EvaluationOptions()) for name, s in SPECS.items()}
    save(judgements, path, dense=False)
    with open_recording(str(path)) as recording:
        assert [*recording.names] == ["time", "near.close", "near.near", "far, but"]
        read = recording.read(Wanted(recording.names, time="time"))
    assert read.numbers["time"].tolist() == (0.5 + np.arange(800) / 8).tolist()
    for name, series in {
        "near.close": judgements["near"].series["close"],
        "near.near": judgements["near"].series["near"],
        "far, but": judgements["far, but"].series["(result)"],
    }.items():
        assert read.numbers[name].tobytes() == series.values.tobytes()


@pytest.mark.parametrize("long", [1 << 30, 0])
def test_events_are_written_in_time_order(
    path: Path, long: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "_LONG", long)
    times = np.arange(8) / 8
    x = times, np.nan_to_num(X, posinf=9, neginf=-9)
    events = EventTrace("made", {"x": x}, (times[0], times[-1]), len(times))
    judgements = {
        name: judge(s, events, None, EvaluationOptions(dense=True)) for name, s in SPECS.items()
    }
    save(judgements, path, dense=True)
    with open_recording(str(path)) as recording:
        assert [*recording.names] == ["time", "variable", "value"]
        read = recording.read(Wanted(["value"], ["variable"], time="time"))
    assert read.times is not None
    assert (np.diff(read.times) >= 0).all()
    series = judgements["near"].series["close"]
    rows = [i for i, name in enumerate(read.texts["variable"]) if name == "near.close"]
    assert read.times[rows].tolist() == series.times.tolist()
    assert read.numbers["value"][rows].tobytes() == series.values.tobytes()


def test_unknown_extension_error_before_judging(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.csv").write_text("x\n1\n")
    out = tmp_path / "r.mat"
    arguments = ["monitor", "always(x > 0)", str(tmp_path / "x.csv"), "--out", str(out)]
    assert main(arguments) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: cannot write {out}: expected a name that ends in "
        ".csv, .csv.gz, .parquet, .feather or .arrow\n"
    )
    assert not out.exists()


N = 40
SIGNALS = {f"v{i}": np.full(N, float(i)) for i in range(15)}


def drawn(
    texts: dict[str, str], *, everything: bool = False, reading: EvaluationOptions | None = None
) -> Figure:
    times = TimeAxis("time", np.arange(N) / 10, 0.0, 1e-12, certain=True)
    specs = {name: rtamt.parse(text) for name, text in texts.items()}
    names = dict.fromkeys(v for spec in specs.values() for v in spec.variables)
    trace = Trace("made", {name: SIGNALS[name] for name in names}, N, times, str)
    rules = reading or EvaluationOptions()
    judgements = {name: judge(s, trace, trace.period(), rules) for name, s in specs.items()}
    reads = {name: spec.variables for name, spec in specs.items()}
    signals = signals_of(trace, trace.period())
    return draw_trace(signals, judgements, "made", reads, everything=everything)


def panels(figure: Figure) -> list[str]:
    return [ax.get_ylabel() for ax in figure.axes]


def said(figure: Figure) -> str:
    return figure.axes[0].get_title(loc="left")


def test_few_requirements_are_all_drawn() -> None:
    figure = drawn({"b": "near = v3 < 5 \n b = always(near)", "a": "always(v1 > 3)"})
    assert panels(figure) == ["v3", "v1", "near", "b", "a"]
    assert said(figure) == ""


def many() -> dict[str, str]:
    texts = {f"r{i}": f"p = v{i} > 4.5 \n r{i} = always(p)" for i in range(15)}
    return texts | {"late": "always[0:90](v14 > 1)"}


def test_worst_requirements_are_drawn() -> None:
    figure = drawn(many())
    # v0 is farthest below 4.5; none of the six drawn requirements is satisfied.
    assert panels(figure) == ["v0", "v1", "v2", "v3", "r0", "r1", "r2", "r3", "r4", "late"]
    assert said(figure) == (
        "the worst 6 of 16 requirements; others: 10 SATISFIED; 11 signals not shown; "
        "--all draws everything"
    )


def test_curve_states_other_end_mode() -> None:
    texts = {"late": "eventually[50:90](true) or v3 > 5", "now": "always(v3 < 5)"}
    axes = drawn(texts, reading=EvaluationOptions(end="cut")).axes
    assert [ax.get_xlabel() for ax in axes] == [
        "",
        "SATISFIED, inf (curve: --end complete)",
        "SATISFIED, 2",
    ]


def test_all_can_be_drawn() -> None:
    figure = drawn(many(), everything=True)
    assert len(panels(figure)) == 15 + 2 * 15 + 1
    assert said(figure) == ""


def test_omitted_panels_are_counted_by_verdict() -> None:
    texts = {f"r{i}": f"always(v{i % 15} < {1 + i / 100})" for i in range(30)}
    figure = drawn(texts)
    assert "; others: 20 VIOLATED, 4 SATISFIED; " in said(figure)
    assert panels(figure)[3:] == ["r14", "r29", "r13", "r28", "r12", "r27"]
