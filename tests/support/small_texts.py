"""Texts of formulas whose windows are so short that all traces can be tried."""

from hypothesis import strategies as st

VALUES = (-1.0, 0.0, 0.5, 1.0, 2.0)
"""A value of each kind that comparisons of a variable with 0 and 1 tell apart."""

_bounds = st.sampled_from(["[0:0]", "[0:1]", "[1:1]", "[1:2]", "[0:2]"])


def _above(below: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    one = st.sampled_from(["not", "rise", "prev", "next"])
    timed = st.sampled_from(["always", "eventually", "once", "historically"])
    two = st.sampled_from(["and", "or", "implies", "iff", "xor"])
    return st.one_of(
        st.builds("{}({})".format, one, below),
        st.builds("{}{}({})".format, timed, _bounds, below),
        st.builds("({}) {} ({})".format, below, two, below),
        st.builds("({}) until{} ({})".format, below, _bounds, below),
    )


def texts_of(*atoms: str) -> st.SearchStrategy[str]:
    """Texts of formulas of these atoms, three of them at most."""
    return st.recursive(st.sampled_from(atoms), _above, max_leaves=3)


texts = texts_of("x > 0", "x >= 1", "x == 0", "x < 1", "x != 1", "true")
"""Texts of one variable."""
