"""Names, signatures, paths and syntax trees of the released library."""

import importlib
import json
import math
import subprocess
import sys

import pytest
from compat_specs import declared, declared_dense
from hypothesis import given
from paths import GOLDEN
from released_cases import CLASSES, measure
from strategies import formulas

import rtamt
from rtamt import Formula, StlDenseTimeSpecification, StlDiscreteTimeSpecification

RELEASED = json.loads((GOLDEN / "released.json").read_text())

# Folders of its own modules; the imported ones exist here too.
FOLDERS = {"antlr", "exception", "explanation", "pastifier", "semantics", "spec", "syntax"}
# Internal objects: interpreters, the rewriting of formulas.
INSIDE = {"explainer", "interpreter", "offline_interpreter", "online_interpreter"}
INSIDE |= {"pastifier", "set_ast_flag"}
# Reading or calling these fails in the released library.
BROKEN = {"add_op", "publish_var", "publish_var_field"}
BROKEN_IN = {"Discrete": {"final_update"}, "Dense": {"explain"}}


def test_the_table_is_whole() -> None:
    kinds = [case["kind"] for case in RELEASED["cases"]]
    counts = {kind: kinds.count(kind) for kind in sorted(set(kinds))}
    assert counts == {"dense offline": 20, "dense online": 10, "offline": 59, "online": 43}


@pytest.mark.parametrize("kind", ["offline", "online", "dense offline", "dense online"])
def test_results_match_the_released_library(kind: str) -> None:
    for case in RELEASED["cases"]:
        if case["kind"] == kind:
            assert measure(case) == case["result"], case


def test_every_public_name_is_there() -> None:
    absent = {name for name in RELEASED["names"]["rtamt"] if not hasattr(rtamt, name)}
    assert absent <= FOLDERS
    assert len(RELEASED["names"]["rtamt"]) == 21


@pytest.mark.parametrize("name", CLASSES)
def test_public_names_of_released_classes(name: str) -> None:
    spec, released = getattr(rtamt, name)(), set(RELEASED["names"][name])
    time = "Discrete" if "Discrete" in name else "Dense"
    absent = {word for word in released if not hasattr(spec, word)}
    assert absent == released & (INSIDE | BROKEN | BROKEN_IN[time])


PATHS = {
    "rtamt.exception.exception": ["RTAMTException"],
    "rtamt.semantics.enumerations.io_type": ["StlIOType"],
    "rtamt.semantics.enumerations.options": ["Language", "Semantics", "TimeInterpretation"],
    "rtamt.spec.stl.discrete_time.specification": [
        "Semantics",
        "StlDiscreteTimeOfflineSpecification",
        "StlDiscreteTimeOnlineSpecification",
        "StlDiscreteTimeOnlineSpecificationCpp",
        "StlDiscreteTimeSpecification",
    ],
    "rtamt.spec.stl.dense_time.specification": [
        "StlDenseTimeOfflineSpecification",
        "StlDenseTimeOnlineSpecification",
        "StlDenseTimeSpecification",
    ],
}


@pytest.mark.parametrize("path", PATHS)
def test_modules_are_where_programs_import_them_from(path: str) -> None:
    module = importlib.import_module(path)
    for name in PATHS[path]:
        assert getattr(module, name) is getattr(rtamt, name)


@pytest.mark.parametrize("time", ["Discrete", "Dense"])
@pytest.mark.parametrize("mode", ["Offline", "Online"])
@pytest.mark.parametrize("semantics", list(rtamt.Semantics)[1:])
def test_interface_aware_constructors(semantics: rtamt.Semantics, mode: str, time: str) -> None:
    words = semantics.value.title().replace("-", "")
    module = importlib.import_module(f"rtamt.spec.iastl.{time.lower()}_time.specification")
    spec = getattr(module, f"IAStl{words}{time}Time{mode}Specification")()
    assert type(spec) is getattr(rtamt, f"Stl{time}Time{mode}Specification")
    assert spec.semantics is semantics


EARLIER = {
    "STLSpecification": "StlDiscreteTimeSpecification",
    "STLIOSpecification": "StlDiscreteTimeSpecification",
    "STLDiscreteTimeSpecification": "StlDiscreteTimeSpecification",
    "LTLSpecification": "StlDiscreteTimeSpecification",
    "LTLDiscreteTimeSpecification": "StlDiscreteTimeSpecification",
    "STLCTSpecification": "StlDenseTimeSpecification",
    "STLIOCTSpecification": "StlDenseTimeSpecification",
    "STLDenseTimeSpecification": "StlDenseTimeSpecification",
}


@pytest.mark.parametrize("name", EARLIER)
def test_earlier_names_take_the_arguments_of_all_times(name: str) -> None:
    cls = getattr(rtamt, name)
    assert issubclass(cls, getattr(rtamt, EARLIER[name]))
    cpp = [cls(is_pure_python=False), cls(0), cls(language=rtamt.Language.CPP)]
    assert [spec.language for spec in cpp] == [rtamt.Language.CPP] * 3
    for spec in (cls(), cls(1), cls(is_pure_python=True)):
        assert (spec.language, spec.semantics) == (rtamt.Language.PYTHON, rtamt.Semantics.STANDARD)
    spec = cls(rtamt.Semantics.INPUT_VACUITY)
    assert spec.iosem == "input-vacuity"
    spec.iosem = "output-robustness"
    assert spec.semantics is rtamt.Semantics.OUTPUT_ROBUSTNESS
    with pytest.raises(rtamt.InputError) as raised:
        spec.iosem = "nonsense"
    assert str(raised.value) == (
        "expected a member of Semantics, or 'standard', 'output-robustness', "
        "'input-vacuity', 'input-robustness', 'output-vacuity', got 'nonsense'"
    )


def test_the_monitors_of_the_2020_paper_run() -> None:
    spec = rtamt.STLIOSpecification(is_pure_python=True)
    for name, io in (("req", "input"), ("gnt", "output"), ("out", "output")):
        spec.declare_var(name, "float")
        spec.set_var_io_type(name, io)
    spec.iosem = "output-robustness"
    spec.spec = "out = always((req >= 3) implies (eventually[0:2](gnt >= 3)))"
    try:
        spec.parse()
    except rtamt.STLParseException as error:
        pytest.fail(str(error))
    samples = [(4.0, 0.0), (0.0, 1.0), (0.0, 1.0), (0.0, 1.0)]
    updates = [spec.update(i, [("req", r), ("gnt", g)]) for i, (r, g) in enumerate(samples)]
    assert updates == [-3.0, -2.0, -2.0, -2.0]
    assert spec.get_var_object("gnt") == 1.0
    spec.reset()
    signals = {"req": [(0, 4.0), (1, 0.0), (2, 0.0)], "gnt": [(0, 0.0), (1, 1.0), (2, 1.0)]}
    assert spec.offline(signals) == -2.0


def test_offline_says_what_is_wrong_with_the_data() -> None:
    spec = rtamt.STLSpecification()
    spec.declare_var("a", "float")
    spec.declare_var("b", "float")
    spec.spec = "a > b"
    spec.parse()
    for data, got in (
        ({"a": [(0, 1.0)], "b": []}, "a: 1, b: 0"),
        ({"a": [(0, 1.0)], "b": [(1, 1.0)]}, "a: 1, b: 1"),
        ({}, "none"),
    ):
        with pytest.raises(rtamt.STLOfflineException) as raised:
            spec.offline(data)
        expected = "expected samples of all variables at the same times, 1 or more; got "
        assert str(raised.value) == expected + got


def test_classes_are_imported_on_first_use() -> None:
    code = (
        "import sys, rtamt; assert 'rtamt.compat' not in sys.modules; "
        "from rtamt import StlDiscreteTimeSpecification; assert 'antlr4' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_names_that_nobody_released_are_absent() -> None:
    with pytest.raises(AttributeError, match="module 'rtamt' has no attribute 'StlNonsense'"):
        _ = rtamt.StlNonsense  # type: ignore[attr-defined]


Spec = StlDiscreteTimeSpecification | StlDenseTimeSpecification


@pytest.mark.parametrize("kind", [StlDiscreteTimeSpecification, StlDenseTimeSpecification])
def test_ast_lists_formulas_with_horizon(kind: type[Spec]) -> None:
    spec = kind()
    assert list(spec.ast.specs) == []
    for name, role in (("a", "input"), ("b", "output"), ("c", "neither"), ("p", "output")):
        spec.declare_var(name, "float")
        spec.set_var_io_type(name, role)
    spec.add_sub_spec("p = eventually[0:2](a > c)")
    spec.spec = "always[0:3](p implies b > a)"
    spec.parse()
    inner, outer = spec.ast.specs
    assert (inner.name, inner.horizon) == ("eventually[0:2](a > c)", 2.0)
    assert (inner.in_vars, inner.out_vars) == (("a",), ())
    assert (outer.name, outer.horizon) == (
        "always[0:3](eventually[0:2](a > c) implies b > a)",
        5.0,
    )
    assert (outer.in_vars, outer.out_vars) == (("a",), ("b",))
    with pytest.raises(AttributeError):
        outer.horizon = 1.0  # type: ignore[misc]
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
def test_ast_of_a_single_formula(
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


def test_ast_names_messages_of_fields() -> None:
    spec = StlDiscreteTimeSpecification()
    spec.import_module(__name__, "Float")
    spec.declare_var("req", "Float")
    spec.set_var_io_type("req", "input")
    spec.spec = "req.value > 1"
    spec.parse()
    (only,) = spec.ast.specs
    assert only.in_vars == ("req",)
