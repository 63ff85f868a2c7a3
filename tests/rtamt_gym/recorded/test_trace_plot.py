"""A picture of a trace shows all of a few requirements, and the worst of many."""

import numpy as np
from matplotlib.figure import Figure

import rtamt
from rtamt_gym import Reading
from rtamt_gym.recorded.judge import judge, signals_of
from rtamt_gym.recorded.plot import draw_trace
from rtamt_gym.recorded.times import TimeAxis
from rtamt_gym.recorded.trace import Trace

N = 40
SIGNALS = {f"v{i}": np.full(N, float(i)) for i in range(15)}


def drawn(
    texts: dict[str, str], *, everything: bool = False, reading: Reading | None = None
) -> Figure:
    times = TimeAxis("time", np.arange(N) / 10, 0.0, 1e-12, certain=True)
    specs = {name: rtamt.parse(text) for name, text in texts.items()}
    names = dict.fromkeys(v for spec in specs.values() for v in spec.variables)
    trace = Trace("made", {name: SIGNALS[name] for name in names}, N, times, str)
    rules = reading or Reading()
    judgements = {name: judge(s, trace, trace.period(), rules) for name, s in specs.items()}
    reads = {name: spec.variables for name, spec in specs.items()}
    signals = signals_of(trace, trace.period())
    return draw_trace(signals, judgements, "made", reads, everything=everything)


def panels(figure: Figure) -> list[str]:
    return [ax.get_ylabel() for ax in figure.axes]


def said(figure: Figure) -> str:
    return figure.axes[0].get_title(loc="left")


def test_a_few_requirements_are_drawn_in_order_with_the_formulas_that_they_use() -> None:
    figure = drawn({"b": "near = v3 < 5 \n b = always(near)", "a": "always(v1 > 3)"})
    assert panels(figure) == ["v3", "v1", "near", "b", "a"]
    assert said(figure) == ""


def many() -> dict[str, str]:
    texts = {f"r{i}": f"p = v{i} > 4.5 \n r{i} = always(p)" for i in range(15)}
    return texts | {"late": "always[0:90](v14 > 1)"}


def test_of_many_requirements_the_worst_are_drawn_and_the_others_counted() -> None:
    figure = drawn(many())
    # v0 is farthest below 4.5; of the six requirements that are drawn none is satisfied.
    assert panels(figure) == ["v0", "v1", "v2", "v3", "r0", "r1", "r2", "r3", "r4", "late"]
    assert said(figure) == (
        "the worst 6 of 16 requirements; others: 10 SATISFIED; 11 signals not shown; "
        "--all draws everything"
    )


def test_a_curve_says_how_it_reads_the_end_where_that_is_another_verdict() -> None:
    texts = {"late": "eventually[50:90](true) or v3 > 5", "now": "always(v3 < 5)"}
    axes = drawn(texts, reading=Reading(end="cut")).axes
    assert [ax.get_xlabel() for ax in axes] == [
        "",
        "SATISFIED, inf (curve: --end complete)",
        "SATISFIED, 2",
    ]


def test_all_can_be_drawn() -> None:
    figure = drawn(many(), everything=True)
    assert len(panels(figure)) == 15 + 2 * 15 + 1
    assert said(figure) == ""


def test_what_is_left_out_has_its_verdict_counted() -> None:
    texts = {f"r{i}": f"always(v{i % 15} < {1 + i / 100})" for i in range(30)}
    figure = drawn(texts)
    assert "; others: 20 VIOLATED, 4 SATISFIED; " in said(figure)
    assert panels(figure)[3:] == ["r14", "r29", "r13", "r28", "r12", "r27"]
