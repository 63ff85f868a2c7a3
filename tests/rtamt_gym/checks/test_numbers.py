"""The fractions that floats represent."""

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from rtamt_gym import simulate
from rtamt_gym.checks.numbers import exact


@given(st.integers(0, 10**7), st.sampled_from([1, 10, 1000, 3, 7, 60, 1024]))
def test_exact_recovers_quotients(numerator: int, denominator: int) -> None:
    fraction = Fraction(numerator, denominator)
    assert exact(numerator / denominator) == fraction
    assert exact(fraction) == fraction


@given(st.fractions(0, 1000, max_denominator=1000), st.integers(1, 50))
def test_exact_recovers_sums(fraction: Fraction, count: int) -> None:
    assert float(exact(float(fraction) * count)) == float(fraction * count)


@given(st.floats(1e-300, 1e15))
def test_exact_stays_close(number: float) -> None:
    assert abs(exact(number) - Fraction(number)) <= Fraction(1, 10**15) * Fraction(number)


def test_durations_are_multiples_of_periods() -> None:
    for period, count in ((0.651, 27), (0.1, 3), (0.07, 30), (1 / 3, 9)):
        run = simulate(lambda t: {"x": t}, "always(x < 99)", period=period, duration=period * count)
        assert run.steps == count
