"""Generated waveforms, and their values in a step, by definition."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import strategies as st

from rtamt_gym import Waveform
from rtamt_gym.inputs.case import LEAST_POINTS, WaveformInterpolation

__all__ = ["of_step", "waveforms"]

INTERPOLATIONS: tuple[WaveformInterpolation, ...] = ("hold", "linear", "pchip")


@st.composite
def waveforms(
    draw: st.DrawFn, low: float, high: float, *, whole: bool = False, span: int = 2
) -> Waveform:
    """Waveforms between two values, with control points over a span of seconds."""
    kind = "hold" if whole else draw(st.sampled_from(INTERPOLATIONS))
    times = st.lists(
        st.fractions(0, span, max_denominator=100),
        min_size=LEAST_POINTS[kind],
        max_size=5,
        unique=True,
    )
    values = st.integers(int(low), int(high)) if whole else st.floats(low, high)
    at = sorted(draw(times))
    return Waveform([float(time) for time in at], [draw(values) for _ in at], kind)


def of_step(entry: float | Waveform, step: int, period: float) -> float:
    """Return the value in a step: at its start if values are held, otherwise at its end."""
    if not isinstance(entry, Waveform):
        return entry
    ahead = 0 if entry.interpolation == "hold" else 1
    return entry(float((step + ahead) * Fraction(str(period))))
