"""A formula that says the unit of every bound reads alike under any unit."""

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st
from strategies import formulas

import rtamt
import rtamt.language.words
from rtamt import EpisodeMonitor, Specification


@given(formulas(3), st.sampled_from(["s", "ms", "us", "ns"]))
def test_its_text_means_the_same_to_who_does_not_know_the_unit(
    formula: rtamt.Formula, unit: str
) -> None:
    spec = rtamt.parse(str(formula), unit=unit)
    read = rtamt.parse(str(spec.standalone()))
    period = Fraction(1, {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit])

    def latency(given: Specification) -> int | None:
        return EpisodeMonitor(given, period=period).program.latency

    assert latency(read) == latency(spec)
    assert rtamt.language.words.in_words(str(spec.standalone())) == rtamt.language.words.in_words(
        str(formula), unit=unit
    )


def test_seconds_stay_unsaid_and_what_is_said_stays() -> None:
    text = "always[0:2](x < 1 implies once[0:5ms](y > 2))"
    assert str(rtamt.parse(text).standalone()) == text
    said = str(rtamt.parse(text, unit="us").standalone())
    assert said == "always[0:2us](x < 1 implies once[0:5ms](y > 2))"
