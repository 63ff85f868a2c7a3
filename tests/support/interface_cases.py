"""Specifications that declare inputs and outputs, each with a semantics, and their oracle."""

from __future__ import annotations

from hypothesis import strategies as st
from interface_oracle import SEMANTICS, reader
from oracle import Read
from strategies import VARIABLES, formulas

import rtamt
from rtamt import Specification
from rtamt.typing import SemanticsName

Case = tuple[Specification, SemanticsName]
AWARE: st.SearchStrategy[SemanticsName] = st.sampled_from(SEMANTICS[1:])
RELATIVE: st.SearchStrategy[SemanticsName] = st.sampled_from(
    ("output-robustness", "input-robustness")
)
VACUITY: st.SearchStrategy[SemanticsName] = st.sampled_from(("input-vacuity", "output-vacuity"))
NEUTRAL = frozenset(SEMANTICS) - {"standard", "boolean"}
"""The semantics in which a predicate may be 0, neither true nor false."""
ROLES = st.permutations(["input", "output", "input", "output", ""]).map(
    lambda roles: dict(zip(VARIABLES, roles, strict=False))
)


@st.composite
def cases(
    draw: st.DrawFn,
    semantics: st.SearchStrategy[SemanticsName] = AWARE,
    *,
    endless: bool = False,
    total: bool = True,
    dense: bool = False,
) -> Case:
    """Specifications with inputs and outputs, and a semantics of a side that has variables."""
    formula = draw(formulas(endless=endless, total=total, dense=dense))
    wanted = draw(semantics)
    role = wanted.partition("-")[0]
    roles = draw(ROLES.filter(lambda roles: wanted == "boolean" or role in roles.values()))
    declarations = "".join(f"{io} float {name};\n" for name, io in roles.items())
    return rtamt.parse(f"{declarations}{formula}"), wanted


def read(case: Case) -> Read:
    """Return the predicate reader of the oracle for a case."""
    spec, semantics = case
    sides = {
        io: frozenset(name for name, d in spec.declarations.items() if d.io == io)
        for io in ("input", "output")
    }
    return reader(semantics, sides["input"], sides["output"])
