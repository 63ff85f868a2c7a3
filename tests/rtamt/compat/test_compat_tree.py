"""`spec.ast.specs`, which checkers of specifications read."""

import math

import pytest
from compat_specs import declared, declared_dense
from hypothesis import given
from strategies import formulas

import rtamt
from rtamt import Formula, StlDenseTimeSpecification, StlDiscreteTimeSpecification

Spec = StlDiscreteTimeSpecification | StlDenseTimeSpecification


@pytest.mark.parametrize("kind", [StlDiscreteTimeSpecification, StlDenseTimeSpecification])
def test_the_formulas_are_there_in_order_with_horizon_and_variables(kind: type[Spec]) -> None:
    spec = kind()
    assert list(spec.ast.specs) == []
    for name, role in (("a", "input"), ("b", "output"), ("c", "neither"), ("p", "output")):
        spec.declare_var(name, "float")
        spec.set_var_io_type(name, role)
    spec.add_sub_spec("p = eventually[0:2](a > c)")
    spec.spec = "always[0:3](p implies b > a)"
    spec.parse()
    inner, whole = spec.ast.specs
    assert (inner.name, inner.horizon) == ("eventually[0:2](a > c)", 2.0)
    assert (inner.in_vars, inner.out_vars) == (("a",), ())
    assert (whole.name, whole.horizon) == (
        "always[0:3](eventually[0:2](a > c) implies b > a)",
        5.0,
    )
    assert (whole.in_vars, whole.out_vars) == (("a",), ("b",))
    with pytest.raises(AttributeError):
        whole.horizon = 1.0  # type: ignore[misc]
    spec.spec = "out = eventually(b > 1)"
    spec.parse()
    assert [formula.horizon for formula in spec.ast.specs] == [2.0, math.inf]


def test_the_horizon_is_in_the_unit_of_the_specification() -> None:
    spec = declared("always[0:200](a > 0)", ("a",))
    spec.unit = "ms"
    assert [formula.horizon for formula in spec.ast.specs] == [200.0]
    spec = declared("always[0:200ms](a > 0)", ("a",))
    assert [formula.horizon for formula in spec.ast.specs] == [0.2]


@given(formula=formulas(dense=True, endless=True))
def test_a_formula_alone_has_the_horizon_and_the_variables_of_its_specification(
    formula: Formula,
) -> None:
    parsed = rtamt.parse(str(formula))
    for spec in (declared(formula), declared_dense(formula)):
        (only,) = spec.ast.specs
        assert (only.name, only.horizon) == (str(formula), parsed.horizon)
        assert (set(only.out_vars), only.in_vars) == (set(parsed.variables), ())


class Float:
    """A message."""

    def __init__(self) -> None:
        self.value = 0.0


def test_a_field_stands_under_the_name_of_its_message() -> None:
    spec = StlDiscreteTimeSpecification()
    spec.import_module(__name__, "Float")
    spec.declare_var("req", "Float")
    spec.set_var_io_type("req", "input")
    spec.spec = "req.value > 1"
    spec.parse()
    (only,) = spec.ast.specs
    assert only.in_vars == ("req",)
