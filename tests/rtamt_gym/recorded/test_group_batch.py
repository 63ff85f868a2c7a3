"""Groups of a table judged together have the outcomes of groups judged one by one."""

import contextlib
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from object_tables import HABITS, OPTIONS, SPECS, group
from profiles import examples

from rtamt_gym.__main__ import main
from rtamt_gym.commands import group_judging
from rtamt_gym.commands.group_judging import judged_groups
from rtamt_gym.commands.judged import Judged
from rtamt_gym.commands.traces import TracesAsked


def table(random: Random, habits: Sequence[str]) -> pd.DataFrame:
    """Return a table of objects, whose rows are next to each other or mixed."""
    groups = [group(random, key, habit) for key, habit in enumerate(habits)]
    if random.random() < 0.5:
        return pd.DataFrame([row for rows in groups for row in rows])
    rows = []
    while any(groups):
        rows.append(random.choice([part for part in groups if part]).pop(0))
    return pd.DataFrame(rows)


def result(arguments: Sequence[str]) -> tuple[int, str, str]:
    """Return the exit code, the output and the errors of a command."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["monitor", *arguments])
    return code, out.getvalue(), err.getvalue()


def none_together(_asked: TracesAsked, _paths: Sequence[str]) -> Iterator[tuple[int, Judged]]:
    """Judge no groups together."""
    return iter(())


@settings(max_examples=examples(40))
@given(
    st.lists(st.sampled_from(HABITS), min_size=2, max_size=7),
    st.sets(st.sampled_from(SPECS), min_size=1, max_size=3),
    st.sampled_from(OPTIONS),
    st.sampled_from((".parquet", ".csv", ".feather")),
    st.sampled_from((("car",), ("car", "kind"), ("kind", "car"))),
    st.sampled_from(("all", "few", "no times", "dates", "integers")),
    st.randoms(use_true_random=False),
)
def test_outcomes_equal_single_groups(
    tmp_path_factory: pytest.TempPathFactory,
    habits: list[str],
    specs: set[str],
    options: Sequence[str],
    end: str,
    by: Sequence[str],
    columns: str,
    random: Random,
) -> None:
    frame = table(random, habits)
    if columns in ("few", "no times"):
        frame = frame[["car", "kind", "time", "x", "a", "b"]]
    if columns == "no times":
        frame = frame.drop(columns="time")
    elif columns == "dates" and frame["time"].notna().all():
        frame["time"] = pd.to_datetime(frame["time"], unit="s")
    elif columns == "integers" and frame["time"].notna().all():
        frame = frame.rename(columns={"time": "time_ms"})
        frame["time_ms"] = (1000 * frame["time_ms"]).round().astype("int64")
    folder = tmp_path_factory.mktemp("table")
    file, junit = folder / f"cars{end}", folder / "cars.xml"
    ranged = folder / "ranged.stl"
    ranged.write_text("input float x in [-4, 4]\nranged = always(x + a > -8)\n")
    texts = [str(ranged) if spec == ranged.name else spec for spec in sorted(specs)]
    {
        ".parquet": frame.to_parquet,
        ".feather": frame.to_feather,
        ".csv": lambda path: frame.to_csv(path, index=False),
    }[end](file)
    where = random.choice([[], [], ["--where", "kind=a"], ["--where", "x=1"]])
    keys = [word for name in by for word in ("--by", name)]
    arguments = [*texts, *options, *keys, *where, "--", str(file)]
    for form in (["--json"], ["--junit", str(junit)]):
        results = []
        for judge in (group_judging.judged_groups, none_together):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(group_judging, "judged_groups", judge)
                printed = result([*form, *arguments])
            results.append((printed, junit.read_bytes() if junit.exists() else b""))
        assert results[0] == results[1]


def test_plain_groups_are_judged_together(tmp_path: Path) -> None:
    """Only groups with a peculiarity are read by themselves, and one bad row costs no more."""
    random = Random(3)
    habits = ["plain", "empty", "one", "plain", "falling", "constant", "objects", "jitter", "two"]
    rows = [row for key, habit in enumerate(habits) for row in group(random, key, habit)]
    file = tmp_path / "cars.parquet"
    pd.DataFrame(rows).to_parquet(file)
    together: list[int] = []

    def recorded(asked: TracesAsked, paths: Sequence[str]) -> Iterator[tuple[int, Judged]]:
        for number, judged in judged_groups(asked, paths):
            together.append(number)
            yield number, judged

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(group_judging, "judged_groups", recorded)
        code, _, _ = result([*SPECS[:2], "--by", "car", "--", str(file)])
    assert code == 2
    assert sorted(together) == [0, 2, 3, 5, 7, 8]
