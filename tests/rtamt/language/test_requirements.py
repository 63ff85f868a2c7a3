"""Requirements: the formulas of a text that no other formula uses."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt import Specification

HEADER = "const float LIMIT = 0.5\ninput float x = 1\noutput float y\n"

_SHAPES = (
    ("{p}", 1),
    ("always(x > LIMIT)", 0),
    ("x - y", 0),
    ("always[0:2]({p})", 1),
    ("{p} and {q}", 2),
    ("(x > 0 and {p}) and y > LIMIT", 1),
    ("{p} until[0:3] (abs({q}) < 1)", 2),
)


@st.composite
def statements(draw: st.DrawFn) -> dict[str, tuple[str, set[str]]]:
    """Formulas by name, ``""`` without a name: their text, and the names in it."""
    drawn: dict[str, tuple[str, set[str]]] = {}
    # "t0" and so on are values of terms, so that abs() accepts them.
    values = ["t0"]
    drawn["t0"] = ("x + 2 * y", set())
    for count in range(draw(st.integers(1, 5))):
        shape, operands = draw(st.sampled_from(_SHAPES))
        used = {
            "p": draw(st.sampled_from([*drawn])) if operands else "",
            "q": draw(st.sampled_from(values)) if operands > 1 else "",
        }
        drawn[f"f{count}"] = (shape.format(**used), set(filter(None, used.values())))
        if shape == "x - y":
            values.append(f"f{count}")
    if draw(st.booleans()):
        drawn[""] = drawn.popitem()[1]
    return drawn


def written(drawn: Mapping[str, tuple[str, set[str]]]) -> str:
    lines = [f"{name} = {text}" if name else text for name, (text, _) in drawn.items()]
    return HEADER + "\n".join(lines)


@given(statements())
def test_requirements_match_separate_texts(
    drawn: dict[str, tuple[str, set[str]]],
) -> None:
    spec = rtamt.parse(written(drawn))
    formulas = {name: rtamt.parse(written(_with(drawn, name))).formula for name in drawn}
    roots = [name for name in drawn if not any(name in used for _, used in drawn.values())]
    if any(formulas[root] is formulas.get("") for root in roots[:-1]):
        roots.remove("")  # the last formula is a requirement that has a name
    results = spec.requirements
    assert [requirement.formula for requirement in results.values()] == [formulas[r] for r in roots]
    for root, (name, requirement) in zip(roots, results.items(), strict=True):
        separate = rtamt.parse(written(_with(drawn, root)))
        if requirement is not spec:  # one alone has all formulas
            assert requirement.formulas == separate.formulas
        assert requirement.variables == separate.variables
        assert requirement.constants == spec.constants
        assert requirement.declarations == spec.declarations
        assert name == root or not root
        assert list(requirement.requirements) == [name]


def _with(drawn: Mapping[str, tuple[str, set[str]]], root: str) -> dict[str, tuple[str, set[str]]]:
    """The statements that a formula needs; the formula comes last."""
    needed, todo = {root}, [root]
    while todo:
        todo += drawn[todo.pop()][1] - needed
        needed.update(todo)
    return {name: each for name, each in drawn.items() if name in needed}


@given(statements())
def test_text_and_pickles_keep_requirements(
    drawn: dict[str, tuple[str, set[str]]],
) -> None:
    spec = rtamt.parse(written(drawn))
    again = rtamt.parse(str(spec))
    assert again == spec
    assert list(again.requirements) == list(spec.requirements)
    for name, requirement in spec.requirements.items():
        assert rtamt.parse(str(requirement)) == requirement
        assert list(rtamt.parse(str(requirement)).requirements) == [name]
        for copied in (pickle.loads(pickle.dumps(requirement)), copy.deepcopy(requirement)):
            assert copied == requirement
            assert copied.formula is requirement.formula
            assert copied.requirement == requirement.requirement


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # A single requirement has the name of the text, of the result, or "spec", in this order.
        ("always(x > 0)", {"spec": "always(x > 0)"}),
        ("a = always(x > 0)", {"a": "always(x > 0)"}),
        ("specification s; a = always(x > 0)", {"s": "always(x > 0)"}),
        ("a = x > 0; always(a)", {"spec": "always(x > 0)"}),
        # A formula uses the formulas that it names.
        ("a = x > 0; b = a", {"b": "x > 0"}),
        ("a = x > 0; a", {"a": "x > 0"}),
        ("a = x > 0; b = always(x > 0)", {"a": "x > 0", "b": "always(x > 0)"}),
        ("a = always(x > 0); b = always(x > 0)", {"a": "always(x > 0)", "b": "always(x > 0)"}),
        (
            "a = x > 0 and y > 0; b = always(a and z > 0)",
            {"b": "always(x > 0 and y > 0 and z > 0)"},
        ),
        ("d = x - y; b = always(abs(d) < 1)", {"b": "always(abs(x - y) < 1)"}),
        # A last formula without a name has the name of the text, or "spec" if that is free.
        ("a = always(x > 0); always(y > 0)", {"a": "always(x > 0)", "spec": "always(y > 0)"}),
        (
            "specification s; a = always(x > 0); always(y > 0)",
            {"a": "always(x > 0)", "s": "always(y > 0)"},
        ),
        (
            "specification a; a = always(x > 0); spec = always(z > 0); always(y > 0)",
            {"a": "always(x > 0)", "spec": "always(z > 0)", "spec2": "always(y > 0)"},
        ),
        # It is not a second requirement if it equals a named one.
        ("a = always(x > 0); always(x > 0)", {"a": "always(x > 0)"}),
        ("a = x > 0; b = y > 0; a", {"b": "y > 0", "a": "x > 0"}),
    ],
)
def test_names_of_requirements(text: str, expected: dict[str, str]) -> None:
    results = rtamt.parse(text).requirements
    assert {name: str(requirement.formula) for name, requirement in results.items()} == expected
    assert list(results) == list(expected)


def test_a_requirement_alone_is_the_specification_itself() -> None:
    spec = rtamt.parse("near = abs(x) < 1; always(near)")
    assert spec.requirements["spec"] is spec
    from_python = Specification.of(rtamt.variable("x") > 0)
    assert dict(from_python.requirements) == {"spec": from_python}
    assert dict(spec.always().requirements) == {"spec": spec.always()}


def test_requirements_are_read_only() -> None:
    spec = rtamt.parse("a = always(x > 0); b = always(y > 0)")
    with pytest.raises(TypeError, match="does not support item assignment"):
        spec.requirements["c"] = spec  # type: ignore[index]  # this is what is refused


def test_requirement_error_place() -> None:
    spec = rtamt.parse("a = always(x > 0)\nb = always[0:0.25](y > 0)\nc = always(b)")
    assert list(spec.requirements) == ["a", "c"]
    with pytest.raises(rtamt.ParseError) as caught:
        rtamt.EpisodeMonitor(spec.requirements["c"], period=0.1)
    assert (caught.value.line, caught.value.column) == (2, 11)


def test_always_changes_one_requirement() -> None:
    spec = rtamt.parse("a = x > 0; b = y > 0; c = z > 0")
    lasting = spec.requirements["b"].always()
    assert {n: str(r.formula) for n, r in lasting.requirements.items()} == {"spec": "always(y > 0)"}
    assert pickle.loads(pickle.dumps(lasting)).formula is lasting.formula
