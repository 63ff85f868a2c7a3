"""Texts of formulas with short windows, so that tests can try all traces."""

from hypothesis import strategies as st

VALUES = (-1.0, 0.0, 0.5, 1.0, 2.0)
"""A value of each kind that comparisons of a variable with 0 and 1 distinguish."""

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
    """Return texts of formulas with at most three of these atoms."""
    return st.recursive(st.sampled_from(atoms), _above, max_leaves=3)


texts = texts_of("x > 0", "x >= 1", "x == 0", "x < 1", "x != 1", "true")
"""Texts of one variable."""
