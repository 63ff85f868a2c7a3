"""The experiments on learning train, judge and tell, with a budget that teaches nothing."""

import csv
import dataclasses
from pathlib import Path

import pytest
from experiments import script

RUNS = [
    ("train_corridor", ["progress-state", "dqn-progress-state", "progress-lstm"], 1024),
    ("train_speed_limit", ["naive", "terminate"], 2048),
    ("train_patrol", ["step-obligations", "penalty-obligations"], 2048),
]


@pytest.mark.parametrize(("name", "variants", "steps"), RUNS)
def test_an_experiment_runs_and_gives_the_same_rows_again(
    name: str, variants: list[str], steps: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = dataclasses.replace(script(name).TASK, points=1, episodes=2)
    files = [tmp_path / "first.csv", tmp_path / "second.csv"]
    for file in files:
        options = ["--seeds", "1", "--steps", str(steps), "--output", str(file)]
        script("training").main(task, "About.", [*options, "--variants", *variants])
    first, second = (
        [
            {field: text for field, text in row.items() if field != "seconds"}
            for row in csv.DictReader(file.read_text(encoding="utf-8").splitlines())
        ]
        for file in files
    )
    assert first == second
    assert [row["variant"] for row in first] == variants
    assert {row["steps"] for row in first} == {str(steps)}
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
