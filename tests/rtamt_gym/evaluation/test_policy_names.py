"""Names of policies: all texts and files distinguish two models of one class."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtamt import InputError
from rtamt_gym import compare, evaluate_policy
from rtamt_gym.__main__ import main
from rtamt_gym.results import Comparison, Evaluation
from rtamt_gym.results.provenance import file_hash

Output = pytest.CaptureFixture[str]

SIGNALS = {"angle": "obs[2]"}
SPEC = "upright = always(abs(angle) < 0.1)"


class PPO:
    """A model as in libraries: only its class has a name."""

    def __init__(self, action: int) -> None:
        self.action = action

    def predict(self, obs: Any, state: Any, *_: Any, deterministic: bool) -> tuple[Any, Any]:  # noqa: ANN401 - as of the library
        del deterministic
        if np.ndim(obs) == 1:
            return self.action, state
        return np.full(len(obs), self.action), state


def evaluated(action: int, name: str | None = None) -> Evaluation:
    return evaluate_policy(PPO(action), "CartPole-v1", SPEC, SIGNALS, episodes=2, name=name)


def test_a_name_is_in_table_file_and_comparison(tmp_path: Path) -> None:
    before = evaluated(0, "before")
    assert before.policy == "before"
    assert str(before).startswith("CartPole-v1 under before\n")
    before.save(tmp_path / "before.json")
    assert Evaluation.load(tmp_path / "before.json").policy == "before"
    found = compare(before, evaluated(1, "after"))
    assert (found.a, found.b) == ("before", "after")


def test_two_models_of_one_class_are_told_apart() -> None:
    found = compare(PPO(0), PPO(1), "CartPole-v1", SPEC, SIGNALS, episodes=2)
    assert (found.a, found.b) == ("PPO (A)", "PPO (B)")
    assert str(found).startswith("A: PPO (A)\nB: PPO (B)\n")
    for pair in ((evaluated(0), evaluated(1)), (evaluated(0, "old"), evaluated(1, "new"))):
        named = compare(*pair, names=("before", "after"))
        assert (named.a, named.b) == ("before", "after")


@pytest.mark.parametrize("names", [("a",), ("a", "a"), ("a", ""), ("a", 3), "ab", ("a", None)])
def test_names_are_two_different_texts(names: Any) -> None:  # noqa: ANN401
    with pytest.raises(InputError, match="expected"):
        compare(evaluated(0), evaluated(1), names=names)


@pytest.mark.parametrize("name", ["", "  ", "two\nlines", 3])
def test_a_name_is_a_text_in_one_line(name: Any) -> None:  # noqa: ANN401
    with pytest.raises(InputError, match=r"expected name= as a text in one line, such as 'before'"):
        evaluate_policy("zero", "CartPole-v1", SPEC, SIGNALS, episodes=1, name=name)


def test_the_command_line_names_a_policy_and_files_tell_others_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("req.stl").write_text(SPEC, encoding="utf-8")
    for name in ("old.json", "new.json", "named.json"):
        own = ["--name", "mine"] if name == "named.json" else []
        spec = ["--spec", "req.stl", "--signal", "angle=obs[2]"]
        play = ["CartPole-v1", "--policy", "zero", *spec, "--episodes", "2", *own, "--save", name]
        assert main(["evaluate", *play]) == 0
    capsys.readouterr()
    assert main(["compare", "old.json", "new.json", "--save", "c.json"]) == 0
    assert capsys.readouterr().out.startswith("A: zero (old.json)\nB: zero (new.json)\n")
    found = Comparison.load("c.json")
    assert (found.a, found.b) == ("zero (old.json)", "zero (new.json)")
    assert main(["compare", "old.json", "named.json"]) == 0
    assert capsys.readouterr().out.startswith("A: zero\nB: mine\n")
    files = Evaluation.load("old.json").record.provenance.files
    assert files == {"req.stl": file_hash("req.stl")}
    assert main(["report", "before=old.json", "after=new.json", "-o", "r.html"]) == 0
    page = Path("r.html").read_text(encoding="utf-8")
    for title in ("before: zero on CartPole-v1", "after: zero on CartPole-v1"):
        assert title in page
    capsys.readouterr()
    assert main(["report", "a=old.json", "a=new.json", "-o", "r.html"]) == 2
    assert "expected different names of results, got a, a" in capsys.readouterr().err
