"""Sorted Parquet files are read in parts, with the outcomes of files that are read whole."""

import contextlib
import io
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from object_tables import HABITS, OPTIONS, SPECS, group
from profiles import examples

from rtamt_gym.__main__ import main
from rtamt_gym.recorded import groups as tables

Output = pytest.CaptureFixture[str]


def result(arguments: Sequence[str]) -> tuple[int, dict[str, Any], str]:
    """Return the exit code, the JSON without the option itself, and the errors of a command."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["monitor", "--json", *arguments])
    stored = json.loads(out.getvalue() or "{}")
    if stored:
        stored["reading"]["columns"].pop("sorted", None)
    return code, stored, err.getvalue()


@settings(max_examples=examples(30))
@given(
    st.lists(st.sampled_from(sorted({*HABITS} - {"nan time"})), min_size=2, max_size=9),
    st.sets(st.sampled_from(SPECS[:6]), min_size=1, max_size=2),
    st.sampled_from(OPTIONS),
    st.sampled_from((("car",), ("car", "kind"))),
    st.sampled_from(([], ["--where", "kind=a"], ["--where", "x=1"], ["--where", "car=1"])),
    st.integers(1, 30),
    st.integers(1, 40),
    st.randoms(use_true_random=False),
)
def test_parts_equal_the_table_in_memory(
    tmp_path_factory: pytest.TempPathFactory,
    habits: list[str],
    specs: set[str],
    options: Sequence[str],
    by: Sequence[str],
    where: Sequence[str],
    rows_of_part: int,
    rows_of_group: int,
    random: Random,
) -> None:
    rows = [row for key, habit in enumerate(habits) for row in group(random, key, habit)]
    file = tmp_path_factory.mktemp("table") / "cars.parquet"
    table = pa.Table.from_pandas(pd.DataFrame(rows), preserve_index=False)
    pq.write_table(table, file, row_group_size=rows_of_group)
    keys = [word for name in by for word in ("--by", name)]
    arguments = [*sorted(specs), *options, *keys, *where, "--", str(file)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "PART_ROWS", rows_of_part)
        parts = result(["--sorted", *arguments])
    assert parts == result(arguments)


def test_a_group_that_comes_back_is_an_error(tmp_path: Path, capsys: Output) -> None:
    file = tmp_path / "cars.parquet"
    frame = pd.DataFrame({"car": [7, 7, 8, 8, 7], "time": [0.0, 1, 0, 1, 2], "x": [1.0] * 5})
    frame.to_parquet(file)
    words = ["monitor", "always(x > 0)", str(file), "--by", "car"]
    assert main([*words, "--sorted"]) == 2
    assert (
        f"{file}, row 5: expected the rows of car=7 to follow each other, as --sorted states, got "
        "one after other groups. Sort the file by car, or leave --sorted out"
    ) in capsys.readouterr().err
    assert main(words) == 0


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["cars.csv", "--by", "car", "--sorted"], "expected a Parquet file for --sorted, got CSV"),
        (["cars.parquet", "--sorted"], "expected --by COLUMN with --sorted, got none"),
        (["cars.parquet", "--by", "cat", "--sorted"], "cars.parquet: No column 'cat'"),
        (["cars.parquet", "--by", "kind", "--sorted"], "row 2, column 'kind': expected a value"),
        (["cars.parquet[car=9]", "--by", "car", "--sorted"], "no row with 9 in car"),
    ],
)
def test_sorted_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output, words: list[str], text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    frame = pd.DataFrame({"car": [7, 7], "kind": ["a", None], "time": [0.0, 1], "x": [1.0, 2]})
    frame.to_parquet("cars.parquet")
    frame.to_csv("cars.csv", index=False)
    assert main(["monitor", "always(x > 0)", *words]) == 2
    assert text in capsys.readouterr().err


PEAK = """
import sys, tracemalloc
import pyarrow as pa
from rtamt_gym.__main__ import main
from rtamt_gym.recorded import groups as tables
tables.PART_ROWS = 10_000
import rtamt_gym.commands.judging, rtamt_gym.recorded.arrow_reader, rtamt_gym.commands.group_judging
tracemalloc.start()
specs = ["always(x < 9)", "always(y > 0.99 implies eventually[0:1](x > 0))"]
code = main(["monitor", *specs, *sys.argv[1:]])
print(code, tracemalloc.get_traced_memory()[1] + pa.default_memory_pool().max_memory())
"""
"""Prints the exit code, and the most memory of NumPy and Arrow in bytes."""


def test_parts_need_the_memory_of_a_part(tmp_path: Path) -> None:
    rows, groups = 2_000, 500
    rng = np.random.default_rng(0)
    file = tmp_path / "cars.parquet"
    table = pa.table(
        {
            "car": np.repeat(np.arange(groups), rows),
            "time": np.tile(np.arange(rows) / 10, groups),
            "x": rng.normal(size=rows * groups),
            "y": rng.random(rows * groups),
        }
    )
    pq.write_table(table, file, row_group_size=4_000)
    peaks = {}
    for option in ("--sorted", "--one-trace"):  # the second changes nothing here
        done = subprocess.run(
            [sys.executable, "-c", PEAK, "--by", "car", option, "--", str(file)],
            capture_output=True,
            text=True,
            check=True,
        )
        *lines, last = done.stdout.splitlines()
        code, peaks[option] = map(int, last.split())
        assert code in (0, 1, 3)
        assert any(line.startswith(f"{groups} traces") for line in lines)
    whole = 3 * 8 * rows * groups  # the times and two variables
    assert peaks["--one-trace"] > whole
    assert peaks["--sorted"] < whole / 2
