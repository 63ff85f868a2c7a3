"""Stages of requirements are recognised by one rule, however a formula was written."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import formulas

import rtamt
from rtamt import Formula
from rtamt.patterns import in_order, prefixes, stages

FORMS = {
    "eventually(a > 0 and eventually(b > 0))": ("a > 0", "b > 0"),
    "eventually[0:9](a > 0 and eventually[2:5](b > 0))": ("a > 0", "b > 0"),
    "eventually(a > 0 and b > 0 and eventually(c > 0 and a > 1))": (
        "a > 0 and b > 0",
        "c > 0 and a > 1",
    ),
    "near = a > 0; done = b > 0; task = eventually(near and eventually done)": ("a > 0", "b > 0"),
    "eventually(a > 0 and eventually always[0:2](b > 0))": ("a > 0", "always[0:2](b > 0)"),
    "eventually(a > 0)": (),
    "eventually(eventually(a > 0))": (),
    "eventually(eventually(b > 0) and a > 0)": (),
    "always(a > 0 and eventually(b > 0))": (),
    "eventually(a > 0 and eventually(b > 0)) and c > 0": (),
    "a > 0": (),
}


@pytest.mark.parametrize("text", FORMS)
def test_one_shape_has_stages(text: str) -> None:
    assert tuple(map(str, stages(text))) == FORMS[text]
    assert stages(rtamt.parse(text)) == stages(rtamt.parse(text).formula) == stages(text)


@given(st.lists(formulas(1), min_size=2, max_size=5), st.sampled_from([None, 2, "500ms"]))
def test_the_arguments_of_in_order_are_the_stages(
    parts: list[Formula], within: int | str | None
) -> None:
    plain = [part.rise() for part in parts]  # no eventually that could be one more stage
    whole = in_order(*plain, within=within)
    assert stages(whole) == tuple(plain)
    found = prefixes(str(whole))
    assert found[0] is plain[0].eventually()
    assert found[-1] is whole
    assert found[1:] == tuple(in_order(*plain[:n], within=within) for n in range(2, len(plain) + 1))
