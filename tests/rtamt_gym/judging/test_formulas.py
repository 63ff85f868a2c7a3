"""Requirements whose operands read only the first sample are refused, with both readings."""

import re

import numpy as np
import pytest

import rtamt
from rtamt import SpecificationError
from rtamt_gym import simulate
from rtamt_gym.__main__ import main
from rtamt_gym.judging.formulas import require_whole_episode

REFUSED = {
    "always x > 0 implies y > 0": "always(x > 0 implies y > 0)",
    "G x > 0 -> y > 0": "always(x > 0 implies y > 0)",
    "G(x > 0) -> y > 0": "always(x > 0 implies y > 0)",
    "G[0:2] (x + 1) * 2 > 0 and y > 0": "always[0:2]((x + 1) * 2 > 0 and y > 0)",
    "eventually x > 0 or y > 0 or z > 1": "eventually(x > 0 or y > 0 or z > 1)",
    "z > 0 and G x > 0 and y > 0": "z > 0 and always(x > 0 and y > 0)",
    "(always(x > 0)) implies y > 0": "always(always(x > 0) implies y > 0)",
    "(G[0:2] (x > 0)) -> (y > 0)": "always(always[0:2](x > 0) implies y > 0)",
    "G (x > 0) -> (y > 0)": "always(x > 0 implies y > 0)",
    "(G x > 0 implies y > 0)": "always(x > 0 implies y > 0)",
    "(eventually[0:1](x > 0)) implies y > 0": "always(eventually[0:1](x > 0) implies y > 0)",
    "F[0:1] x > 0 -> y > 0": "always(eventually[0:1](x > 0) implies y > 0)",
    "s_next x > 0 implies y > 0": "always(s_next(x > 0) implies y > 0)",
    "G x > 0 iff y > 0": "always(x > 0 iff y > 0)",
    "G x > 0 xor y > 0": "always(x > 0 xor y > 0)",
    "s_next x > 0 and y > 0": "s_next(x > 0 and y > 0)",
    "ok = y > 0\nout = always x > 0 and ok": "always(x > 0 and y > 0)",
}

ACCEPTED = [
    "always(x > 0 implies y > 0)",
    "x > 0 implies always y > 0",
    "y > 0 and always x > 0",
    "always(x > 0) and y > 0",
    "always[0:2] (x > 0) and y > 0",
    "G x > 0 and G y > 0",
    "G x > 0 implies F y > 0",
    "low = G x > 0\nout = low and y > 0",
    "always(G x > 0 implies y > 0)",
    "not always(x > 0) or y > 0",
    "x > 0 until y > 0",
]


@pytest.mark.parametrize(("text", "every"), REFUSED.items())
def test_loose_operand_error(text: str, every: str) -> None:
    spec = rtamt.parse(text)
    with pytest.raises(rtamt.ParseError, match="at the first sample only") as caught:
        require_whole_episode("it", spec, "--view step")
    written = re.fullmatch(r"write (.*), or for the first sample (.*)", caught.value.hint)
    assert written is not None
    assert written[1] == every
    for way_out in written.groups():
        require_whole_episode("it", rtamt.parse(way_out), "--view step")
    rng = np.random.default_rng(0)
    for _ in range(40):  # the second suggestion is equal at the first sample
        trace = {name: rng.integers(-2, 3, 3) for name in "xyz"}
        same = [rtamt.evaluate(each, trace, period=1)[0] for each in (text, written[2])]
        assert rtamt.holds(same[0]) == rtamt.holds(same[1])


@pytest.mark.parametrize("text", ACCEPTED)
def test_accepted_operands(text: str) -> None:
    require_whole_episode("it", rtamt.parse(text), "--view step")


def test_python_formulas_are_accepted() -> None:
    x, y = rtamt.variable("x"), rtamt.variable("y")
    formula = (x > 0).always().implies(y > 0)
    require_whole_episode("it", rtamt.Specification.of(formula), "--view step")


def test_loose_operand_in_run_and_command(
    tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "always brake == 0 implies speed < 30"
    rows = [{"brake": 0.0, "speed": 20.0}, {"brake": 0.0, "speed": 40.0}]
    with pytest.raises(SpecificationError, match="write always"):
        simulate(rows, text)
    simulate(rows, text.replace("always", "always[0:1]"), view="step", period=1)
    path = tmp_path_factory.mktemp("logs") / "log.csv"
    path.write_text("time,brake,speed\n0,0,20\n1,0,40\n")
    assert main(["monitor", text, str(path)]) == 2
    assert "hint: write always(brake == 0 implies speed < 30)" in capsys.readouterr().err
    assert main(["monitor", "always(brake == 0 implies speed < 30)", str(path)]) == 1
