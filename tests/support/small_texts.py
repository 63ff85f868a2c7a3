"""Texts of formulas of one variable whose windows are so short that all traces can be tried."""

from hypothesis import strategies as st

VALUES = (-1.0, 0.0, 0.5, 1.0, 2.0)
"""A value of each kind that comparisons of a variable with 0 and 1 tell apart."""

_atoms = st.sampled_from(["x > 0", "x >= 1", "x == 0", "x < 1", "x != 1", "true"])
_bounds = st.sampled_from(["[0:0]", "[0:1]", "[1:1]", "[1:2]", "[0:2]"])


def _above(below: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    one = st.sampled_from(["not", "rise", "prev", "next"])
    timed = st.sampled_from(["always", "eventually", "once", "historically"])
    two = st.sampled_from(["and", "or", "implies", "xor"])
    return st.one_of(
        st.builds("{}({})".format, one, below),
        st.builds("{}{}({})".format, timed, _bounds, below),
        st.builds("({}) {} ({})".format, below, two, below),
        st.builds("({}) until{} ({})".format, below, _bounds, below),
    )


texts = st.recursive(_atoms, _above, max_leaves=3)
