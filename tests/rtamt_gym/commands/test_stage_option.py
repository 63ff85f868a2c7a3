"""`rtamt monitor --stage`: the progress of recorded traces in named stages."""

import json
from pathlib import Path

import pytest

from rtamt_gym.__main__ import main

GOAL = "task = eventually always[0:1](up > 0.1)"
STAGES = ["--stage", "near > 0", "--stage", "up > 0.1"]


@pytest.fixture
def trace(tmp_path: Path) -> str:
    path = tmp_path / "run.csv"
    rows = ["near,up", "-4,0", "1,-0.1", "1,0.05", "1,0"]
    path.write_text("\n".join(rows), encoding="utf-8")
    return str(path)


def says(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    main(["monitor", *arguments])
    return capsys.readouterr().out


def test_the_progress_in_named_stages_is_said(
    trace: str, capsys: pytest.CaptureFixture[str]
) -> None:
    goal = GOAL.replace("always[0:1](up > 0.1)", "always[0:1](up > 0.1 and near > 0)")
    out = says([goal, trace, *STAGES], capsys)
    assert "VIOLATED, robustness -0.1, at the end of the trace, progress 0.87" in out
    assert "progress 0" not in says([goal, trace], capsys)
    data = json.loads(says([goal, trace, *STAGES, "--json"], capsys))
    assert data["trials"][0]["outcomes"]["task"]["progress"] == pytest.approx(0.875)
    assert data["reading"]["stages"] == {"task": ["near > 0", "up > 0.1"]}


def test_stages_are_of_the_requirement_that_they_name(
    trace: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "task = eventually(near > 0 and up > 1); calm = always(up < 9)"
    stages = ["--stage", "task: near > 0", "--stage", "task: up > 1"]
    data = json.loads(says([text, trace, *stages, "--json"], capsys))
    outcomes = data["trials"][0]["outcomes"]
    assert 0.5 < outcomes["task"]["progress"] < 1
    assert "progress" not in outcomes["calm"]


@pytest.mark.parametrize(
    ("spec", "stages", "said"),
    [
        (GOAL, ["up > 0"], "expected two or more --stage, got 1"),
        (
            GOAL,
            ["up > 0", "near > 0"],
            "in the stages of 'task': stage 2, near > 0, reads near, which the",
        ),
        (GOAL, ["up > 0", "up >"], "in stage 2: in the stages of 'task': "),
        (
            f"{GOAL}; calm = always(up < 9)",
            ["up > 0", "up > 1"],
            "as in 'task: up > 0', for there are several: 'task', 'calm'",
        ),
        (
            f"{GOAL}; calm = always(up < 9)",
            ["tsk: up > 0", "tsk: up > 1"],
            "a requirement, 'task', 'calm', got 'tsk'; did you mean 'task'?",
        ),
    ],
)
def test_bad_stages_exit_with_2(
    spec: str, stages: list[str], said: str, trace: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [word for stage in stages for word in ("--stage", stage)]
    assert main(["monitor", spec, trace, *options]) == 2
    assert said in " ".join(capsys.readouterr().err.split())


def test_instants_and_intervals_are_refused_where_they_mean_nothing(
    tmp_path: Path, trace: str, capsys: pytest.CaptureFixture[str]
) -> None:
    stages = ["--stage", "up > 0", "--stage", "always[0:2](up > 0.1)"]
    assert main(["monitor", "up > 0", trace, "--view", "step", *stages]) == 2
    assert "--view step judges every instant by itself" in capsys.readouterr().err
    events = tmp_path / "events.csv"
    events.write_text("time,up\n0,-1\n0.5,1\n3,1\n", encoding="utf-8")
    goal = "eventually always[0:1](up > 0.1)"
    assert main(["monitor", goal, str(events), "--dense", *stages]) == 2
    assert "in dense time a stage is reached at an event" in " ".join(
        capsys.readouterr().err.split()
    )
    plain = ["--stage", "up > 0", "--stage", "up > 4"]
    assert main(["monitor", "eventually always[0:1](up > 4)", str(events), "--dense", *plain]) == 1
    assert "progress 0.50" in capsys.readouterr().out
