"""Formulas that contain an implication."""

from __future__ import annotations

import functools
from collections.abc import Callable

from hypothesis import strategies as st
from interface_cases import ROLES, Case
from interface_oracle import SEMANTICS
from strategies import formulas, rooted

from rtamt import Formula, parse

Wrap = Callable[[Formula, Formula], Formula]
WRAPS: tuple[Wrap, ...] = (
    lambda f, _: f.always(),
    lambda f, _: f.always(1, 3),
    lambda f, _: f.always(2),
    lambda f, _: f.eventually(),
    lambda f, _: f.eventually(0, 2),
    lambda f, _: f.historically(1, 2),
    lambda f, _: f.once(),
    lambda f, _: f.prev(),
    lambda f, _: f.next(strong=True),
    lambda f, _: f.rise(),
    lambda f, _: ~f,
    lambda f, g: f & g,
    lambda f, g: g | f,
    lambda f, g: f.implies(g),
    lambda f, g: g.implies(f),
    lambda f, g: f.iff(g),
    lambda f, g: f.until(g, 1, 2),
    lambda f, g: f.until(g, 0, 0),
    lambda f, g: g.until(f, 1),
    lambda f, g: f.since(g, 0, 2),
    lambda f, g: g.since(f),
    lambda f, g: f.unless(g, 1, 2),
    lambda f, g: f.unless(g),
    lambda f, _: f & f.next() & (f & f.historically(2, 2)).always(),
    lambda f, g: (f & g).always().eventually(),
)


@functools.cache
@st.composite
def requirements(draw: st.DrawFn, most: int = 3, *, total: bool = True) -> Formula:
    """Formulas with an implication at some place."""
    formula = draw(rooted("implies", 1, endless=True, total=total))
    for wrap in draw(st.lists(st.sampled_from(WRAPS), min_size=0, max_size=most)):
        formula = wrap(formula, draw(formulas(1, total=total)))
    return formula


@st.composite
def aware(draw: st.DrawFn, drawn: st.SearchStrategy[Formula]) -> Case:
    """Requirements that declare inputs and outputs, and a semantics."""
    semantics = draw(st.sampled_from(SEMANTICS))
    role = semantics.partition("-")[0]
    plain = semantics in ("standard", "boolean")
    roles = draw(ROLES.filter(lambda roles: plain or role in roles.values()))
    declared = "".join(f"{io} float {name};\n" for name, io in roles.items())
    return parse(f"{declared}{draw(drawn)}"), semantics


DENSE_WRAPS = tuple(wrap for i, wrap in enumerate(WRAPS) if i not in (7, 8, 9, 23))


@functools.cache
@st.composite
def dense_requirements(draw: st.DrawFn) -> Formula:
    """Formulas in dense time with an implication at some place."""
    formula = draw(rooted("implies", 1, endless=True, dense=True))
    for wrap in draw(st.lists(st.sampled_from(DENSE_WRAPS), min_size=0, max_size=2)):
        formula = wrap(formula, draw(formulas(1, dense=True)))
    return formula
