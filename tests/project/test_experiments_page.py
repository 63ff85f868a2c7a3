"""The page on the experiments equals the files of results."""

import csv
import re

import numpy as np
import pytest
from experiments import SCRIPTS, script
from paths import EXAMPLES, ROOT

PAGE = (ROOT / "docs" / "experiments.md").read_text(encoding="utf-8")

FIRST_SEEDS = {"corridor": 40_000, "patrol": 41_000, "speed_limit": 42_000}
"""Names of the study, as the page uses them before its tables."""


def tables(head: str = "variant") -> list[list[list[str]]]:
    """Return the cells of the rows of each table of the page, without the line below the header."""
    found = re.findall(rf"^\| {head} .*\n(?:\|.*\n)+", PAGE, re.MULTILINE)
    rows = [[line.strip("|").split("|") for line in text.splitlines()] for text in found]
    return [[[cell.strip() for cell in row] for row in [table[0], *table[2:]]] for table in rows]


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(("at", "name"), list(enumerate(SCRIPTS)))
def test_a_table_of_the_page_is_what_the_file_of_results_says(at: int, name: str) -> None:
    module, training = script(name), script("training")
    path = EXAMPLES / "results" / f"{module.TASK.name}.csv"
    table = [[cell.replace("**", "") for cell in row] for row in tables()[at]]
    assert table == training.table(module.TASK, training.read_curves(path))
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    last = [row for row in rows if int(row["steps"]) == module.TASK.steps]
    assert len(last) == sum(int(row[1]) for row in table[1:])
    for variant, seeds, satisfied, *_ in table[1:]:
        runs = [row for row in last if row["variant"] == variant]
        assert len(runs) == len({row["seed"] for row in runs}) == int(seeds)
        assert min(int(row["seed"]) for row in runs) == module.TASK.first_seed
        assert all(int(row["episodes"]) == module.TASK.episodes for row in runs)
        mean, *interval = map(float, re.findall(r"-?\d+", satisfied))
        rates = [100 * int(row["satisfied"]) / int(row["episodes"]) for row in runs]
        assert mean == float(f"{np.mean(rates):.0f}")
        assert len(interval) == (2 if len(runs) > 1 else 0)
        low, high = interval or (mean, mean)
        assert min(rates) - 0.5 <= low <= mean <= high <= max(rates) + 0.5


def test_the_page_shows_the_pictures_and_says_how_much_was_trained() -> None:
    for name in SCRIPTS:
        task = script(name).TASK
        assert f"](examples/learning_{task.name}.png)" in PAGE
        assert f"python examples/{name}.py" in PAGE
        assert f"{task.steps:,} steps" in PAGE


def test_the_first_table_repeats_those_of_the_study() -> None:
    named = re.findall(r"^<!-- study (\w+) -->", PAGE, re.MULTILINE)
    found = {
        name: {row[0]: dict(zip(table[0], row, strict=True)) for row in table[1:]}
        for name, table in zip(named, tables("method"), strict=True)
    }
    (summary,) = tables("task")
    assert [row[0] for row in summary[1:]] == named
    for name, _, *ours, plain, naive, control in summary[1:]:
        of = found[name]
        assert ours == [of["ours"][key] for key in ("runs", "mean %", "minimum", "below 80 %")]
        for shown, method in ((plain, "plain"), (naive, "naive"), (control, "control")):
            row = of.get(method)
            assert shown == (f"{row['mean %'].split()[0]} ({row['runs']})" if row else "no run")


@pytest.mark.slow
def test_the_tables_of_the_study_are_what_its_rows_say() -> None:
    study = script("study")
    rows = study.rows_of(EXAMPLES / "results" / "study.jsonl")
    named = re.findall(r"^<!-- study (\w+) -->", PAGE, re.MULTILINE)
    assert set(named) == {row["task"] for row in rows} == set(FIRST_SEEDS)
    for name, table in zip(named, tables("method"), strict=True):
        assert table == study.table(rows, name)
        task = study.TASKS[name]
        for method, runs, mean, minimum, _, below, last, stopped, *_ in table[1:]:
            of = [row for row in rows if (row["task"], row["method"]) == (name, method)]
            ends = [100 * row["satisfied"] / row["episodes"] for row in of]
            assert {row["episodes"] for row in of} == {100}
            # Fixed before the first run: no seed between is omitted.
            first = FIRST_SEEDS[name]
            assert sorted(row["seed"] for row in of) == list(range(first, first + int(runs)))
            assert task.first_seed == first
            assert mean.split(" [")[0] == f"{np.mean(ends):.1f}"
            assert ("[" in mean) == (len(of) > 1)
            assert float(minimum) == min(ends)
            assert below == f"{sum(end < 80 for end in ends)} of {runs}"
            assert last == f"{np.mean([row['last'] for row in of]):.1f}"
            assert stopped == f"{sum(row['stopped'] for row in of)} of {runs}"
            for row in of:  # a run that was not stopped was trained to the end
                assert row["stopped"] or row["steps"][-1] >= task.steps
                assert not (row["stopped"] and method in study.UNSTOPPED)
                assert len(row["chosen_by"]) == len(row["steps"])
    for task in study.TASKS.values():
        assert f"{task.steps:,} steps" in PAGE


def test_what_the_page_says_of_trials_is_what_their_rows_say() -> None:
    trials = script("study").rows_of(EXAMPLES / "results" / "study_trials.jsonl")
    ours = [row for row in trials if row["method"] == "ours"]
    assert all(1000 <= row["seed"] < 2000 for row in trials)
    assert min(row["satisfied"] for row in ours) == 99
    assert f"have {len(ours)} runs, all with 99 % or more" in PAGE
