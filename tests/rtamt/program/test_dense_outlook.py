"""Programs for bounds over dense time: well formed, and given as much time as they need."""

import math
from dataclasses import replace
from typing import Any

import pytest
from dense_signals import INTEGERS, Signals, relevant, signals
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from strategies import formulas

from rtamt import Formula, judge_dense, parse
from rtamt.program.dense_lowering import compile_dense
from rtamt.program.dense_outlook import DenseOutlook, Mask, Plan, look_out_dense

SECOND = 10**9
INF = math.inf


def looked_out(text: str, *, best: bool, cut: bool) -> DenseOutlook:
    return look_out_dense(compile_dense(parse(text)), zero=0.0, best=best, cut=cut)


@settings(max_examples=60)
@given(formula=formulas(depth=3, endless=True, dense=True), best=st.booleans(), cut=st.booleans())
def test_programs_are_well_formed(formula: Formula, *, best: bool, cut: bool) -> None:
    assume(formula.variables)
    outlook = looked_out(str(formula), best=best, cut=cut)
    outlook.dense.program.verify()
    plan = outlook.plan(7 * SECOND)
    assert len(plan.masks) + len(formula.variables) == len(outlook.dense.program.variables)
    assert plan.masks[0] == Mask(-INF if best else INF, 7 * SECOND)
    assert all(mask.last + 1 < plan.end for mask in plan.masks)


@pytest.mark.parametrize(
    ("text", "cut", "last", "end"),
    [
        ("x > 0", False, 5, 5),
        ("always[0:2](x > 0)", False, 5, 5),
        ("always[0:8](x > 0)", True, 5, 8),
        ("always[1:8] eventually[2:3](x > 0)", True, 5, 11),
        ("always[0:8] once[0:3](x > 0)", True, 5, 8),
        ("always(x > 0)", True, 5, 5),
        ("always(eventually[0:4](x > 0))", True, 5, 9),
        ("always[7:inf](x > 0)", True, 5, 7),
    ],
)
def test_signals_are_held_as_long_as_bounds_read_them(
    text: str, *, cut: bool, last: int, end: int
) -> None:
    plan = looked_out(text, best=False, cut=cut).plan(last * SECOND)
    assert plan.end == end * SECOND + 2


@settings(max_examples=40)
@given(formula=formulas(depth=2, endless=True, dense=True), whole=signals(INTEGERS))
def test_more_time_than_the_plan_gives_changes_nothing(formula: Formula, whole: Signals) -> None:
    assume(formula.variables)
    its = relevant(whole, formula.variables)
    planned: Any = DenseOutlook.plan

    def longer(outlook: DenseOutlook, last: int) -> Plan:
        plan: Plan = planned(outlook, last)
        return replace(plan, end=plan.end + 50 * SECOND)

    for end in ("cut", "open"):
        found = judge_dense(formula, its, end)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(DenseOutlook, "plan", longer)
            other = judge_dense(formula, its, end)
        assert (other.lower, other.upper, other.verdict) == (
            found.lower,
            found.upper,
            found.verdict,
        )
