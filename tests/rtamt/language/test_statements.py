"""Statements: names, declarations, constants, ids, and ends of statements."""

from __future__ import annotations

import pickle
import sys
import types

import pytest

import rtamt
from rtamt import Formula
from rtamt.errors import ParseError
from rtamt.language.declarations import Declaration


def formula(text: str) -> Formula:
    return rtamt.parse(text).formula


WHOLE = """
specification gripper // a comment
from geometry_msgs.msg import Twist
/* comments
   of two lines */
const float K = 5; const int MINUS = -3
input Twist cmd
output float pos = 0.5
float other = -1
float out
@ topic(cmd, /robot/cmd.v2/always/1)

near = abs(cmd.linear.x - pos) < K
out = always[0:K ms](near)
"""


def test_a_whole_specification() -> None:
    msg = types.SimpleNamespace(Twist=object)
    spec = rtamt.parse(WHOLE, modules={"geometry_msgs.msg": msg})
    assert spec.name == "gripper"
    assert spec.text == WHOLE
    assert list(spec.formulas) == ["near", "out"]
    assert spec.formula is spec.formulas["out"] is formula("G[0:5ms](abs(cmd.linear.x - pos) < 5)")
    assert spec.variables == ("cmd.linear.x", "pos")
    assert spec.inputs == ("cmd.linear.x",)
    assert spec.outputs == ("pos",)
    assert spec.declarations == {
        "cmd": Declaration("Twist", "input"),
        "pos": Declaration("float", "output", 0.5),
        "other": Declaration("float", None, -1.0),
        "out": Declaration("float"),
    }
    assert spec.declaration("cmd.linear.x") == Declaration("Twist", "input")
    assert spec.constants == {"K": 5.0, "MINUS": -3.0}
    assert spec.topics == {"cmd": "/robot/cmd.v2/always/1"}
    assert spec.imports == {"Twist": "geometry_msgs.msg"}
    assert spec.horizon == 0.005


@pytest.mark.parametrize(
    "text",
    [
        "p = x > 0; q = y > 0; p and q",
        "p = x > 0\nq = y > 0\np and q",
        "\n\n;p = x > 0;;\n;q = y > 0\n\np and q;\n",
        "p =\n x\n > 0\nq = y >\n\n 0\n// more\np\nand q",
        "p = x > 0\r\nq = y > 0 // so\r\n\r\np and q\r\n",
        "p = (\nx\n>\n0\n)\nq = y > 0\np and\n\nq",
        "p = x > 0 /* ; */; q = y > 0 /*\n*/; p\n/**/ and // and\nq",
    ],
)
def test_statements_end_with_the_line_or_a_semicolon(text: str) -> None:
    spec = rtamt.parse(text)
    assert list(spec.formulas) == ["p", "q"]
    assert spec.formula is formula("x > 0 and y > 0")


@pytest.mark.parametrize(
    ("text", "joined"),
    [
        ("p = x\n- y > 0", "p = x - y > 0"),
        ("always\nx", "always x"),
        ("always[0:5]\nx > 0", "always[0:5] x > 0"),
        ("always[3,)\nx > 0", "always[3,) x > 0"),
        ("always\n[0:5]\nx", "always[0:5] x"),
        ("x until\n[0:5] y", "x until[0:5] y"),
        ("x\nuntil y", "x until y"),
        ("x\n\n\n/ y > 0", "x / y > 0"),
        ("x > 0\n-> y", "x > 0 -> y"),
        ("abs\n(x) > 0", "abs(x) > 0"),
        ("not\n! x", "not ! x"),
        ("min(x\n,\ny) > 0", "min(x, y) > 0"),
    ],
)
def test_an_operator_continues_the_line(text: str, joined: str) -> None:
    assert rtamt.parse(text) == rtamt.parse(joined)
    assert formula(text) is formula(joined)


def test_a_prefix_operator_begins_a_statement() -> None:
    assert list(rtamt.parse("p = x > 0\nq = y > 0\n!p").formulas) == ["p", "q"]


def test_later_formulas_use_earlier_ones() -> None:
    spec = rtamt.parse("p = x > 0\nq = always p\nr = x\nr > 3 implies q")
    assert spec.formula is formula("x > 3 implies always(x > 0)")
    assert spec.formulas["r"] is formula("x")
    assert spec.variables == ("x",)


def test_formula_declared_as_output() -> None:
    spec = rtamt.parse("input float x\noutput float out\nout = always(x > 0)")
    assert spec.variables == spec.inputs == ("x",)
    assert spec.outputs == ()
    # It declares no variable that formulas read, so the others need no declaration.
    assert rtamt.parse("output float out\nout = always(x > 0)").variables == ("x",)


def test_order_of_variables() -> None:
    assert rtamt.parse("p = c > b\na > b").variables == ("c", "b", "a")
    assert rtamt.parse("float a; float b; float c; float d; p = c > b\na > b").variables == (
        "a",
        "b",
        "c",
    )


def test_constants_of_the_text_declare_no_variables() -> None:
    spec = rtamt.parse("const float K = 3\nx > K - 1")
    assert spec.variables == ("x",)
    assert spec.formula is formula("x > 3 - 1")


def test_constants_given_by_the_caller_are_used_and_kept() -> None:
    spec = rtamt.parse("G[0:T] x > K", constants={"T": "0.1", "K": 2})
    assert spec.formula is formula("G[0:0.1] x > 2")
    assert spec.constants == {"T": 0.1, "K": 2.0}


def test_topics_may_name_a_variable_that_is_not_declared() -> None:
    assert rtamt.parse("x > 0\n@ topic(x, a/b)").topics == {"x": "a/b"}


@pytest.mark.parametrize("kind", ["bool", "int", "float", "double", "uint8", "int64", "float32"])
def test_primitive_types(kind: str) -> None:
    assert rtamt.parse(f"{kind} x; const {kind} K = 1; x > K").declarations["x"].type == kind


def test_nothing_is_imported_from_text() -> None:
    text = "from antigravity import geohash\ninput geohash x\nx.y > 0"
    spec = rtamt.parse(text)
    assert "antigravity" not in sys.modules
    assert spec.imports == {"geohash": "antigravity"}
    assert spec.types == {}
    assert spec.variables == spec.inputs == ("x.y",)


@pytest.mark.parametrize(
    "line",
    [
        "from m import A, B, min",
        "from m import A,B ; from m import min, A",
        "from m import A, B\nfrom m import min",
    ],
)
def test_one_import_has_several_types(line: str) -> None:
    text = "input A a; input B b; output min c\n(a.x > b.y or b.z.w > c.v)\n@ topic(b, r/b)"
    lines = "from m import A\nfrom m import B\nfrom m import min"
    spec, other = rtamt.parse(f"{line}\n{text}"), rtamt.parse(f"{lines}\n{text}")
    assert spec.imports == {"A": "m", "B": "m", "min": "m"}
    assert str(spec) == str(other)
    assert spec.subscriptions() == other.subscriptions()
    assert rtamt.parse(str(spec)) == spec == pickle.loads(pickle.dumps(spec))
    assert {name: d.type for name, d in spec.declarations.items()} == {
        "a": "A",
        "b": "B",
        "c": "min",
    }


def test_every_type_of_an_import_is_looked_up() -> None:
    twist, point = type("Twist", (), {}), type("Point", (), {})
    given = {"m": types.SimpleNamespace(Twist=twist, Point=point)}
    spec = rtamt.parse("from m import Twist, Point\ninput Point p\np.x > 0", modules=given)
    assert spec.types == {"Twist": twist, "Point": point}
    with pytest.raises(ParseError) as caught:
        rtamt.parse("from m import Twist, Piont\ninput Twist t\nt.x > 0", modules=given)
    assert str(caught.value).splitlines() == [
        "STL:1:22: module 'm' has no type 'Piont'",
        "  from m import Twist, Piont",
        "                       ^",
        "  hint: did you mean 'Point'?",
    ]


def test_modules_that_are_given_have_what_is_imported() -> None:
    given = {"m": types.SimpleNamespace(Twist=1)}
    for modules in ({}, given):
        with pytest.raises(ParseError) as caught:
            rtamt.parse("from node import Twist\nx", modules=modules)
        assert str(caught.value).splitlines() == [
            "STL:1:6: module 'node' was not given",
            "  from node import Twist",
            "       ^",
            "  hint: modules=['node'] imports it",
        ]
    with pytest.raises(ParseError, match=r"given(.|\n)*hint: did you mean 'm\.msg'\?$"):
        rtamt.parse("from mmsg import Twist\nx", modules={"m.msg": given["m"]})
    with pytest.raises(ParseError, match=r"module 'm' has no type 'Twits'(.|\n)*mean 'Twist'"):
        rtamt.parse("from m import Twits\nx", modules=given)


def test_a_declaration_says_a_range() -> None:
    text = """
    const float LIMIT = 4
    input float x in [-LIMIT, LIMIT] = 2
    uint8 gear in [0:5]
    output float y in [-inf, 0.5]
    float in in [0, inf]
    x > y and gear > in
    """
    spec = rtamt.parse(text)
    assert spec.ranges == {
        "x": (-4.0, 4.0),
        "gear": (0.0, 5.0),
        "y": (float("-inf"), 0.5),
        "in": (0.0, float("inf")),
    }
    assert spec.declarations["x"] == Declaration("float", "input", 2.0, (-4.0, 4.0))
    assert str(spec).splitlines()[1:5] == [
        "input float x in [-4, 4] = 2",
        "uint8 gear in [0, 5]",
        "output float y in [-inf, 0.5]",
        "float in in [0, inf]",
    ]
    again = rtamt.parse(str(spec))
    assert again == spec
    assert again.ranges == spec.ranges
    wider = rtamt.parse(text, constants={"LIMIT": 9})
    assert wider.ranges["x"] == (-9.0, 9.0)
    assert wider != spec
    assert pickle.loads(pickle.dumps(wider)) == wider


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("bool", (0.0, 1.0)),
        ("uint8", (0.0, 255.0)),
        ("int16", (-32768.0, 32767.0)),
        ("uint", (0.0, float("inf"))),
        ("int", None),
        ("long", None),
        ("float32", None),
    ],
)
def test_types_have_ranges(kind: str, values: tuple[float, float] | None) -> None:
    assert rtamt.parse(f"{kind} x; x > 0").ranges.get("x") == values
    if values is not None:
        assert rtamt.parse(f"{kind} x in [0, 1]; x > 0").ranges["x"] == (0.0, 1.0)


def test_the_range_of_a_message_is_that_of_its_data() -> None:
    text = "from std_msgs.msg import Float64\ninput Float64 level in [0, 9]\nlevel.data > 3"
    assert rtamt.parse(text).ranges == {"level.data": (0.0, 9.0)}
    other = "from sensor_msgs.msg import Imu\ninput Imu imu in [0, 9]\nimu.orientation.x > 3"
    assert rtamt.parse(other).ranges == {}


def test_monitors_judge_values_outside_of_a_range() -> None:
    judged = rtamt.judge("float x in [0, 1]; always(x < 3)", {"x": [0.5, 2.0]})
    assert judged.verdict is rtamt.Verdict.SATISFIED
    assert judged.robustness == 1.0
