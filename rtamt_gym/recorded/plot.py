"""Pictures of recorded traces: the signals and the robustness of every formula."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rtamt import Verdict
from rtamt_gym import drawing
from rtamt_gym.recorded.judge import RESULT, Series, TraceJudgement
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.tables import shorten

_SHADE: Mapping[str, Any] = {
    "color": drawing.VERDICT_COLOURS[Verdict.VIOLATED],
    "alpha": 0.3,
    "linewidth": 0,
}


_MOST = 12
"""Panels up to which a picture is read at a glance."""

_WORST, _SIGNALS = 6, 4
"""Requirements and signals in a picture that cannot hold all."""


def draw_trace(
    signals: Mapping[str, Series],
    judgements: Mapping[str, TraceJudgement],
    title: str,
    reads: Mapping[str, Collection[str]],
    *,
    everything: bool = False,
) -> Figure:
    """Draw the signals, and below them a panel for every formula, shaded where it is negative.

    The line at 0 is thick where the robustness is -0.0, because there is nothing to shade. If there
    are more than 12 panels, the picture shows the worst requirements, the worst first, and the
    signals that they read. It omits the formulas that they use, and lists the omitted panels in a
    line.
    """
    formulas = [(spec, name) for spec, judged in judgements.items() for name in judged.series]
    left_out = ""
    if not everything and len(signals) + len(formulas) > _MOST:
        worst = sorted(judgements, key=lambda name: _rank(judgements[name]))[:_WORST]
        formulas = [(spec, list(judgements[spec].series)[-1]) for spec in worst]
        read = dict.fromkeys(v for spec in worst for v in signals if v in reads[spec])
        left_out = _left_out(judgements, worst, len(signals) - len(list(read)[:_SIGNALS]))
        signals = {name: signals[name] for name in list(read)[:_SIGNALS]}
    heights = [1.0] * len(signals) + [1.3] * len(formulas)
    figure = Figure(figsize=(8.0, 1.25 * sum(heights) + 0.9), layout="constrained")
    axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    end = max(float(signal.times[-1]) for signal in signals.values()) if signals else 0.0
    ax: Axes
    for ax, (name, signal) in zip(axes, signals.items(), strict=False):
        drawing.tidy(ax, shorten(name, 24))
        _line(ax, signal, signal.values, end, drawing.SIGNAL)
        ax.margins(x=0.0, y=0.15)
    for ax, (spec, name) in zip(axes[len(signals) :], formulas, strict=True):
        judgement = judgements[spec]
        series = judgement.series[name]
        label = shorten(spec if name == RESULT else name, 24)
        (values,) = drawing.robustness_panel(ax, label, series.text, 96, [series.values])
        _line(ax, series, values, end, drawing.ROBUSTNESS)
        if name == list(judgement.series)[-1]:
            words = f"{judgement.verdict.name}, {judgement.robustness_text}"
            if judgement.otherwise_complete:
                words += " (curve: --end complete)"
            drawing.show_verdict(ax, judgement.verdict, words)
    figure.align_ylabels(axes)
    figure.suptitle(title, fontsize=12, fontweight="bold")
    if left_out:
        # Place the text below the title, where the layout keeps room.
        axes[0].set_title(left_out, fontsize=9, loc="left", color=drawing.OPEN)
    timed = any(
        s.step is not None for judged in judgements.values() for s in judged.series.values()
    )
    figure.supxlabel("time in s" if timed else "samples", fontsize=9, color=drawing.OPEN)
    return figure


def _rank(judgement: TraceJudgement) -> tuple[int, float]:
    """Return a sort key: violated, undecided, satisfied, each by robustness."""
    order = (Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.SATISFIED)
    return order.index(judgement.verdict), judgement.found.robustness


def _left_out(judgements: Mapping[str, TraceJudgement], shown: Sequence[str], signals: int) -> str:
    """Return the text on the panels that a picture leaves out."""
    others = Counter(
        judgement.verdict for name, judgement in judgements.items() if name not in shown
    )
    counts = ", ".join(f"{others[v]} {v.name}" for v in Verdict if others[v])
    words = []
    if others:
        words.append(f"the worst {len(shown)} of {len(judgements)} requirements; others: {counts}")
    if signals:
        words.append(f"{signals} {'signals' if signals > 1 else 'signal'} not shown")
    return "; ".join([*words, "--all draws everything"])


def _line(ax: Axes, series: Series, values: Floats, end: float, colour: str) -> None:
    times = series.times
    if series.held:
        times, values = np.append(times, max(end, times[-1])), np.append(values, values[-1])
        ax.plot(times, values, color=colour, linewidth=1.4, drawstyle="steps-post")
    else:
        ax.plot(times, values, color=colour, linewidth=1.4)
    if series.text:
        just = np.where(np.signbit(values) & (values == 0.0), 0.0, np.nan)
        style = "steps-post" if series.held else "default"
        ax.plot(times, just, marker=".", color=_SHADE["color"], linewidth=3, drawstyle=style)
    if series.text and series.held:
        ax.fill_between(times, np.minimum(values, 0.0), step="post", **_SHADE)
    elif series.text:
        ax.fill_between(times, values, where=list(np.signbit(values)), interpolate=True, **_SHADE)
